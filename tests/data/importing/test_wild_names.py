"""Names, units and forms of files as people bring them: words are believed, and what is lacking is asked for."""

from __future__ import annotations

import importlib.util
import json
import shutil
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import scipy.io

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import Imported, import_case
from jaxmodel.data.importing.ambient import temperature_in
from jaxmodel.data.importing.roles import roles_of
from jaxmodel.data.tables import read_table
from jaxmodel.data.tables.names import are_units, matches, parse_name
from jaxmodel.data.tables.raw_table import units_in
from tests.conftest import Wild
from tests.data.importing.benches import cell_log, motor_log


def under(folder: Path, header: str, frame: pd.DataFrame, name: str = "log.csv") -> Path:
    """Write a table under lines of its own."""
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(header + "\n" + frame.to_csv(index=False, header=False), encoding="utf-8")
    return path


def columns_of(imported: Imported) -> dict[str, str]:
    """The columns of the files by what they became, as the decisions say."""
    return {one.about: one.value for one in imported.decisions if one.value.startswith("column ")}


def saying(kind: Any, path: Path, **options: Any) -> str:
    """The sentence with which an import is refused."""
    with pytest.raises(MeasurementError) as caught:
        import_case(path, kind, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


# Lines of names and of units


def test_names_that_all_end_in_a_bracket_are_names(wild: Wild):
    imported = import_case(wild("01-names-all-in-brackets")[0], "cell", ambient=22.0)
    said = columns_of(imported)
    assert said["current_A"] == "column 'Current(A)' in A"
    assert said["voltage_V"] == "column 'Voltage(V)' in V"
    assert not [one for one in imported.findings if one.what in ("column by its looks", "unit assumed", "not read")]
    assert imported.runs[0].log.columns["voltage_V"][0] == 4.19


@pytest.mark.parametrize("above", ["", "Charger 3, cell 7\n", "made by; nobody\n\n"])
def test_a_title_above_the_names_changes_nothing(tmp_path: Path, above: str):
    log = cell_log()[["voltage_V", "time_s", "current_A"]]
    frame = pd.DataFrame(
        {"U": 1000.0 * log.voltage_V, "t": np.round(log.time_s / 60.0, 6), "I": 1000.0 * log.current_A}
    )
    path = under(tmp_path, above + "Spannung[mV],Zeit[min],Strom[mA]", frame)
    run = import_case(path, "cell", ambient=10.0).runs[0].log
    np.testing.assert_allclose(run.columns["voltage_V"], log.voltage_V)
    np.testing.assert_allclose(run.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.time_s, log.time_s, atol=1e-3)


def test_an_unknown_unit_in_a_line_of_units_is_asked_for_by_its_column(wild: Wild):
    (path,) = wild("02-units-line-with-an-unknown-unit", "dyno.csv")
    options: dict[str, Any] = {"ambient": 22.0, "seconds_per_row": 5.0}
    said = saying("motor", path, **options)
    assert "column 'Output Speed' is in 'rad.s'" in said
    assert '--unit "Output Speed=rad/s"' in said
    run = import_case(path, "motor", units={"Output Speed": "rad/s"}, **options).runs[0].log
    assert run.columns["load_torque_Nm"].max() == pytest.approx(0.4)
    assert set(run.columns["speed_rad_s"]) == {20.0, 40.0, 60.0, 80.0}
    assert {"current_A", "voltage_V"} <= run.columns.keys()


@pytest.mark.parametrize(
    ("units", "asked"),
    [
        ("s;V;A;[Nm];[U per s]", "Drehzahl"),
        ("(s);(V);(A);(kgf*foot2);(rpm)", "Drehmoment"),
        ("ticks.s;V;A;Nm;rpm", "Zeit"),
        ("sec;Vdc;Adc;oz.xx;rpms", "Drehmoment"),
    ],
)
def test_a_unit_that_nobody_knows_leaves_the_names_names(tmp_path: Path, units: str, asked: str):
    path = under(tmp_path, f"Zeit;Spannung;Strom;Drehmoment;Drehzahl\n{units}".replace(";", ","), motor_log())
    said = saying("motor", path, ambient=20.0)
    assert f"column '{asked}' is in " in said
    assert f'--unit "{asked}=' in said


def test_an_unknown_unit_of_a_column_that_no_case_needs_leaves_it_out(tmp_path: Path):
    log = cell_log()
    path = under(tmp_path, "time_s,current_A,voltage_V,Surface temperature (mystery),step", log)
    imported = import_case(path, "cell", ambient=20.0)
    assert "cell_temperature_degC" not in imported.runs[0].log.columns
    (found,) = [one for one in imported.findings if one.what == "unit unknown"]
    assert "'Surface temperature (mystery)'" in found.sentence


@pytest.mark.parametrize(
    ("fields", "above", "are"),
    [
        ("s,A,V", "t,i,u", True),
        ("s,A,V", "x1,x2,x3", True),
        ("N.mm,rad.s,A,V", "Torque,Speed,Current,Voltage", True),
        ("lbs.yd,rot.s", "Torque,Speed", True),
        ("Time(s),Current(A)", "A title", False),
        ("Time(s),Current(A)", "Time,Current", False),
        ("time,rpm,V,A", "Bench 4,Miller,May,ok", False),
        ("s,V", "A title", False),
        ("Time [s],Speed [rpm],Current [A]", "Motor,Motor,Battery", False),
    ],
)
def test_a_line_states_units_if_its_words_are_units(fields: str, above: str, are: bool):
    assert are_units(fields.split(","), above.split(",")) == are


@pytest.mark.parametrize(
    ("column", "words", "unit"),
    [
        ("Current (Motor)", "current motor", ""),
        ("Voltage (Motor) [V]", "voltage motor", "V"),
        ("Spannung (U)", "spannung u", ""),
        ("Speed (rot/fortnight)", "speed", "rot/fortnight"),
        ("Torque/N.mm", "torque", "N.mm"),
        ("Nm", "nm", "Nm"),
        ("V", "v", ""),
    ],
)
def test_a_bracket_holds_a_unit_or_a_remark(column: str, words: str, unit: str):
    assert parse_name(column) == (words, unit)


def test_a_known_unit_of_another_quantity_speaks_against_a_name():
    assert not matches("Voltage (A)")
    assert not matches("Speed (m/s)")
    assert matches("Speed (fancy)")[0].unit_unknown


# Roles by units


def test_the_only_column_in_volts_is_the_voltage(wild: Wild):
    (path,) = wild("04-voltage-known-by-its-unit-only", "flight.csv")
    imported = import_case(path, "cell", ambient=22.0, cells_in_series=3)
    assert columns_of(imported)["voltage_V"] == "column 'VFAS(V)' in V"
    assert imported.runs[0].log.columns["voltage_V"][0] == pytest.approx(4.1)
    assert np.median(imported.runs[0].log.columns["current_A"]) > 0.0


def roles(kind: str, *names: str) -> dict[str, str]:
    return {target: role.column for target, role in roles_of(names, units_in(names), kind, {}).items()}


def test_a_role_is_found_by_the_unit_in_the_header():
    found = roles("motor", "clk [s]", "Umot [mV]", "Idc [A]", "nMot [1/min]", "Mshaft [mNm]")
    assert found == {
        "voltage_V": "Umot [mV]",
        "current_A": "Idc [A]",
        "speed_rad_s": "nMot [1/min]",
        "load_torque_Nm": "Mshaft [mNm]",
    }
    assert roles("cell", "time_s", "Umess (mV)", "Imess (mA)")["voltage_V"] == "Umess (mV)"


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("cell", ("time_s", "VFAS(V)", "RxBt(V)", "Curr(A)")),  # two of them: which one?
        ("cell", ("time_s", "OCV (V)", "Curr(A)")),
        ("cell", ("time_s", "limit [V]", "Curr(A)")),
        ("motor", ("time_s", "Battery voltage (V)", "Curr(A)")),
    ],
)
def test_a_unit_does_not_speak_against_the_name(kind: str, names: Sequence[str]):
    assert "voltage_V" not in roles(kind, *names)


