"""What the runs of a case must show for an effect to be told from a calibration, or from other effects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from jaxmodel.case.records import Case, Run
from jaxmodel.effects.drive import BACK_DRIVING, BOTH_TEMPERATURES, BRUSHES, FAST_VOLTAGE, LOST_MOTION, REVERSING
from jaxmodel.model.ports import Effect

# A quantity that varies by less than this share of its largest value is no variable of a law. Assumed.
LEAST_SPAN = 0.02
# Share of rows in which power must flow each way to tell what rubs from what is lost. Assumed.
_BOTH_WAYS = 0.02
_LOAD, _SPEED = "load_torque_Nm", "speed_rad_s"
_STAGES = ("winding_temperature_degC", "case_temperature_degC")
# A run shows what a reversal does if it has so many, at speeds above this share of the largest, and rows no farther
# apart in s: a rotor turns round in some 10 ms. Assumed.
_REVERSALS, _MOVES, _FOLLOWED_S = 4, 0.02, 0.05


def is_distinguishable(case: Case, cls: type[Effect]) -> bool:
    """Return True if the fit runs show what tells an effect apart: a parameter that differs, or what its mark asks."""
    told_by, fitted = cls.distinguished_by, [run for run in case.runs if run.split == "fit"]
    if not told_by:
        return True
    if told_by in _SHOWN:
        return _SHOWN[told_by](case, fitted)
    common = case.parameters.get(told_by)
    values = {run.overrides.get(told_by) or common for run in fitted}
    return len({None if one is None else one.value for one in values}) > 1


def _reverses(run: Run) -> bool:
    """Return True if a run turns both ways, often enough and in rows that follow a reversal."""
    speed = next((read for name in (_SPEED, "reference_speed_rad_s") if (read := _column(run, name)) is not None), None)
    if speed is None or not _is_fast(run):
        return False
    moving = speed[np.abs(np.nan_to_num(speed)) > _MOVES * float(np.nanmax(np.abs(speed)))]
    return int(np.count_nonzero(np.diff(np.sign(moving)))) >= _REVERSALS


def _follows_voltage(run: Run) -> bool:
    """Return True if a voltage drives a rotor that is free to follow it, in rows that show how."""
    return "voltage_V" in run.measured.inputs and _SPEED not in run.measured.inputs and _is_fast(run)


def _is_fast(run: Run) -> bool:
    return float(np.median(np.diff(run.measured.time_s))) <= _FOLLOWED_S


def _tells_heat_apart(runs: Sequence[Run]) -> bool:
    """Return True if winding and case are read in a run, and the motor runs at speeds that differ in these runs."""
    read = [_column(run, _SPEED) for run in runs if set(_STAGES) <= set(run.measured.outputs)]
    at = np.concatenate([np.zeros(0), *(np.abs(speed) for speed in read if speed is not None)])
    largest = float(np.nanmax(at, initial=0.0))
    return largest > 0.0 and float(np.nanstd(at)) > LEAST_SPAN * largest


def _drives_back(run: Run) -> bool:
    """Return True if the load drives the motor in some rows of a run, and the motor the load in others."""
    load, speed = _column(run, _LOAD), _column(run, _SPEED)
    if load is None or speed is None:
        return False
    power = load * speed
    return min(float(np.nanmean(power > 0.0)), float(np.nanmean(power < 0.0))) > _BOTH_WAYS


def _column(run: Run, name: str) -> np.ndarray | None:
    return run.measured.inputs.get(name, run.measured.outputs.get(name))


# By mark of an effect, whether a case and its fit runs show it.
_SHOWN: Mapping[str, Callable[[Case, Sequence[Run]], bool]] = {
    BRUSHES: lambda case, _: not case.brushless,
    BACK_DRIVING: lambda case, runs: case.load == "gravity" or any(map(_drives_back, runs)),
    REVERSING: lambda _, runs: any(map(_reverses, runs)),
    LOST_MOTION: lambda _, runs: any("position_rad" in run.measured.outputs and _reverses(run) for run in runs),
    BOTH_TEMPERATURES: lambda _, runs: _tells_heat_apart(runs),
    FAST_VOLTAGE: lambda _, runs: any(map(_follows_voltage, runs)),
}
