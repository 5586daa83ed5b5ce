"""A log of several motors becomes runs of each, and a log of one stays as it is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.reading import read_case
from jaxmodel.data.importing import Options, import_case
from jaxmodel.data.importing.motors import motors_in

TIME_S = np.arange(0.0, 20.0, 0.1)
SPEED = 100.0 + 20.0 * np.sin(TIME_S)


def log(folder: Path, name: str, *columns: str, scale: float = 1.0, **shared: float) -> Path:
    """A log whose columns hold speeds, or voltages and currents that belong to them, each column a little other."""
    table = {"time_s": TIME_S}
    for place, column in enumerate(columns):
        size = 0.05 if "volt" in column.lower() else 0.02 if "curr" in column.lower() else 1.0
        table[column] = scale * size * SPEED * (1.0 + 0.01 * place)
    path = folder / f"{name}.csv"
    pd.DataFrame(table | shared).to_csv(path, index=False)
    return path


def imported(*paths: Path, **decisions):
    return import_case(paths, "motor", ambient=20.0, load="unknown", progress=False, **decisions)


SIDES = ("left_motor_voltage_V", "right_motor_voltage_V", "left_motor_current_A", "right_motor_current_A",
         "left_motor_speed_rad_s", "right_motor_speed_rad_s")  # fmt: skip


@pytest.mark.parametrize(
    ("names", "motors", "bare"),
    [
        (("left_motor_current_A", "right_motor_current_A"), ["left", "right"], "motor_current_A"),
        (("motor1_pwm", "motor2_pwm", "motor1_speed_rpm", "motor2_speed_rpm"), ["motor1", "motor2"], "motor_pwm"),
        (("m0_current_A", "m1_current_A", "m2_current_A"), ["motor0", "motor1", "motor2"], "current_A"),
        (("Motor 1 Current (A)", "Motor 2 Current (A)"), ["motor1", "motor2"], "Motor Current (A)"),
        (("motor[0].speed_rpm", "motor[1].speed_rpm"), ["motor0", "motor1"], "motor.speed_rpm"),
        (("front_left_speed_rad_s", "rear_left_speed_rad_s"), ["front_left", "rear_left"], "speed_rad_s"),
        (("speed_fl_rad_s", "speed_rr_rad_s"), ["front_left", "rear_right"], "speed_rad_s"),
        (("leftMotorCurrent_A", "rightMotorCurrent_A"), ["left", "right"], "MotorCurrent_A"),
        (("motorLeftCurrent_A", "motorRightCurrent_A"), ["left", "right"], "motorCurrent_A"),
        (("current_left_A", "current_right_A"), ["left", "right"], "current_A"),
        (("current_A_left", "current_A_right"), ["left", "right"], "current_A"),
    ],
)
def test_motors_are_recognised_by_names(names: tuple[str, ...], motors: list[str], bare: str):
    found = motors_in(("time_s", *names), Options())
    assert list(found) == motors
    assert bare in found[motors[0]].values()


@pytest.mark.parametrize(
    "names",
    [
        ("current_A", "voltage_V", "speed_rad_s"),
        ("left_motor_current_A", "left_wheel_speed_m_s"),  # one motor
        ("motor1_current_A", "motor2_speed_rad_s"),  # nothing that both have
        ("cell_1_V", "cell_2_V", "cell_3_V"),
        ("voltage_1", "voltage_2", "current_1"),
        ("temp_m1_degC", "temp_m2_degC", "current_A", "voltage_V"),  # two thermometers
        ("left_x", "right_x", "current_A"),  # nothing that a case of a motor holds
        ("acc_m_s2", "area_m2", "current_A"),
        ("motor_current_A", "motor_speed_rpm", "motor_temp_1_degC"),
    ],
)
def test_other_names_are_not_of_several_motors(names: tuple[str, ...]):
    assert motors_in(("time_s", *names), Options()) == {}


def test_a_log_of_two_sides_is_two_runs_of_two_specimens(tmp_path: Path):
    found = imported(log(tmp_path, "ride", *SIDES))
    assert [(run.log.name, run.log.specimen) for run in found.runs] == [("ride_left", "left"), ("ride_right", "right")]
    (said,) = [one for one in found.decisions if one.about == "motors"]
    assert said.value == "left, right"
    assert "motor_voltage_V" in said.why
    case = read_case(found.write(tmp_path / "case"))
    assert list(case.specimens) == ["left", "right"]
    ratio = case.runs[1].measured.inputs["voltage_V"] / case.runs[0].measured.inputs["voltage_V"]
    assert ratio == pytest.approx(1.01, rel=1e-4)


def test_what_all_share_is_in_each_run_and_a_formula_names_columns_without_their_motor(tmp_path: Path):
    path = log(tmp_path, "flight", "motor1_speed_rpm", "motor2_speed_rpm", battery_voltage_V=3.7, motor1_pwm=0.5,
               motor2_pwm=0.6, scale=10.0)  # fmt: skip
    columns = {"voltage_V": "battery_voltage_V*motor_pwm"}
    found = import_case(path, "motor", ambient=20.0, load="propeller", progress=False, columns=columns)
    assert [float(run.log.columns["voltage_V"][0]) for run in found.runs] == pytest.approx([1.85, 2.22])


def test_the_same_thing_is_said_once_of_all_motors(tmp_path: Path):
    path = log(tmp_path, "ride", *(name.replace("_rad_s", "") for name in SIDES))
    sentences = [one.sentence for one in imported(path).findings if one.what == "unit assumed"]
    assert len(sentences) == len(set(sentences)) == 1


def test_motors_of_one_log_have_one_unit(tmp_path: Path):
    """One of them turns at more than 1,000 and the other does not: both are in 1/min."""
    path = tmp_path / "flight.csv"
    pd.DataFrame({"time_s": TIME_S, "motor1_speed": 9.0 * SPEED, "motor2_speed": 7.0 * SPEED, "voltage_V": 3.0}).to_csv(
        path, index=False
    )
    found = import_case(path, "motor", ambient=20.0, load="free", progress=False)
    first, second = (run.log.columns["speed_rad_s"] for run in found.runs)
    assert second / first == pytest.approx(7.0 / 9.0)
    assert first[0] == pytest.approx(900.0 * np.pi / 30.0)


def test_motors_of_one_log_have_one_unit_whatever_is_guessed(tmp_path: Path):
    """1500 of a current without a unit are mA, of each motor."""
    path = log(tmp_path, "ride", "left_current", "right_current", "left_speed_rad_s", "right_speed_rad_s", scale=600.0)
    one = imported(path)
    left, right = (run.log.columns["current_A"] for run in one.runs)
    assert np.nanmax(left) == pytest.approx(0.02 * 600.0 * 120.0 / 1000.0, rel=0.01)
    assert right == pytest.approx(1.01 * left)
    (said,) = [finding for finding in one.findings if finding.what == "unit assumed"]
    assert "it goes up to 1454, taken as mA" in said.sentence
    assert said.weight == "warning"


def test_a_current_of_all_motors_is_not_that_of_one(tmp_path: Path):
    path = log(tmp_path, "stand", "motor1_speed_rad_s", "motor2_speed_rad_s", "voltage_V", current_A=4.0)
    found = import_case(path, "motor", ambient=20.0, load="free", progress=False)
    assert all("current_A" not in run.log.columns for run in found.runs)
    (said,) = [one for one in found.findings if one.what == "of all motors"]
    assert '--column "current_A=current_A/2"' in said.sentence
    shared = imported(path, columns={"current_A": "current_A/2"})
    assert [float(run.log.columns["current_A"][0]) for run in shared.runs] == [2.0, 2.0]


def test_one_motor_may_be_chosen_and_is_then_a_log_of_one(tmp_path: Path):
    path = log(tmp_path, "ride", *SIDES)
    found = imported(path, motors=("right",))
    assert [(run.log.name, run.log.specimen) for run in found.runs] == [("ride", "")]
    assert float(found.runs[0].log.columns["speed_rad_s"][0]) == pytest.approx(105.0)
    assert [one.value for one in found.decisions if one.about == "motors"] == ["right"]


def test_who_names_a_column_of_one_motor_means_that_motor(tmp_path: Path):
    columns = {target: f"right_motor_{target}" for target in ("voltage_V", "current_A", "speed_rad_s")}
    found = imported(log(tmp_path, "ride", *SIDES), columns=columns)
    assert [(run.log.name, run.log.specimen) for run in found.runs] == [("ride", "")]
    assert float(found.runs[0].log.columns["speed_rad_s"][0]) == pytest.approx(105.0)


@pytest.mark.parametrize(
    ("kind", "motors", "columns", "words"),
    [
        ("motor", ("rigth",), SIDES, "there is no 'rigth'. Did you mean 'right'?"),
        ("motor", ("left",), ("motor_voltage_V", "motor_speed_rad_s"), "its columns are not of several motors"),
        ("robot", ("left",), SIDES, "--kind motor"),
    ],
)
def test_a_motor_that_is_not_there_is_refused(tmp_path: Path, kind, motors, columns, words: str):
    with pytest.raises(MeasurementError) as found:
        import_case(log(tmp_path, "ride", *columns), kind, ambient=20.0, motors=motors, progress=False)
    assert words in str(found.value)


def rides(folder: Path, count: int = 3) -> list[Path]:
    return [log(folder, f"ride{n}", *SIDES, scale=1.0 + 0.001 * n) for n in range(count)]


def test_what_was_logged_together_is_held_out_together(tmp_path: Path):
    splits = {run.log.name: run.split for run in imported(*rides(tmp_path)).runs}
    assert [name for name, split in splits.items() if split == "check"] == ["ride2_left", "ride2_right"]
    stated = imported(*rides(tmp_path), check=("ride0",))
    assert [run.log.name for run in stated.runs if run.split == "check"] == ["ride0_left", "ride0_right"]
    one = imported(*rides(tmp_path), check=("ride0_left",))
    assert [run.log.name for run in one.runs if run.split == "check"] == ["ride0_left"]


def test_each_motor_keeps_a_run_to_fit(tmp_path: Path):
    with pytest.raises(MeasurementError, match="every run of left would be held out"):
        imported(*rides(tmp_path), check=("*_left",))
    (only,) = rides(tmp_path, 1)
    assert [run.split for run in imported(only).runs] == ["fit", "fit"]


def bench(folder: Path, *names: str) -> list[Path]:
    """Files of one motor each."""
    columns = ("motor_voltage_V", "motor_current_A", "motor_speed_rad_s")
    return [log(folder, name, *columns, scale=1.0 + 0.001 * n) for n, name in enumerate(names)]


def test_specimens_in_files_of_their_own_are_stated_by_patterns(tmp_path: Path):
    paths = bench(tmp_path, "step_a", "ramp_a", "hold_a", "step_b", "ramp_b", "hold_b")
    found = imported(*paths, specimens={"A": "*_a", "B": "*_b"})
    assert [run.log.specimen for run in found.runs] == ["A"] * 3 + ["B"] * 3
    for motor in ("A", "B"):
        assert any(run.split == "fit" for run in found.runs if run.log.specimen == motor)
    assert list(found.case.specimens) == ["A", "B"]


@pytest.mark.parametrize(
    ("names", "stated", "words"),
    [
        (("step_a", "step_b", "step_c"), {"A": "*_a", "B": "*_b"}, "step_c.csv: specimen: the file is of none of them"),
        (("step_a", "step_b"), {"A": "*_a", "B": "step_*"}, "step_a.csv: specimen: the file is of A and B"),
        (
            ("step_a",),
            {"A": "*_a", "B": "*_b"},
            "no file is called '*_b'; correct the pattern of B. The files are step_a",
        ),
        (("step_a", "step_b"), {"A": "*"}, "only A is stated, and there is nothing to compare it with"),
        (("step_a", "step_b"), {"A": "", "B": "*_b"}, "A has no pattern of files"),
    ],
)
def test_specimens_that_do_not_fit_the_files_are_refused(tmp_path: Path, names, stated, words: str):
    with pytest.raises(MeasurementError) as found:
        imported(*bench(tmp_path, *names), specimens=stated)
    assert words in str(found.value)


def test_names_that_point_to_several_motors_are_told_with_what_to_do(tmp_path: Path):
    (said,) = [
        one for one in imported(*bench(tmp_path, "motor1_step", "motor2_step")).findings
        if one.what == "several specimens"
    ]  # fmt: skip
    assert "--specimen" in said.sentence


@pytest.mark.parametrize("word", ["axis{}_", "ODrive {} ", "joint{}/", "servo_{}_"])
def test_axes_that_a_controller_numbers_are_motors(tmp_path: Path, word: str):
    names = [word.format(n) + what for n in (0, 3) for what in ("voltage_V", "current_A", "speed_rad_s")]
    found = imported(log(tmp_path, "ride", *names))
    assert [run.log.name for run in found.runs] == ["ride_motor0", "ride_motor3"]
    (said,) = [one.sentence for one in found.findings if one.what == "no check run"]
    assert "All runs were logged together" in said


def test_who_names_a_column_of_one_motor_gets_no_column_of_another(tmp_path: Path):
    names = [f"axis{n}_{what}" for n in (0, 1) for what in ("voltage_V", "current_A", "speed_rad_s")]
    path = log(tmp_path, "ride", *names)
    second = pd.read_csv(path)
    second[[name for name in names if "axis1" in name]] *= 2.0
    second.to_csv(path, index=False)
    (run,) = imported(path, columns={"current_A": "axis1_current_A"}).runs
    for what in ("voltage_V", "current_A", "speed_rad_s"):
        np.testing.assert_allclose(run.log.columns[what], second[f"axis1_{what}"])


def test_the_load_that_a_servo_reports_is_no_torque(tmp_path: Path):
    time = 0.01 * np.arange(500)
    frame = {
        "timestamp": time,
        "position": np.sin(time),
        "speed": np.cos(time),
        "load": (150 * np.cos(time)).astype(int),
    }
    path = tmp_path / "servo.csv"
    pd.DataFrame(frame | {"input_volts": 7.3}).to_csv(path, index=False)
    options = Options(ambient=20.0, columns={"voltage_V": "load * input_volts / 885"}, load="gravity")
    found = import_case(path, "motor", options=options, progress=False)
    assert "load_torque_Nm" not in found.runs[0].log.columns
    (said,) = [one.sentence for one in found.findings if one.what == "no torque"]
    assert '--unit "load=N m"' in said
    stated = import_case(path, "motor", options=options, units={"load": "mN m"}, progress=False)
    assert np.nanmax(stated.runs[0].log.columns["load_torque_Nm"]) == pytest.approx(0.15)
