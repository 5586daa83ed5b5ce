"""Whole columns that look like something else are said with what to do and imported; right ones are not doubted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import read_case
from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.plausible import doubts
from jaxmodel.data.importing import Imported, import_case
from tests.data.importing.benches import cell_log, motor_log

REPOSITORY = Path(__file__).parents[3]
ODD = {"exchanged columns", "odd size of the current", "odd temperature", "odd size of the torque"}
Change = Callable[[pd.DataFrame], pd.DataFrame]


def imported(folder: Path, frame: pd.DataFrame, kind: str = "cell", **options) -> Imported:
    path = folder / "log.csv"
    frame.to_csv(path, index=False)
    return import_case(path, kind, **({"ambient": 25.0} | options))  # type: ignore[arg-type]


def odd(one: Imported) -> list[str]:
    return [finding.sentence for finding in one.findings if finding.what in ODD]


@pytest.fixture(scope="module")
def emptied() -> pd.DataFrame:
    """A real cell from full to its cut-off at 1C, with its thermometer and the room's."""
    frame = read_case(REPOSITORY / "examples" / "samsung_30q").to_dataframes()["cc1C"]
    return frame.iloc[:: max(len(frame) // 300, 1)]


def mA(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(current_A=1000.0 * frame.current_A)


def in_degF(*names: str) -> Change:
    return lambda frame: frame.assign(**{name: 1.8 * frame[name] + 32.0 for name in names})


def exchanged(frame: pd.DataFrame) -> pd.DataFrame:
    return frame.assign(current_A=frame.voltage_V, voltage_V=frame.current_A)


def test_a_real_discharge_is_not_doubted(tmp_path: Path, emptied: pd.DataFrame):
    assert odd(imported(tmp_path, emptied, ambient=None)) == []


def test_milliamperes_under_amperes_are_said(tmp_path: Path, emptied: pd.DataFrame):
    (sentence,) = odd(imported(tmp_path, mA(emptied), ambient=None))
    assert "a full discharge gives 29" in sentence
    assert '--unit "current_A=mA"' in sentence
    mended = imported(tmp_path, mA(emptied), ambient=None, units={"current_A": "mA"})
    assert odd(mended) == []
    assert mended.capacity is not None
    assert mended.capacity.value == pytest.approx(2.96, rel=0.02)


def test_a_guessed_capacity_is_no_reason(tmp_path: Path):
    """A log that is never emptied tells no capacity: the current alone is spoken of."""
    half = mA(cell_log()[:200])
    (sentence,) = odd(imported(tmp_path, half, accept_unsettled_sign=True))
    assert "A h" not in sentence
    assert "few cells carry 500 A" in sentence
    assert odd(imported(tmp_path, mA(cell_log()[:200]).assign(current_A=lambda f: f.current_A / 20.0))) == []


@pytest.mark.parametrize(
    ("change", "column"),
    [
        (in_degF("ambient_degC", "cell_temperature_degC"), "ambient_degC"),
        (in_degF("cell_temperature_degC"), "cell_temperature_degC"),
    ],
    ids=["both", "the cell's alone"],
)
def test_degrees_fahrenheit_under_celsius_are_said(tmp_path: Path, emptied: pd.DataFrame, change: Change, column: str):
    (sentence,) = odd(imported(tmp_path, change(emptied), ambient=None))
    assert f'--unit "{column}=degF"' in sentence
    units = {name: "degF" for name in ("ambient_degC", "cell_temperature_degC") if name == column or column[0] == "a"}
    assert odd(imported(tmp_path, change(emptied), ambient=None, units=units)) == []


@pytest.mark.parametrize("degC", [-20.0, 0.0, 25.0, 45.0, 60.0])
def test_chambers_are_not_taken_for_fahrenheit(tmp_path: Path, degC: float):
    log = cell_log()
    assert odd(imported(tmp_path, log.assign(temperature_degC=log.temperature_degC - 25.0 + degC), ambient=degC)) == []


def test_an_ambient_temperature_in_degF_that_was_stated_is_said_in_its_words(tmp_path: Path):
    (sentence,) = odd(imported(tmp_path, cell_log().drop(columns="temperature_degC"), ambient=77.0))
    assert "state --ambient 25" in sentence


def test_exchanged_columns_are_said_where_the_sign_is_open(tmp_path: Path, emptied: pd.DataFrame):
    with pytest.raises(MeasurementError, match='--column current_A="voltage_V" --column voltage_V="current_A" --unit'):
        imported(tmp_path, exchanged(emptied), ambient=None)
    (sentence,) = odd(imported(tmp_path, exchanged(emptied), ambient=None, sign="discharge-positive"))
    assert "as the voltage of a cell does" in sentence


def test_exchanged_columns_that_are_named_are_right(tmp_path: Path, emptied: pd.DataFrame):
    columns = {"current_A": "voltage_V", "voltage_V": "current_A"}
    mended = imported(
        tmp_path, exchanged(emptied), ambient=None, columns=columns, units={"voltage_V": "A", "current_A": "V"}
    )
    assert odd(mended) == []
    np.testing.assert_allclose(mended.runs[0].log.columns["voltage_V"], emptied.voltage_V, rtol=1e-6)


def test_exchanged_columns_of_a_log_with_rests_are_said(tmp_path: Path):
    (sentence,) = odd(imported(tmp_path, exchanged(cell_log())))
    assert "if the two are exchanged" in sentence


def test_a_charge_at_constant_voltage_is_not_taken_for_exchanged(tmp_path: Path):
    """The voltage is held and the current falls, as the two columns of a discharge would if they were exchanged."""
    time_s = np.arange(0.0, 5400.0, 10.0)
    current = -3.0 * np.exp(-time_s / 1500.0)
    log = pd.DataFrame({"time_s": time_s, "current_A": current, "voltage_V": 4.2 - 1e-4 * np.exp(-time_s / 60.0)})
    assert odd(imported(tmp_path, log, sign="discharge-positive")) == []


@pytest.mark.parametrize(
    ("factor", "said"),
    [(0.01, '--column load_torque_Nm="100 * torque_Nm"'), (0.001, '--column load_torque_Nm="1000 * torque_Nm"')],
)
def test_a_torque_that_is_far_too_small_is_said(tmp_path: Path, factor: float, said: str):
    log = motor_log()
    small = log.assign(torque_Nm=factor * log.torque_Nm)
    one = imported(tmp_path, small, "motor")
    (sentence,) = odd(one)
    assert f"looks {1 / factor:,.0f} times too small" in sentence
    assert said in sentence
    formula = said.partition('"')[2].rstrip('"')
    assert odd(imported(tmp_path, small, "motor", columns={"load_torque_Nm": formula})) == []
    (doubt,) = doubts(one.case)
    assert "column 'load_torque_Nm'" in doubt


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_a_torque_of_the_right_size_is_not_doubted(tmp_path: Path, factor: float):
    log = motor_log()
    assert odd(imported(tmp_path, log.assign(torque_Nm=factor * log.torque_Nm), "motor")) == []


def test_a_load_that_never_changes_tells_nothing(tmp_path: Path):
    assert odd(imported(tmp_path, motor_log().assign(torque_Nm=1e-4), "motor")) == []


@pytest.mark.slow("a123_26650_plett")
@pytest.mark.parametrize(
    "folder", ["a123_26650_plett", "dmegc_18650_electrothermal", "k2_lfp_26650", "lg_mj1_18650", "nasa_18650_ageing"]
)
def test_public_measurements_are_not_doubted(shared: Path, folder: str):
    files = sorted((shared / "data" / folder).glob("*.csv"))
    if not files:
        pytest.skip("these measurements are not there")
    assert odd(import_case(files, "cell")) == []


def test_loads_that_were_measured_are_not_doubted(shared: Path):
    """A gear motor on a Prony brake: torque and speed are those of the shaft behind its gear, and so is k_tau."""
    file = shared / "data" / "gearmotor_prony_brake" / "static_load_points.csv"
    if not file.is_file():
        pytest.skip("these measurements are not there")
    columns = {"voltage_V": "applied_voltage_V"}
    assert odd(import_case(file, "motor", ambient=25.0, seconds_per_row=10.0, columns=columns)) == []
