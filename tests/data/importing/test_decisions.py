"""Signs, columns, units, runs and check runs are decided by what the files hold, and the user has the last word."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxmodel.base.errors import MeasurementError, UserError
from jaxmodel.data.importing import import_case
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.sign import evidence, settle
from tests.data.importing.benches import arbin, cell_log, motor_log


def log_of(frame: pd.DataFrame, factor: float = 1.0) -> Log:
    columns = {"current_A": factor * frame.current_A.to_numpy(), "voltage_V": frame.voltage_V.to_numpy()}
    return Log("run", Path("run.csv"), frame.time_s.to_numpy(dtype=float), columns)


def write(folder: Path, frame: pd.DataFrame, name: str = "log.csv") -> Path:
    path = folder / name
    frame.to_csv(path, index=False)
    return path


@given(
    resistance=st.floats(0.002, 0.2),
    reversed_=st.booleans(),
    seed=st.integers(0, 1000),
    rows=st.sampled_from([slice(0, 130), slice(0, 480), slice(200, 700), slice(560, None)]),
)
def test_the_sign_is_found_whichever_way_a_bench_counts(resistance: float, reversed_: bool, seed: int, rows: slice):
    frame = cell_log(seed, resistance)[rows].reset_index(drop=True)
    log = log_of(frame, -1.0 if reversed_ else 1.0)
    assert (evidence(log).odds < 1.0) == reversed_
    (settled,) = settle([log], None, False)
    np.testing.assert_array_equal(settled.columns["current_A"], frame.current_A)


def test_a_current_that_never_changes_is_settled_by_the_charge():
    frame = cell_log()[200:460].reset_index(drop=True)
    frame = frame[frame.current_A == 2.9]
    (settled,) = settle([log_of(frame, -1.0)], None, False)
    assert (settled.columns["current_A"] > 0.0).all()


def test_what_physics_cannot_settle_is_asked_for():
    frame = cell_log().assign(voltage_V=3.7)
    with pytest.raises(MeasurementError, match=r"sign of the current is not settled.*--sign discharge-positive or"):
        settle([log_of(frame)], None, False)
    (kept,) = settle([log_of(frame)], "charge-positive", False)
    np.testing.assert_array_equal(kept.columns["current_A"], -frame.current_A)


def test_a_file_of_the_other_sign_among_many_is_told(tmp_path: Path):
    good, bad = cell_log(), cell_log(1).assign(current_A=lambda f: -f.current_A)
    files = [write(tmp_path, good, "a.csv"), write(tmp_path, good, "b.csv"), write(tmp_path, bad, "c.csv")]
    imported = import_case(files, "cell", ambient=25.0)
    assert [finding.where for finding in imported.findings if finding.what == "sign"] == ["c"]


@settings(max_examples=10)
@given(
    current=st.sampled_from([("A", 1.0), ("mA", 1e-3), ("kA", 1e3)]),
    voltage=st.sampled_from([("V", 1.0), ("mV", 1e-3)]),
    time=st.sampled_from([("s", 1.0), ("min", 60.0), ("h", 3600.0), ("ms", 1e-3)]),
    warmth=st.sampled_from([("°C", 1.0, 0.0), ("K", 1.0, -273.15), ("degF", 5.0 / 9.0, -160.0 / 9.0)]),
)
def test_any_unit_gives_the_same_readings(tmp_path_factory, current, voltage, time, warmth):
    log = cell_log()[::4].reset_index(drop=True)
    frame = pd.DataFrame(
        {
            f"t [{time[0]}]": log.time_s / time[1],
            f"I [{current[0]}]": log.current_A / current[1],
            f"U [{voltage[0]}]": log.voltage_V / voltage[1],
            f"Temperature [{warmth[0]}]": (log.temperature_degC - warmth[2]) / warmth[1],
        }
    )
    (run,) = import_case(write(tmp_path_factory.mktemp("units"), frame), "cell", ambient=25.0).runs
    np.testing.assert_allclose(run.log.time_s, log.time_s, atol=1e-6)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A, atol=1e-9)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V, atol=1e-9)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], log.temperature_degC, atol=1e-9)


def test_columns_without_names_are_found_by_their_looks_and_said(tmp_path: Path):
    log = cell_log()
    path = tmp_path / "log.csv"
    log[["time_s", "voltage_V", "current_A"]].to_csv(path, index=False, header=False)
    imported = import_case(path, "cell", ambient=25.0)
    np.testing.assert_array_equal(imported.runs[0].log.columns["voltage_V"], log.voltage_V)
    np.testing.assert_array_equal(imported.runs[0].log.columns["current_A"], log.current_A)
    assert {f.column for f in imported.findings if f.what == "column by its looks"} == {
        "time_s",
        "voltage_V",
        "current_A",
    }


def test_a_stated_column_and_unit_come_before_what_is_found(tmp_path: Path):
    log = cell_log().assign(
        temperature_tab_degC=30.0 + np.arange(len(cell_log())) * 0.01, x=lambda f: 1000.0 * f.voltage_V
    )
    path = write(tmp_path, log)
    columns = {"cell_temperature_degC": "temperature_tab_degC", "voltage_V": "x"}
    imported = import_case(path, "cell", ambient=25.0, columns=columns, units={"x": "mV"})
    columns = imported.runs[0].log.columns
    np.testing.assert_array_equal(columns["cell_temperature_degC"], log.temperature_tab_degC)
    np.testing.assert_allclose(columns["voltage_V"], log.voltage_V)
    without = import_case(path, "cell", ambient=25.0, columns={"cell_temperature_degC": ""})
    assert "cell_temperature_degC" not in without.runs[0].log.columns


def test_runs_begin_where_the_clock_or_the_user_says(tmp_path: Path):
    one = cell_log()
    twice = pd.concat([one.assign(cycle=1), one.assign(cycle=2)])
    path = write(tmp_path, twice)
    assert [run.log.name for run in import_case(path, "cell", ambient=25.0).runs] == ["log-1", "log-2"]
    single = write(tmp_path, one, "one.csv")
    by_rest = import_case(single, "cell", ambient=25.0, split_at="rests", rest_minutes=15.0).runs
    assert len(by_rest) == 2
    assert by_rest[1].log.columns["current_A"][1] == -2.0
    assert by_rest[1].log.time_s[0] == 0.0
    assert sum(run.log.rows for run in by_rest) == len(one)
    by_step = import_case(single, "cell", ambient=25.0, split_at="steps")
    dropped = sum(f.numbers["rows"] for f in by_step.findings if f.what == "short parts")
    assert sum(run.log.rows for run in by_step.runs) + dropped == len(one)


def test_a_whole_condition_is_held_out(tmp_path: Path):
    files = []
    for where, degrees in (("p25", 0.0), ("n10", -35.0), ("p45", 20.0)):
        log = cell_log()[::3].assign(temperature_degC=lambda f, by=degrees: f.temperature_degC + by)
        files += [write(tmp_path, log, f"{name}_{where}degC.csv") for name in ("a", "b")]
    imported = import_case(files, "cell")
    assert {run.log.name for run in imported.runs if run.split == "check"} == {"a_p25degC", "b_p25degC"}
    assert {run.ambient_degC for run in imported.runs} == {25.0, -10.0, 45.0}
    chosen = import_case(files, "cell", check=("*_n10*",))
    assert {run.log.name for run in chosen.runs if run.split == "check"} == {"a_n10degC", "b_n10degC"}
    with pytest.raises(MeasurementError, match=r"no run is called 'a_p2degC'\. Did you mean 'a_p25degC'"):
        import_case(files, "cell", check=("a_p2degC",))


def test_the_state_of_charge_is_counted_from_the_cutoff_or_read_from_rests(tmp_path: Path):
    log = cell_log()
    later = log[70:].reset_index(drop=True)
    middle = log[137:].assign(time_s=lambda f: f.time_s - 1370.0)[:150]
    files = [
        write(tmp_path, log, "full.csv"),
        write(tmp_path, later, "later.csv"),
        write(tmp_path, middle, "middle.csv"),
    ]
    imported = import_case(files, "cell", ambient=25.0)
    truth = 1.0 - np.cumsum(log.current_A) * 10.0 / 3600.0 / 3.0
    for run, first in zip(imported.runs, (0, 70, 137), strict=True):
        assert run.start is not None
        assert abs(run.start.value - truth[first]) < 2.5 * (run.start.sd or 0.0)


def test_a_motor_is_imported_with_first_constants(tmp_path: Path):
    log = motor_log()
    frame = log.rename(columns={"speed_rad_s": "speed_rpm"}).assign(speed_rpm=log.speed_rad_s * 30.0 / np.pi)
    imported = import_case(write(tmp_path, frame), "motor", ambient=23.0, out=tmp_path / "case")
    np.testing.assert_allclose(imported.runs[0].log.columns["speed_rad_s"], log.speed_rad_s)
    assert imported.constants["k_tau"].value == pytest.approx(0.05, rel=1e-6)
    assert imported.constants["R_0"].value == pytest.approx(0.5, rel=1e-6)
    flipped = import_case(write(tmp_path, frame.assign(current_A=-log.current_A)), "motor", ambient=23.0)
    assert any(finding.what == "sign" and "--flip current_A" in finding.sentence for finding in flipped.findings)


def test_a_list_of_files_states_ambient_label_and_load(tmp_path: Path):
    log = motor_log().drop(columns="torque_Nm")
    write(tmp_path, log, "a.csv")
    write(tmp_path, log, "b.csv")
    listing = pd.DataFrame({"file": ["a.csv", "b.csv"], "kind": ["no load", "loaded"], "ambient_degC": [20, 30]})
    listing["load_torque_Nm"] = [0.0, 0.1]
    write(tmp_path, listing, "runs.csv")
    imported = import_case(sorted(tmp_path.glob("*.csv")), "motor")
    assert [run.ambient_degC for run in imported.runs] == [20.0, 30.0]
    assert [run.log.columns["load_torque_Nm"][0] for run in imported.runs] == [0.0, 0.1]
    assert [run.label for run in imported.runs] == ["no load, 20 degC", "loaded, 30 degC"]


def test_a_list_of_more_files_than_were_taken_is_still_a_list(tmp_path: Path):
    log = motor_log().drop(columns="torque_Nm")
    taken = [write(tmp_path, log, "a.csv"), write(tmp_path, log.iloc[:300], "b.csv")]
    rows = [(f"{name}.csv", 0.1 * place) for place, name in enumerate("abcdefghij")]
    listing = write(tmp_path, pd.DataFrame(rows, columns=["file", "load_torque_Nm"]), "runs.csv")
    imported = import_case([*taken, listing], "motor", ambient=23.0)
    assert [run.log.columns["load_torque_Nm"][0] for run in imported.runs] == [0.0, 0.1]


def test_what_is_open_is_asked_where_somebody_answers(tmp_path: Path):
    path = write(tmp_path, cell_log().drop(columns="temperature_degC"))
    asked = []

    def answer(question) -> str:
        asked.append(question.option)
        return "21.5"

    imported = import_case(path, "cell", ask=answer)
    assert asked == ["--ambient DEGC"]
    assert imported.runs[0].ambient_degC == 21.5


def test_a_column_that_no_name_tells_is_asked_for(tmp_path: Path):
    log = motor_log().rename(columns={"torque_Nm": "brake"})
    path = write(tmp_path, log)
    imported = import_case(path, "motor", ambient=23.0, ask=lambda question: "brake")
    np.testing.assert_array_equal(imported.runs[0].log.columns["load_torque_Nm"], log.brake)
    unknown = import_case(path, "motor", ambient=23.0, ask=lambda question: "none")
    assert "speed_rad_s" in unknown.case.runs[0].measured.inputs
    assert any(one.about == "load" and one.value == "unknown" for one in unknown.decisions)


@pytest.mark.parametrize(
    ("change", "options", "parts"),
    [
        (lambda f: f.drop(columns="temperature_degC"), {}, ["no ambient temperature", "--ambient"]),
        (lambda f: f.drop(columns="current_A"), {"ambient": 25.0}, ["current_A", "--column"]),
        (lambda f: f.drop(columns="time_s"), {"ambient": 25.0}, ["no column of time", "--seconds-per-row"]),
        (
            lambda f: f.assign(voltage_V=6.0 * f.voltage_V),
            {"ambient": 25.0},
            ["more than one cell", "--cells-in-series 6"],
        ),
        (lambda f: f, {"units": {"current_A": "V"}}, ["'V'", "not a unit of current_A", "--unit"]),
        (lambda f: f, {"columns": {"current": "current_A"}}, ["no column 'current'", "Did you mean 'current_A'"]),
        (lambda f: f, {"columns": {"current_A": "I"}}, ["no file has a column 'I'"]),
        (lambda f: f, {"constants": {"load": 1.0}}, ["a cell has no column 'load'"]),
        (lambda f: f, {"sign": "positive"}, ["sign", "discharge-positive or charge-positive"]),
        (lambda f: f, {"initial_soc": 80.0}, ["initial_soc", "0 and 1", "percent, state 0.8"]),
        (lambda f: f, {"ambient": 298.15}, ["ambient: 298.15", "kelvin, state 25"]),
        (lambda f: f, {"ambient": float("nan")}, ["ambient: nan", "correct it"]),
        (
            lambda f: f,
            {"each_cell": True, "ambient": 25.0},
            ["no columns hold voltages of single cells", "--each-cell"],
        ),
        (lambda f: f, {"each_cell": True, "columns": {"voltage_V": "cell_1"}}, ["--each-cell or --column voltage_V"]),
        (lambda f: f, {"each_cell": True, "specimens": {"A": "a*"}}, ["the columns tell the cells"]),
        (lambda f: f, {"each_cell": True, "cells_in_series": 3}, ["--each-cell or --cells-in-series"]),
        (lambda f: f, {"tempo": 1}, ["no decision 'tempo'"]),
    ],
)
def test_a_mistake_gets_one_sentence(tmp_path: Path, change, options, parts):
    path = write(tmp_path, change(cell_log()))
    with pytest.raises(UserError) as caught:
        import_case(path, "cell", **options)
    for part in parts:
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_are_not_written_over(tmp_path: Path):
    imported = import_case(write(tmp_path, cell_log()), "cell", ambient=25.0)
    with pytest.raises(MeasurementError, match="give another"):
        imported.write(tmp_path)


def test_a_module_is_divided_into_cells(tmp_path: Path):
    log = cell_log()
    path = write(tmp_path, log.assign(voltage_V=6.0 * log.voltage_V, current_A=2.0 * log.current_A))
    columns = import_case(path, "cell", ambient=25.0, cells_in_series=6, parallel_cells=2).runs[0].log.columns
    np.testing.assert_allclose(columns["voltage_V"], log.voltage_V)
    np.testing.assert_allclose(columns["current_A"], log.current_A)


def test_decisions_and_findings_are_data(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text(arbin(cell_log()))
    imported = import_case(path, "cell", ambient=25.0)
    for one in (*imported.findings, *imported.decisions):
        assert dataclasses.is_dataclass(one)
        assert set(one.to_dict()) == {field.name for field in dataclasses.fields(one)}
    assert len(imported.to_dataframe()) == 1
    assert "parameterise" in imported.summary()


@pytest.mark.parametrize(
    ("kind", "given", "parts"),
    [
        ("cell", {"load": "free"}, ["a cell turns nothing", "remove --load"]),
        ("motor", {"load": "gravity", "load_numbers": {"mass": 1.0}}, ["gravity has no number 'mass'", "'mass_kg'"]),
        ("motor", {"load": "free", "load_numbers": {"c": 1.0}}, ["free has no number 'c'", "Remove it"]),
        ("motor", {"load": "gravity", "load_numbers": {"mass_kg": -1.0}}, ["gravity: 'mass_kg' = -1", "0 to 10000 kg"]),
        ("motor", {"load": ""}, ["there is no ''; use measured or"]),
        ("motor", {"load": "unknown", "constants": {"load_torque_Nm": 0.0}}, ["with --load unknown", "remove one"]),
        ("motor", {"load": "unknown", "columns": {"incline_deg": "slope"}}, ["with --load unknown", "no incline_deg"]),
        ("motor", {"each_cell": True}, ["cells are parted with --kind cell"]),
    ],
)
def test_a_load_that_cannot_be_is_one_sentence(tmp_path: Path, kind, given: dict, parts: list[str]):
    path = write(tmp_path, motor_log())
    with pytest.raises(UserError) as error:
        import_case(path, kind, ambient=23.0, **given)
    for part in parts:
        assert part in str(error.value)
