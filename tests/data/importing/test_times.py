"""Times in every form that benches write are seconds, and names of files state temperatures and not rates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel import import_case
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.ambient import temperature_in
from jaxmodel.data.tables.times import parse_times
from tests.data.importing.benches import motor_log

SECONDS = np.array([0.0, 1.5, 61.0, 3723.25, 90_061.0])


def clock(seconds: float) -> str:
    return f"{int(seconds // 3600)}:{int(seconds % 3600 // 60):02d}:{seconds % 60:05.2f}"


def with_days(seconds: float) -> str:
    return f"{int(seconds // 86_400)}d {clock(seconds % 86_400)}"


@pytest.mark.parametrize(
    ("column", "unit"),
    [
        (SECONDS, "s"),
        (SECONDS / 60.0, "min"),
        (SECONDS / 3600.0, "h"),
        (1e3 * SECONDS, "ms"),
        ([clock(s) for s in SECONDS], ""),
        ([clock(s).replace(".", ",") for s in SECONDS], ""),
        ([with_days(s) for s in SECONDS], ""),
        (pd.to_timedelta(SECONDS, unit="s"), ""),
    ],
    ids=["s", "min", "h", "ms", "h:min:s", "decimal comma", "days", "timedelta"],
)
def test_elapsed_times_are_seconds(column, unit: str):
    times = parse_times(pd.Series(column), unit)
    assert times is not None
    assert not times.absolute
    np.testing.assert_allclose(times.seconds, SECONDS, atol=1e-9)


START = pd.Timestamp("2024-03-04 22:00:00")


@pytest.mark.parametrize(
    "write",
    [
        lambda stamps: stamps,
        lambda stamps: stamps.dt.strftime("%Y-%m-%d %H:%M:%S.%f"),
        lambda stamps: stamps.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        lambda stamps: stamps.dt.strftime("%d.%m.%Y %H:%M:%S.%f"),
        lambda stamps: stamps.dt.strftime("%m/%d/%Y %H:%M:%S.%f"),
        lambda stamps: stamps.astype("int64") / 1e9 if stamps.dt.unit == "ns" else stamps.astype("int64") / 1e6,
        lambda stamps: (stamps - pd.Timestamp("1899-12-30")) / pd.Timedelta(days=1),
    ],
    ids=["datetime", "ISO", "ISO with Z", "day first", "month first", "since 1970", "spreadsheet"],
)
def test_time_stamps_are_seconds_apart(write):
    stamps = pd.Series(START + pd.to_timedelta(SECONDS, unit="s"))
    times = parse_times(pd.Series(write(stamps)), "")
    assert times is not None
    assert times.absolute
    np.testing.assert_allclose(times.seconds - times.seconds[0], SECONDS, atol=1e-4)


@given(st.lists(st.integers(0, 10**7), min_size=2, max_size=20).map(sorted))
def test_any_duration_comes_back(seconds: list[int]):
    times = parse_times(pd.Series([clock(float(s)) for s in seconds]), "")
    assert times is not None
    np.testing.assert_allclose(times.seconds, seconds)


@pytest.mark.parametrize(
    ("name", "first", "found"),
    [
        ("hppc_p25degC", None, 25.0),
        ("drive_us06_n20degC", -18.9, -20.0),
        ("log -10 degC", None, -10.0),
        ("Zelle_45°C_3", 45.3, 45.0),
        ("K2 Discharge Test 20C", 20.7, 20.0),
        ("cc2C", 23.0, None),
        ("cell1_cc3C", 23.0, None),
        ("pulse_20C", 45.0, None),
        ("run_12", 20.0, None),
        ("trise_from_n20degC", 20.0, None),
    ],
)
def test_a_name_states_a_temperature_and_not_a_rate(name: str, first: float | None, found: float | None):
    assert temperature_in(name, first) == found


@pytest.mark.parametrize(("name", "step_s"), [("Timestamp", 0.02), ("time", 0.01), ("t", 0.002)])
def test_whole_numbers_of_a_motor_may_be_milliseconds(tmp_path: Path, name: str, step_s: float):
    log = motor_log(step_s=step_s)
    log.insert(0, name, np.arange(len(log)) * round(1000 * step_s))
    log = log.drop(columns="time_s")
    log.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(MeasurementError, match=f"'{name}' states no unit.* 4 s if in ms.*--unit \"{name}=ms\""):
        import_case(tmp_path / "log.csv", "motor", ambient=25.0)
    (run,) = import_case(tmp_path / "log.csv", "motor", ambient=25.0, units={name: "ms"}).runs
    np.testing.assert_allclose(run.log.time_s, np.arange(len(log)) * step_s)


def test_rows_a_second_apart_are_seconds_and_may_be_milliseconds(tmp_path: Path):
    log = motor_log(step_s=0.02)
    log.assign(time_s=np.arange(len(log))).rename(columns={"time_s": "time"}).to_csv(tmp_path / "log.csv", index=False)
    imported = import_case(tmp_path / "log.csv", "motor", ambient=25.0)
    (finding,) = [one for one in imported.findings if one.what == "unit assumed"]
    assert '--unit "time=ms"' in finding.sentence


@pytest.mark.parametrize(
    ("name", "factor"), [("s", 1.0), ("[s]", 1.0), ("ms", 1000.0), ("seconds", 1.0), ("t_sec", 1.0)]
)
def test_a_clock_called_by_its_unit_is_in_that_unit(tmp_path: Path, name: str, factor: float):
    log = motor_log()
    log.assign(time_s=factor * log.time_s).rename(columns={"time_s": name}).to_csv(tmp_path / "log.csv", index=False)
    imported = import_case(tmp_path / "log.csv", "motor", ambient=25.0)
    np.testing.assert_allclose(imported.runs[0].log.time_s, log.time_s, atol=1e-9)
    assert not [one for one in imported.findings if one.what in ("unit assumed", "column by its looks")]
