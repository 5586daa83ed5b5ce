"""Clocks, signs, starts and capacities of logs as people bring them, of which no file says what it is."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import Imported, import_case
from tests.conftest import Wild


def cell(
    parts: Sequence[tuple[float, float]], soc: float, capacity_Ah: float = 2.0, step_s: float = 10.0
) -> pd.DataFrame:
    """A layered oxide of 40 mohm, 3.0 + 1.2 SOC; parts of seconds and amperes, positive on discharge."""
    current = np.concatenate([np.full(int(seconds / step_s), amperes) for seconds, amperes in parts])
    socs = soc - np.cumsum(current) * step_s / 3600.0 / capacity_Ah
    voltage = np.round(3.0 + 1.2 * socs - 0.04 * current, 4)
    return pd.DataFrame({"time_s": np.arange(current.size) * step_s, "current_A": current, "voltage_V": voltage})


def imported(folder: Path, kind: str = "cell", options: dict | None = None, **frames: pd.DataFrame) -> Imported:
    files = [folder / f"{name}.csv" for name in frames]
    for file, frame in zip(files, frames.values(), strict=True):
        frame.to_csv(file, index=False)
    return import_case(files, kind, ambient=22.0, **(options or {}))  # pyrefly: ignore[bad-argument-type]


def sentences(one: Imported, what: str) -> list[str]:
    return [finding.sentence for finding in one.findings if finding.what == what]


FULL = [(60.0, 0.0), (3400.0, 2.0), (600.0, 0.0)]  # 94 % of 2 A h


# Clocks


def test_the_clock_of_a_scooter_is_its_milliseconds(wild: Wild):
    (file,) = wild("06-clock-in-whole-milliseconds")
    one = import_case(file, "cell", ambient=22.0, cells_in_series=10, parallel_cells=3, capacity_Ah=3.0)
    assert one.runs[0].log.time_s[-1] == pytest.approx(599.5)


def test_millis_of_a_motor_are_milliseconds(wild: Wild):
    (file,) = wild("29-millis-as-seconds")
    columns = {"voltage_V": "motorCommand / 255 * batteryVoltage / 1000"}
    one = import_case(file, "motor", ambient=22.0, columns=columns, constants={"load_torque_Nm": 0.0})
    assert one.runs[0].log.time_s[-1] == pytest.approx(86.9)


@pytest.mark.parametrize(
    ("name", "factor", "start"),
    [("uptime_ms", 1e3, 7e6), ("micros", 1e6, 5e8), ("tick_us", 1e6, 1e3), ("millis", 1e3, 0)],
)
def test_a_clock_is_found_beside_what_rises_too(tmp_path: Path, name: str, factor: float, start: float):
    log = cell(FULL, 1.0)
    rising = np.linspace(20.0, 41.5, len(log))
    log = log.assign(temp_fet_max=rising, amp_hours_used=rising / 20.0, odometer=rising)
    log.insert(4, name, (start + factor * log.time_s).astype("int64"))
    one = imported(tmp_path, ride=log.drop(columns="time_s"))
    np.testing.assert_allclose(one.runs[0].log.time_s, log.time_s, atol=1e-6)


def test_what_may_be_seconds_or_milliseconds_is_asked(tmp_path: Path):
    log = cell([(60.0, 0.0), (450.0, 2.0), (60.0, 0.0)], 1.0, step_s=0.5)
    log = log.assign(time_s=(1000.0 * log.time_s).astype(int)).rename(columns={"time_s": "time"})
    with pytest.raises(MeasurementError, match=r"'time' states no unit.*6\.6 days.*9\.5 min.*--unit \"time=ms\""):
        imported(tmp_path, log=log)
    answered = import_case(tmp_path / "log.csv", "cell", ambient=22.0, ask=lambda question: "ms")
    assert answered.runs[0].log.time_s[-1] == pytest.approx(569.5)


def test_a_thermometer_is_no_clock(tmp_path: Path):
    log = cell(FULL, 1.0).assign(temp_mos=lambda f: 20.0 + 0.001 * f.time_s).drop(columns="time_s")
    with pytest.raises(MeasurementError, match="no column of time"):
        imported(tmp_path, log=log)


# Sign


def test_each_file_of_a_tester_without_signs_decides_alone(wild: Wild):
    files = wild("03-current-without-a-sign", "*charge.csv")
    by_name = {run.log.name: run.log.columns["current_A"] for run in import_case(files, "cell", ambient=22.0).runs}
    assert by_name["charge"].min() == pytest.approx(-0.6)
    assert by_name["discharge"].max() == pytest.approx(0.6)


def test_each_block_of_a_log_without_signs_decides(wild: Wild):
    one = import_case(wild("03-current-without-a-sign", "both.csv"), "cell", ambient=22.0)
    current = one.runs[0].log.columns["current_A"]
    assert (current.max(), current.min()) == (1.5, -1.2)


def magnitudes(log: pd.DataFrame, factor: float = 1.0) -> pd.DataFrame:
    return log.assign(current_A=factor * log.current_A.abs())


BOTH = [(60.0, 0.0), (1800.0, 2.0), (300.0, 0.0), (900.0, -1.0), (300.0, 0.0), (600.0, 2.0), (60.0, 0.0)]


@pytest.mark.parametrize("factor", [1.0, -1.0])
def test_magnitudes_get_the_sign_of_the_voltage_block_by_block(tmp_path: Path, factor: float):
    log = cell(BOTH, 1.0)
    one = imported(tmp_path, log=magnitudes(log, factor))
    np.testing.assert_array_equal(one.runs[0].log.columns["current_A"], log.current_A)
    (decision,) = [d for d in one.decisions if d.about == "sign of the current"]
    assert "2 blocks of discharge and 1 of charge" in decision.why
    assert "certain" not in decision.why


def test_more_discharges_than_charges_do_not_outvote_a_charge(tmp_path: Path):
    charge = cell([(60.0, 0.0), (6400.0, -1.0), (60.0, 0.0)], 0.05)
    one = imported(tmp_path, a=cell(FULL, 1.0), b=cell(FULL, 0.99), c=magnitudes(charge))
    np.testing.assert_array_equal(one.runs[2].log.columns["current_A"], charge.current_A)
    assert not sentences(one, "sign")


@pytest.mark.parametrize("words", [("D", "C", "R"), ("DChg", "Chg", "Rest"), ("CC_DISCHARGE", "CC_CHARGE", "PAUSE")])
@pytest.mark.parametrize("signed", [True, False])
def test_a_column_of_states_tells(tmp_path: Path, words: tuple[str, str, str], signed: bool):
    log = cell(BOTH, 1.0).assign(voltage_V=3.7)  # the voltage tells nothing
    state = np.where(log.current_A > 0, words[0], np.where(log.current_A < 0, words[1], words[2]))
    written = log.assign(current_A=-log.current_A) if signed else magnitudes(log)
    one = imported(tmp_path, log=written.assign(state=state))
    np.testing.assert_array_equal(one.runs[0].log.columns["current_A"], log.current_A)


# Start of charge


def test_the_highest_voltage_of_the_files_is_no_full_cell(wild: Wild):
    one = import_case(wild("08-full-is-the-highest-voltage-seen", "from*"), "cell", ambient=22.0, capacity_Ah=3.0)
    assert one.runs[0].start is not None
    assert (one.runs[0].start.value, one.runs[0].start.sd) == (0.5, 0.3)
    assert sentences(one, "initial SOC")


def test_the_plateau_of_lfp_tells_nothing(wild: Wild):
    files = wild("08-full-is-the-highest-voltage-seen", "lfp*")
    for run in import_case(files, "cell", ambient=22.0, capacity_Ah=150.0, sign="discharge-positive").runs:
        assert run.start is not None
        assert (run.start.value, run.start.sd) == (0.5, 0.3)


@pytest.mark.parametrize(("soc", "full"), [(0.98, True), (0.45, False), (0.7, False)])
def test_a_start_is_full_by_the_voltage_of_a_full_cell_only(tmp_path: Path, soc: float, full: bool):
    one = imported(tmp_path, log=cell([(60.0, 0.0), (900.0, 2.0), (60.0, 0.0)], soc), options={"capacity_Ah": 2.0})
    start = one.runs[0].start
    assert start is not None
    assert (start.value > 0.9) == full
    assert abs(start.value - soc) < 2.0 * (start.sd or 0.0)


def test_a_part_of_a_charge_ends_at_no_full_cell(tmp_path: Path):
    parts = [(60.0, 0.0), (700.0, 2.0), (60.0, 0.0), (1000.0, -2.0), (60.0, 0.0)]
    start = imported(tmp_path, log=cell(parts, 0.65), options={"capacity_Ah": 2.0}).runs[0].start
    assert start is not None
    assert start.sd == 0.3


def test_the_state_of_charge_of_the_log_is_used_and_held_against_the_voltage(tmp_path: Path):
    log = cell([(60.0, 0.0), (900.0, 2.0), (60.0, 0.0)], 0.62)
    log["SOC"] = 100.0 * (0.62 - np.cumsum(log.current_A) * 10.0 / 3600.0 / 2.0)
    one = imported(tmp_path, log=log)
    assert one.runs[0].start is not None
    assert one.runs[0].start.value == pytest.approx(0.62)
    assert one.capacity is not None
    assert one.capacity.value == pytest.approx(2.0, rel=0.01)
    assert not sentences(one, "initial SOC")
    other = cell(FULL, 1.0)
    other["SOC"] = 60.0 - 0.5 * np.arange(len(other)) / 10.0
    (said,) = sentences(imported(tmp_path, options={"capacity_Ah": 2.0}, other=other), "initial SOC")
    assert "60%" in said
    assert "100%" in said


# Charge that does not balance


def test_two_capacities_are_one_finding(wild: Wild):
    one = import_case(wild("23-two-capacities"), "cell", ambient=22.0)
    (said,) = sentences(one, "charge balance")
    assert said.startswith("3 discharges from full to the cut-off give 4.5, 4, 3.89 A h: the current of slow")
    assert one.capacity is not None
    assert abs(one.capacity.value - 3.9) <= (one.capacity.sd or 0.0) + 0.02


def test_less_in_than_out_is_one_finding_and_the_start_is_counted_back(wild: Wild):
    one = import_case(wild("12-parameterise-writes-what-nobody-reads"), "cell")
    (said,) = sentences(one, "charge balance")
    assert "from empty to full 2.03 A h go in, and 2.6 A h come out" in said
    for run in one.runs:
        assert run.start is not None
        assert run.start.value == pytest.approx(1.0 - 2.03 / 2.6, abs=0.01)


@pytest.mark.parametrize("factor", [0.85, 1.2])
def test_the_log_whose_current_is_off_is_named(tmp_path: Path, factor: float):
    good = cell([(60.0, 0.0), (3600.0, 1.9), (600.0, 0.0)], 1.0)
    odd = good.assign(current_A=factor * good.current_A)
    fine = imported(tmp_path, a=good, b=good, c=good)
    assert not sentences(fine, "charge balance")
    (said,) = sentences(imported(tmp_path, a=good, b=odd, c=good), "charge balance")
    assert "the current of b" in said


def test_what_goes_in_is_held_against_what_comes_out(tmp_path: Path):
    parts = [(600.0, 0.0), (7000.0, -1.0), (600.0, 0.0), (7000.0, 1.0), (600.0, 0.0)]
    log = cell(parts, 0.02)
    assert not sentences(imported(tmp_path, log=log), "charge balance")
    low = log.assign(current_A=log.current_A.where(log.current_A > 0.0, 0.78 * log.current_A))
    one = imported(tmp_path, log=low)
    assert len(sentences(one, "charge balance")) == 1
    assert one.capacity is not None
    assert (one.capacity.sd or 0.0) > 0.3


# Gaps, order, copies, pulses


def test_a_gap_under_load_ends_a_run(wild: Wild):
    one = import_case(wild("10-current-held-over-gaps"), "cell", ambient=22.0)
    assert [run.log.rows for run in one.runs] == [31] * 6
    assert one.capacity is not None
    assert "pulse of 625 mA h" in one.capacity.why
    assert abs(one.capacity.value - 150.0) < 2.0 * (one.capacity.sd or 0.0)


def test_no_charge_is_counted_over_a_gap_and_a_thinned_log_has_none(tmp_path: Path):
    log = cell([(60.0, 0.0), (1200.0, 2.0)], 1.0, step_s=0.5)
    late = log.assign(time_s=log.time_s + 7200.0 * (log.index > 1500))
    one = imported(tmp_path, log=late, options={"capacity_Ah": 2.0})
    assert len(one.runs) == 2
    assert sum(run.log.time_s[-1] for run in one.runs) < 1300.0
    assert len(sentences(one, "gap")) == 1
    thinned = pd.concat([log[:400], log[400::120]]).reset_index(drop=True)
    assert len(imported(tmp_path, log=thinned, options={"capacity_Ah": 2.0}).runs) == 1


def test_a_run_ends_where_a_cell_at_rest_has_another_temperature_after_a_gap(tmp_path: Path):
    """A row of the next day's program at 11 degC is none of a run at 25 degC."""
    log = cell([(60.0, 0.0), (1200.0, 2.0), (300.0, 0.0)], 1.0, step_s=5.0)
    warmth = np.where(log.index == log.index[-1], 11.4, 25.0)
    late = log.assign(time_s=log.time_s + 40_000.0 * (warmth < 20.0), cell_temperature_degC=warmth)
    one = imported(tmp_path, log=late, options={"capacity_Ah": 2.0})
    assert [run.log.rows for run in one.runs] == [len(log) - 1]
    assert "after which the temperature is another" in sentences(one, "gap")[0]
    assert "1 part of fewer than 10 rows (1 row in all) is left out" in sentences(one, "short parts")[0]
    told = imported(tmp_path, log=late.assign(ambient_degC=warmth), options={"capacity_Ah": 2.0})
    assert [run.log.rows for run in told.runs] == [len(log)], "a column says what the surroundings are"
    warm = imported(tmp_path, log=late.assign(cell_temperature_degC=25.0), options={"capacity_Ah": 2.0})
    assert [run.log.rows for run in warm.runs] == [len(log)]


