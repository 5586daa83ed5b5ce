"""The filter of a cell's state of charge as one file of C: its start and its step, with test vectors.

The step is `jaxmodel.operation.kalman.corrected_step`, Jacobians included, written from its jaxpr.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case, Run
from jaxmodel.export import c_vectors
from jaxmodel.export.c_file import CFile, Given, comment
from jaxmodel.export.c_model import PRECISIONS, constants_of
from jaxmodel.export.wording import heading, identifier, own_values_of_runs
from jaxmodel.lanes.emitter import NotNative
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.kalman import Tuning, before_first_reading, corrected_step, state_names
from jaxmodel.operation.preparation import for_estimation
from jaxmodel.operation.state_of_charge import FILTER, read_tunings

# What a step tells beside mean and covariance, of the fields of `FilterOutput`, and its place among them.
_OUTPUTS = {"soc": 0, "sd": 1, "innovation": 5, "scale": 3, "offset_V": 4, "capacity_scale": 6, "capacity_sd": 7}
_OUTPUTS |= {"current_offset_A": 8}
_STEPS, _MOST_ROWS = 12, 2000

_TEXT = """{heading}
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* The states of the filter, in this order: {states}. */
#define {upper}_STATES {size}

typedef struct {{
    {real} mean[{size}];
    {real} covariance[{square}];  /* row after row */
}} {name}_filter;

typedef struct {{
{outputs}
}} {name}_estimate;

/* Before the first reading: a state of charge as it is assumed, a current in A and a temperature in degC at that time,
 * and the sd in V of the voltages of the RC pairs, 0 after a rest. */
void {name}_filter_start({real} soc, {real} current_A, {real} degC, {real} pairs_sd_V, {name}_filter *filter);
/* After duration_s seconds (0 for the first reading) under a current in A, positive on discharge, at a temperature of
 * the cell in degC, with a voltage in V at the end; NAN where there is none. */
void {name}_filter_step({real} duration_s, {real} current_A, {real} degC, {real} voltage_V, {name}_filter *filter,
                        {name}_estimate *estimate);

