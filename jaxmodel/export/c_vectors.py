"""Test vectors of a file of C: steps of the model as JAX computes them, and a program that compares the two."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.export.wording import identifier
from jaxmodel.lanes.c_emitter import broken, literal
from jaxmodel.model.electrothermal import Model, read, step
from jaxmodel.model.flow import REST, State
from jaxmodel.model.profile import Profile
from jaxmodel.model.robot import Inputs
from jaxmodel.model.simulation import simulate

# A result of the file may differ from ours by this share of the largest of its kind. In float32 another order of the
# same operations may lose some times what ours loses.
_FLOAT64, _FLOAT32, _TIMES_OF_FLOAT32 = 1e-12, 2e-5, 4.0
_STEPS = 24
_MOST_ROWS = 5000  # of the run that steps are taken from

_TEST = """/* Compiled with -D{upper}_TEST, the file is a program that compares it with jaxmodel: it returns 0 if
 * each result is within {tolerance:g} of the largest of its kind. Each row is a call: what is given, what is found. */
#ifdef {upper}_TEST
#include <stdio.h>
#include <string.h>

{parts}
int main(void)
{{
    double worst = 0.0;
{worst}
    printf("{counts}, largest error %.3g, allowed %.3g\\n", worst, {tolerance:g});
    return worst <= {tolerance:g} ? 0 : 1;
}}
#endif
"""
_PART = """static const double {what}[{count}][{width}] = {{
{rows}
}};
static const double largest_of_{what}[{results}] = {{{largest}}};

static double error_of_{what}(void)
{{
    double worst = 0.0;
    for (int32_t row = 0; row < {count}; row++) {{
        {real} found[{results}];
{declared}
{load}
{calls}
{gather}
        for (int32_t k = 0; k < {results}; k++) {{
            const double error = fabs((double)found[k] - {what}[row][{given} + k]) / largest_of_{what}[k];
            if (!(error <= worst)) {{ worst = isnan(error) ? INFINITY : error; }}
        }}
    }}
    return worst;
}}
"""


@dataclasses.dataclass(frozen=True, eq=False)
class Steps:
    """Numbers of steps: (steps, numbers) that are given, and that are found."""

    given: np.ndarray
    found: np.ndarray

    @property
    def size(self) -> np.ndarray:
        """Return the largest of each number that is found, 1 where all are zero."""
        size = np.abs(self.found).max(axis=0, initial=0.0)
        return np.where(size > 0.0, size, 1.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Vectors(Steps):
    """Steps of a model.

    Attributes:
        states: names of the states, in the order of the numbers; also `inputs` and `readings`.
        given: (steps, numbers) states, inputs, and duration in s.
        found: (steps, numbers) states after it, and readings there.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    readings: tuple[str, ...]


def steps(model: Model, of_run: Model, profile: Profile) -> Vectors:
    """Return steps that are spread over a run, in float64.

    Args:
        model: whose steps they are.
        of_run: the model with the start of the run, whose states the steps begin at.
        profile: of the run.
    """
    rows = min(profile.time_s.size, _MOST_ROWS)
    short = Profile(profile.time_s[:rows], {key: values[:rows] for key, values in profile.inputs.items()})
    states = simulate(of_run, short).states
    begin = np.unique(np.linspace(0, rows - 2, _STEPS).round().astype(int))
    before = {key: jnp.asarray(states[key])[begin] for key in sorted(states)}
    inputs = {key: jnp.asarray(short.inputs[key])[begin + 1] for key in sorted(short.inputs)}
    duration = jnp.diff(jnp.asarray(short.time_s))[begin]
    after, readings = _stepped(model, before, inputs, duration)
    given = np.stack([*before.values(), *inputs.values(), duration], axis=1)
    names = tuple(sorted(before)), tuple(sorted(inputs)), tuple(sorted(readings))
    found = np.stack([*(after[key] for key in names[0]), *(readings[key] for key in names[2])], axis=1)
    usable = np.isfinite(found).all(axis=1)
    return Vectors(given[usable], found[usable], *names)


@jax.jit
def _stepped(model: Model, before: State, inputs: dict[str, Array], duration: Array) -> tuple[State, Any]:
    def one(state: State, given: Inputs, seconds: Any) -> tuple[State, Any]:
        after = step(model, state, given, seconds)
        return after, read(model, after, given)

    return jax.vmap(one)(before, inputs, duration)


