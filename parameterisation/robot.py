"""Parameters of a robot: its pack as a cell, its track motors as a motor, and the on-board draw."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from jaxmodel import Case, Known, Run
from jaxmodel.cases import with_preset
from jaxmodel.errors import FitError
from jaxmodel.measurements import Measured
from jaxmodel.parameters import info
from parameterisation.cell import parameterise_cell
from parameterisation.motor import parameterise_motor
from parameterisation.result import Extraction, Parameterisation, absent

DRAW_TEST = "Pack current and motor current together, at rest and at several duties, would give it."
OF_CELL = {
    "cycles",
    "storage_months",
    "capacity_Ah",
    "series_resistance_scale",
    "rc_resistance_scale",
    "rc_capacitance_scale",
}


def parameterise_robot(case: Case, progress: Callable[[str], None] | None = None) -> Parameterisation:
    """Return first parameters of a robot: what its pack's and its motors' readings give, each by itself.

    Runs with pack voltage and pack current identify the cells (V = V_pack / n_series); runs with duty, pack voltage and
    motor current identify the motors (eq. 14: V_M = rho V_pack); eq. 21 gives the on-board current.

    Raises:
        FitError: no fit run has the readings of either.
    """
    stated = with_preset(case).parameters

    def number(name: str) -> float:
        return stated[name].value if name in stated else float(info(name).default)

    parts: dict[str, Parameterisation] = {}
    problems: list[str] = []
    jobs = {
        "cells": (_cell_case(case, number("n_series")), parameterise_cell),
        "motors": (_motor_case(case), parameterise_motor),
    }
    for name, (part, method) in jobs.items():
        if part is None:
            problems.append(f"no fit run has the readings that identify the {name}")
            continue
        try:
            parts[name] = method(part, progress)
        except FitError as error:
            problems.append(str(error))
    if not parts:
        raise FitError(
            f"{case.label}: {'; '.join(problems)}; give 'pack_voltage_V' with 'pack_current_A' or 'motor_current_A'."
        )
    found = [one for part in parts.values() for one in part.extractions]
    draw = _onboard(case, number("n_motors"), number("onboard_current_A"))
    found.append(draw)
    for name in jobs.keys() - parts.keys():
        found.append(
            absent(
                name,
                math.nan,
                "",
                f"the preset '{case.preset}'",
                "Runs with pack voltage and current would give them." if name == "cells" else DRAW_TEST,
            )
        )
    points = {f"{name}_{key}": table for name, part in parts.items() for key, table in part.points.items()}
    remarks = (*(remark for part in parts.values() for remark in part.remarks), *problems)
    return Parameterisation(_merged(case, parts, draw), tuple(found), points, remarks)


def _cell_case(case: Case, n_series: float) -> Case | None:
    """Return the pack as a cell: each run with pack voltage and current."""
    runs = []
    for run in case.runs:
        outputs = run.measured.outputs
        if (
            not {"pack_voltage_V", "pack_current_A"} <= outputs.keys()
            or not np.isfinite(outputs["pack_current_A"]).any()
        ):
            continue
        time_s, current = run.measured.time_s, outputs["pack_current_A"]
        there = np.isfinite(current)
        filled = np.interp(time_s, time_s[there], current[there])
        read = {"voltage_V": outputs["pack_voltage_V"] / n_series}
        if "cell_temperature_degC" in outputs:
            read["cell_temperature_degC"] = outputs["cell_temperature_degC"]
        inputs = {"current_A": filled, "ambient_degC": run.measured.inputs["ambient_degC"]}
        runs.append(dataclasses.replace(run, measured=Measured(time_s, inputs, read)))
    return _part(case, "cell", runs)


def _motor_case(case: Case) -> Case | None:
    """Return the track motors as one motor: each run with duty, pack voltage, and motor current or speed."""
    runs = []
    for run in case.runs:
        inputs, outputs = run.measured.inputs, run.measured.outputs
        if "pack_voltage_V" not in outputs or not {"motor_current_A", "speed_rad_s"} & outputs.keys():
            continue
        duty = inputs["duty"] if "duty" in inputs else (inputs["V_set"] - 2.5) / 2.5  # eq. 22
        time_s, pack = run.measured.time_s, outputs["pack_voltage_V"]
        there = np.isfinite(pack)
        new = {
            "voltage_V": duty * np.interp(time_s, time_s[there], pack[there]),
            "ambient_degC": inputs["ambient_degC"],
        }
        if "load_torque_Nm" not in inputs:
            continue
        new["load_torque_Nm"] = inputs["load_torque_Nm"]
        names = ("speed_rad_s", "winding_temperature_degC", "case_temperature_degC")
        read = {name: outputs[name] for name in names if name in outputs}
        if "motor_current_A" in outputs:
            read["current_A"] = outputs["motor_current_A"]
        runs.append(dataclasses.replace(run, measured=Measured(time_s, new, read)))
    return _part(case, "motor", runs)


def _part(case: Case, kind, runs: list[Run]) -> Case | None:
    if not any(run.split == "fit" for run in runs):
        return None
    tables = case.tables if kind == "cell" else {}
    return dataclasses.replace(case, kind=kind, runs=tuple(runs), tables=tables, effects={}, effect_sd={}, sensors={})


def _onboard(case: Case, n_motors: float, known: float) -> Extraction:
    """Return the on-board current: I_pack - n rho i_a (eqs. 14 and 21), its median and spread."""
    values, names = [], []
    for run in case.runs:
        inputs, outputs = run.measured.inputs, run.measured.outputs
        if run.split != "fit" or not {"pack_current_A", "motor_current_A"} <= outputs.keys() or "duty" not in inputs:
            continue
        left = outputs["pack_current_A"] - n_motors * inputs["duty"] * outputs["motor_current_A"]
        values.append(left[np.isfinite(left)])
        names.append(run.name)
    every = np.concatenate(values) if values else np.empty(0)
    if every.size < 3 or np.median(every) <= 0.0:
        return absent("onboard_current_A", known, "A", f"the case or its preset '{case.preset}'", DRAW_TEST)
    median = float(np.median(every))
    spread = 1.4826 * float(np.median(np.abs(every - median)))
    sd = max(1.2533 * spread / math.sqrt(every.size / 10.0), 0.002 * median)
    method = "pack current less the draw of the motors"
    return Extraction("onboard_current_A", median, sd, "A", tuple(names), f"{every.size} rows", method)


def _merged(case: Case, parts: dict[str, Parameterisation], draw: Extraction) -> Case:
    """Return the robot's case with the numbers of its parts."""
    parameters, tables, effects, effect_sd = (
        dict(case.parameters),
        dict(case.tables),
        dict(case.effects),
        dict(case.effect_sd),
    )
    sensors = dict(case.sensors)
    renamed = {
        "cells": {"voltage_V": "pack_voltage_V", "current_A": "pack_current_A"},
        "motors": {"current_A": "motor_current_A"},
    }
    for name, part in parts.items():
        found = part.case
        wanted = OF_CELL if name == "cells" else {one.name for one in part.extractions if one.found}
        parameters |= {key: value for key, value in found.parameters.items() if key in wanted}
        tables |= found.tables
        kept = {key: value for key, value in found.effects.items() if key != "torque_offset"}
        effects, effect_sd = kept | effects, found.effect_sd | effect_sd
        for column, sd in found.sensors.items():
            sensors.setdefault(renamed[name].get(column, column), sd)
    stated = case.parameters.get("onboard_current_A")
    if draw.found and (stated is None or stated.sd is not None):
        parameters["onboard_current_A"] = Known(draw.value, draw.sd)
    exact = {key: value for key, value in case.parameters.items() if value.sd is None}
    effect_sd = {name: sd for name, sd in effect_sd.items() if name in effects}
    starts = {run.name: run for part in (parts.get("cells"),) if part for run in part.case.runs}
    runs = tuple(
        dataclasses.replace(
            run,
            initial_soc=starts[run.name].initial_soc,
            initial_cell_temperature=starts[run.name].initial_cell_temperature,
        )
        if run.name in starts
        else run
        for run in case.runs
    )
    return dataclasses.replace(
        case,
        path=None,
        parameters=parameters | exact,
        tables=tables,
        effects=effects,
        effect_sd=effect_sd,
        sensors=sensors,
        runs=runs,
    )