def test_a_pulse_does_not_tell_the_capacity(wild: Wild, tmp_path: Path):
    one = import_case(wild("11-pulse-without-capacity"), "cell", ambient=22.0, out=tmp_path / "case")
    (said,) = sentences(one, "capacity")
    assert "a pulse of 25 mA h does not tell the capacity" in said
    assert "--capacity" in said
    assert one.case.runs


def test_a_guessed_capacity_is_not_held_against_a_pulse_of_any_size(tmp_path: Path):
    for factor in (1e-3, 1.0, 50.0):
        log = cell([(10.0, 0.0), (10.0, 3.0), (60.0, 0.0), (10.0, 6.0), (120.0, 0.0)], 1.0, step_s=0.5)
        one = imported(tmp_path, log=log.assign(current_A=factor * log.current_A))
        one.check()
        assert "does not tell the capacity" in sentences(one, "capacity")[0]


@pytest.mark.parametrize("soc", [0.85, 0.6])
@pytest.mark.parametrize("share", [0.02, 0.15, 0.4])
@pytest.mark.parametrize("rate", [0.3, 1.0])
def test_a_part_of_the_plateau_of_lfp_does_not_tell_the_capacity(tmp_path: Path, soc: float, share: float, rate: float):
    """A tenth of a volt holds half of the charge: what was moved is the least, and no more is known."""
    current = np.repeat([0.0, 100.0 * rate, 0.0], [60, int(360 * share / rate), 120])
    moved = np.cumsum(current) * 10.0 / 3600.0
    volts = np.round(3.25 + 0.1 * (soc - moved / 100.0) - 0.0005 * current, 4)
    frame = pd.DataFrame({"time_s": 10.0 * np.arange(current.size), "current_A": current, "voltage_V": volts})
    one = imported(tmp_path, log=frame, options={"sign": "discharge-positive"})
    assert one.capacity is not None
    assert not one.capacity_known
    assert one.capacity.value > moved[-1]
    assert abs(np.log(one.capacity.value / 100.0)) < 2.0 * (one.capacity.sd or 0.0) / one.capacity.value
    (said,) = sentences(one, "capacity")
    assert "does not tell" in said