@pytest.mark.parametrize("name", ["PWM frequency [Hz]", "Gyro z [deg/s]", "wheel speed target [rpm]"])
def test_what_turns_is_not_always_the_motor(name: str):
    assert "speed_rad_s" not in roles("motor", "time_s", "voltage_V", name)


def test_a_clock_in_a_unit_of_time_is_found_though_it_counts_in_whole_numbers(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V"]]
    log = log.assign(time_s=(1000.0 * log.time_s).astype(int))
    run = import_case(under(tmp_path, "clk [ms],I [A],U [V]", log), "cell", ambient=20.0).runs[0].log
    np.testing.assert_allclose(run.time_s, cell_log().time_s)


@pytest.mark.parametrize("name", ["Force", "speed", "command", "thrust2", "Axis 1", "cmd"])
def test_a_name_that_says_another_quantity_is_no_current_by_its_looks(tmp_path: Path, name: str):
    path = under(tmp_path, f"time_s,{name},voltage_V", cell_log()[["time_s", "current_A", "voltage_V"]])
    said = saying("cell", path, ambient=20.0)
    assert f"no column is current_A, which a cell needs; the columns are time_s (time_s), {name}, voltage_V" in said


# What is lacking


def test_what_is_lacking_is_said_with_the_columns(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V", "step"]]
    said = saying("cell", under(tmp_path, "time_s,I [A],humidity,Step", log), ambient=20.0)
    assert "no column is voltage_V; the columns are time_s (time_s), I [A] (current_A), humidity, Step (step)" in said
    assert "--sign" not in said
    said = saying("motor", under(tmp_path, "time_s,I [A],U [V],other", log), ambient=20.0)
    assert "no column is load_torque_Nm" in said
    assert "I [A] (current_A), U [V] (voltage_V), other" in said


@pytest.mark.parametrize("named", ["Cur(A)", "I [mA]", "Ampere", "a * b", "current_A +"])
@pytest.mark.parametrize("target", ["current_A", "time_s"])
def test_a_column_that_is_none_is_answered_by_the_columns(tmp_path: Path, named: str, target: str):
    path = under(tmp_path, "time_s,current_A,voltage_V,heat,step", cell_log())
    said = saying("cell", path, ambient=20.0, columns={target: named})
    assert f"'{named}'" in said
    assert "the columns are time_s (time_s), current_A (current_A), voltage_V (voltage_V), heat, step (step)" in said


def test_a_name_like_a_formula_may_be_of_one_file_only(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V"]]
    paths = [under(tmp_path, "time_s,I (A),U", log, "one.csv"), under(tmp_path, "time_s,current,U", log, "two.csv")]
    imported = import_case(paths, "cell", ambient=20.0, columns={"current_A": "I (A)"})
    assert len(imported.runs) == 2


def test_columns_that_are_not_imported_are_printed(tmp_path: Path):
    path = under(tmp_path, "time_s,current_A,voltage_V,humidity,step", cell_log())
    said = import_case(path, "cell", ambient=20.0).summary()
    assert f"decided: not imported ({tmp_path.name}/log.csv): humidity - no column of the case holds it" in said


def test_steps_shorter_than_a_run_are_said_as_such(wild: Wild):
    options: dict[str, Any] = {"ambient": 22.0, "seconds_per_row": 5.0, "columns": {"step": "set_speed"}}
    (path,) = wild("25-steps-of-nine-points", "points.csv")
    assert "each step has 9 rows, and a run needs 10" in saying("motor", path, split_at="steps", **options)
    assert len(import_case(path, "motor", **options).runs) == 1


def test_parts_shorter_than_a_run_are_said_as_such(tmp_path: Path):
    log = motor_log()[:35].assign(step=np.arange(35) // 7)[:32]
    path = tmp_path / "points.csv"
    log.to_csv(path, index=False)
    said = saying("motor", path, ambient=20.0, split_at="steps")
    assert "each step has at most 7 rows, and a run needs 10" in said


# Temperatures in names


@pytest.mark.parametrize(("name", "degC"), [("hppcCell25degC", 25.0), ("cell_minus5degC", -5.0)])
def test_the_temperature_in_the_name_of_a_file(wild: Wild, name: str, degC: float):
    (path,) = wild("19-temperature-in-a-name", f"{name}.csv")
    assert import_case(path, "cell").runs[0].ambient_degC == degC


@pytest.mark.parametrize(
    ("name", "degC"),
    [
        ("Pulse40degC", 40.0),
        ("agedCellN10degC", -10.0),
        ("HPPCn20degC", -20.0),
        ("neg_10_degC", -10.0),
        ("US06 at minus 18 deg C", -18.0),
        ("plus45Celsius", 45.0),
        ("Temp25degC", 25.0),
        ("film5degC", 5.0),
        ("cell-25degC", 25.0),
        ("cell_-5°C", -5.0),
        ("10deg", 10.0),
        ("5A_0deg", 0.0),
        ("10degrade", None),
        ("20R", None),
    ],
)
def test_a_temperature_stands_in_a_name_in_many_ways(name: str, degC: float | None):
    assert temperature_in(name, None) == degC


def test_degrees_alone_may_be_an_angle_where_something_turns():
    assert temperature_in("slope_10deg", None, turns=True) is None
    assert temperature_in("slope_10deg_35degC", None, turns=True) == 35.0


@pytest.mark.parametrize(("folder", "degC"), [("25deg", 25.0), ("minus10degC", -10.0), ("T_35°C", 35.0)])
def test_the_temperature_in_the_name_of_a_folder(tmp_path: Path, folder: str, degC: float):
    path = under(tmp_path / folder, "time_s,current_A,voltage_V", cell_log()[["time_s", "current_A", "voltage_V"]])
    imported = import_case(path, "cell")
    assert imported.runs[0].ambient_degC == degC
    assert "the name of the folder states it" in [d.why for d in imported.decisions if d.about == "ambient_degC"]
    named = shutil.copy(path, path.with_name("cell_45degC.csv"))
    assert import_case(named, "cell").runs[0].ambient_degC == 45.0


# MATLAB tables


def test_a_matlab_table_is_read_or_said_to_be_one(wild: Wild):
    (path,) = wild("21-matlab-table", "cell_25degC.mat")
    if importlib.util.find_spec("matio") is None:
        said = saying("cell", path)
        assert "holds a MATLAB table" in said
        assert "jaxmodel[matlab], or save it with writetable or table2struct(T, ToScalar=true)" in said
        return
    imported = import_case(path, "cell")
    assert imported.runs[0].ambient_degC == 25.0
    assert imported.runs[0].log.columns["voltage_V"][0] == 4.19


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_tables_in_structures_and_timetables_of_matlab(tmp_path: Path, version: str):
    with warnings.catch_warnings():  # theirs, on how they use pandas
        warnings.simplefilter("ignore")
        matio = pytest.importorskip("matio")
        tables_of_matlab(tmp_path / "log.mat", matio.save_to_mat, version)


def tables_of_matlab(path: Path, save: Any, version: str) -> None:
    log = cell_log()
    table = pd.DataFrame({"t.all (s)": log.time_s, "I": log.current_A, "U": log.voltage_V, "note": "rest"})
    save(str(path), {"cell": {"log": table, "serial": np.array([7.0])}}, version=version)
    read = read_table(path)
    assert list(read.frame) == ["t.all (s)", "I", "U"]
    np.testing.assert_allclose(read.frame["U"], log.voltage_V)
    times = table[["I", "U"]].set_index(pd.to_timedelta(log.time_s, unit="s"))
    save(str(path), {"run": times}, version=version)
    run = import_case(path, "cell", ambient=20.0).runs[0].log
    np.testing.assert_allclose(run.time_s, log.time_s)
    np.testing.assert_allclose(run.columns["current_A"], log.current_A)


def test_a_structure_needs_no_package(tmp_path: Path):
    path = tmp_path / "log.mat"
    scipy.io.savemat(path, {"data": {"run": {"t": np.arange(5.0), "U": np.ones(5)}}})
    assert list(read_table(path).frame) == ["t", "U"]


# JSON


def test_lists_of_rows_of_json_are_runs_by_their_keys(wild: Wild):
    (path,) = wild("26-json", "sysid.json")
    imported = import_case(path, "motor", ambient=22.0, constants={"load_torque_Nm": 0.0})
    assert [run.log.name for run in imported.runs] == [
        "sysid-slow-forward",
        "sysid-slow-backward",
        "sysid-fast-forward",
        "sysid-fast-backward",
    ]
    assert [run.log.rows for run in imported.runs] == [1200, 1200, 300, 300]
    assert set(imported.runs[2].log.columns["voltage_V"]) == {7.0}
    assert imported.runs[0].log.time_s[-1] == pytest.approx(5.995)
    assert "--load" in saying("motor", path, ambient=22.0)


LOG = cell_log()[["time_s", "current_A", "voltage_V"]]
NUMBERS = LOG.to_numpy().tolist()
RECORDS = LOG.to_dict("records")
FORMS: dict[str, Any] = {
    "records": RECORDS,
    "columns": LOG.to_dict("list"),
    "columns by row": {name: {str(n): v for n, v in enumerate(LOG[name])} for name in LOG},
    "split": {"columns": list(LOG), "index": list(range(len(LOG))), "data": NUMBERS},
    "rows with names": [list(LOG), *NUMBERS],
    "nested": {"meta": {"bench": 3, "cells": ["a", "b"]}, "log": {"records": RECORDS}},
    "channels": [{"name": name, "values": LOG[name].tolist()} for name in LOG],
    "texts": [{name: str(value) for name, value in row.items()} for row in RECORDS],
}


@pytest.mark.parametrize("form", FORMS)
def test_one_table_of_json_in_any_form(tmp_path: Path, form: str):
    path = tmp_path / "log.json"
    path.write_text(json.dumps(FORMS[form]))
    table = read_table(path)
    assert list(table.frame) == list(LOG)
    np.testing.assert_array_equal(table.frame.to_numpy(), LOG.to_numpy())
    (run,) = import_case(path, "cell", ambient=20.0).runs
    assert run.log.name == "log"


def test_json_lines(tmp_path: Path):
    path = tmp_path / "log.jsonl"
    path.write_text("\n".join(map(json.dumps, RECORDS)))
    np.testing.assert_array_equal(read_table(path).frame.to_numpy(), LOG.to_numpy())


def test_channels_of_json_state_their_units(tmp_path: Path):
    path = tmp_path / "log.json"
    units = {"time_s": "s", "current_A": "A", "voltage_V": "V"}
    channels = {f"ch {n}": {"unit": units[name], "data": LOG[name].tolist()} for n, name in enumerate(LOG)}
    path.write_text(json.dumps({"channels": channels}))
    run = import_case(path, "cell", ambient=20.0).runs[0].log
    np.testing.assert_array_equal(run.columns["voltage_V"], LOG.voltage_V)


@pytest.mark.parametrize("form", ["records", "columns", "rows with names"])
def test_tables_of_json_under_keys_are_runs(tmp_path: Path, form: str):
    path = tmp_path / "bench.json"
    runs = {"cold": FORMS[form], "warm": FORMS[form], "settings": {"limits": [1, 2, 3]}}
    path.write_text(json.dumps({"date": "2026-05-01", "runs": runs}))
    imported = import_case(path, "cell", ambient=20.0)
    assert [run.log.name for run in imported.runs] == ["bench-cold", "bench-warm"]
    for run in imported.runs:
        np.testing.assert_array_equal(run.log.columns["voltage_V"], LOG.voltage_V)
    (run,) = import_case(path, "cell", ambient=20.0, sheet="warm").runs
    assert run.log.rows == len(LOG)
    assert "has no table 'hot'" in saying("cell", path, ambient=20.0, sheet="hot")


def test_tables_of_json_need_not_have_all_columns(tmp_path: Path):
    path = tmp_path / "bench.json"
    warmed = LOG.assign(temperature_degC=25.0).to_dict("list")
    path.write_text(json.dumps({"a": RECORDS, "b": warmed, "table": [[1, 2], [3, 4]]}))
    imported = import_case(path, "cell", ambient=20.0)
    assert [run.log.name for run in imported.runs] == ["bench-a", "bench-b"]
    assert "cell_temperature_degC" not in imported.runs[0].log.columns
    assert set(imported.runs[1].log.columns["cell_temperature_degC"]) == {25.0}
    assert "'table' has other columns and was not read" in imported.summary()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[1, 2", "cannot be read as JSON"),
        ("[" * 100_000, "cannot be read as JSON"),
        ('{"a": 1}', "holds no table"),
        ("[[1, 2], [3]]", "holds no table"),
        ("[]", "holds no table"),
    ],
)
def test_json_without_a_table_gets_one_sentence(tmp_path: Path, text: str, says: str):
    path = tmp_path / "log.json"
    path.write_text(text)
    with pytest.raises(MeasurementError, match=says) as caught:
        read_table(path)
    assert "\n" not in str(caught.value)


def test_what_a_formula_uses_is_imported(tmp_path: Path):
    rows = "\n".join(f"{k},{11.1 + k % 2},{127},{300 + k},{5}" for k in range(40))
    (tmp_path / "log.csv").write_text(f"time_s,battery_V,pwm,speed_rpm,humidity\n{rows}\n")
    found = import_case(
        [tmp_path / "log.csv"],
        kind="motor",
        columns={"voltage_V": "battery_V * pwm / 255"},
        constants={"load_torque_Nm": 0.0},
        ambient=22.0,
    )
    left = [one.value for one in found.decisions if one.about == "not imported"]
    assert left == ["humidity"]


# Columns called by a unit of temperature alone


@pytest.mark.parametrize("name", ["degC", "°C", "C", "[degC]", "Celsius"])
def test_a_column_called_by_a_unit_of_temperature_is_the_thermometer(tmp_path: Path, name: str):
    log = cell_log()[["time_s", "current_A", "voltage_V", "temperature_degC"]]
    imported = import_case(under(tmp_path, f"s,A,V,{name}", log), "cell", ambient=25.0)
    run = imported.runs[0].log
    np.testing.assert_allclose(run.columns["cell_temperature_degC"], log.temperature_degC)
    np.testing.assert_allclose(run.time_s, log.time_s)
    assert not [one for one in imported.findings if one.what == "column by its looks"]


def test_of_a_motor_it_is_the_case(tmp_path: Path):
    log = motor_log().assign(warmth=25.0)
    imported = import_case(under(tmp_path, "s,V,A,Nm,rad/s,degC", log), "motor", ambient=25.0)
    assert columns_of(imported)["case_temperature_degC"] == "column 'degC' in degC"


def test_a_letter_that_moves_as_no_temperature_is_asked_about(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V"]].assign(charge=lambda f: 0.9 * f.time_s)
    imported = import_case(under(tmp_path, "s,A,V,C", log), "cell", ambient=25.0)
    assert "cell_temperature_degC" not in imported.runs[0].log.columns
    (found,) = [one for one in imported.findings if one.what == "column of a unit"]
    assert '--column cell_temperature_degC="C" --unit "C=degC"' in found.sentence


def test_a_capital_t_beside_a_clock_is_a_temperature(tmp_path: Path):
    log = cell_log()[["time_s", "current_A", "voltage_V", "temperature_degC"]]
    run = import_case(under(tmp_path, "s,A,V,T", log), "cell", ambient=25.0).runs[0].log
    np.testing.assert_allclose(run.columns["cell_temperature_degC"], log.temperature_degC)
    np.testing.assert_allclose(run.time_s, log.time_s)
