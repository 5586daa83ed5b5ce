"""The filter of a cell's state of charge as one file of C: start, first reading and step, with test vectors.

They are those of `jaxmodel.operation.kalman`, Jacobians included, written from the jaxprs. The search of the first
reading is a loop in C over its improbability.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from jaxmodel.operation.kalman import (
    FIRST_CHARGES,
    FIRST_ROUNDS,
    SOC_RANGE,
    Measured,
    Tuning,
    before_first_reading,
    corrected_at,
    corrected_step,
    first_corrected,
    improbability,
    predicted,
    state_names,
)
from jaxmodel.operation.preparation import for_estimation
from jaxmodel.operation.state_of_charge import FILTER, read_tunings

# What a step tells beside mean and covariance, of the fields of `FilterOutput`, and its place among them.
_OUTPUTS = {"soc": 0, "sd": 1, "innovation": 5, "scale": 3, "offset_V": 4, "capacity_scale": 6, "capacity_sd": 7}
_OUTPUTS |= {"current_offset_A": 8}
_STEPS, _MOST_ROWS = 12, 2000
# First readings among the test vectors: from as many states of charge, and with these sd of the voltages of the pairs.
_STARTS, _PAIRS_SD_V = 8, (0.0, 0.0, 0.02, 0.02)

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
/* At the first reading: the most probable state of charge is searched, of {charges} over the whole range and that of
 * the start; the reading is linearised there, and {rounds} times where the last round ended. Arguments as in a step. */
void {name}_filter_first({real} current_A, {real} degC, {real} voltage_V, {name}_filter *filter,
                         {name}_estimate *estimate);
/* After duration_s seconds under a current in A, positive on discharge, at a temperature of the cell in degC, with a
 * voltage in V at the end; NAN where there is none. */
void {name}_filter_step({real} duration_s, {real} current_A, {real} degC, {real} voltage_V, {name}_filter *filter,
                        {name}_estimate *estimate);

{body}
{search}
{test}"""
# The functions that the compiler makes of jaxprs compute; these call them.
_SEARCH = """void {name}_filter_first({real} current_A, {real} degC, {real} voltage_V, {name}_filter *filter,
                         {name}_estimate *estimate)
{{
    const {name}_filter before = *filter;
    if (isfinite(voltage_V)) {{
        {real} least = INFINITY;
        for (int32_t k = 0; k <= {charges}; k++) {{
            const {real} soc = k < {charges} ? ({real})k / ({real}){last} : before.mean[{soc}];
            const {real} found = {name}_improbability(soc, current_A, degC, voltage_V, &before);
            if (found < least) {{
                least = found;
                filter->mean[{soc}] = soc;
            }}
        }}
    }}
    for (int32_t round = 0; round < {rounds}; round++) {{
        {name}_correct(current_A, degC, voltage_V, filter->mean, &before, filter, estimate);
    }}
}}

void {name}_filter_step({real} duration_s, {real} current_A, {real} degC, {real} voltage_V, {name}_filter *filter,
                        {name}_estimate *estimate)
{{
    {name}_predict(duration_s, current_A, degC, filter);
    {name}_correct(current_A, degC, voltage_V, filter->mean, filter, filter, estimate);
}}
"""


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
        "Its band does not widen in the cold below the least charge that fit runs have reached there.",
        *(("The tuning is that by default: jaxmodel estimate finds that of the cell.",) if tuning is None else ()),
        *own_values_of_runs(case),
    )  # fmt: skip
    table = _table(run)
    compared = _steps(model, tuned, table, run.initial_soc.value), _firsts(model, tuned, table)
    with jax.enable_x64(dtype.itemsize == 8):
        model, tuned = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), dtype=dtype), (model, tuned))
        error = _error_of_float32(model, tuned, *compared) if dtype.itemsize == 4 else 0.0
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
        charges=FIRST_CHARGES,
        rounds=FIRST_ROUNDS - 1,
        body=file.text(),
        search=_SEARCH.format(
            name=name,
            real=file.real,
            charges=FIRST_CHARGES,
            last=FIRST_CHARGES - 1,
            soc=states.index("soc"),
            rounds=FIRST_ROUNDS,
        ),
        test=c_vectors.comparison(
            name, file.real, _parts(name, file.real, size, *compared), c_vectors.tolerance(error)
        ),
    )
    return Exported(text, left_out)


