"""The runs of a cell in the Battery Data Format: labels, sign, what is left out, and who reads it back."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, read_case, read_table
from jaxmodel.base.errors import MeasurementError, ParameterError
from jaxmodel.data.importing import import_case
from jaxmodel.export.bdf import LABELS, TIME
from tests.export.other_python import run_by
from tests.export.test_c_model import made_up


@pytest.fixture(scope="module")
def case() -> Case:
    return read_case("examples/samsung_30q")


def with_gaps() -> Case:
    time = np.arange(0.0, 400.0, 2.0)
    voltage = 4.1 - 0.1 * (time > 20.0) - 1e-4 * time
    voltage[50] = np.nan
    rows = {"time_s": time, "current_A": 1.0 * (time > 20.0), "ambient_degC": 21.3, "voltage_V": voltage}
    frame = pd.DataFrame(rows | {"soc": 1.0 - 1e-4 * time})
    silent = frame.drop(columns=["voltage_V", "soc"]).assign(cell_temperature_degC=22.0)
    return Case.from_dataframes({"read": frame, "silent": silent}, kind="cell", name="gaps")


def test_each_run_is_a_file_with_labels_of_the_format(case: Case, tmp_path: Path) -> None:
    found = case.export("bdf", tmp_path / "new" / "runs")
    assert [path.name for path in sorted((tmp_path / "new" / "runs").iterdir())] == sorted(found.files)
    assert list(found.files) == [f"{run.name}.bdf.csv" for run in case.runs]
    header, first, *_ = found.files["cc1C.bdf.csv"].splitlines()
    assert header == "Test Time / s,Voltage / V,Current / A,Ambient Temperature / degC,Surface Temperature T1 / degC"
    assert first == "0.0,4.1432,0.0282,22.56,22.95"
    assert "4 files" in repr(found)


@pytest.mark.parametrize("gaps", [False, True])
def test_our_own_reader_returns_the_same_numbers(case: Case, gaps: bool, tmp_path: Path) -> None:
    case = with_gaps() if gaps else case
    for name, content in case.export("bdf", tmp_path).files.items():
        table = read_table(tmp_path / name)
        assert (table.format, table.current_positive_on) == ("Battery Data Format", "charge")
        (run,) = [run for run in case.runs if name == f"{run.name}.bdf.csv"]
        frame = pd.read_csv(tmp_path / name)
        given = run.to_dataframe()
        given["current_A"] *= -1.0
        expected = given[["time_s", *(column for column in LABELS if column in given)]]
        np.testing.assert_array_equal(frame.to_numpy(), expected.to_numpy())
        assert len(content.splitlines()) == 1 + len(given)


def test_it_is_imported_as_the_runs_that_it_is_of(case: Case, tmp_path: Path) -> None:
    case.export("bdf", tmp_path)
    for run in case.runs:
        (log,) = [one.log for one in import_case(tmp_path / f"{run.name}.bdf.csv", "cell").runs]
        np.testing.assert_array_equal(log.time_s, run.measured.time_s)
        given = run.measured.inputs | run.measured.outputs
        assert set(log.columns) == set(given)
        for name, values in given.items():
            np.testing.assert_array_equal(log.columns[name], values)


def test_what_the_format_has_no_place_for_is_said() -> None:
    said = " ".join(with_gaps().export("bdf").left_out)
    assert "initial_soc" in said
    assert "read no voltage: silent." in said
    assert "state of charge that read reads" in said


def test_what_is_no_cell_or_reads_no_voltage_is_refused() -> None:
    with pytest.raises(ParameterError, match="of single cells, and this is a motor"):
        made_up("motor").export("bdf")
    rows = {"time_s": [0.0, 1.0], "current_A": 1.0, "ambient_degC": 20.0, "cell_temperature_degC": 20.0}
    with pytest.raises(ParameterError, match="no run reads the voltage"):
        Case.from_dataframes({"warm": pd.DataFrame(rows)}, kind="cell").export("bdf")


def test_several_files_need_a_folder_and_no_run_is_replaced(case: Case, tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(MeasurementError, match="'bdf' writes several; give a folder"):
        case.export("bdf", tmp_path / "taken")
    first, second = case.runs[:2]
    twins = (dataclasses.replace(first, name="a"), dataclasses.replace(second, name="a.bdf"))
    dataclasses.replace(case, runs=twins).write(tmp_path / "case")
    with pytest.raises(MeasurementError, match=r"a\.bdf\.csv: this is a file of the case; give another folder"):
        read_case(tmp_path / "case").export("bdf", tmp_path / "case")


def test_the_alliance_reads_and_validates_it(case: Case, tmp_path: Path) -> None:
    paths = []
    for one in (case, with_gaps()):
        paths += [tmp_path / name for name in one.export("bdf", tmp_path).files]
    found = run_by("bdf", "by_bdf.py", *paths)
    for path in paths:
        read = found[str(path)]
        assert read["report"] == {"ok": True, "missing": [], "extras": [], "legacy_labels": []}
        assert read["monotonic"]
        expected = pd.read_csv(path)
        assert next(iter(read["columns"])) == TIME
        np.testing.assert_array_equal(np.array(list(read["columns"].values()), dtype=float).T, expected.to_numpy())
