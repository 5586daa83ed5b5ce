"""An ambient temperature that is stated is held against names, columns and thermometers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.data.importing import import_case
from jaxmodel.data.importing.findings import Finding
from tests.data.importing.benches import cell_log, motor_log


def contradicted(folder: Path, logs: dict[str, pd.DataFrame], ambient: float | None, kind="cell") -> list[Finding]:
    for name, log in logs.items():
        log.to_csv(folder / f"{name}.csv", index=False)
    files = [folder / f"{name}.csv" for name in logs]
    return [one for one in import_case(files, kind, ambient=ambient).findings if one.what == "ambient contradicted"]


def at(degC: float, seed: int = 0) -> pd.DataFrame:
    return cell_log(seed).assign(temperature_degC=lambda log: log.temperature_degC + degC - 25.0)


@pytest.mark.parametrize(
    ("name", "degC", "said"),
    [
        ("discharge_p40degC", 40.0, "discharge_p40degC (40 degC)"),
        ("pulse_-5degC", -5.0, "pulse_-5degC (-5 degC)"),
        ("minus10degC_cell", -10.0, "minus10degC_cell (-10 degC)"),
    ],
)
@pytest.mark.parametrize("thermometer", [True, False])
def test_a_name_speaks_against_what_is_stated(tmp_path: Path, name: str, degC: float, said: str, thermometer: bool):
    log = at(degC) if thermometer else at(degC).drop(columns="temperature_degC")
    (found,) = contradicted(tmp_path, {name: log}, 23.0)
    assert f"--ambient 23 contradicts what files or folders are called in {said}" in found.sentence
    assert "leave --ambient out" in found.sentence
    assert found.weight == "warning"


def test_a_name_that_agrees_says_nothing(tmp_path: Path):
    assert not contradicted(tmp_path, {"pulse_25degC": at(25.0), "cc1C": at(24.0, 1)}, 24.0)


def test_one_sentence_names_all_files(tmp_path: Path):
    logs = {f"pulse_{degC}degC": at(degC, degC) for degC in (0, 10, 25, 40, 45, 50)}
    (found,) = contradicted(tmp_path, logs, 25.0)
    assert "pulse_0degC (0 degC), pulse_10degC (10 degC)" in found.sentence
    assert "and 1 more runs" in found.sentence
    assert found.numbers == {"stated_degC": 25.0, "runs": 5.0}


def test_a_thermometer_at_rest_speaks_against_what_is_stated(tmp_path: Path):
    (found,) = contradicted(tmp_path, {"log": at(40.0)}, 23.0)
    assert "the thermometer at rest in log (40 degC)" in found.sentence
    assert not contradicted(tmp_path, {"log": at(27.0)}, 23.0)


def test_a_thermometer_under_load_says_nothing(tmp_path: Path):
    assert not contradicted(tmp_path, {"log": at(40.0)[300:]}, 23.0)


def test_a_column_speaks_against_what_is_stated(tmp_path: Path):
    log = at(40.0).assign(ambient_degC=40.0)
    (found,) = contradicted(tmp_path, {"log": log}, 23.0)
    assert "the column of the ambient temperature in log (40 degC)" in found.sentence


def test_a_motor_may_be_warm_of_an_earlier_run(tmp_path: Path):
    log = motor_log()
    log.loc[:20, ["voltage_V", "current_A", "speed_rad_s"]] = 0.0
    cold = log.assign(motor_temperature_degC=22.0)
    warm = log.assign(motor_temperature_degC=41.0, voltage_V=np.sqrt(log.voltage_V))
    assert not contradicted(tmp_path, {"a": cold, "b": warm}, 22.0, "motor")
    (found,) = contradicted(tmp_path, {"b": warm}, 22.0, "motor")
    assert "the thermometer at rest in b (41 degC)" in found.sentence


def test_one_temperature_is_not_that_of_runs_that_begin_apart(tmp_path: Path):
    logs = {"slow": at(24.5), "middle": at(26.1, 1), "fast": at(24.5, 2)}
    (found,) = contradicted(tmp_path, logs, 25.0)
    assert "its cell" not in found.sentence
    assert "rests at 24.5 degC when " in found.sentence
    assert "at 26.1 degC when middle does; leave --ambient out" in found.sentence
    assert not contradicted(tmp_path, logs, None)
    assert not contradicted(tmp_path, {"slow": at(24.6), "fast": at(25.3, 1)}, 25.0)