def _file(model: Model, tuning: Tuning, name: str, dtype: np.dtype) -> CFile:
    file = CFile(dtype)
    constants = constants_of(file, model)
    for key, value in vars(tuning).items():
        file.constants[f"t_{key}"] = (float(value), "")
        constants.append(Given(np.asarray(value), f"t_{key}"))
    size, one = len(state_names(model)), jnp.zeros((), dtype)

    def numbers(*names: str) -> list[Given]:
        return [Given(one, key, f"u_{key}") for key in names]

    def of_filter(pointer: str) -> list[Given]:
        mean, covariance = jnp.zeros(size, dtype), jnp.zeros((size, size), dtype)
        return [Given(mean, f"{pointer}->mean", "m"), Given(covariance, f"{pointer}->covariance", "P")]

    def write(
        head: str, function: Callable, given: list[Given], targets: dict[str, str], about: str = "", returned: str = ""
    ) -> None:
        arguments = (model, tuning, *(one.value for one in given))
        head = head.format(name=name, real=file.real)
        file.write(head, function, arguments, [*constants, *given], targets, returned or None)
        if about:
            file.functions[-1] = f"{comment([about])}\n{file.functions[-1]}"

    to_filter = {"mean": "filter->mean", "covariance": "filter->covariance"}
    write(
        "void {name}_filter_start({real} soc, {real} current_A, {real} degC, {real} pairs_sd_V, {name}_filter *filter)",
        _started, numbers("soc", "current_A", "degC", "pairs_sd_V"), to_filter,
    )  # fmt: skip
    write(
        "static void {name}_predict({real} duration_s, {real} current_A, {real} degC, {name}_filter *filter)",
        _predicted, [*of_filter("filter"), *numbers("duration_s", "current_A", "degC")], to_filter,
    )  # fmt: skip
    write(
        "static void {name}_correct({real} current_A, {real} degC, {real} voltage_V, const {real} *at,\n"
        "                           const {name}_filter *before, {name}_filter *filter, {name}_estimate *estimate)",
        _corrected,
        [*of_filter("before"), *numbers("current_A", "degC", "voltage_V"), Given(jnp.zeros(size, dtype), "at", "x")],
        to_filter | {key: f"estimate->{key}" for key in _OUTPUTS},
        "Corrects by a voltage that is linearised at given states.",
    )  # fmt: skip
    write(
        "static {real} {name}_improbability({real} soc, {real} current_A, {real} degC, {real} voltage_V,\n"
        "                                   const {name}_filter *filter)",
        _improbability, [*of_filter("filter"), *numbers("current_A", "degC", "voltage_V", "soc")],
        {"found": f"const {file.real} found"},
        "Of a state of charge at the first reading: -2 log of its posterior density, without a constant.", "found",
    )  # fmt: skip
    return file


def _row(current_A: Any, degC: Any, voltage_V: Any) -> tuple[Any, ...]:
    return current_A, degC, voltage_V, jnp.zeros_like(degC)  # the model is known at any charge


def _started(model: Model, tuning: Tuning, soc: Any, current_A: Any, degC: Any, pairs_sd_V: Any) -> dict[str, Array]:
    mean, covariance = before_first_reading(model, tuning, _row(current_A, degC, degC), soc, pairs_sd_V)
    return {"mean": mean, "covariance": covariance}


def _predicted(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, duration: Any, current_A: Any, degC: Any
) -> dict[str, Array]:
    mean, covariance = predicted(model, tuning, mean, covariance, duration, _row(current_A, degC, degC))
    return {"mean": mean, "covariance": covariance}


def _corrected(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, current_A: Any, degC: Any, volts: Any, at: Array
) -> dict[str, Array]:
    return _found(*corrected_at(model, tuning, mean, covariance, _row(current_A, degC, volts), at))


def _improbability(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, current_A: Any, degC: Any, volts: Any, soc: Any
) -> dict[str, Array]:
    return {"found": improbability(model, tuning, mean, covariance, _row(current_A, degC, volts), soc)}


def _found(carried: tuple[Array, Array], told: tuple[Array, ...]) -> dict[str, Array]:
    """Return mean and covariance after a reading, and what is told of them."""
    return {"mean": carried[0], "covariance": carried[1]} | {key: told[place] for key, place in _OUTPUTS.items()}


def _step(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, duration: Any, current_A: Any, degC: Any, volts: Any
) -> dict[str, Array]:
    return _found(*corrected_step(model, tuning, mean, covariance, duration, _row(current_A, degC, volts)))


def _first(model: Model, tuning: Tuning, soc: Any, current_A: Any, degC: Any, pairs_sd_V: Any, volts: Any) -> dict:
    one = (jnp.zeros(1, soc.dtype), *(x[None] for x in _row(current_A, degC, volts)))
    return _found(*first_corrected(model, tuning, Measured(*one), soc, pairs_sd_V)[:2])


def _error_of_float32(model: Model, tuning: Tuning, steps: c_vectors.Steps, firsts: c_vectors.Steps) -> float:
    """Return by how much numbers in float32 differ from those in float64, as a share of the largest of its kind."""
    found = _called(_packed_step, model, tuning, steps.given), _called(_first, model, tuning, firsts.given)
    return float(max(np.max(np.abs(x - y.found) / y.size) for x, y in zip(found, (steps, firsts), strict=True)))


