"""Unified inputs: every run has the same inputs, and the sign of currents is checked."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.base.errors import FitError, MeasurementError
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.records import Case, Run
from jaxmodel.model.pieces import run_in_pieces
from jaxmodel.model.robot import duty_of_signal

# With reversed current, the voltage error of a cell must fall to this share to count as a wrong sign.
_CLOSER = 0.5
# A quantity that varies by less than this share of its largest value counts as constant.
_CHANGING = 0.05


def with_like_inputs(case: Case) -> Case:
    """Return a case whose runs have the same inputs: a set voltage becomes a duty (eq. 22), missing optional inputs 0.

    Raises:
        FitError: two runs have different inputs.
    """
    case = _with_duty(case)
    optional = case.vocabulary.optional_inputs
    zeros = [name for name in optional if any(name in run.measured.inputs for run in case.runs)]
    runs = []
    for run in case.runs:
        inputs = {name: np.zeros(run.measured.time_s.size) for name in zeros} | run.measured.inputs
        runs.append(run.driven_by(inputs))
    first = runs[0]
    for run in runs[1:]:
        if other := sorted(first.measured.inputs.keys() ^ run.measured.inputs.keys()):
            raise FitError(
                f"{case.label}: {first.file} and {run.file} have different inputs ("
                f"{', '.join(other)}); put runs with the same inputs into a case of their own."
            )
    return dataclasses.replace(case, runs=tuple(runs))


def check_sign_of_current(case: Case) -> None:
    """Refuse a cell whose current is negative on discharge.

    In that case the voltage rises with the current and with the removed charge in every run, and the stated model with
    reversed current is far closer to it.

    Raises:
        MeasurementError: the sign is wrong.
    """
    runs = [run for run in case.runs if case.kind == "cell" and "voltage_V" in run.measured.outputs]
    runs = [run for run in runs if np.any(run.measured.inputs["current_A"])]
    if not runs or not all(_rises_with_current(run) for run in runs):
        return
    if _misfit(case, runs, -1.0) < _CLOSER * _misfit(case, runs, 1.0):
        raise MeasurementError(
            f"{case.label}: voltage_V falls where current_A is negative, in every run; currents are "
            "positive on discharge, so multiply the column current_A by -1."
        )


def _rises_with_current(run: Run) -> bool:
    """Return whether the voltage rises with the current and with its charge, if these vary."""
    current, voltage = run.measured.inputs["current_A"], run.measured.outputs["voltage_V"]
    charge = np.cumsum(current * np.diff(run.measured.time_s, prepend=run.measured.time_s[0]))
    there = np.isfinite(voltage)
    changing = [one[there] for one in (current, charge) if np.std(one[there]) > _CHANGING * np.max(np.abs(one))]
    if not changing:
        return False
    columns = [one - one.mean() for one in changing]
    scaled = np.stack([one / np.linalg.norm(one) for one in columns], axis=1)
    slopes = np.linalg.lstsq(scaled, voltage[there] - voltage[there].mean(), rcond=None)[0]
    return bool(np.all(slopes > 0.0))


def _misfit(case: Case, runs: list[Run], sign: float) -> float:
    """Return the RMS voltage error of the stated model, with its currents multiplied by a sign."""
    errors = []
    for run in runs:
        turned = run.driven_by(run.measured.inputs | {"current_A": sign * run.measured.inputs["current_A"]})
        found = run_in_pieces(case_model(case, run), run_profile(turned)).readings["voltage_V"]
        errors.append(run.measured.outputs["voltage_V"] - found)
    together = np.concatenate(errors)
    together = together[np.isfinite(together)]
    return float(np.sqrt(np.mean(together**2))) if together.size else np.inf


def _with_duty(case: Case) -> Case:
    """Return a robot's case with the operator's signal and its noise converted to duties (eq. 22)."""
    runs = []
    for run in case.runs:
        inputs = dict(run.measured.inputs)
        if "V_set" in inputs:
            inputs["duty"] = duty_of_signal(inputs.pop("V_set"))
        runs.append(run.driven_by(inputs))
    sensors = dict(case.sensors)
    if "V_set" in sensors:
        sd = sensors.pop("V_set") * (duty_of_signal(1.0) - duty_of_signal(0.0))
        sensors = {"duty": sd} | sensors
    return dataclasses.replace(case, runs=tuple(runs), sensors=sensors)
