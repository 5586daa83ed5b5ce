"""One run's CSV: what is read, and the sentence for each way in which a CSV can be wrong."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.units import LARGEST
from jaxmodel.case.measurements import KINDS, read_measurements

CELL = "time_s,current_A,ambient_degC,voltage_V\n0,2,20,3.96\n1,2,20,3.95\n2.5,-1,20,4.01\n"


@pytest.fixture
def write(tmp_path: Path):
    def to_file(content: str | bytes, name: str = "run.csv") -> Path:
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return to_file


def test_inputs_and_outputs_are_told_apart(write):
    measured = read_measurements(write(CELL), "cell")
    assert measured.time_s.tolist() == [0, 1, 2.5]
    assert {name: values.tolist() for name, values in measured.inputs.items()} == {
        "current_A": [2, 2, -1],
        "ambient_degC": [20, 20, 20],
    }
    assert {name: values.tolist() for name, values in measured.outputs.items()} == {"voltage_V": [3.96, 3.95, 4.01]}


@pytest.mark.parametrize(
    "content",
    [
        b"\xef\xbb\xbf" + CELL.encode(),
        CELL.replace("\n", "\r\n").encode(),
        CELL.replace(",", " , ").encode(),
        b'# cycler 3\n\n#, "quoted, once\n' + CELL.encode() + b"\n\n",
        CELL.rstrip("\n").encode(),
        CELL.replace("time_s", '"time_s"').encode(),
    ],
    ids=["byte-order mark", "CRLF", "spaces", "comments and blank lines", "no last newline", "quoted name"],
)
def test_harmless_differences_of_form_change_nothing(write, content):
    plain, other = read_measurements(write(CELL), "cell"), read_measurements(write(content, "other.csv"), "cell")
    np.testing.assert_array_equal(other.time_s, plain.time_s)
    assert other.inputs.keys() == plain.inputs.keys()
    np.testing.assert_array_equal(other.inputs["current_A"], plain.inputs["current_A"])
    np.testing.assert_array_equal(other.outputs["voltage_V"], plain.outputs["voltage_V"])


def test_an_empty_output_field_is_a_missing_reading_and_not_a_zero(write):
    path = write("time_s,current_A,ambient_degC,voltage_V,soc\n0,2,20,,\n1,2,20, ,0.9\n2,0,20,0,\n")
    outputs = read_measurements(path, "cell").outputs
    np.testing.assert_array_equal(outputs["voltage_V"], [np.nan, np.nan, 0.0])
    np.testing.assert_array_equal(outputs["soc"], [np.nan, 0.9, np.nan])


def test_a_number_that_nothing_measured_can_be_is_refused_with_its_line(write):
    with pytest.raises(MeasurementError, match=r"line 3: 'current_A' = 1e\+300, .* correct it or its unit"):
        read_measurements(write("time_s,current_A,ambient_degC\n0,2,20\n1,1e300,20\n"), "cell")


numbers = st.floats(-LARGEST, LARGEST)


@given(rows=st.lists(st.tuples(numbers, st.none() | numbers), min_size=2, max_size=20))
def test_every_finite_number_is_read_to_the_last_bit(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("run") / "run.csv"
    body = "".join(
        f"{time},{current!r},20,{'' if voltage is None else repr(voltage)}\n"
        for time, (current, voltage) in enumerate(rows)
    )
    path.write_text("time_s,current_A,ambient_degC,voltage_V\n" + body)
    measured = read_measurements(path, "cell")
    assert measured.inputs["current_A"].tolist() == [current for current, _ in rows]
    np.testing.assert_array_equal(
        measured.outputs["voltage_V"], [np.nan if voltage is None else voltage for _, voltage in rows]
    )


@pytest.mark.parametrize(
    ("header", "drive", "outputs"),
    [
        ("voltage_V,current_A", "voltage_V", ["current_A", "speed_rad_s"]),
        ("current_A,voltage_V", "voltage_V", ["current_A", "speed_rad_s"]),
        ("current_A", "current_A", ["speed_rad_s"]),
        ("voltage_V", "voltage_V", ["speed_rad_s"]),
    ],
)
def test_a_motors_current_is_measured_where_its_voltage_drives_it(write, header, drive, outputs):
    fields = ",".join("12" for _ in header.split(","))
    lines = [f"time_s,{header},load_torque_Nm,ambient_degC,speed_rad_s", *(f"{t},{fields},0.1,20,300" for t in (0, 1))]
    measured = read_measurements(write("\n".join(lines)), "motor")
    assert set(measured.inputs) == {"load_torque_Nm", "ambient_degC", drive}
    assert list(measured.outputs) == outputs


@pytest.mark.parametrize(
    ("columns", "inputs"),
    [
        ({"duty": 0.3, "load_torque_Nm": 0.1}, {"duty", "load_torque_Nm"}),
        ({"V_set": 3.25, "load_torque_Nm": 0.1}, {"V_set", "load_torque_Nm"}),
        ({"duty": -1, "incline_deg": 10}, {"duty", "incline_deg"}),
        (
            {"duty": 1, "incline_deg": 10, "acceleration_m_s2": 0.1, "arm_duty": 0.2, "arm_torque_Nm": 0.05},
            {"duty", "incline_deg", "acceleration_m_s2", "arm_duty", "arm_torque_Nm"},
        ),
    ],
)
def test_a_robot_is_driven_by_duty_or_set_voltage_and_loaded_by_torque_or_incline(write, columns, inputs):
    row = ",".join(str(value) for value in columns.values())
    path = write(f"time_s,{','.join(columns)},ambient_degC,pack_voltage_V\n0,{row},20,24\n1,{row},20,23\n")
    measured = read_measurements(path, "robot")
    assert set(measured.inputs) == inputs | {"ambient_degC"}
    for name, value in columns.items():
        assert measured.inputs[name].tolist() == [value, value]


def test_an_ambient_temperature_may_be_one_number_for_the_run(write):
    path = write("time_s,current_A\n0,1\n1,1\n")
    assert read_measurements(path, "cell", ambient_degC=-10.0).inputs["ambient_degC"].tolist() == [-10.0, -10.0]


def test_every_alternative_and_companion_is_a_column_of_its_kind():
    for kind in KINDS.values():
        assert len(set(kind.columns)) == len(kind.columns)
        for name, other in kind.only_with.items():
            assert {name, other} <= set(kind.columns) - set(kind.outputs)


HEADER = "time_s,current_A,ambient_degC,voltage_V\n"
ROBOT = "time_s,duty,load_torque_Nm,ambient_degC,pack_voltage_V\n"


@pytest.mark.parametrize(
    ("kind", "content", "parts"),
    [
        pytest.param("cell", "", ["is empty", "time_s first"], id="empty"),
        pytest.param("cell", "# only a comment\n", ["is empty"], id="comments only"),
        pytest.param("cell", HEADER, ["0 rows", "at least two"], id="header only"),
        pytest.param("cell", HEADER + "0,1,20,4\n", ["1 row of", "at least two"], id="one row"),
        pytest.param(
            "cell", "t,current_A,ambient_degC\n0,1,20\n1,1,20\n", ["line 1", "'t'", "must be 'time_s'"], id="no time"
        ),
        pytest.param("cell", "time_s;current_A\n0;1\n", ["line 1", "not separated by commas", "','"], id="semicolons"),
        pytest.param(
            "cell",
            "# a\ntime_s,current_A,ambient_degC,current_A\n0,1,20,1\n1,1,20,1\n",
            ["line 2", "two columns 'current_A'", "remove or rename"],
            id="duplicate column",
        ),
        pytest.param(
            "cell", "time_s,current_A,ambient_degC,\n0,1,20,\n1,1,20,\n", ["column 4 has no name"], id="nameless column"
        ),
        pytest.param(
            "cell",
            "time_s,current_A,ambient_C\n0,1,20\n1,1,20\n",
            ["line 1", "no column 'ambient_C'", "'ambient_degC'", "Convert the readings to degC and rename"],
            id="unit misspelt",
        ),
        pytest.param(
            "cell",
            HEADER.replace("voltage_V", "voltage_mV") + "0,1,20,4000\n1,1,20,4000\n",
            ["no column 'voltage_mV'", "'voltage_V'", "Convert the readings to V "],
            id="millivolt",
        ),
        pytest.param(
            "motor",
            "time_s,voltage_V,load_torque_Nm,ambient_degC,speed_rpm\n0,1,0,20,0\n1,1,0,20,0\n",
            ["no column 'speed_rpm'", "'speed_rad_s'", "Convert the readings to rad/s"],
            id="rpm",
        ),
        pytest.param(
            "robot",
            ROBOT.replace("pack_voltage_V", "SOC_percent") + "0,0,0,20,90\n1,0,0,20,90\n",
            ["'SOC_percent'", "'soc'", "to fractions of 1"],
            id="percent",
        ),
        pytest.param(
            "cell",
            HEADER.replace("voltage_V", "remark") + "0,1,20,x\n1,1,20,x\n",
            ["no column 'remark'", "Rename it to one of current_A,", "or remove it"],
            id="nothing like it",
        ),
        pytest.param("cell", "time_s,current_A\n0,1\n1,1\n", ["'ambient_degC'", "add it", "[[runs]]"], id="no ambient"),
        pytest.param(
            "motor",
            "time_s,voltage_V,ambient_degC\n0,1,20\n1,1,20\n",
            ["line 1", "a motor needs one of the columns 'load_torque_Nm' or 'speed_rad_s'; add one."],
            id="no load",
        ),
        pytest.param(
            "motor",
            "time_s,load_torque_Nm,ambient_degC\n0,1,20\n1,1,20\n",
            ["'voltage_V' or 'current_A'", "add one"],
            id="no drive",
        ),
        pytest.param(
            "robot",
            "time_s,duty,V_set,load_torque_Nm,ambient_degC\n0,0,2.5,0,20\n1,0,2.5,0,20\n",
            ["'duty' or 'V_set'", "not by both", "remove one"],
            id="two drives",
        ),
        pytest.param(
            "robot",
            "time_s,duty,load_torque_Nm,acceleration_m_s2,ambient_degC\n0,0,0,0,20\n1,0,0,0,20\n",
            ["'acceleration_m_s2'", "'incline_deg'"],
            id="acceleration of nothing",
        ),
        pytest.param(
            "robot",
            "time_s,duty,load_torque_Nm,flipper_torque_Nm,ambient_degC\n0,0,0,0,20\n1,0,0,0,20\n",
            ["'flipper_torque_Nm'", "'flipper_duty'"],
            id="flippers without their duty",
        ),
        pytest.param("cell", HEADER + "0,1,20,4\n1,1,20\n", ["line 3", "3 fields", "header has 4"], id="short row"),
        pytest.param(
            "cell", HEADER + "0,1,20,4\n1,1,20,4,1\n", ["line 3", "5 fields", "decimals with a point"], id="long row"
        ),
        pytest.param(
            "cell",
            "#\n" + HEADER + "0,1,20,4\n\n1,,20,4\n",
            ["line 5", "'current_A' is empty", "fill it in or drop the row"],
            id="input missing",
        ),
        pytest.param("cell", HEADER + "0,1,20,4\n,1,20,4\n", ["line 3", "'time_s' is empty"], id="time missing"),
        pytest.param(
            "cell",
            HEADER + "0,1,20,4\n1,1,20,NaN\n",
            ["line 3", "'voltage_V'", "'NaN'", "leave the field empty for a missing reading"],
            id="NaN text",
        ),
        pytest.param(
            "cell", HEADER + "0,nan,20,4\n1,1,20,4\n", ["line 2", "'current_A'", "leave the field empty"], id="nan"
        ),
        pytest.param(
            "cell",
            HEADER + "0,1,20,4\n1,1,20,-inf\n",
            ["line 3", "'voltage_V'", "'-inf' is not finite", "empty"],
            id="infinity",
        ),
        pytest.param(
            "cell",
            HEADER + "0,1,20,4\n1,off,20,4\n",
            ["line 3", "'current_A'", "'off' is not a number", "correct it"],
            id="text",
        ),
        pytest.param("cell", HEADER + "0,1,20,4\n1,1_0,20,4\n", ["line 3", "'1_0' is not a number"], id="underscore"),
        pytest.param(
            "cell", HEADER + '0,1,20,4\n1,1,20,"4\n2,1,20,4\n', ["line 3", "not a number"], id="quote left open"
        ),
        pytest.param(
            "cell",
            HEADER + "0,1,20,4\n2,1,20,4\n1.5,1,20,4\n",
            ["line 4", "time_s = 1.5 comes after 2", "sort the rows"],
            id="time runs back",
        ),
        pytest.param("cell", HEADER + "0,1,20,4\n0,1,20,4\n", ["line 3", "0 comes after 0"], id="time repeats"),
        pytest.param("cell", CELL.encode("utf-16"), ["not UTF-8", "save it again"], id="UTF-16"),
        pytest.param("cell", HEADER + "0,1,20," + "4" * 200_000, ["line 2", "not CSV", "quote"], id="endless field"),
    ],
)
def test_a_wrong_csv_gets_one_sentence_with_place_and_remedy(write, kind, content, parts):
    path = write(content, "run-07.csv")
    with pytest.raises(MeasurementError) as caught:
        read_measurements(path, kind)
    message = str(caught.value)
    assert f"{path.parent.name}/run-07.csv" in message
    for part in parts:
        assert part in message
    assert "\n" not in message
    assert message.endswith(".")


def test_ambient_as_column_and_as_constant_is_an_error(write):
    with pytest.raises(MeasurementError, match=r"run\.csv, line 1: 'ambient_degC' is a column and .* remove one"):
        read_measurements(write(CELL), "cell", ambient_degC=20.0)


def test_a_csv_that_is_not_there_is_named(tmp_path):
    with pytest.raises(MeasurementError, match=r"absent\.csv cannot be read .* check its name"):
        read_measurements(tmp_path / "absent.csv", "cell")
