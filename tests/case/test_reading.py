"""A case folder: what is read, and the sentence for each way in which a case can be wrong."""

import csv
import os
import tomllib
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

from jaxmodel.base.errors import MeasurementError, ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.forms import CaseEntry
from jaxmodel.case.known import Known, Tolerance
from jaxmodel.case.measurements import KINDS
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case

CSV = {
    "cell": "time_s,current_A,ambient_degC,voltage_V\n0,2,20,3.96\n1,2,20,\n",
    "motor": "time_s,voltage_V,load_torque_Nm,ambient_degC,current_A\n0,12,0.1,20,0\n1,12,0.1,20,4\n",
    "robot": "time_s,V_set,load_torque_Nm,ambient_degC,pack_voltage_V\n0,2.5,0.1,20,24\n1,3.2,0.1,20,23.5\n",
}
RUNS = '[[runs]]\nfile = "run-01.csv"\nsplit = "fit"\n[[runs]]\nfile = "run-02.csv"\nsplit = "check"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder for a case, with two runs of a cell."""
    case = tmp_path / "bench"
    case.mkdir()
    for name in ("run-01.csv", "run-02.csv"):
        (case / name).write_text(CSV["cell"])
    return case


def read(folder: Path, toml: str) -> Case:
    (folder / "case.toml").write_text(toml)
    return read_case(folder)


def shared_cases() -> list[Path]:
    """Return the development cases that lie beside some checkouts."""
    for parent in Path(__file__).resolve().parents:
        if (parent / "shared" / "cases").is_dir():
            folder = parent / "shared" / "cases"
            return sorted([*folder.glob("dev-*"), *folder.glob("hard-*")])
    return []


@pytest.mark.skipif(not shared_cases(), reason="the development cases are not beside this checkout")
def test_every_development_case_is_read_as_it_is_written():
    for path in shared_cases():
        case, raw = read_case(path), tomllib.loads((path / "case.toml").read_text())
        assert (case.name, case.title, case.kind) == (path.name, raw["title"], raw["kind"])
        assert [run.split for run in case.runs] == [run["split"] for run in raw["runs"]]
        assert case.sensors == raw["sensors"]
        assert {name: bound.rms for name, bound in case.tolerance.items()} == raw.get("tolerance", {})
        assert {*case.parameters, *case.tables} == set(raw["parameters"])
        for name, known in case.parameters.items():
            stated = raw["parameters"][name]
            assert known == (Known(**stated) if isinstance(stated, dict) else Known(float(stated)))
        for run, stated in zip(case.runs, raw["runs"], strict=True):
            assert run.initial_soc == Known(**stated.get("initial_soc", {"value": 1.0}))
            assert ("cycles" in run.overrides) == ("cycles" in stated)
            with (path / run.file).open(newline="") as stream:
                rows = list(csv.DictReader(stream))
            columns = {"time_s": run.measured.time_s, **run.measured.inputs, **run.measured.outputs}
            assert set(columns) == set(rows[0])
            for name, values in columns.items():
                np.testing.assert_array_equal(values, [float(row[name] or "nan") for row in rows])


@pytest.mark.parametrize("kind", list(KINDS))
def test_a_small_case_of_every_kind_is_read(folder, kind):
    for name in ("run-01.csv", "run-02.csv"):
        (folder / name).write_text(CSV[kind])
    case = read(folder, f'title = "Small"\nkind = "{kind}"\n{RUNS}')
    assert (case.name, case.title, case.kind, case.preset) == ("bench", "Small", kind, "paper")
    assert [(run.name, run.split, run.label) for run in case.runs] == [("run-01", "fit", ""), ("run-02", "check", "")]
    assert case.runs[0].initial_soc == Known(1.0, None)
    assert case.runs[1].source == (folder / "run-02.csv").resolve()
    header = CSV[kind].splitlines()[0].split(",")
    assert {*case.runs[0].measured.inputs, *case.runs[0].measured.outputs} == set(header[1:])
    assert (case.parameters, case.tables, case.effects, case.sensors, case.cutoff) == ({}, {}, {}, {}, {})