@pytest.mark.parametrize(("hours", "amperes"), [(1.0, 0.1), (0.5, 0.2), (2.0, -0.05)])
def test_a_small_part_of_a_charge_that_never_rests_does_not_tell_the_capacity(
    tmp_path: Path, hours: float, amperes: float
):
    log = cell([(3600.0 * hours, amperes)], 0.6)
    one = imported(tmp_path, log=log, options={"sign": "discharge-positive"})
    assert one.capacity is not None
    assert abs(np.log(one.capacity.value / 2.0)) < 2.0 * (one.capacity.sd or 0.0) / one.capacity.value
    (said,) = sentences(one, "capacity")
    assert "does not tell" in said


def test_the_same_log_under_two_names_is_found(tmp_path: Path):
    log = cell(FULL, 1.0)
    one = imported(tmp_path, first=log, other=cell(FULL, 0.99), second=log.assign(time_s=log.time_s + 5.0))
    (said,) = sentences(one, "same log")
    assert "second.csv" in said
    assert "first.csv" in said


def test_rows_out_of_order_are_put_in_order(tmp_path: Path):
    log = cell(FULL, 1.0)
    half = len(log) // 2
    for spoilt in (log[::-1], pd.concat([log[half:], log[:half]])):
        one = imported(tmp_path, log=spoilt)
        np.testing.assert_array_equal(one.runs[0].log.columns["voltage_V"], log.voltage_V)
        assert len(sentences(one, "out of order")) == 1


