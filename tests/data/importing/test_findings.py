"""Each fault of a log is found, said and, where a reading is touched, counted; a good log has none of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.data.importing import Imported, import_case
from tests.data.importing.benches import cell_log


def imported(folder: Path, frame: pd.DataFrame, **options) -> Imported:
    path = folder / "log.csv"
    frame.to_csv(path, index=False)
    return import_case(path, "cell", ambient=25.0, **options)


def found(one: Imported) -> set[str]:
    return {finding.what for finding in one.findings if finding.weight == "warning"}


def test_a_good_log_has_nothing_to_look_at(tmp_path: Path):
    assert found(imported(tmp_path, cell_log())) == {"no check run"}


def gap(log: pd.DataFrame) -> pd.DataFrame:
    return log.drop(index=range(250, 330))


def repeated(log: pd.DataFrame) -> pd.DataFrame:
    return pd.concat([log[:100], log[99:]]).reset_index(drop=True)


def out_of_order(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(time_s=log.time_s.where(log.index != 300, 17.0))


def reset(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(time_s=np.where(log.index < 500, log.time_s, log.time_s - log.time_s[500])).drop(columns="step")


def stuck(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(temperature_degC=25.0)


def loaded(log: pd.DataFrame) -> pd.DataFrame:
    return log[220:].assign(time_s=lambda f: f.time_s - f.time_s.iloc[0])


def spike(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(temperature_degC=log.temperature_degC.where(log.index != 400, 180.0))


def kelvin(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(temperature_degC=log.temperature_degC + 273.15)


def jump(log: pd.DataFrame) -> pd.DataFrame:
    stamps = pd.Timestamp("2024-03-31") + pd.to_timedelta(log.time_s + 3600.0 * (log.index > 450), unit="s")
    return log.assign(timestamp=stamps.dt.strftime("%Y-%m-%d %H:%M:%S"))


def drift(log: pd.DataFrame) -> pd.DataFrame:
    stamps = pd.Timestamp("2024-03-31") + pd.to_timedelta(1.01 * log.time_s, unit="s")
    return log.assign(timestamp=stamps.dt.strftime("%Y-%m-%d %H:%M:%S.%f"))


def not_finite(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(voltage_V=log.voltage_V.where(log.index != 10, np.inf))


def counted(log: pd.DataFrame) -> pd.DataFrame:
    return log.assign(**{"Discharge_Capacity(Ah)": (np.maximum(log.current_A, 0.0) * 5.0 / 3600.0).cumsum()})


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (gap, "gap"),
        (out_of_order, "out of order"),
        (reset, "reset"),
        (stuck, "stuck sensor"),
        (loaded, "start under load"),
        (spike, "spike"),
        (kelvin, "wrong unit"),
        (jump, "clock jump"),
        (drift, "clock drift"),
        (counted, "charge count"),
    ],
)
def test_a_fault_is_found(tmp_path: Path, spoil, what: str):
    assert what in found(imported(tmp_path, spoil(cell_log())))


def test_infinite_readings_are_missing_and_said(tmp_path: Path):
    one = imported(tmp_path, not_finite(cell_log()))
    assert np.isnan(one.runs[0].log.columns["voltage_V"][10])
    assert any(f.what == "not finite" for f in one.findings)


def test_a_copy_of_a_row_goes_and_a_row_of_the_same_time_stays(tmp_path: Path):
    log = cell_log()
    copies = imported(tmp_path, repeated(log))
    assert copies.runs[0].log.rows == len(log)
    assert any(finding.what == "repeated rows" for finding in copies.findings)
    # As cyclers log the end of one step and the start of the next.
    twin = pd.concat([log[:60], log[60:61].assign(time_s=590.0), log[60:]]).reset_index(drop=True)
    kept = imported(tmp_path, twin).runs[0].log
    assert kept.rows == len(log) + 1
    assert 0.0 < kept.time_s[60] - kept.time_s[59] <= 1e-3
    assert kept.columns["current_A"][60] == 6.0


def test_a_clock_of_whole_seconds_is_spread(tmp_path: Path):
    log = cell_log(step_s=10.0).assign(time_s=lambda f: np.floor(f.time_s / 40.0) * 4.0)
    one = imported(tmp_path, log)
    steps = np.diff(one.runs[0].log.time_s)
    np.testing.assert_allclose(steps[:-2], 1.0)  # the last second is not full
    assert "same time" in found(one)


def test_a_gap_in_an_input_is_interpolated_and_a_gap_in_a_reading_stays(tmp_path: Path):
    log = cell_log()
    log.loc[5:8, "current_A"] = np.nan
    log.loc[20:22, "voltage_V"] = np.nan
    one = imported(tmp_path, log)
    columns = one.runs[0].log.columns
    assert (columns["current_A"][5:9] == 0.0).all()
    assert np.isnan(columns["voltage_V"][20:23]).all()
    assert any(f.what == "gap in an input" and f.numbers["rows"] == 4.0 for f in one.findings)


def test_a_saturated_sensor_is_told_from_a_controlled_step(tmp_path: Path):
    log = cell_log()
    wave = 25.0 + 12.0 * np.sin(log.time_s / 300.0)
    clipped = imported(tmp_path, log.assign(temperature_degC=np.round(np.minimum(wave + 0.002 * log.index, 33.0), 2)))
    assert "saturation" in found(clipped)
    assert "saturation" not in found(imported(tmp_path, log))
    # A sum of readings above the limit stays as it was read.
    assert clipped.runs[0].log.columns["cell_temperature_degC"].max() == 33.0


def test_a_coarse_digit_is_noted(tmp_path: Path):
    log = cell_log()
    one = imported(tmp_path, log.assign(temperature_degC=np.round(log.temperature_degC)))
    assert any(f.what == "coarse resolution" and f.column == "cell_temperature_degC" for f in one.findings)


def test_two_loggers_are_joined_by_their_stamps(tmp_path: Path):
    log = cell_log()
    start = pd.Timestamp("2024-05-01 12:00:00")
    electrical = log[["time_s", "current_A", "voltage_V"]].assign(
        timestamp=(start + pd.to_timedelta(log.time_s, unit="s")).dt.strftime("%Y-%m-%d %H:%M:%S")
    )
    seconds = np.arange(0.0, 9000.0, 3.0)
    warm = pd.DataFrame(
        {"time_s": seconds, "temperature_degC": np.interp(seconds + 30.0, log.time_s, log.temperature_degC)}
    )
    warm["timestamp"] = (start + pd.to_timedelta(seconds + 30.0, unit="s")).strftime("%Y-%m-%d %H:%M:%S")
    for name, frame in {"cycler": electrical, "thermo": warm}.items():
        frame.to_csv(tmp_path / f"{name}.csv", index=False)
    one = import_case([tmp_path / "cycler.csv", tmp_path / "thermo.csv"], "cell", ambient=25.0)
    (run,) = one.runs
    read = run.log.columns["cell_temperature_degC"]
    there = np.isfinite(read)
    assert there.sum() > 850
    np.testing.assert_allclose(read[there], log.temperature_degC[there], atol=0.15)


def test_a_shift_between_two_loggers_is_told(tmp_path: Path):
    time_s = np.arange(0.0, 7200.0, 2.0)
    current = 8.0 * (np.floor(time_s / 400.0) % 2)
    warm = np.empty_like(time_s)
    warm[0] = 25.0
    for n in range(1, time_s.size):
        warm[n] = warm[n - 1] + 2.0 * (0.0004 * current[n] ** 2 - (warm[n - 1] - 25.0) / 900.0)
    voltage = 4.1 - 0.02 * current - 0.9 * np.cumsum(current) / np.sum(current)
    pd.DataFrame({"time_s": time_s, "current_A": current, "voltage_V": voltage}).to_csv(
        tmp_path / "cycler.csv", index=False
    )
    for by, told in ((0.0, False), (90.0, True)):
        shifted = np.interp(time_s + by, time_s, warm)
        pd.DataFrame({"time_s": time_s, "temperature_degC": np.round(shifted, 3)}).to_csv(
            tmp_path / "thermo.csv", index=False
        )
        one = import_case([tmp_path / "cycler.csv", tmp_path / "thermo.csv"], "cell", ambient=25.0)
        shifts = [finding.numbers["shift_s"] for finding in one.findings if finding.what == "clock shift"]
        assert bool(shifts) == told
        if told:
            assert shifts[0] == pytest.approx(by, abs=15.0)


def test_a_picture_shows_every_column_and_what_was_found(tmp_path: Path):
    one = imported(tmp_path, gap(cell_log()))
    figure = one.plot()
    axes = figure.axes
    assert len(axes) == len(one.runs[0].log.columns)
    assert any("gap" in text.get_text() for text in figure.texts)
    assert sum(len(panel.patches) for panel in axes) >= len(axes)