def test_all_that_a_case_may_say_is_kept(folder):
    (folder / "run-02.csv").write_text("time_s,current_A,voltage_V\n0,1,4\n1,1,4\n")
    case = read(
        folder,
        """
        kind = "cell"
        preset = "other"
        [parameters]
        capacity_Ah = { value = 5, sd = 0.15 }
        cycles = 25
        initial_soc = { value = 0.7, sd = 0.02 }
        ocv = { soc = [0, 0.5, 1], voltage_V = [3.0, 3.7, 4.2] }
        R_ints = { soc = [0.0, 1.0], temperature_degC = [-20, 0, 40], ohm = [[0.2, 0.15], [0.1, 0.08], [0.05, 0.04]] }
        C_TL = { soc = [0.5], farad = [4000] }
        [effects]
        ocv_hysteresis = { M_V = 0.02, g = 60 }
        current_offset = { column = "current_A", c = 0.05 }
        [sensors]
        voltage_V = 0.002
        current_A = 0.005
        [cutoff]
        voltage_V = 3.0
        [[runs]]
        file = "run-01.csv"
        split = "fit"
        label = "warm"
        initial_soc = { value = 0.9, sd = 0.01 }
        cycles = 240
        R_0 = { value = 0.1, sd = 0.01 }
        [[runs]]
        file = "run-02.csv"
        split = "fit"
        ambient_degC = 5
        """,
    )
    assert (case.title, case.preset) == ("bench", "other")
    assert case.parameters == {"capacity_Ah": Known(5.0, 0.15), "cycles": Known(25.0)}
    assert case.tables["ocv"].values.tolist() == [3.0, 3.7, 4.2]
    assert case.tables["ocv"].temperature_degC is None
    assert case.tables["R_ints"].values.shape == (3, 2)
    assert case.tables["R_ints"].values[0].tolist() == [0.2, 0.15]  # the row of -20 degC
    assert case.tables["R_ints"].temperature_degC.tolist() == [-20.0, 0.0, 40.0]
    assert case.tables["C_TL"].soc.dtype == case.tables["C_TL"].values.dtype == float
    assert case.effects == {
        "ocv_hysteresis": {"M_V": 0.02, "g": 60},
        "current_offset": {"column": "current_A", "c": 0.05},
    }
    assert case.sensors == {"voltage_V": 0.002, "current_A": 0.005}
    assert case.cutoff == {"voltage_V": 3.0}
    first, second = case.runs
    assert (first.label, first.initial_soc) == ("warm", Known(0.9, 0.01))
    assert first.overrides == {"cycles": Known(240.0), "R_0": Known(0.1, 0.01)}
    assert second.initial_soc == Known(0.7, 0.02)
    assert second.measured.inputs["ambient_degC"].tolist() == [5.0, 5.0]


def test_how_well_tables_and_effects_are_known_is_kept(folder):
    case = read(
        folder,
        """
        kind = "cell"
        [parameters]
        ocv = { soc = [0, 1], voltage_V = [3.0, 4.2], sd_V = 0.005 }
        R_ints = { soc = [0, 1], ohm = [0.02, 0.03], sd_relative = 0.1 }
        R_TS = { soc = [0, 1], ohm = [0.02, 0.03] }
        dU_dT = { soc = [0, 1], V_per_K = [-1e-4, 2e-4], sd_V_per_K = 1e-5 }
        [effects]
        self_heating = { C_th = { value = 60, sd = 5 }, hA = 0.3 }
        current_offset = { column = "current_A", c = { value = 0.05, sd = 0.01 } }
        entropic_ocv = { dU_dT = 1e-4 }
        """
        + RUNS,
    )
    of_tables = {"ocv": 0.005, "R_ints": 0.1, "R_TS": None, "dU_dT": 1e-5}
    assert {name: table.sd for name, table in case.tables.items()} == of_tables
    assert case.tables["dU_dT"].values.tolist() == [-1e-4, 2e-4]
    assert case.effects == {
        "self_heating": {"C_th": 60.0, "hA": 0.3},
        "current_offset": {"column": "current_A", "c": 0.05},
        "entropic_ocv": {"dU_dT": 1e-4},
    }
    assert case.effect_sd == {"self_heating": {"C_th": 5.0}, "current_offset": {"c": 0.01}}


