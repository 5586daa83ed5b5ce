"""Inputs with different names are unified; a current with the wrong sign is refused, and nothing else."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import FitError, MeasurementError
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.fit.preparation.inputs import check_sign_of_current, with_like_inputs
from tests.diagnosis.made_cases import MadeCell

TIME_S = np.arange(0.0, 50.0, 10.0)


def robot(folder: Path, *runs: dict[str, float]) -> Case:
    """A robot's case with runs of constant inputs."""
    text = 'kind = "robot"\n[parameters]\ncapacity_Ah = { value = 5.2, sd = 0.1 }\n[sensors]\nV_set = 0.025\n'
    for number, inputs in enumerate(runs):
        columns = {"time_s": TIME_S, "ambient_degC": 20.0, "pack_voltage_V": 24.0} | inputs
        pd.DataFrame(columns).to_csv(folder / f"{number}.csv", index=False)
        text += f'[[runs]]\nfile = "{number}.csv"\nsplit = "fit"\n'
    (folder / "case.toml").write_text(text, encoding="utf-8")
    return read_case(folder)


def test_set_voltage_becomes_a_duty_and_its_noise_too(tmp_path: Path) -> None:
    found = with_like_inputs(
        robot(tmp_path, {"V_set": 3.75, "load_torque_Nm": 0.1}, {"duty": -0.2, "load_torque_Nm": 0.1})
    )
    assert [run.measured.inputs["duty"][0] for run in found.runs] == pytest.approx([0.5, -0.2])
    assert found.sensors == pytest.approx({"duty": 0.01})


def test_optional_input_of_one_run_is_zero_in_the_others(tmp_path: Path) -> None:
    flippers = {"flipper_torque_Nm": 1.0, "flipper_duty": 0.5}
    drive = {"duty": 0.5, "load_torque_Nm": 0.1}
    with_them, without = with_like_inputs(robot(tmp_path, drive | flippers, drive)).runs
    assert with_them.measured.inputs.keys() == without.measured.inputs.keys()
    assert np.all(without.measured.inputs["flipper_duty"] == 0.0)
    assert np.all(with_them.measured.inputs["flipper_torque_Nm"] == 1.0)


def test_runs_with_different_inputs_are_named(tmp_path: Path) -> None:
    case = robot(tmp_path, {"duty": 0.5, "load_torque_Nm": 0.1}, {"duty": 0.5, "incline_deg": 5.0})
    with pytest.raises(FitError, match=r"0\.csv and 1\.csv .*incline_deg, load_torque_Nm"):
        with_like_inputs(case)


def with_current(case: Case, change) -> Case:
    runs = []
    for run in case.runs:
        inputs = run.measured.inputs | {"current_A": change(run.measured.inputs["current_A"])}
        runs.append(run.driven_by(inputs))
    return dataclasses.replace(case, runs=tuple(runs))


def test_a_current_of_wrong_sign_is_refused(plain_cell: MadeCell) -> None:
    check_sign_of_current(plain_cell.case)
    with pytest.raises(MeasurementError, match="multiply the column current_A by -1"):
        check_sign_of_current(with_current(plain_cell.case, lambda current: -current))


def test_a_current_without_effect_on_the_voltage_is_accepted(plain_cell: MadeCell) -> None:
    rng = np.random.default_rng(0)
    check_sign_of_current(with_current(plain_cell.case, np.zeros_like))
    check_sign_of_current(with_current(plain_cell.case, lambda current: rng.permutation(current)))
