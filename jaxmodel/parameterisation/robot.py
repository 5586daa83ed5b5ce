"""Parameters of a robot: its pack as a cell, its track motors as a motor, and the on-board draw.

The cells' numbers hold the age at which the robot was measured: a case with `cycles` and `storage_months` is
parameterised at that age, and the case that is written has none.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import FitError
from jaxmodel.base.remark import Remark
from jaxmodel.case.build import case_model, with_preset
from jaxmodel.case.known import Known
from jaxmodel.case.measurements import Measured
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import duty_of
from jaxmodel.effects.loads import LAWS
from jaxmodel.model.cell import storage_factor
from jaxmodel.model.parameters import info
from jaxmodel.model.robot import accessory_draw, load_torque
from jaxmodel.parameterisation.cell import AGE, parameterise_cell
from jaxmodel.parameterisation.motor import parameterise_motor
from jaxmodel.parameterisation.result import Extraction, Parameterisation, absent

TESTS = {
    "cells": "Runs with pack voltage and pack current would give them.",
    "motors": "Runs with duty, pack voltage, and motor current or speed would give them.",
    "draw": "Pack current and motor current together, at rest and at several duties, would give it.",
}
# What tables found in the data replace; a scale beside them would count twice.
SCALES = ("series_resistance_scale", "rc_resistance_scale", "rc_capacitance_scale")
OF_CELL = {*AGE, *SCALES, "capacity_Ah"}
COLUMNS = {
    "cells": {"voltage_V": "pack_voltage_V", "current_A": "pack_current_A"},
    "motors": {"current_A": "motor_current_A"},
}
LEAST_SHARE_SD = 0.002  # of the on-board current
INDEPENDENT = 10.0  # one in so many readings of the pack's current. Assumed.


def parameterise_robot(case: Case, progress: Callable[[str], None] | None = None) -> Parameterisation:
    """Return first parameters of a robot: what its pack's and its motors' readings give, each by itself.

    Runs with pack voltage and pack current identify the cells (V = V_pack / n_series); runs with duty, pack voltage and
    motor current or speed identify the motors (eq. 14: V_M = rho V_pack); eq. 21 gives the on-board current.

    Raises:
        FitError: no fit run has the readings of either.
    """
    n_series = _number(case, "n_series")
    parts: dict[str, Parameterisation] = {}
    problems: dict[str, str] = {}
    jobs = {
        "cells": (_cell_case(case, n_series), parameterise_cell),
        "motors": (_motor_case(case), parameterise_motor),
    }
    for name, (part, method) in jobs.items():
        if part is None:
            problems[name] = f"{case.label}: no fit run has the readings that identify the {name}."
            continue
        try:
            parts[name] = _renamed(method(part, progress), COLUMNS[name], n_series)
        except FitError as error:
            problems[name] = str(error)
    if not parts:
        raise FitError(
            f"{case.label}: no fit run has the readings that identify cells or motors; "
            "give 'pack_voltage_V' with 'pack_current_A', 'motor_current_A' or 'speed_rad_s'."
        )
    draw = _onboard(case)
    found = [one for part in parts.values() for one in part.extractions] + [draw]
    found += [
        absent(name, math.nan, "", f"the case or its preset '{Path(case.preset).name}'", TESTS[name])
        for name in problems
    ]
    points = {f"{name}_{key}": table for name, part in parts.items() for key, table in part.points.items()}
    remarks = [remark for part in parts.values() for remark in part.remarks]
    remarks += [Remark(problem, "not_parameterised", name) for name, problem in problems.items()]
    if "cells" in parts and any(_number(case, name) for name in AGE):
        sentence = "The numbers of the cells hold their age; cycles and storage_months count from here."
        remarks.append(Remark(sentence, "age_included", ", ".join(AGE)))
    return Parameterisation(_merged(case, parts, draw), tuple(found), points, tuple(remarks))


def _number(case: Case, name: str) -> float:
    stated = with_preset(case).parameters
    return stated[name].value if name in stated else float(info(name).default)


def _renamed(part: Parameterisation, columns: dict[str, str], n_series: float) -> Parameterisation:
    """Return a part with the sensors of the robot: those of the pack's voltage are `n_series` times those of a cell."""

    def times(column: str) -> float:
        return n_series if columns.get(column) == "pack_voltage_V" else 1.0

    said = []
    for one in part.extractions:
        column = one.name.removeprefix("noise of ")
        if column != one.name:
            name, factor = f"noise of {columns.get(column, column)}", times(column)
            one = dataclasses.replace(one, name=name, value=factor * one.value, sd=factor * one.sd)
        said.append(one)
    sensors = {columns.get(column, column): times(column) * sd for column, sd in part.case.sensors.items()}
    return dataclasses.replace(part, extractions=tuple(said), case=dataclasses.replace(part.case, sensors=sensors))