def test_a_tolerance_is_that_of_the_case_or_of_a_run(folder):
    tolerance = "[tolerance]\nvoltage_V = 0.01\ncell_temperature_degC = { rms = 1, max = 3 }\n"
    case = read(folder, CELL + tolerance + RUNS + "tolerance = { voltage_V = 0.05 }\n")
    assert case.tolerance == {"voltage_V": Tolerance(0.01, None), "cell_temperature_degC": Tolerance(1.0, 3.0)}
    assert [run.tolerance for run in case.runs] == [{}, {"voltage_V": Tolerance(0.05, None)}]
    silent = read(folder, CELL + RUNS)
    assert (silent.tolerance, silent.effect_sd, silent.runs[0].tolerance) == ({}, {}, {})


def test_a_toml_file_elsewhere_may_refer_to_the_data_by_relative_paths(folder, tmp_path):
    answer = tmp_path / "answers" / "one"
    answer.mkdir(parents=True)
    toml = answer / "extended.toml"
    toml.write_text('kind = "cell"\n' + RUNS.replace('"run-', '"../../bench/run-'))
    case = read_case(toml)
    assert (case.name, case.path) == ("one", toml.resolve())
    assert [run.name for run in case.runs] == ["run-01", "run-02"]
    assert [run.source.parent for run in case.runs] == [folder.resolve()] * 2


def test_a_case_is_found_from_the_working_directory_and_with_a_byte_order_mark(folder, monkeypatch):
    (folder / "case.toml").write_text('kind = "cell"\n' + RUNS, encoding="utf-8-sig")
    monkeypatch.chdir(folder)
    assert read_case(".").name == read_case("case.toml").name == read_case(folder).name == "bench"


def test_a_case_without_runs_to_calibrate_on_can_still_be_read(folder):
    assert {run.split for run in read(folder, 'kind = "cell"\n' + RUNS.replace('"fit"', '"check"')).runs} == {"check"}


def test_the_schema_and_the_vocabulary_have_the_same_kinds():
    assert set(get_args(get_type_hints(CaseEntry)["kind"])) == set(KINDS)


CELL = 'kind = "cell"\n'


