"""What is remarked on beside a verdict."""

from __future__ import annotations

import dataclasses

import numpy as np

from discrepancy.contract import noise_of_case
from discrepancy.ladder import ChannelError, Rung
from discrepancy.remarks import _about, far_on_check_runs, starts_elsewhere, starts_moving, worse_held_out
from jaxmodel.cases import Case
from tests.discrepancy.made_cases import case_of, run_of

SD = 0.1
NAME = "cell_temperature_degC"


def _case(*starts_degC: float) -> Case:
    inputs = {"current_A": np.full(40, 1.0), "ambient_degC": np.full(40, 25.0)}
    rng = np.random.default_rng(5)
    read = [start + np.linspace(0.0, 4.0, 40) + SD * rng.standard_normal(40) for start in starts_degC]
    runs = [run_of(number, inputs, {NAME: values}) for number, values in enumerate(read, start=1)]
    return case_of("cell", {}, runs, {NAME: SD})


def _said(case: Case) -> tuple[str, ...]:
    return starts_elsewhere(case, noise_of_case(case), {run.name: {NAME: np.full(40, 25.0)} for run in case.runs})


def test_a_thermometer_that_starts_off_the_ambient_temperature_is_remarked_on():
    (said,) = _said(_case(25.0, 23.5, 24.3))
    assert said.startswith(f"{NAME} in run-02 begins -1")
    assert "K off ambient_degC" in said
    assert "by less in run-03:" in said
    assert "run-01" not in said
    assert "by less" not in _said(_case(24.3, 25.0))[0]


def test_noise_at_the_start_a_temperature_that_rises_later_and_little_of_its_course_are_not():
    assert _said(_case(25.0, 25.0)) == ()
    fine = dataclasses.replace(noise_of_case(_case(24.7))[NAME], sd=0.001)
    case = _case(24.7)
    assert starts_elsewhere(case, {NAME: fine}, {case.runs[0].name: {NAME: np.full(40, 25.0)}}) == ()


def test_a_motor_that_turns_when_its_file_begins_is_remarked_on():
    rows = np.full(40, 12.0)
    inputs = {"voltage_V": rows, "load_torque_Nm": 0.0 * rows, "ambient_degC": rows}
    speeds = [np.linspace(start, 300.0, 40) for start in (0.2, -150.0)]
    runs = [run_of(number, inputs, {"speed_rad_s": speed}) for number, speed in enumerate(speeds, start=1)]
    case = case_of("motor", {}, runs, {"speed_rad_s": 0.3})
    noise = noise_of_case(case)

    def said(*starts: float) -> tuple[str, ...]:
        predicted = zip(case.runs, starts, strict=True)
        return starts_moving(case, noise, {run.name: {"speed_rad_s": start + 0.0 * rows} for run, start in predicted})

    (told,) = said(0.0, 0.0)
    assert told.endswith("if it did turn, give initial_speed_rad_s = -150 to run-02.")
    assert said(0.0, -150.0) == ()
    assert starts_moving(_case(25.0), noise_of_case(_case(25.0)), {}) == ()


def _rung(check: float, *added: str) -> Rung:
    return Rung("", added, {}, (), {NAME: ChannelError(fit=SD, check=check)}, {}, 0.0, 0)


def test_an_effect_that_makes_runs_held_out_worse_is_remarked_on():
    noise = noise_of_case(_case(25.0))
    (said,) = worse_held_out([_rung(1.0), _rung(0.5, "one"), _rung(0.7, "one", "other")], noise)
    assert said.startswith(f"With other the error of {NAME} on check runs grows by 40%")
    assert worse_held_out([_rung(1.0), _rung(1.05, "one")], noise) == ()
    assert worse_held_out([_rung(0.7 * SD), _rung(SD, "one")], noise) == (), "both are as good as the sensor"
    assert worse_held_out([_rung(np.nan), _rung(np.nan, "one")], noise) == (), "nothing was held out"


def test_runs_held_out_that_are_left_far_above_noise_and_fit_are_told():
    noise = noise_of_case(_case(25.0))
    (said,) = far_on_check_runs(_rung(7.0 * SD), noise)
    assert said.startswith(f"On check runs the error of {NAME} is 7.0 times that on fit runs")
    assert far_on_check_runs(_rung(1.2 * SD), noise) == ()
    assert far_on_check_runs(_rung(np.nan), noise) == (), "nothing was held out"
    far = dataclasses.replace(_rung(7.0 * SD), errors={NAME: ChannelError(fit=6.0 * SD, check=7.0 * SD)})
    assert far_on_check_runs(far, noise) == (), "the fit runs show it too"


def test_an_effect_far_stronger_than_usual_is_beyond_its_range_at_either_end():
    assert _about(15.0, 20.0, 2000.0), "the ends are nothing sharp"
    assert _about(4000.0, 20.0, 2000.0)
    assert not _about(1.0, 20.0, 2000.0), "a resistance is strong where it is small"
    assert not _about(1e5, 20.0, 2000.0)
    assert _about(-0.011, -0.01, 0.01)
    assert not _about(-0.02, -0.01, 0.01)


def test_a_first_reading_that_is_missing_is_not_what_a_thermometer_starts_with():
    case = _case(23.5)
    for run in case.runs:
        run.measured.outputs[NAME][:2] = np.nan
    (said,) = _said(case)
    assert "begins -1" in said
