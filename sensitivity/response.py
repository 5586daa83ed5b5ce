"""A run's answer as a pure function of a vector of parameters: the one thing that every study here differentiates.

Beside the numbers of the model, the inputs of the run are parameters too, under their own names: the ambient temperature by a shift in K,
every other input by a factor.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.errors import ParameterError, nearest
from jaxmodel.model import Model, initial_state, read
from jaxmodel.names import parameter_table, value, with_values
from jaxmodel.parameters import ParameterInfo, Scalar
from jaxmodel.profile import Profile
from jaxmodel.simulate import Cutoff, Track, Trajectory, run_track, track
from sensitivity.influence import influential
from sensitivity.metrics import Log, Metric, choose_metrics

SHIFTED_INPUT = "ambient_degC"


class Answer(eqx.Module):
    """What a study asks of a run: single numbers, and readings over time."""

    metrics: Float[Array, "... metric"]
    outputs: Float[Array, "... output rows"]


class Response(eqx.Module):
    """The answer of a model to a profile, as a function of the parameters called `names`.

    The steps of integration are those of the model as it is given: they do not move with the parameters, so that a
    difference between two answers is due to the parameters alone.
    """

    model: Model
    course: Track
    time_s: Float[Array, " rows"]
    cutoff: Cutoff | None
    names: tuple[str, ...] = eqx.field(static=True)
    metrics: tuple[Metric, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, values: Float[Array, " parameter"]) -> Answer:
        """Return the answer at parameter values in the units of the table."""
        return self.run(self.named(values))[0]

    def named(self, values: Float[Array, " parameter"]) -> dict[str, Scalar]:
        """Return parameter values by name."""
        return dict(zip(self.names, values, strict=True))

    def run(self, given: Mapping[str, Scalar]) -> tuple[Answer, Trajectory]:
        """Return the answer at parameter values by name, and the whole run behind it."""
        inputs = {name: _changed(name, column, given) for name, column in self.course.inputs.items()}
        model = with_values(self.model, {name: new for name, new in given.items() if name not in inputs})
        course = eqx.tree_at(lambda c: c.inputs, self.course, inputs)
        trajectory = run_track(model, course, self.time_s, self.cutoff)

        at_rows = jnp.concatenate([jnp.zeros(1, dtype=course.last_step.dtype), course.last_step + 1])
        columns = {name: column[at_rows] for name, column in inputs.items()} | trajectory.readings
        log = Log(self.time_s, columns, trajectory.end_row, model.parameters)
        numbers = [metric(model.kind, log) for metric in self.metrics]
        readings = [trajectory.readings[name] for name in self.outputs]
        answer = Answer(
            metrics=jnp.stack(numbers) if numbers else jnp.zeros(0),
            outputs=jnp.stack(readings) if readings else jnp.zeros((0, self.time_s.size)),
        )
        return answer, trajectory

    def values(self) -> Float[Array, " parameter"]:
        """Return the parameters' values as the model and the profile have them; of an input, shift 0 or factor 1."""
        neutral = {name: 0.0 if name == SHIFTED_INPUT else 1.0 for name in self.course.inputs}
        return jnp.asarray([neutral[n] if n in neutral else value(self.model, n) for n in self.names], dtype=float)

    def table(self) -> list[ParameterInfo]:
        """Return what is known of each parameter."""
        known = parameter_table(self.model) | input_table(self.course)
        return [known[name] for name in self.names]


def _changed(name: str, column: Array, given: Mapping[str, Scalar]) -> Array:
    if name not in given:
        return column
    return column + given[name] if name == SHIFTED_INPUT else column * given[name]


def input_table(course: Track) -> dict[str, ParameterInfo]:
    """Return the inputs of a run as parameters: by name, a shift in K of the ambient, a factor on any other."""
    table = {}
    for name, column in course.inputs.items():
        if name == SHIFTED_INPUT:
            table[name] = ParameterInfo(name, unit="K", meaning="shift of the ambient temperature", default=0.0)
        else:
            largest = float(np.max(np.abs(np.asarray(column))))
            upper = 1.0 / largest if name.endswith("duty") and largest > 0.0 else math.inf
            table[name] = ParameterInfo(name, unit="", meaning=f"factor on the input {name}", default=1.0, upper=upper)
    return table