@pytest.mark.parametrize(
    ("toml", "error", "parts"),
    [
        pytest.param(
            'kind = "cell"\ntitle = Bench\n' + RUNS,
            MeasurementError,
            ["line 2", "not valid TOML", "correct it there"],
            id="TOML",
        ),
        pytest.param('kind = "cell', MeasurementError, ["not valid TOML", "end of document"], id="TOML's end"),
        pytest.param(RUNS, MeasurementError, ["kind is missing; add it"], id="no kind"),
        pytest.param(
            'kind = "Cell"\n' + RUNS,
            MeasurementError,
            ['kind must be "cell", "motor" or "robot", not "Cell"'],
            id="kind",
        ),
        pytest.param(
            CELL + "[sensor]\nvoltage_V = 1\n" + RUNS,
            MeasurementError,
            ["knows no 'sensor'", "Did you mean 'sensors'?"],
            id="key of the file",
        ),
        pytest.param(CELL, MeasurementError, ["runs must be one [[runs]] block", "at least one"], id="no runs"),
        pytest.param(
            CELL + '[runs]\nfile = "run-01.csv"\nsplit = "fit"\n',
            MeasurementError,
            ["[[runs]] block"],
            id="single [runs]",
        ),
        pytest.param(
            CELL + RUNS.replace('"check"', '"test"'),
            MeasurementError,
            ["run of run-02.csv: ", 'runs[2].split must be "fit" or "check", not "test"'],
            id="split",
        ),
        pytest.param(
            CELL + RUNS.replace("split", "splt"),
            MeasurementError,
            ["run of run-01.csv", "runs[1] knows no 'splt'", "Did you mean 'split'?", "1 more error)"],
            id="key of a run",
        ),
        pytest.param(
            CELL + RUNS + "cycels = 3\n", MeasurementError, ["runs[2]", "Did you mean 'cycles'?"], id="override's name"
        ),
        pytest.param(
            CELL + RUNS + "cycles = -3\n",
            ParameterError,
            ["run of run-02.csv", "runs[2]", "'cycles' = -3", "outside its range 0 to"],
            id="override's bounds",
        ),
        pytest.param(
            CELL + RUNS + "initial_soc = 80\n",
            ParameterError,
            ["run of run-02.csv", "'initial_soc' = 80", "divide it by 100"],
            id="percent",
        ),
        pytest.param(
            CELL + RUNS.replace("run-02.csv", "run-03.csv"),
            MeasurementError,
            ["runs[2].file", "no 'run-03.csv' next to case.toml", "Did you mean 'run-0"],
            id="no such CSV",
        ),
        pytest.param(
            CELL + RUNS.replace("run-02.csv", "./run-01.csv"),
            MeasurementError,
            ["runs[1].file and runs[2].file are both 'run-01'", "list each file once"],
            id="file twice",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity = 5\n" + RUNS,
            ParameterError,
            ["parameters knows no 'capacity'", "Did you mean 'capacity_Ah'?"],
            id="parameter's name",
        ),
        pytest.param(
            CELL + "[parameters]\nR_int = { soc = [0, 1], ohm = [1, 1] }\n" + RUNS,
            ParameterError,
            ["parameters knows no 'R_int'", "Did you mean 'R_ints'?"],
            id="table's name",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity_Ah = 0\n" + RUNS,
            ParameterError,
            ["[parameters]: 'capacity_Ah' = 0 is outside its range"],
            id="parameter's bounds",
        ),
        pytest.param(
            CELL + '[parameters]\ncapacity_Ah = "5.2"\n' + RUNS,
            ParameterError,
            ["parameters.capacity_Ah must be a number or { value = ..., sd = ... }", 'not "5.2"'],
            id="text",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity_Ah = true\n" + RUNS,
            ParameterError,
            ["parameters.capacity_Ah must be a number", "not true"],
            id="boolean",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity_Ah = { value = true }\n" + RUNS,
            ParameterError,
            ["parameters.capacity_Ah.value must be a number, not true"],
            id="boolean value",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity_Ah = nan\n" + RUNS,
            ParameterError,
            ["parameters.capacity_Ah must be a finite number, not nan"],
            id="nan",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity_Ah = { value = 5.2, std = 0.1 }\n" + RUNS,
            ParameterError,
            ["parameters.capacity_Ah knows no 'std'", "Did you mean 'sd'?"],
            id="key of a value",
        ),
        pytest.param(
            CELL + "[parameters]\ncapacity_Ah = { value = 5.2, sd = 0 }\n" + RUNS,
            ParameterError,
            ["parameters.capacity_Ah.sd must be greater than 0, not 0", "leave it out"],
            id="sd of zero",
        ),
        pytest.param(
            CELL + "[effects]\nwindage = 3\n" + RUNS,
            MeasurementError,
            ["effects.windage must be a table, { name = value }, not 3"],
            id="effect",
        ),
        pytest.param(
            CELL + '[effects]\nwindage = { c = "much" }\n' + RUNS,
            MeasurementError,
            ['effects.windage.c must be a number or { value = ..., sd = ... }, not "much"'],
            id="effect's parameter",
        ),
        pytest.param(
            CELL + "[effects]\ncurrent_offset = { column = 3, c = 1 }\n" + RUNS,
            MeasurementError,
            ["effects.current_offset.column must be text in quotes, not 3"],
            id="effect's column",
        ),
        pytest.param(
            CELL + "[sensors]\npack_voltage_V = 0.1\n" + RUNS,
            MeasurementError,
            ["[sensors]", "a cell has no column 'pack_voltage_V'", "Did you mean 'voltage_V'?"],
            id="sensor's column",
        ),
        pytest.param(
            CELL + "[sensors]\nvoltage_V = -0.1\n" + RUNS,
            MeasurementError,
            ["sensors.voltage_V must be greater than 0, not -0.1"],
            id="sensor's sd",
        ),
        pytest.param(
            CELL + "[tolerance]\nvolt_V = 0.1\n" + RUNS,
            MeasurementError,
            ["[tolerance]", "a cell has no reading 'volt_V'", "Did you mean 'voltage_V'?"],
            id="tolerance's column",
        ),
        pytest.param(
            CELL + RUNS + "tolerance = { current_A = 0.1 }\n",
            MeasurementError,
            ["run of run-02.csv", "runs[2].tolerance: a cell has no reading 'current_A'", "Use one of voltage_V"],
            id="tolerance of an input",
        ),
        pytest.param(
            CELL + "[tolerance]\nvoltage_V = { rms = 0.02, max = 0.01 }\n" + RUNS,
            MeasurementError,
            ["tolerance.voltage_V has max 0.01 below rms 0.02"],
            id="tolerance that none can hold",
        ),
        pytest.param(
            CELL + '[tolerance]\nvoltage_V = "small"\n' + RUNS,
            MeasurementError,
            ['tolerance.voltage_V must be a number or { rms = ..., max = ... }, not "small"'],
            id="tolerance's form",
        ),
        pytest.param(
            CELL + "[cutoff]\nsoc = 10\n" + RUNS,
            MeasurementError,
            ["cutoff.soc must be at most 1, not 10"],
            id="cutoff",
        ),
    ],
)
def test_a_wrong_case_gets_one_sentence_with_place_and_remedy(folder, toml, error, parts):
    with pytest.raises(error) as caught:
        read(folder, toml)
    message = str(caught.value)
    for part in ["bench/case.toml", *parts]:
        assert part in message
    assert "\n" not in message
    assert message.endswith((".", "?"))