def error_of_float32(model: Model, start: State, vectors: Vectors) -> float:
    """Return by how much steps of a model in float32 differ from those in float64, as a share of the largest.

    Args:
        model: in float32.
        start: a state in float32, with the rests of its sums.
        vectors: the steps in float64.
    """
    columns = [jnp.asarray(column, dtype=np.float32) for column in vectors.given.T]
    before = dict(zip(vectors.states, columns, strict=False))
    before |= {key: jnp.zeros_like(columns[0]) for key in start if key.endswith(REST)}
    inputs = dict(zip(vectors.inputs, columns[len(vectors.states) :], strict=False))
    after, readings = _stepped(model, before, inputs, columns[-1])
    found = [*(after[key] for key in vectors.states), *(readings[key] for key in vectors.readings)]
    return float(np.max(np.abs(np.stack(found, axis=1).astype(float) - vectors.found) / vectors.size, initial=0.0))


def tolerance(error_of_float32: float) -> float:
    """Return the allowed error as a share of the largest number; `error_of_float32` is 0 for a file in float64."""
    return max(_FLOAT32, _TIMES_OF_FLOAT32 * error_of_float32) if error_of_float32 else _FLOAT64


def program(name: str, real: str, vectors: Vectors, tolerance: float) -> str:
    """Return the text of a program that compares a file with steps.

    Args:
        name: that the functions of the file begin with.
        real: the type of its numbers.
        vectors: the steps.
        tolerance: the largest error, as a share of the largest number of its kind.
    """
    states = tuple(f"state.{identifier(key)}" for key in vectors.states)
    part = Part(
        "steps",
        (
            f"{name}_state state;",
            f"{name}_inputs inputs;",
            f"{name}_readings readings;",
            f"{real} duration_s;",
            "memset(&state, 0, sizeof state);",
        ),
        (*states, *(f"inputs.{identifier(key)}" for key in vectors.inputs), "duration_s"),
        (f"{name}_step(&inputs, duration_s, &state);", f"{name}_read(&inputs, &state, &readings);"),
        (*states, *(f"readings.{identifier(key)}" for key in vectors.readings)),
        vectors,
    )
    return comparison(name, real, [part], tolerance)


@dataclasses.dataclass(frozen=True, eq=False)
class Part:
    """Calls of a file that are compared.

    Attributes:
        what: the calls are, as "steps".
        declared: declarations of the variables of a call.
        targets: where each number that is given goes.
        calls: of the functions.
        sources: where each number that is found is.
        steps: the numbers.
    """

    what: str
    declared: Sequence[str]
    targets: Sequence[str]
    calls: Sequence[str]
    sources: Sequence[str]
    steps: Steps


def comparison(name: str, real: str, parts: Sequence[Part], tolerance: float) -> str:
    """Return the text of a program that compares a file with numbers of ours.

    Args:
        name: that the functions of the file begin with.
        real: the type of its numbers.
        parts: what is compared.
        tolerance: the largest error, as a share of the largest number of its kind.
    """
    return _TEST.format(
        upper=name.upper(),
        tolerance=tolerance,
        parts="\n".join(_part(real, part) for part in parts),
        worst="\n".join(f"    worst = fmax(worst, error_of_{part.what}());" for part in parts),
        counts=", ".join(f"{len(part.steps.given)} {part.what}" for part in parts),
    )


def _part(real: str, part: Part) -> str:
    rows = np.concatenate([part.steps.given, part.steps.found], axis=1)
    load = [f"{target} = ({real}){part.what}[row][{k}];" for k, target in enumerate(part.targets)]
    return _PART.format(
        what=part.what,
        real=real,
        count=len(rows),
        width=rows.shape[1],
        results=len(part.sources),
        given=len(part.targets),
        largest=broken(", ".join(literal(value, np.float64) for value in part.steps.size)),
        rows="\n".join(broken("    {" + ", ".join(literal(x, np.float64) for x in row) + "},") for row in rows),
        declared=_indented(part.declared),
        load=_indented(load),
        calls=_indented(part.calls),
        gather=_indented([f"found[{k}] = {source};" for k, source in enumerate(part.sources)]),
    )


def _indented(lines: Sequence[str]) -> str:
    return "\n".join(f"        {line}" for line in lines)