def _firsts(model: Model, tuning: Tuning, table: np.ndarray) -> c_vectors.Steps:
    """Return first readings from several states of charge: that of a run, and one amid it, at rest and not."""
    readings = table[np.isfinite(table).all(axis=1)][:, 1:]
    currents, degC, volts = readings[np.resize([0, len(readings) // 2], _STARTS)].T
    starts, sds = np.linspace(*SOC_RANGE, _STARTS), np.resize(_PAIRS_SD_V, _STARTS)
    rows = np.stack([starts, currents, degC, sds, volts], axis=1)
    return c_vectors.Steps(rows, _called(_first, model, tuning, rows))


def _steps(model: Model, tuning: Tuning, table: np.ndarray, start_soc: float) -> c_vectors.Steps:
    """Return steps that are spread over a run's table."""
    current_A, degC = map(jnp.asarray, table[0, 1:3])
    begun = _started(model, tuning, jnp.asarray(start_soc), current_A, degC, jnp.zeros(()))
    begin = begun["mean"], begun["covariance"]

    def advance(carried: tuple[Array, Array], row: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        found = _step(model, tuning, *carried, *row)
        return (found["mean"], found["covariance"]), carried

    _, before = jax.jit(lambda rows: jax.lax.scan(advance, begin, rows))(jnp.asarray(table))
    chosen = np.unique(np.linspace(0, len(table) - 1, _STEPS).round().astype(int))
    chosen = chosen[np.isfinite(table[chosen]).all(axis=1)]
    columns = [before[0][chosen], before[1][chosen].reshape(chosen.size, -1), table[chosen]]
    rows = np.concatenate(columns, axis=1)
    return c_vectors.Steps(rows, _called(_packed_step, model, tuning, rows))


def _packed_step(model: Model, tuning: Tuning, *row: Array) -> dict[str, Array]:
    size = len(state_names(model))
    covariance = jnp.stack(row[size:-4]).reshape(size, size)
    return _step(model, tuning, jnp.stack(row[:size]), covariance, *row[-4:])


def _called(function: Callable, model: Model, tuning: Tuning, rows: np.ndarray) -> np.ndarray:
    """Return mean, covariance and outputs of a function for each row of its numbers, in the model's type."""

    def one(row: Array) -> Array:
        found = function(model, tuning, *row)
        told = jnp.stack([found[key] for key in _OUTPUTS])
        return jnp.concatenate([found["mean"], found["covariance"].ravel(), told])

    given = jnp.asarray(rows, dtype=tuning.start_sd.dtype)
    return np.asarray(jax.jit(jax.vmap(one))(given), dtype=float)


def _table(run: Run) -> np.ndarray:
    """Return duration, current, temperature and voltage of the rows of a run."""
    rows = min(run.measured.time_s.size, _MOST_ROWS)
    columns = run.measured.inputs | run.measured.outputs
    degC = columns.get("cell_temperature_degC", columns["ambient_degC"])
    degC = np.where(np.isfinite(degC), degC, columns["ambient_degC"])
    durations = np.diff(run.measured.time_s[:rows], prepend=run.measured.time_s[0])
    return np.stack([durations, columns["current_A"][:rows], degC[:rows], columns["voltage_V"][:rows]], axis=1)


def _parts(name: str, real: str, size: int, steps: c_vectors.Steps, firsts: c_vectors.Steps) -> list[c_vectors.Part]:
    """Return what a program compares: steps, and first readings."""
    of_filter = [f"filter.mean[{k}]" for k in range(size)] + [f"filter.covariance[{k}]" for k in range(size * size)]
    sources = (*of_filter, *(f"estimate.{key}" for key in _OUTPUTS))
    of_step = ("duration_s", "current_A", "degC", "voltage_V")
    of_first = ("soc", "current_A", "degC", "pairs_sd_V", "voltage_V")

    def declared(numbers: Sequence[str]) -> tuple[str, ...]:
        return f"{name}_filter filter;", f"{name}_estimate estimate;", *(f"{real} {key};" for key in numbers)

    call = f"{name}_filter_step({', '.join(of_step)}, &filter, &estimate);"
    start = f"{name}_filter_start({', '.join(of_first[:-1])}, &filter);"
    first = f"{name}_filter_first(current_A, degC, voltage_V, &filter, &estimate);"
    return [
        c_vectors.Part("steps", declared(of_step), (*of_filter, *of_step), (call,), sources, steps),
        c_vectors.Part("starts", declared(of_first), of_first, (start, first), sources, firsts),
    ]