@pytest.mark.parametrize(
    ("table", "parts"),
    [
        ("ocv = { soc = [0, 1], ohm = [3, 4] }", ["ocv knows no 'ohm'", "Use one of soc, temperature_degC, voltage_V"]),
        ("ocv = { soc = [0, 1] }", ["ocv.voltage_V is missing"]),
        ("ocv = { soc = [], voltage_V = [] }", ["ocv.soc must not be empty"]),
        ("ocv = { soc = [0, 1], voltage_V = [3, 4, 5] }", ["ocv has 2 soc and 3 values", "one value per soc"]),
        ("ocv = { soc = [0, 0.5, 0.5], voltage_V = [3, 4, 5] }", ["ocv has soc 0.5 after 0.5", "increase"]),
        ("ocv = { soc = [0, 50, 100], voltage_V = [3, 4, 5] }", ["ocv has soc from 0.0 to 100.0", "fraction"]),
        ('ocv = { soc = [0, 1], voltage_V = [3, "4"] }', ["ocv.voltage_V must hold finite numbers only", '"4"']),
        ("ocv = { soc = [0, 1], voltage_V = [3, inf] }", ["ocv.voltage_V must hold finite numbers only, not inf"]),
        ("R_TS = { soc = [0, 1], ohm = [0.1, 0] }", ["R_TS has ohm = 0", "greater than 0"]),
        ("C_TS = { soc = [0, 1], farad = [[1, 1], [1, 1]] }", ["C_TS has rows in farad but no temperature_degC"]),
        (
            "R_ints = { soc = [0, 1], temperature_degC = [0, 20], ohm = [0.1, 0.2] }",
            ["R_ints needs one row of ohm per temperature_degC", "2 rows of 2 numbers"],
        ),
        (
            "R_ints = { soc = [0, 1], temperature_degC = [0, 20, 40], ohm = [[1, 1], [1, 1]] }",
            ["R_ints needs one row of ohm per temperature_degC", "3 rows of 2 numbers"],
        ),
        (
            "R_ints = { soc = [0, 1], temperature_degC = [20, 0], ohm = [[1, 1], [1, 1]] }",
            ["R_ints has temperature_degC 0.0 after 20.0", "sort it"],
        ),
        (
            "R_ints = { soc = [0, 1], temperature_degC = [0, 20], ohm = [[1, 1], [1, 1, 1]] }",
            ["R_ints has 2 soc and 3 values in ohm"],
        ),
        ("R_ints = 0.02", ["R_ints must be a table", "not 0.02"]),
        ("ocv = { soc = [0, 1], voltage_V = [3, 4], sd_V = 0 }", ["ocv.sd_V must be greater than 0, not 0"]),
        (
            "R_TL = { soc = [0, 1], ohm = [3, 4], sd_rel = 0.1 }",
            ["R_TL knows no 'sd_rel'", "Did you mean 'sd_relative'?"],
        ),
        ("friction = { speed_rad_s = [0, 9], Nm = [0.1] }", ["friction has 2 speed_rad_s and 1 values in Nm"]),
        ("friction = { speed_rad_s = [-9, 9], Nm = [0.1, 0.1] }", ["friction has speed_rad_s -9", "a size, from 0 on"]),
        ("friction = { speed_rad_s = [9, 0], Nm = [0.1, 0.1] }", ["friction has speed_rad_s 0.0 after 9.0", "sort it"]),
        ("torque_factor = { current_A = [0, 9], factor = [1, 0] }", ["torque_factor has factor = 0", "greater than 0"]),
    ],
)
def test_a_wrong_table_gets_one_sentence(folder, table, parts):
    with pytest.raises(ParameterError) as caught:
        read(folder, f"{CELL}[parameters]\n{table}\n{RUNS}")
    for part in ["bench/case.toml: parameters.", *parts]:
        assert part in str(caught.value)


