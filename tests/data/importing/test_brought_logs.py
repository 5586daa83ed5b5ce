"""Small habits of loggers, cyclers and programs of users: names, clocks, counts, marks and fields."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.io

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import Imported
from jaxmodel.data.tables.names import parse_name
from jaxmodel.data.tables.times import unit_by_stamps
from tests.data.importing.benches import cell_log, motor_log, stamps


def write(folder: Path, frame: pd.DataFrame, name: str = "log.csv", head: str = "", **form: Any) -> Path:
    path = folder / name
    path.write_text(head + frame.to_csv(index=False, **form), encoding="utf-8")
    return path


def about(imported: Imported, what: str) -> list[str]:
    return [one.sentence for one in imported.findings if one.what == what]


# Names and units


@pytest.mark.parametrize(
    "names",
    [
        "Tempo_s,Corrente_A,Tensao_V,Temperatura_C",
        "Tiempo (s),Corriente (A),Tensión (V),Temperatura (°C)",
        "Temps écoulé [s],Courant [A],Tension [V],Température [°C]",
        "Time in s,Current in A,Potential in V,Temperature in °C",
        "Cumulative Time,mAmps,Volts,T1[\ufffdC]",
    ],
)
def test_names_in_other_words_are_known(tmp_path: Path, names: str):
    log = cell_log()[["time_s", "current_A", "voltage_V", "temperature_degC"]]
    scaled = log.assign(current_A=1000.0 * log.current_A) if "mAmps" in names else log
    imported = import_case(write(tmp_path, scaled.set_axis(names.split(","), axis=1)), "cell", ambient=25.0)
    run = imported.runs[0].log
    for target, name in (
        ("current_A", "current_A"),
        ("voltage_V", "voltage_V"),
        ("cell_temperature_degC", "temperature_degC"),
    ):
        np.testing.assert_allclose(run.columns[target], log[name], err_msg=target)
    np.testing.assert_allclose(run.time_s, log.time_s)
    assert not about(imported, "column by its looks")


def test_a_unit_may_stand_behind_in():
    assert parse_name("Angle in deg") == ("angle", "deg")
    assert parse_name("Voltage in total") == ("voltage in total", "")


def test_an_encoder_without_a_voltage_is_asked_for_its_voltage(tmp_path: Path):
    log = motor_log()
    angle = np.degrees(np.cumsum(log.speed_rad_s) * 0.01)
    path = write(tmp_path, pd.DataFrame({"Timestamp": log.time_s, "Angle in deg": angle}))
    options: dict[str, Any] = {"ambient": 20.0, "constants": {"load_torque_Nm": 0.0}}
    with pytest.raises(MeasurementError, match=r"no column is voltage_V .*--constant voltage_V=VALUE"):
        import_case(path, "motor", **options)
    options["constants"] = {"load_torque_Nm": 0.0, "voltage_V": 12.0}
    assert "speed_rad_s" in import_case(path, "motor", **options).runs[0].log.columns


# Clocks


@pytest.mark.parametrize(("unit", "seconds"), [("min", 60.0), ("h", 3600.0), ("ms", 1e-3), ("s", 1.0), ("d", 86_400.0)])
def test_time_stamps_tell_the_unit_of_elapsed_times(tmp_path: Path, unit: str, seconds: float):
    log = cell_log()
    form = "%Y-%m-%d %H:%M:%S"
    frame = log.drop(columns=["time_s", "step"]).assign(TestTime=log.time_s / seconds + 0.0, Stamp=stamps(log, form))
    imported = import_case(write(tmp_path, frame), "cell", ambient=25.0)
    np.testing.assert_allclose(imported.runs[0].log.time_s, log.time_s, atol=1e-6)
    assert not about(imported, "unit assumed") + about(imported, "clock drift")
    assert any(one.about == "clock" and one.why == f"numbers in {unit}" for one in imported.decisions)


def test_stamps_that_fit_no_unit_tell_none():
    assert unit_by_stamps(np.arange(9.0), 17.0 * np.arange(9.0)) is None
    assert unit_by_stamps(np.arange(3.0), np.arange(3.0)) is None


def test_stamps_rounded_to_the_hundredth_of_a_day_do_not_jump(tmp_path: Path):
    log = cell_log()
    days = np.round(43_374.42 + log.time_s / 86_400.0, 2)
    path = write(tmp_path, log.drop(columns="step").assign(date_stamp=days))
    assert not about(import_case(path, "cell", ambient=25.0), "clock jump")


def test_a_night_between_two_drives_is_no_load(tmp_path: Path):
    log = cell_log()[:400].drop(columns="step")
    rest = log[:1].assign(time_s=4000.0, current_A=0.0)
    later = log[62:300].assign(time_s=lambda part: part.time_s + 40_000.0)
    path = write(tmp_path, pd.concat([log[60:380], rest, later]))
    imported = import_case(path, "cell", ambient=25.0)
    assert [run.log.rows for run in imported.runs] == [321, 238]
    assert "no charge is counted over it" in about(imported, "gap")[0]


# The sign of the current


def counted(log: pd.DataFrame, step_s: float = 10.0) -> pd.DataFrame:
    into, out = (np.maximum(sign * log.current_A, 0.0).cumsum() * step_s / 3600.0 for sign in (-1.0, 1.0))
    return log.drop(columns="step").assign(Charge_Capacity=into, Discharge_Capacity=out, current_A=log.current_A.abs())


def test_a_testers_counts_of_charge_tell_magnitudes_apart(tmp_path: Path):
    log = cell_log()
    imported = import_case(write(tmp_path, counted(log)), "cell", ambient=25.0)
    np.testing.assert_allclose(imported.runs[0].log.columns["current_A"], log.current_A)
    assert any("its count of charge tells it" in one.why for one in imported.decisions)


def test_a_charge_whose_voltage_falls_at_first_is_a_charge_by_its_count(tmp_path: Path):
    log = cell_log()[542:].reset_index(drop=True)
    drop = np.where(log.current_A < 0.0, -0.3 + 0.15 * (log.index > 400), 0.0)
    imported = import_case(write(tmp_path, counted(log.assign(voltage_V=log.voltage_V + drop))), "cell", ambient=25.0)
    np.testing.assert_allclose(imported.runs[0].log.columns["current_A"], log.current_A)
    assert not about(imported, "charge count")


@pytest.mark.parametrize(
    "head", ["EC-Lab ASCII FILE\nNb header lines : 3\n\n", "~Resultfile from Basytec Battery Test System\n~\n"]
)
def test_a_maker_who_names_itself_in_the_head_fixes_the_sign(tmp_path: Path, head: str):
    log = cell_log()[50:90].assign(voltage_V=3.7, current_A=lambda part: -part.current_A)
    frame = log[["time_s", "current_A", "voltage_V"]].set_axis(["time/s", "I/A", "Ecell/V"], axis=1)
    imported = import_case(write(tmp_path, frame, "log.txt", head, sep="\t"), "cell", ambient=25.0, capacity_Ah=3.0)
    assert imported.runs[0].log.columns["current_A"].max() == 6.0
    assert any("its current is positive on charge" in one.why for one in imported.decisions)


def test_one_clear_step_of_the_voltage_settles_the_sign(tmp_path: Path):
    log = cell_log()[30:64].drop(columns="step")
    step = log.assign(voltage_V=np.where(log.current_A > 0.0, 3.95, 4.0))
    run = import_case(write(tmp_path, step), "cell", ambient=25.0).runs[0].log
    assert run.columns["current_A"].max() == 6.0
    small = log.assign(voltage_V=np.where(log.current_A > 0.0, 3.998, 4.0))
    with pytest.raises(MeasurementError, match="--sign"):
        import_case(write(tmp_path, small), "cell", ambient=25.0)


# Files


def test_lines_of_json_are_read_whatever_the_file_is_called(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V"]]
    path = tmp_path / "LOG.TXT"
    path.write_text("\n".join(json.dumps(row) for row in log.to_dict("records")))
    np.testing.assert_allclose(import_case(path, "cell", ambient=25.0).runs[0].log.columns["voltage_V"], log.voltage_V)
    path.write_text(json.dumps(log.to_dict("list"), indent=1))
    assert len(read_table(path).frame) == len(log)
    path.write_text("[Summary]\nmade by: nobody\n[Data]\n" + log.to_csv(index=False))
    assert read_table(path).format == "text"


def vesc(log: pd.DataFrame) -> pd.DataFrame:
    """Readings under the names of libraries that ask a VESC for them."""
    return pd.DataFrame(
        {
            "t": log.time_s / 100.0,
            "avgMotorCurrent": 2.0 * log.current_A.abs(),
            "avgInputCurrent": log.current_A.abs(),
            "dutyCycleNow": 0.5,
            "rpm": 7000.0,
            "inpVoltage": 4.0 * log.voltage_V,
            "mosfet_temp": 40.7,
            "wattHours": 0.04,
        }
    )


def test_the_rpm_of_a_vesc_is_electrical(tmp_path: Path):
    path = write(tmp_path, vesc(cell_log()))
    with pytest.raises(MeasurementError, match="no column is load_torque_Nm"):
        import_case(path, "robot", ambient=20.0)
    imported = import_case(path, "robot", ambient=20.0, columns={"speed_rad_s": "rpm * 0.10472 / 7"})
    columns = imported.runs[0].log.columns
    assert {"pack_voltage_V", "pack_current_A", "motor_current_A", "duty"} <= columns.keys()
    np.testing.assert_allclose(columns["speed_rad_s"], 104.72)
    assert any("rpm * 0.10472 / PAIRS" in one.value for one in imported.decisions)


def test_a_log_of_leaf_spy_is_its_mean_cell(tmp_path: Path):
    log = cell_log().assign(current_A=lambda f: 20.0 * f.current_A)
    soc = 1.0 - np.cumsum(log.current_A) * 10.0 / 3600.0 / 60.0
    cells = {f"CP{n}": (-1 if n % 3 else 1) * (1000.0 * log.voltage_V).round().astype(int) for n in range(1, 97)}
    frame = pd.DataFrame(
        {
            "Date/Time": stamps(log, "%d/%m/%Y %H:%M"),
            "Gids": 343,
            "SOC": (1e6 * soc).round().astype(int),
            "Pack Volts": 96.0 * log.voltage_V,
            "Pack Amps": log.current_A,
            "Pack T1 F": 77.0,
            "Pack T1 C": log.temperature_degC,
            "Pack T3 C": "none",
            **cells,
            "12v Bat Amps": 0.75,
            "Ambient": 8,
            "epoch time": 1_580_372_664 + log.time_s.astype(int),
            "Speed1": 3683,
        }
    )
    imported = import_case(write(tmp_path, frame), "cell", ambient=25.0, columns={"soc": "SOC"})
    columns = imported.runs[0].log.columns
    np.testing.assert_allclose(columns["voltage_V"], log.voltage_V, atol=1e-3)
    np.testing.assert_allclose(columns["current_A"], log.current_A)
    np.testing.assert_allclose(columns["soc"], soc, atol=1e-5)
    np.testing.assert_allclose(imported.runs[0].log.time_s, log.time_s)


def test_a_state_of_charge_that_another_program_computed_is_no_reading(tmp_path: Path):
    log = cell_log()
    frame = log.assign(SOC=100.0 - 100.0 * log.current_A.cumsum() * 10.0 / 3600.0 / 3.0).drop(columns="step")
    path = write(tmp_path, frame)
    plain = import_case(path, "cell", ambient=25.0)
    assert "soc" not in plain.runs[0].log.columns
    assert "soc" not in plain.case.runs[0].measured.outputs
    assert "left out" in [one.value for one in plain.decisions if one.about == "soc"]
    assert "soc" in import_case(path, "cell", ambient=25.0, columns={"soc": "SOC"}).case.runs[0].measured.outputs


def test_what_a_program_prints_between_rows_is_no_line_of_names(tmp_path: Path):
    path = tmp_path / "monitor.log"
    rows = [f"{4000 - 3 * n} {330 - n} {200 + n % 7}" for n in range(60)]
    path.write_text("\n".join(["START", "EEPROM values=0x22 0x67 0x7E", *rows]))
    assert [*read_table(path).frame] == ["column 1", "column 2", "column 3"]


def test_drives_that_each_move_little_tell_the_capacity_together(tmp_path: Path):
    log = cell_log(step_s=5.0)
    paths = []
    for name, begin in (("a", 400), ("b", 600)):
        part = log[begin : begin + 110].assign(
            soc=lambda f: 100.0 - 100.0 * (f.current_A.cumsum() * 5.0 / 3600.0) / 3.0
        )
        paths.append(write(tmp_path, part.drop(columns="step"), f"{name}.csv"))
    imported = import_case(paths, "cell", ambient=25.0)
    assert imported.capacity is not None
    assert imported.capacity.value == pytest.approx(3.0, rel=0.05)
    assert imported.capacity.why == "by the log's own state of charge, in 2 runs"


# Gaps and messages of their own clock


def test_a_constant_current_goes_on_over_a_logger_that_slept(tmp_path: Path):
    log = cell_log(step_s=2.0).drop(columns="step")
    held = log[(log.time_s < 3000.0) | (log.time_s > 3600.0)]
    assert len(import_case(write(tmp_path, held), "cell", ambient=25.0).runs) == 1
    short = log[((log.time_s > 1860.0) & (log.time_s < 2100.0)) | (log.time_s > 4000.0)]
    assert len(import_case(write(tmp_path, short), "cell", ambient=25.0).runs) == 2


def test_a_voltage_that_is_sent_once_is_held(tmp_path: Path):
    log = motor_log()
    sent = pd.Series(np.nan, index=log.index)
    sent[[100, 300]] = [3.0, 0.0]
    frame = log[["time_s", "speed_rad_s"]].assign(command=sent)
    columns = {"voltage_V": "command"}
    imported = import_case(
        write(tmp_path, frame), "motor", ambient=25.0, columns=columns, constants={"load_torque_Nm": 0.0}
    )
    voltage = imported.runs[0].log.columns["voltage_V"]
    assert set(voltage[:100]) == {0.0}
    assert set(voltage[100:300]) == {3.0}
    assert set(voltage[300:]) == {0.0}
    assert "held until it is set anew" in about(imported, "gap in an input")[0]


# Times and columns of a second choice


def test_minutes_and_seconds_of_a_spreadsheet_go_on_after_an_hour(tmp_path: Path):
    log = cell_log()
    texts = [f"{int(s // 60) % 60:02d}:{s % 60:04.1f}" for s in log.time_s + 2583.0]
    frame = log.drop(columns=["time_s", "step"])
    frame.insert(0, "datetime", texts)
    imported = import_case(write(tmp_path, frame), "cell", ambient=25.0)
    np.testing.assert_allclose(imported.runs[0].log.time_s - imported.runs[0].log.time_s[0], log.time_s)


def test_another_column_of_time_stamps_stands_in(tmp_path: Path):
    log = cell_log()
    frame = log.drop(columns=["time_s", "step"]).assign(datetime="unknown", timestamp=1_684_230_233 + log.time_s)
    np.testing.assert_allclose(import_case(write(tmp_path, frame), "cell", ambient=25.0).runs[0].log.time_s, log.time_s)


def test_a_bracket_in_the_middle_of_a_name_is_no_unit():
    assert parse_name("knee[ActPack]:motor_current").unit == ""
    assert parse_name("Speed (rot/fortnight)").unit == "rot/fortnight"


def test_a_scope_calls_its_clock_an_axis(tmp_path: Path):
    log = cell_log()[["time_s", "voltage_V", "current_A"]]
    path = write(tmp_path, log.set_axis(["second", "Volt", "Ampere"], axis=1), head="x-axis,1,2\n")
    run = import_case(path, "cell", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.time_s, log.time_s)
    np.testing.assert_allclose(run.columns["current_A"], log.current_A)


def test_the_signal_of_an_encoder_is_no_voltage_of_a_motor(tmp_path: Path):
    log = motor_log()[["time_s", "current_A"]].assign(encoder_V=3.39)
    with pytest.raises(MeasurementError, match=r"beside current_A.*--column speed_rad_s="):
        import_case(write(tmp_path, log), "motor", ambient=25.0, constants={"load_torque_Nm": 0.0})


def test_units_in_columns_of_their_own_count(tmp_path: Path):
    log = cell_log()
    frame = log[["time_s", "current_A", "voltage_V"]].assign(**{"Aux #1": log.temperature_degC, " Units": " C  "})
    run = import_case(write(tmp_path, frame, sep="\t"), "cell", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.columns["cell_temperature_degC"], log.temperature_degC)
    absent = import_case(write(tmp_path, frame.assign(**{"Aux #1": -2501.7}), sep="\t"), "cell", ambient=25.0)
    assert "-2502 degC, as of a sensor that is not there" in about(absent, "no sensor")[0]


def test_replies_of_an_instrument_that_end_in_a_new_line_are_one_row(tmp_path: Path):
    log = cell_log()
    path = tmp_path / "log.csv"
    rows = [
        f'{n},{t},"{u:+.5E}\n",{i}'
        for n, (t, u, i) in enumerate(zip(log.time_s, log.voltage_V, log.current_A, strict=True))
    ]
    path.write_text("\n".join([",time_s,voltage,current", *rows]))
    run = import_case(path, "cell", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.columns["voltage_V"], log.voltage_V, atol=1e-4)
    np.testing.assert_allclose(run.columns["current_A"], log.current_A)


def test_microvolts_of_a_shunt_are_no_voltage_of_a_motor(tmp_path: Path):
    log = motor_log().assign(voltage_V=lambda f: 1e-8 * f.voltage_V)
    with pytest.raises(MeasurementError, match="which no motor has: state the --unit"):
        import_case(write(tmp_path, log), "motor", ambient=25.0)


def test_a_current_of_thousands_without_a_unit_is_in_milliamperes(tmp_path: Path):
    log = cell_log().drop(columns="step")
    frame = log.assign(current_A=1000.0 * log.current_A).rename(columns={"current_A": "current"})
    imported = import_case(write(tmp_path, frame), "cell", ambient=25.0)
    np.testing.assert_allclose(imported.runs[0].log.columns["current_A"], log.current_A)
    assert "taken as mA" in about(imported, "unit assumed")[0]


def test_columns_that_only_look_like_a_cell_must_agree(tmp_path: Path):
    random = np.random.default_rng(5)
    columns = [np.arange(300) * 60, 1700 + random.normal(0.0, 60.0, 300), np.abs(random.normal(0.0, 0.5, 300))]
    path = tmp_path / "log.csv"
    pd.DataFrame(np.column_stack(columns)).to_csv(path, index=False, header=False)
    with pytest.raises(MeasurementError, match="sign of the current is not settled"):
        import_case(path, "cell", ambient=25.0)


# Loggers of benches and consoles


@pytest.mark.parametrize("names", [None, "millis;volt;mA"])
@pytest.mark.parametrize("blanks", [False, True])
def test_a_serial_monitor_puts_a_time_before_each_line(tmp_path: Path, names: str | None, blanks: bool):
    log = cell_log()
    rows = [
        f"{1000 * t:.0f};{u};{1000 * i:.0f}" for t, u, i in zip(log.time_s, log.voltage_V, log.current_A, strict=True)
    ]
    mark = " " if blanks else ";"
    lines = [line.replace(";", mark) for line in ([names] if names else []) + rows]
    path = tmp_path / "console.txt"
    arrival = stamps(pd.DataFrame({"time_s": np.arange(len(lines)) * 10.0}), "%H:%M:%S.250")
    path.write_text("\n".join(f"{at} -> {line}" for at, line in zip(arrival, lines, strict=True)))
    run = import_case(path, "cell", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.time_s, log.time_s)
    np.testing.assert_allclose(run.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.columns["voltage_V"], log.voltage_V)


def test_milliseconds_behind_a_colon_are_parts_of_a_second(tmp_path: Path):
    log = cell_log()
    scan = pd.DataFrame(
        {
            "Time": stamps(log, "%m/%d/%Y %H:%M:%S:250"),
            "101 <Voltage> (VDC)": log.voltage_V,
            "102 <Current> (ADC)": log.current_A,
            "103 <Surface> (C)": log.temperature_degC,
        }
    )
    imported = import_case(write(tmp_path, scan, head="Data Logger\n\n"), "cell", ambient=25.0)
    run = imported.runs[0].log
    np.testing.assert_allclose(run.time_s, log.time_s)
    np.testing.assert_allclose(run.columns["cell_temperature_degC"], log.temperature_degC)
    assert any(one.why == "the only column in a unit of temperature" for one in imported.decisions)


def test_two_columns_in_degrees_are_not_guessed(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V"]].assign(**{"left (C)": 25.0, "right (C)": 26.0})
    columns = import_case(write(tmp_path, log), "cell", ambient=25.0).runs[0].log.columns
    assert "cell_temperature_degC" not in columns


def test_the_time_to_go_is_no_clock(tmp_path: Path):
    log = cell_log()
    frame = log[["voltage_V", "current_A"]].assign(**{"Time to go": np.nan})
    frame.insert(0, "Europe/Vienna (+01:00)", stamps(log, "%Y-%m-%d %H:%M:%S"))
    np.testing.assert_allclose(import_case(write(tmp_path, frame), "cell", ambient=25.0).runs[0].log.time_s, log.time_s)


def test_a_mark_between_names_and_rows_hides_no_names(tmp_path: Path):
    log = motor_log()
    body = log[["time_s", "voltage_V", "current_A", "speed_rad_s"]].to_csv(index=False, header=False)
    rows = "".join(f",{line}\n" for line in body.splitlines())
    head = "origin,host\n\ntrace_title,time,Voltage,Current,Speed\ntrace_unit,s,V,A,rad/s\ntrace_values\n"
    path = tmp_path / "desk.csv"
    path.write_text(head + rows)
    run = import_case(path, "motor", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.columns["speed_rad_s"], log.speed_rad_s)
    np.testing.assert_allclose(run.columns["voltage_V"], log.voltage_V)


def test_the_velocity_of_an_encoder_is_no_angle_and_a_bus_no_winding(tmp_path: Path):
    log = motor_log()
    frame = pd.DataFrame(
        {
            "time": log.time_s,
            "vbus_voltage": 24.0,
            "axis0.current_control.Iq_measured": log.current_A,
            "axis0.encoder.vel_estimate": log.speed_rad_s / 2.0 / np.pi,
            "axis0.encoder.pos_estimate": np.cumsum(log.speed_rad_s) * 0.01 / 2.0 / np.pi,
        }
    )
    with pytest.raises(MeasurementError, match="neither a voltage nor a load torque"):
        import_case(write(tmp_path, frame), "motor", ambient=25.0)
    imported = import_case(write(tmp_path, frame), "motor", ambient=25.0, columns={"voltage_V": "vbus_voltage"})
    assert {"speed_rad_s", "current_A"} <= imported.runs[0].log.columns.keys()
    assert not about(imported, "commanded")


def test_a_potential_against_a_reference_is_in_volts(tmp_path: Path):
    log = cell_log()
    rows = zip(log.time_s, log.voltage_V, log.current_A, strict=True)
    body = "\n".join(f"\t{n}\t{t:g}\t{u}\t0\t{i}" for n, (t, u, i) in enumerate(rows))
    path = tmp_path / "discharge.DTA"
    path.write_text("EXPLAIN\nTAG\tPWR800\nCURVE\tTABLE\n\tPt\tT\tVf\tVu\tIm\n\t#\ts\tV vs. Ref.\tV\tA\n" + body)
    run = import_case(path, "cell", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.columns["voltage_V"], log.voltage_V)
    np.testing.assert_allclose(run.time_s, log.time_s)


def test_elements_of_cell_arrays_are_runs(tmp_path: Path):
    log = cell_log()
    parts = [log, log[:900], log[:950]]
    cells = {}
    for name, column in {"t": "time_s", "It": "current_A", "Vt": "voltage_V"}.items():
        cells[name] = np.empty((3, 1), dtype=object)
        for place, part in enumerate(parts):
            cells[name][place, 0] = part[column].to_numpy()[:, None]
    other = np.empty((3, 1), dtype=object)
    other[:, 0] = [np.arange(5.0), np.arange(6.0), np.arange(7.0)]
    path = tmp_path / "tests.mat"
    scipy.io.savemat(path, {**cells, "Pulses": other})
    columns = {"current_A": "It", "voltage_V": "Vt", "time_s": "t"}
    runs = import_case(path, "cell", ambient=25.0, columns=columns).runs
    assert [(run.log.name, run.log.rows) for run in runs] == [
        ("tests-run 1", 1022),
        ("tests-run 2", 900),
        ("tests-run 3", 950),
    ]
    scipy.io.savemat(path, {"meas": log[["time_s", "current_A", "voltage_V"]].to_numpy()})
    assert read_table(path).key == ""


def test_a_first_row_of_0_V_is_no_charge(tmp_path: Path):
    log = cell_log()[:450].drop(columns="step").reset_index(drop=True)
    log.loc[0, "voltage_V"] = 0.0
    log.loc[:59, "current_A"] = 0.0
    log.loc[1:5, "current_A"] = 2.0
    run = import_case(write(tmp_path, log), "cell", ambient=25.0, capacity_Ah=3.0).runs[0].log
    assert run.columns["current_A"].min() == 0.0


def test_a_motor_that_turns_at_no_voltage_is_doubted(tmp_path: Path):
    log = motor_log().assign(voltage_V=0.0)
    imported = import_case(write(tmp_path, log), "motor", ambient=25.0)
    (sentence,) = about(imported, "no drive")
    assert "voltage_V is 0 in every row" in sentence
    assert not about(import_case(write(tmp_path, motor_log()), "motor", ambient=25.0), "no drive")