def test_a_rest_gets_one_sentence(tmp_path: Path):
    rest = cell([(3000.0, 0.0)], 0.6).assign(voltage_V=lambda f: 3.72 - 1e-6 * f.time_s)
    one = imported(tmp_path, discharge=cell(FULL, 1.0), rest=rest)
    (said,) = [finding.sentence for finding in one.findings if finding.where == "rest"]
    assert "no current flows in it" in said


def test_a_guessed_capacity_accuses_no_sensor(tmp_path: Path):
    """From empty to full, and what comes out again nobody has seen."""
    one = imported(tmp_path, log=cell([(600.0, 0.0), (7000.0, -1.0), (600.0, 0.0)], 0.02))
    assert not one.capacity_known
    assert not sentences(one, "charge balance")


# Limits that a tester turns at


def cycled(low: float, high: float, capacity_Ah: float = 2.0, times: int = 3, tail: bool = True) -> pd.DataFrame:
    """A cell whose voltage rises with its charge from one limit to the other, from the middle upwards."""
    hour = 3600.0 * capacity_Ah
    turns = [(600.0, 0.0), (0.5 * hour, -1.0), *[(600.0, 0.0), (hour, 1.0), (600.0, 0.0), (hour, -1.0)] * times]
    current = np.concatenate([np.full(int(seconds / 20.0), ampere) for seconds, ampere in turns])
    soc = 0.5 - np.cumsum(current) * 20.0 / 3600.0 / capacity_Ah
    volts = low + (high - low) * (soc + 0.1 * np.sin(7.0 * soc)) - 0.005 * current
    rows = slice(None) if tail else slice(0, int(1.2 * hour / 20.0))
    return pd.DataFrame({"time_s": 20.0 * np.arange(current.size), "current_A": current, "voltage_V": volts})[rows]


@pytest.mark.parametrize(("low", "high"), [(0.05, 1.0), (1.3, 3.8), (1.5, 2.7)])
def test_limits_of_any_chemistry_tell_the_capacity(tmp_path: Path, low: float, high: float):
    """A half-cell, one of sodium, one of LTO: no voltage of theirs is that of a full cell of another kind."""
    one = imported(tmp_path, log=cycled(low, high))
    assert one.capacity is not None
    assert one.capacity.value == pytest.approx(2.0, rel=0.02)
    assert one.capacity_known
    start = one.runs[0].start
    assert start is not None
    assert start.value == pytest.approx(0.5, abs=0.03)


def test_one_charge_and_one_discharge_are_no_limits(tmp_path: Path):
    assert not imported(tmp_path, log=cycled(0.05, 1.0, tail=False)).capacity_known