def test_a_table_of_a_motor_is_none_of_a_cell(folder):
    table = "friction = { speed_rad_s = [0, 9], Nm = [0.1, 0.2] }"
    with pytest.raises(ParameterError, match="friction is a table of a motor, and the case is of a cell"):
        case_model(read(folder, f"{CELL}[parameters]\n{table}\n{RUNS}"))


def test_a_table_may_reach_a_little_beyond_empty_and_full(folder):
    case = read(folder, f"{CELL}[parameters]\nocv = {{ soc = [-0.05, 1.05], voltage_V = [2.9, 4.2] }}\n{RUNS}")
    assert case.tables["ocv"].soc.tolist() == [-0.05, 1.05]


def test_a_wrong_csv_is_named_with_its_line(folder):
    (folder / "run-02.csv").write_text(CSV["cell"] + "2,on,20,3.9\n")
    with pytest.raises(MeasurementError, match=r"bench/run-02\.csv, line 4, column 'current_A': 'on' is not a number"):
        read(folder, CELL + RUNS)


@pytest.mark.parametrize("name", ["", "absent", f"absent{os.sep}case.toml"])
def test_a_path_without_a_case_is_an_error(folder, name):
    with pytest.raises(MeasurementError, match=r"There is no .*; give a folder that has a case\.toml"):
        read_case(folder / name)


def test_a_csv_is_not_a_case(folder):
    with pytest.raises(MeasurementError, match=r"bench/run-01\.csv is not a TOML file; give the case\.toml"):
        read_case(folder / "run-01.csv")