{body}
{test}"""


def export_c_filter(case: Case, *, precision: str = "float64", tuning: str | Path | None = None) -> Exported:
    """Return the filter of a cell's state of charge as one file of C.

    Args:
        case: of a cell, with a run that reads the voltage.
        precision: "float64" or "float32".
        tuning: the file `tuning.json` that `jaxmodel estimate` wrote; by default the tuning of `Tuning()`.

    Raises:
        ParameterError: the case is not of a cell or reads no voltage, the precision is unknown, or the model has an
            operation that has no C.
        MeasurementError: the tuning cannot be read.
    """
    if case.kind != "cell":
        raise ParameterError(f"{case.label}: it is not of a cell, and this format is a cell's filter; give a cell.")
    if precision not in PRECISIONS:
        raise ParameterError(f"There is no precision '{precision}' of C; use float64 or float32.")
    run = next((run for run in case.runs if "voltage_V" in run.measured.outputs), None)
    if run is None:
        raise ParameterError(f"{case.label}: no run reads voltage_V, which the filter needs; add one.")
    model = for_estimation(case_model(case))
    tuned = Tuning() if tuning is None else read_tunings(tuning)[FILTER]
    name, dtype = identifier(case.name), np.dtype(PRECISIONS[precision])
    left_out = (
        "The filter starts at the stated charge, without the search for the most probable one at the first reading.",
        "Its band does not widen in the cold below the least charge that fit runs have reached there.",
        *(("The tuning is that by default: jaxmodel estimate finds that of the cell.",) if tuning is None else ()),
        *own_values_of_runs(case),
    )  # fmt: skip
    steps = _steps(model, tuned, run)
    with jax.enable_x64(dtype.itemsize == 8):
        model, tuned = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), dtype=dtype), (model, tuned))
        error = _error_of_float32(model, tuned, steps) if dtype.itemsize == 4 else 0.0
        try:
            file = _file(model, tuned, name, dtype)
        except NotNative as error:
            raise ParameterError(f"{case.label}: its filter cannot be written as C ({error}).") from error
    states, size = state_names(model), len(state_names(model))
    text = _TEXT.format(
        heading=comment(heading(case, "The filter of the state of charge", left_out)),
        name=name,
        upper=name.upper(),
        real=file.real,
        size=size,
        square=size * size,
        states=", ".join(states),
        outputs="\n".join(f"    {file.real} {key};" for key in _OUTPUTS),
        body=file.text(),
        test=_test(name, file.real, size, steps, c_vectors.tolerance(error)),
    )
    return Exported(text, left_out)


def _file(model: Model, tuning: Tuning, name: str, dtype: np.dtype) -> CFile:
    file = CFile(dtype)
    constants = constants_of(file, model)
    for key, value in vars(tuning).items():
        file.constants[f"t_{key}"] = (float(value), "")
        constants.append(Given(np.asarray(value), f"t_{key}"))
    size = len(state_names(model))
    one = jnp.zeros((), dtype)
    numbers = [Given(one, key, f"u_{key}") for key in ("duration_s", "current_A", "degC", "voltage_V")]

    def start(model: Model, tuning: Tuning, soc: Any, current_A: Any, degC: Any, pairs_sd_V: Any) -> dict[str, Any]:
        mean, covariance = before_first_reading(
            model, tuning, (current_A, degC, degC, jnp.zeros_like(degC)), soc, pairs_sd_V
        )
        return {"mean": mean, "covariance": covariance}

    arguments = [Given(one, key, f"u_{key}") for key in ("soc", "current_A", "degC", "pairs_sd_V")]
    file.write(
        f"void {name}_filter_start({', '.join(f'{file.real} {one.text}' for one in arguments)}, {name}_filter *filter)",
        start, (model, tuning, one, one, one, one), [*constants, *arguments],
        {"mean": "filter->mean", "covariance": "filter->covariance"},
    )  # fmt: skip
    of_filter = [
        Given(jnp.zeros(size, dtype), "filter->mean", "m"),
        Given(jnp.zeros((size, size), dtype), "filter->covariance", "P"),
    ]
    file.write(
        f"void {name}_filter_step({', '.join(f'{file.real} {one.text}' for one in numbers)}, {name}_filter *filter,\n"
        f"{' ' * len(f'void {name}_filter_step(')}{name}_estimate *estimate)",
        _step, (model, tuning, *(one.value for one in of_filter), one, one, one, one),
        [*constants, *of_filter, *numbers],
        {"mean": "filter->mean", "covariance": "filter->covariance"} | {key: f"estimate->{key}" for key in _OUTPUTS},
    )  # fmt: skip
    return file


def _step(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, duration: Any, current_A: Any, degC: Any, volts: Any
) -> dict[str, Array]:
    """Return mean and covariance after a step and its reading, and what is told of them."""
    row = (current_A, degC, volts, jnp.zeros_like(degC))  # the model is known at any charge
    (mean, covariance), told = corrected_step(model, tuning, mean, covariance, duration, row)
    return {"mean": mean, "covariance": covariance} | {key: told[place] for key, place in _OUTPUTS.items()}


def _steps(model: Model, tuning: Tuning, run: Run) -> c_vectors.Steps:
    """Return steps that are spread over a run."""
    rows = min(run.measured.time_s.size, _MOST_ROWS)
    columns = run.measured.inputs | run.measured.outputs
    degC = columns.get("cell_temperature_degC", columns["ambient_degC"])
    degC = np.where(np.isfinite(degC), degC, columns["ambient_degC"])
    durations = np.diff(run.measured.time_s[:rows], prepend=run.measured.time_s[0])
    table = np.stack([durations, columns["current_A"][:rows], degC[:rows], columns["voltage_V"][:rows]], axis=1)
    zero = jnp.zeros(())
    first = (jnp.asarray(table[0, 1]), jnp.asarray(table[0, 2]), zero, zero)
    begin = before_first_reading(model, tuning, first, jnp.asarray(run.initial_soc.value), zero)

    def advance(carried: tuple[Array, Array], row: Array) -> tuple[tuple[Array, Array], tuple[Any, ...]]:
        found = _step(model, tuning, *carried, *row)
        after = found["mean"], found["covariance"]
        return after, (carried, after, [found[key] for key in _OUTPUTS])

    _, (before, after, told) = jax.jit(lambda rows: jax.lax.scan(advance, begin, rows))(jnp.asarray(table))
    chosen = np.unique(np.linspace(0, rows - 1, _STEPS).round().astype(int))
    chosen = chosen[np.isfinite(table[chosen]).all(axis=1)]
    given = [before[0][chosen], before[1][chosen].reshape(chosen.size, -1), table[chosen]]
    found = [after[0][chosen], after[1][chosen].reshape(chosen.size, -1), np.stack(told, axis=1)[chosen]]
    return c_vectors.Steps(np.concatenate(given, axis=1), np.concatenate(found, axis=1))


def _error_of_float32(model: Model, tuning: Tuning, steps: c_vectors.Steps) -> float:
    """Return by how much steps in float32 differ from those in float64, as a share of the largest of its kind."""
    size = len(state_names(model))
    table = jnp.asarray(steps.given, dtype=np.float32)

    def one(row: Array) -> Array:
        mean, covariance = row[:size], row[size:-4].reshape(size, size)
        found = _step(model, tuning, mean, covariance, *row[-4:])
        told = jnp.stack([found[key] for key in _OUTPUTS])
        return jnp.concatenate([found["mean"], found["covariance"].ravel(), told])

    found = np.asarray(jax.jit(jax.vmap(one))(table), dtype=float)
    return float(np.max(np.abs(found - steps.found) / steps.size))


def _test(name: str, real: str, size: int, steps: c_vectors.Steps, tolerance: float) -> str:
    """Return a program that compares the file with steps."""
    of_filter = [f"filter.mean[{k}]" for k in range(size)] + [f"filter.covariance[{k}]" for k in range(size * size)]
    numbers = ("duration_s", "current_A", "degC", "voltage_V")
    return c_vectors.comparison(
        name,
        real,
        (f"{name}_filter filter;", f"{name}_estimate estimate;", *(f"{real} {key};" for key in numbers)),
        (*of_filter, *numbers),
        (f"{name}_filter_step({', '.join(numbers)}, &filter, &estimate);",),
        (*of_filter, *(f"estimate.{key}" for key in _OUTPUTS)),
        steps,
        tolerance,
    )
