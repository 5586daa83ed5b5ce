"""A clock that states no unit, or counts rows: what the head or other readings tell of it, and what a person must."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import Imported, import_case

COUNT = np.arange(4000)


def motor(step_s: float, tau_s: float = 0.08) -> pd.DataFrame:
    """A first-order motor of 0.05 V s/rad that is stepped between 2 and 6 V twice a thousand rows, with noise."""
    volts = np.where(COUNT // 500 % 2 == 0, 6.0, 2.0)
    speed, found = 0.0, []
    for each in volts:
        speed += (each / 0.05 - speed) * step_s / tau_s
        found.append(speed)
    speeds = np.array(found) + 0.05 * np.random.default_rng(0).standard_normal(COUNT.size)
    angle = np.cumsum(found) * step_s
    frame = {"time": COUNT, "voltage_V": volts, "speed_rad_s": speeds, "shaft_angle_rad": angle}
    return pd.DataFrame(frame)


def imported(file: Path, frame: pd.DataFrame, kind: str = "motor", head: str = "", **options) -> Imported:
    file.write_text(head + frame.to_csv(index=False))
    options |= {"load": "free"} if kind == "motor" else {}
    return import_case(file, kind, ambient=22.0, progress=False, **options)  # pyrefly: ignore[bad-argument-type]


@pytest.mark.parametrize("step_s", [0.001, 0.01, 0.002])
def test_an_angle_and_its_speed_tell_what_a_clock_counts(tmp_path: Path, step_s: float):
    one = imported(tmp_path / "log.csv", motor(step_s))
    np.testing.assert_allclose(one.runs[0].log.time_s, COUNT * step_s, rtol=1e-9)
    (said,) = [finding.sentence for finding in one.findings if finding.what == "unit assumed"]
    assert "'shaft_angle_rad' rises by 'speed_rad_s' times it" in said


def test_an_angle_whose_speed_states_no_unit_tells_nothing(tmp_path: Path):
    frame = motor(0.001).rename(columns={"speed_rad_s": "speed"})
    with pytest.raises(MeasurementError, match="states no unit"):
        imported(tmp_path / "log.csv", frame)


@pytest.mark.parametrize("head", ["Sample rate: 100 Hz\n", "# fs = 100\n", "Ts;0.01\n", "Sampling interval (ms),10\n"])
def test_the_head_of_a_file_tells_what_a_clock_counts(tmp_path: Path, head: str):
    one = imported(tmp_path / "log.csv", motor(0.01).drop(columns="shaft_angle_rad"), head=head)
    np.testing.assert_allclose(one.runs[0].log.time_s, COUNT * 0.01, rtol=1e-9)


def test_a_clock_with_a_unit_is_not_what_the_head_says(tmp_path: Path):
    """The head may speak of the device, and the file was thinned."""
    frame = motor(1.0, tau_s=2.0).drop(columns="shaft_angle_rad").rename(columns={"time": "time_s"})
    one = imported(tmp_path / "log.csv", frame, head="Sample rate: 100 Hz\n")
    np.testing.assert_array_equal(one.runs[0].log.time_s, COUNT)


def test_rows_of_a_motor_that_follows_slowly_are_no_seconds(tmp_path: Path):
    frame = motor(0.001).drop(columns="shaft_angle_rad")
    with pytest.raises(MeasurementError) as error:
        imported(tmp_path / "log.csv", frame)
    for part in ("counts rows", "the speed needs 5", '"time=ms"', "--seconds-per-row S"):
        assert part in str(error.value)
    stated = import_case(tmp_path / "log.csv", "motor", ambient=22.0, load="free", units={"time": "ms"}, progress=False)
    assert stated.runs[0].log.time_s[-1] == pytest.approx(3.999)


def test_rows_of_a_motor_that_follows_at_once_may_be_seconds(tmp_path: Path):
    one = imported(tmp_path / "log.csv", motor(1.0, tau_s=1.5).drop(columns="shaft_angle_rad"))
    assert one.runs[0].log.time_s[-1] == COUNT[-1]
    (said,) = [finding.sentence for finding in one.findings if finding.what == "unit assumed"]
    assert "--seconds-per-row" in said


@pytest.mark.parametrize(("step_s", "unit"), [(60.0, "min"), (1.0, ""), (10.0, "counts of 10 s")])
def test_a_testers_charge_tells_what_its_clock_counts(tmp_path: Path, step_s: float, unit: str):
    current = np.where(COUNT[:400] < 20, 0.0, 0.5 * 60.0 / step_s)
    taken = np.cumsum(current) * step_s / 3600.0
    voltage = 4.18 - 0.3 * taken / taken[-1] - 0.02 * current
    frame = {"time": COUNT[:400], "current_A": current, "voltage_V": voltage, "discharge_capacity_Ah": taken}
    one = imported(tmp_path / "log.csv", pd.DataFrame(frame), "cell", sign="discharge-positive")
    assert one.runs[0].log.time_s[-1] == pytest.approx(399 * step_s)
    said = [finding.sentence for finding in one.findings if finding.what == "unit assumed"]
    assert [unit in sentence for sentence in said] == ([True] if unit else [])