def make_response(
    model: Model,
    profile: Profile,
    names: Iterable[str] | None = None,
    metrics: Iterable[str | Metric] | None = None,
    outputs: Iterable[str] | None = None,
    cutoff: Cutoff | None = None,
) -> Response:
    """Return the response of a model to a profile.

    Args:
        model: any kind; its leaves are scalars.
        profile: inputs over time.
        names: parameters of the model, of its effects ("effect.parameter") and inputs of the profile; None takes all that
            enter the answer.
        metrics: names of `sensitivity.metrics`, or metrics of one's own; None takes all that the run has.
        outputs: readings whose course is asked for; None takes all, () none.
        cutoff: where the run ends, if before the end of the profile.

    Raises:
        ParameterError: a parameter, metric or output is unknown; the message gives the nearest name.
    """
    course = track(model, profile)
    readings = _reading_names(model, course)
    columns = (*readings, *course.inputs)
    if outputs is None:
        chosen_outputs = readings
    else:
        chosen_outputs = tuple(outputs)
        _check(chosen_outputs, readings, "outputs", "output")
    known = (*parameter_table(model), *course.inputs)
    response = Response(
        model=model,
        course=course,
        time_s=jnp.asarray(profile.time_s),
        cutoff=cutoff,
        names=known if names is None else tuple(names),
        metrics=choose_metrics(metrics, model.kind, columns),
        outputs=chosen_outputs,
    )
    if names is None:
        enters = influential(lambda given: response.run(given)[0], response.named(response.values()))
        return dataclasses.replace(response, names=tuple(name for name in known if name in enters))
    _check(response.names, known, "names", "parameter or input")
    return response


def _reading_names(model: Model, course: Track) -> tuple[str, ...]:
    first = {name: column[0] for name, column in course.inputs.items()}
    return tuple(jax.eval_shape(lambda m, u: read(m, initial_state(m, u), u), model, first))


def _check(wanted: Sequence[str], known: Sequence[str], argument: str, what: str) -> None:
    for name in wanted:
        if name not in known:
            raise ParameterError(
                f"{argument}: this run has no {what} '{name}'.{nearest(name, known)} It has {', '.join(known)}."
            )


@dataclasses.dataclass(frozen=True)
class Steps:
    """By how much each parameter is moved when changes are compared.

    Attributes:
        size: in the parameter's unit: its value, so that the step is a doubling, or where that means nothing a stated step.
        doubles: True where the step is the parameter's value.
        in_bounds: True where value + step is a value that the parameter may have.
    """

    size: np.ndarray
    doubles: np.ndarray
    in_bounds: np.ndarray


def steps(response: Response) -> Steps:
    """Return the step of each parameter of a response.

    A proportional change means nothing for a temperature in degC, whose zero is arbitrary, and for a parameter that is zero (or infinite:
    an effect at its null). Their steps are 1 K; else the table's default, for an effect a middling value; else, where that is zero too,
    a hundredth of the parameter's range.
    """
    values = np.asarray(response.values())
    table = response.table()
    doubles = np.array(
        [v != 0.0 and math.isfinite(v) and info.unit != "degC" for v, info in zip(values, table, strict=True)], dtype=bool
    )
    stated = np.array([_stated_step(info) for info in table])
    size = np.where(doubles, values, stated)
    lower, upper = np.array([(info.lower, info.upper) for info in table]).reshape(-1, 2).T
    moved = values + size
    return Steps(size, doubles, (moved >= lower) & (moved <= upper))


def _stated_step(info: ParameterInfo) -> float:
    if info.unit == "degC" or info.name == SHIFTED_INPUT:
        return 1.0
    if info.default != 0.0:
        return info.default
    width = info.upper - info.lower
    return 0.01 * width if math.isfinite(width) else 1.0