def _cell_case(case: Case, n_series: float) -> Case | None:
    """Return the pack as a cell of today's age: each run with pack voltage and current."""
    runs = []
    for run in case.runs:
        outputs, time_s = run.measured.outputs, run.measured.time_s
        if not all(_read(run, name) for name in ("pack_voltage_V", "pack_current_A")):
            continue
        inputs = {
            "current_A": _filled(time_s, outputs["pack_current_A"]),
            "ambient_degC": run.measured.inputs["ambient_degC"],
        }
        read = {"voltage_V": outputs["pack_voltage_V"] / n_series}
        if "cell_temperature_degC" in outputs:
            read["cell_temperature_degC"] = outputs["cell_temperature_degC"]
        overrides = {name: value for name, value in run.overrides.items() if name not in AGE}
        runs.append(dataclasses.replace(run, measured=Measured(time_s, inputs, read), overrides=overrides))
    kept = {name: value for name, value in case.parameters.items() if name not in (*AGE, *SCALES)}
    storage = (jnp.asarray(_number(case, name)) for name in ("storage_months", "storage_temperature_degC"))
    left = float(storage_factor(*storage))
    stated = case.parameters.get("capacity_Ah", Known(_number(case, "capacity_Ah"), 0.1 * _number(case, "capacity_Ah")))
    kept["capacity_Ah"] = Known(left * stated.value, None if stated.sd is None else left * stated.sd)
    return _part(dataclasses.replace(case, parameters=kept), "cell", runs)


def _motor_case(case: Case) -> Case | None:
    """Return the track motors as one motor: each run with duty, pack voltage, and motor current or speed."""
    runs = []
    for run in case.runs:
        inputs, outputs, time_s = run.measured.inputs, run.measured.outputs, run.measured.time_s
        at_speed = "speed_rad_s" in inputs
        if not _read(run, "pack_voltage_V") or not (_read(run, "motor_current_A") or _read(run, "speed_rad_s")):
            continue
        new = {
            "voltage_V": duty_of(run) * _filled(time_s, outputs["pack_voltage_V"]),
            "ambient_degC": inputs["ambient_degC"],
        }
        if at_speed:
            new["speed_rad_s"] = inputs["speed_rad_s"]
        elif case.load not in LAWS:
            new["load_torque_Nm"] = _by_row(lambda p, row: load_torque(p, row, ()), case, run)
        else:
            new |= {name: inputs[name] for name in ("load_torque_Nm", "incline_deg") if name in inputs}
        names = ("speed_rad_s", "winding_temperature_degC", "case_temperature_degC")
        read = {name: outputs[name] for name in names if name in outputs}
        if "motor_current_A" in outputs:
            read["current_A"] = outputs["motor_current_A"]
        runs.append(dataclasses.replace(run, measured=Measured(time_s, new, read)))
    return _part(case, "motor", runs)


def _read(run: Run, name: str) -> bool:
    return name in run.measured.outputs and bool(np.isfinite(run.measured.outputs[name]).any())


