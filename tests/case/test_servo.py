"""What a case says of its drive and controller: columns, positions, words, and a file that says the same again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, import_case, read_case, simulate_case
from jaxmodel.base.errors import MeasurementError, UserError
from jaxmodel.case.build import case_model
from jaxmodel.case.measurements import Servo, vocabulary
from jaxmodel.operation.load import estimate_load

ROWS = 400
TIME = 1e-3 * np.arange(ROWS)
REFERENCE = 5.0 * np.sin(20.0 * TIME)
GAINS = {"position_controller": {"k_p": 4.0, "k_d": 0.02, "limit": 8.0}}


def frame(**columns) -> pd.DataFrame:
    return pd.DataFrame({"time_s": TIME, "ambient_degC": 20.0} | columns)


def servo_case(table: pd.DataFrame | None = None, **said) -> Case:
    table = frame(reference_position_rad=REFERENCE, position_rad=REFERENCE, current_A=0.0) if table is None else table
    said = {"load": "free", "drive": "current", "controller": "position", "effects": GAINS} | said
    return Case.from_dataframes({"run": table}, kind="motor", **said)


def test_a_current_drive_is_driven_by_its_current_and_reads_a_position():
    known = vocabulary("motor", "free", Servo("current"))
    assert "current_A" in known.required_inputs
    assert "position_rad" in known.outputs
    assert {"voltage_V", "current_A"}.isdisjoint(known.outputs)


def test_in_a_closed_loop_the_reference_is_the_input_and_the_drive_a_reading():
    assert "reference_position_rad" in vocabulary("motor", "free", Servo("current", "position")).required_inputs
    known = vocabulary("motor", "free", Servo("", "speed"))
    assert "reference_speed_rad_s" in known.required_inputs
    assert {"voltage_V", "current_A", "speed_rad_s", "position_rad"} <= set(known.outputs)


def test_a_case_without_words_of_its_drive_has_the_columns_it_had():
    assert vocabulary("motor") == vocabulary("motor", "", Servo())
    assert "position_rad" not in vocabulary("motor").columns


def test_a_closed_loop_begins_at_the_position_that_was_read():
    case = servo_case(frame(reference_position_rad=2.0, position_rad=np.where(TIME > 0.0, 2.0, 1.5)))
    effects = {effect.name: effect for effect in case_model(case, case.runs[0]).effects}
    assert effects["shaft_position"].initial_position_rad == 1.5
    assert effects["position_controller"].column == "current_A"
    position = simulate_case(case)[0].table["position_rad"]
    assert position.iloc[0] == 1.5
    assert position.iloc[-1] == pytest.approx(2.0, abs=0.2)


def test_without_a_word_of_the_drive_a_controller_sets_the_voltage():
    case = servo_case(frame(reference_position_rad=REFERENCE, voltage_V=0.0), drive=None)
    assert case.runs[0].measured.outputs.keys() == {"voltage_V"}
    assert case_model(case, case.runs[0]).effects[0].column == "voltage_V"


def test_a_case_that_is_written_says_it_again(tmp_path: Path):
    case = servo_case()
    case.write(tmp_path / "servo")
    again = read_case(tmp_path / "servo")
    assert again.servo == case.servo == Servo("current", "position")
    assert again.effects == case.effects
    first, second = (simulate_case(one)[0].table for one in (case, again))
    pd.testing.assert_frame_equal(first, second)


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"effects": {}}, 'controller = "position" has no gains'),
        ({"controller": "speed"}, "speed and position are two controllers of one motor; keep one of them."),
        ({"load": "unknown"}, "with a controller the speed is an answer"),
        ({"controller": "torque"}, "controller"),
    ],
)
def test_what_cannot_be_is_refused(said, words: str):
    with pytest.raises(MeasurementError, match=words):
        servo_case(**said)


def test_a_cell_has_no_drive():
    table = frame(current_A=1.0, voltage_V=3.7)
    with pytest.raises(MeasurementError, match="drive and controller are of a motor, not of a cell; remove them"):
        Case.from_dataframes({"run": table}, kind="cell", drive="current")


def test_a_closed_loop_without_its_reference_is_refused():
    with pytest.raises(MeasurementError, match="a motor needs the column 'reference_position_rad'"):
        servo_case(frame(position_rad=REFERENCE))


def test_what_the_load_asked_is_found_in_a_closed_loop_too():
    """The controller is set aside: what it set was read, and so was the speed."""
    truth = simulate_case(servo_case(frame(reference_position_rad=REFERENCE, load_torque_Nm=0.01, position_rad=0.0)))
    read = {name: truth[0].table[name] for name in ("current_A", "speed_rad_s", "position_rad")}
    found = estimate_load(servo_case(frame(reference_position_rad=REFERENCE, **read)))
    moving = np.abs(found.runs[0].table["speed_rad_s"]) > 50.0
    assert moving.sum() > 100
    assert found.runs[0].table["load_torque_Nm"][moving].mean() == pytest.approx(0.01, abs=0.003)


def log(folder: Path) -> Path:
    file = folder / "servo.csv"
    table = {"time_s": TIME, "drive_V": 0.1 * np.sin(20.0 * TIME), "position_mm": REFERENCE, "target_mm": REFERENCE}
    pd.DataFrame(table).to_csv(file, index=False)
    return file


IMPORT = {"ambient": 22.0, "load": "free", "drive": "current", "progress": False}
COLUMNS = {"current_A": "drive_V*1", "position_rad": "position_mm*1"}
FOLLOWED = COLUMNS | {"reference_position_rad": "target_mm*1"}
CLOSED = {"controller": "position", "controller_numbers": {"k_p": 40.0}}


def test_an_import_takes_the_command_of_a_current_drive_as_its_current(tmp_path: Path):
    case = import_case(log(tmp_path), "motor", columns=COLUMNS, **IMPORT).case
    measured = case.runs[0].measured
    assert set(measured.inputs) == {"ambient_degC", "current_A"}
    assert set(measured.outputs) == {"speed_rad_s", "position_rad"}


def test_an_import_takes_a_reference_and_gains(tmp_path: Path):
    found = import_case(
        log(tmp_path), "motor", out=tmp_path / "case", columns=FOLLOWED, controller="position",
        controller_numbers={"k_p": 40.0, "k_d": 0.2}, **IMPORT,
    )  # fmt: skip
    assert set(found.case.runs[0].measured.outputs) == {"current_A", "speed_rad_s", "position_rad"}
    assert read_case(tmp_path / "case").servo == Servo("current", "position")


def test_a_reference_that_is_called_as_in_a_case_needs_no_option(tmp_path: Path):
    file = tmp_path / "run.csv"
    pd.read_csv(log(tmp_path)).rename(columns={"target_mm": "reference_position_rad"}).to_csv(file, index=False)
    found = import_case(file, "motor", columns=COLUMNS, **IMPORT | CLOSED)
    np.testing.assert_allclose(found.runs[0].log.columns["reference_position_rad"], REFERENCE)
    open_loop = import_case(file, "motor", columns=COLUMNS, **IMPORT)
    assert "reference_position_rad" not in open_loop.runs[0].log.columns


def test_a_case_with_a_controller_whose_speed_drives_the_model_is_refused():
    with pytest.raises(MeasurementError, match="the speed is an answer"):
        servo_case(frame(reference_position_rad=REFERENCE, current_A=0.0, speed_rad_s=1.0), load=None)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"controller": "position"}, "position has no gains; state them, as in --controller position:k_p=10"),
        (
            {"controller": "position", "controller_numbers": {"kp": 1.0}},
            "position has no number 'kp'. Did you mean 'k_p'",
        ),
        ({"controller": "torque"}, "there is no 'torque'; use position or speed"),
        ({"drive": "amps"}, "there is no 'amps'; use voltage or current"),
        (
            CLOSED | {"load": "unknown"},
            "the speed is an answer of the loop, and with --load unknown it drives the model",
        ),
        (
            CLOSED | {"load": None, "columns": FOLLOWED},
            "with --controller the speed is an answer of the model, and nothing tells the load",
        ),
        (CLOSED | {"controller_numbers": {"k_p": 0.0}}, "the output of position is always 0"),
        (CLOSED | {"controller_numbers": {"k_p": 10.0, "limit": 0.0}}, "the output of position is always 0"),
        (CLOSED | {"controller_numbers": {"k_p": -1.0}}, "'k_p' = -1 is outside its range 0 to"),
        (CLOSED, 'it may be --column reference_position_rad="target_mm"'),
        ({"columns": FOLLOWED}, "state --controller position:k_p=VALUE too"),
        (
            {"columns": COLUMNS | {"voltage_V": "command"}},
            "with --load free and --drive current a motor has no voltage_V",
        ),
    ],
)
def test_words_of_a_drive_that_nobody_knows_are_refused(options, words: str, tmp_path: Path):
    with pytest.raises(UserError, match=words):
        import_case(log(tmp_path), "motor", **IMPORT | {"columns": COLUMNS} | options)