def _filled(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    there = np.isfinite(values)
    return np.interp(time_s, time_s[there], values[there])


def _by_row(relation: Callable, case: Case, run: Run) -> np.ndarray:
    """Return a relation of parameters and inputs for each row of a run, shape (rows,)."""
    parameters = case_model(case, run).parameters
    inputs = {name: jnp.asarray(values) for name, values in run.measured.inputs.items()}
    return np.array(jax.vmap(lambda row: relation(parameters, row))(inputs))


def _part(case: Case, kind, runs: list[Run]) -> Case | None:
    if not any(run.split == "fit" for run in runs):
        return None
    tables = case.tables if kind == "cell" else {}
    part = dataclasses.replace(case, kind=kind, runs=tuple(runs), tables=tables, effects={}, effect_sd={}, sensors={})
    if kind == "cell":
        return dataclasses.replace(part, load="")
    if (law := LAWS.get(case.load)) is None:
        return part
    sd = {law.name: case.effect_sd[law.name]} if law.name in case.effect_sd else {}
    return dataclasses.replace(part, effects={law.name: case.effects[law.name]}, effect_sd=sd)


def _onboard(case: Case) -> Extraction:
    """Return the on-board current: I_pack - n rho i_a - I_Mf - I_Ma (eqs. 14 and 21), its median and spread."""
    values, names = [], []
    for run in case.runs:
        outputs = run.measured.outputs
        if run.split != "fit" or not (_read(run, "pack_current_A") and _read(run, "motor_current_A")):
            continue
        limbs = _by_row(accessory_draw, case, run)
        motors = _number(case, "n_motors") * duty_of(run) * outputs["motor_current_A"]
        left = outputs["pack_current_A"] - motors - limbs
        values.append(left[np.isfinite(left)])
        names.append(run.name)
    every = np.concatenate(values) if values else np.empty(0)
    if every.size < 3 or np.median(every) <= 0.0:
        known = _number(case, "onboard_current_A")
        return absent(
            "onboard_current_A", known, "A", f"the case or its preset '{Path(case.preset).name}'", TESTS["draw"]
        )
    median = float(np.median(every))
    spread = 1.4826 * float(np.median(np.abs(every - median)))
    sd = max(1.2533 * spread / math.sqrt(every.size / INDEPENDENT), LEAST_SHARE_SD * median)
    method = "pack current less the draw of the motors"
    return Extraction("onboard_current_A", median, sd, "A", tuple(names), f"{every.size} rows", method)


def _merged(case: Case, parts: dict[str, Parameterisation], draw: Extraction) -> Case:
    """Return the robot's case with the numbers of its parts; what it states as exact stays, but for age and scales."""
    parameters, sensors = dict(case.parameters), dict(case.sensors)
    tables, effects, effect_sd = dict(case.tables), dict(case.effects), dict(case.effect_sd)
    replaced = {*AGE, *SCALES, "capacity_Ah"} if "cells" in parts else set()
    with_load = any("load_torque_Nm" in run.measured.inputs for run in case.runs)
    for name, part in parts.items():
        found = part.case
        wanted = OF_CELL if name == "cells" else {one.name for one in part.extractions if one.found}
        parameters |= {key: value for key, value in found.parameters.items() if key in wanted}
        tables |= found.tables
        kept = {key: value for key, value in found.effects.items() if key != "torque_offset" or with_load}
        effects, effect_sd = kept | effects, found.effect_sd | effect_sd
        sensors = found.sensors | sensors
    stated = case.parameters.get("onboard_current_A")
    if draw.found and (stated is None or stated.sd is not None):
        parameters["onboard_current_A"] = Known(draw.value, draw.sd)
    exact = {key: value for key, value in case.parameters.items() if value.sd is None and key not in replaced}
    return dataclasses.replace(
        case,
        path=None,
        parameters=parameters | exact,
        tables=tables,
        effects=effects,
        effect_sd={name: sd for name, sd in effect_sd.items() if name in effects},
        sensors=sensors,
        runs=tuple(_run(run, parts, replaced) for run in case.runs),
    )


def _run(run: Run, parts: dict[str, Parameterisation], replaced: set[str]) -> Run:
    """Return a run of the robot with what its parts found of its start."""
    overrides = {name: value for name, value in run.overrides.items() if name not in replaced.intersection(AGE)}
    for part in parts.values():
        overrides |= next((one.overrides for one in part.case.runs if one.name == run.name), {})
    run = dataclasses.replace(
        run, overrides={k: v for k, v in overrides.items() if k not in replaced.intersection(AGE)}
    )
    cells = parts["cells"].case.runs if "cells" in parts else ()
    for one in cells:
        if one.name == run.name:
            temperature = one.initial_cell_temperature
            run = dataclasses.replace(run, initial_soc=one.initial_soc, initial_cell_temperature=temperature)
    return run
