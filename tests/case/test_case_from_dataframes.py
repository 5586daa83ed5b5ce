"""A case of DataFrames: the same as one of files, with the same checks and messages."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, Known, UserError, read_case, simulate_case
from jaxmodel.base.errors import MeasurementError, ParameterError

TIME_S = np.arange(0.0, 300.0, 10.0)


def frame(current_A: float = 1.0, **columns: Any) -> pd.DataFrame:
    readings = {"voltage_V": 4.0 - 2e-4 * TIME_S * current_A}
    return pd.DataFrame({"time_s": TIME_S, "current_A": current_A, "ambient_degC": 20.0} | readings | columns)


def cell(**changes: Any) -> Case:
    given: dict[str, Any] = {
        "kind": "cell",
        "check": ["fast"],
        "parameters": {"capacity_Ah": (2.0, 0.05), "storage_months": 0},
        "tables": {"ocv": {"soc": np.linspace(0.0, 1.0, 3), "voltage_V": [3.0, 3.7, 4.2]}},
        "sensors": {"voltage_V": np.float64(0.001)},
        "tolerance": {"voltage_V": 0.01},
        "runs": {"fast": {"initial_soc": (0.95, 0.01), "label": "2 A"}},
    }
    return Case.from_dataframes({"slow": frame(), "fast": frame(2.0)}, **(given | changes))


def test_what_is_stated_is_there() -> None:
    case = cell()
    assert [(run.name, run.split, run.label) for run in case.runs] == [("slow", "fit", ""), ("fast", "check", "2 A")]
    assert case.parameters["capacity_Ah"] == Known(2.0, 0.05)
    assert case.parameters["storage_months"] == Known(0.0)
    assert (case.runs[0].initial_soc, case.runs[1].initial_soc) == (Known(1.0), Known(0.95, 0.01))
    np.testing.assert_array_equal(case.tables["ocv"].values, [3.0, 3.7, 4.2])
    assert (case.sensors, case.tolerance["voltage_V"].rms) == ({"voltage_V": 0.001}, 0.01)
    pd.testing.assert_frame_equal(case.to_dataframes()["fast"], frame(2.0))


def test_a_case_that_was_written_is_read_as_it_was(tmp_path: Path) -> None:
    case = cell()
    again = read_case(case.write(tmp_path / "mine"))
    assert (again.name, again.parameters, again.sensors) == ("mine", case.parameters, case.sensors)
    for before, after in zip(case.runs, again.runs, strict=True):
        assert (before.split, before.initial_soc, before.label) == (after.split, after.initial_soc, after.label)
        pd.testing.assert_frame_equal(before.to_dataframe(), after.to_dataframe())
    for mine, its in zip(simulate_case(case), simulate_case(again), strict=True):
        pd.testing.assert_frame_equal(mine.table, its.table)


def test_a_constant_ambient_is_stated_and_written_as_a_constant(tmp_path: Path) -> None:
    bare = frame().drop(columns="ambient_degC")
    case = Case.from_dataframes({"a": bare}, kind="cell", runs={"a": {"ambient_degC": 25.0}})
    np.testing.assert_array_equal(case.runs[0].measured.inputs["ambient_degC"], 25.0)
    file = case.write(tmp_path / "mine")
    assert "ambient_degC = 25.0" in file.read_text(encoding="utf-8")
    assert "ambient_degC" not in pd.read_csv(tmp_path / "mine" / "a.csv").columns
    pd.testing.assert_frame_equal(read_case(file).runs[0].to_dataframe(), case.runs[0].to_dataframe())


def test_measurements_are_not_written_over(tmp_path: Path) -> None:
    case = read_case(cell().write(tmp_path / "mine"))
    with pytest.raises(MeasurementError, match="give another one"):
        case.write(tmp_path / "mine")


def test_time_may_be_the_index_and_a_missing_reading_stays_one() -> None:
    table = frame(voltage_V=np.where(TIME_S == 50.0, np.nan, 3.9)).set_index("time_s")
    case = Case.from_dataframes({"a": table}, kind="cell")
    assert np.flatnonzero(np.isnan(case.runs[0].measured.outputs["voltage_V"])).tolist() == [5]


@pytest.mark.parametrize(
    ("frames", "options", "said"),
    [
        ({"a": frame()}, {"check": ["b"]}, "check names the run 'b', but there is no such run"),
        ({"a": frame()}, {"runs": {"aa": {}}}, "runs names the run 'aa', but there is no such run. Did you mean 'a'?"),
        ({"a": frame().rename(columns={"voltage_V": "voltage"})}, {}, "run 'a': a cell has no column 'voltage'."),
        ({"a": frame().drop(columns="time_s")}, {}, "run 'a' has no column 'time_s'"),
        ({"a": frame(voltage_V="high")}, {}, "run 'a', column 'voltage_V' holds"),
        ({"a": frame(voltage_V=np.inf)}, {}, "run 'a', column 'voltage_V', row 0 is not finite"),
        ({"a": frame(current_A=np.nan)}, {}, "run 'a', row 0: 'current_A' is empty"),
        ({"a": frame().iloc[::-1]}, {}, "run 'a', row 1: time_s = 280 comes after 290"),
        ({"a": frame().iloc[:1]}, {}, "run 'a' has 1 rows; a run needs at least two."),
        (
            {"a": frame().assign(time_s=pd.to_timedelta(TIME_S, unit="s"))},
            {},
            "holds dates or durations",
        ),
        ({"a": frame()}, {"effects": {"self_heat": {}}}, "no effect is called 'self_heat'. Did you mean"),
        ({"a": frame()}, {"preset": "samsung"}, "no preset is called 'samsung'"),
        ({}, {}, "runs must be one"),
    ],
)
def test_a_mistake_is_one_sentence(frames: dict[str, Any], options: dict[str, Any], said: str) -> None:
    with pytest.raises(UserError) as raised:
        Case.from_dataframes(frames, kind="cell", **options)
    assert str(raised.value).startswith("case 'case'")
    assert said in str(raised.value)


def test_runs_may_be_numbered() -> None:
    case = Case.from_dataframes({1: frame(), 2: frame()}, kind="cell", check=[2], runs={1: {"label": "first"}})
    assert [(run.name, run.split, run.label) for run in case.runs] == [("1", "fit", "first"), ("2", "check", "")]


def test_formulas_of_another_cell_are_named() -> None:
    assert cell().formulas == ("R_ints", "R_TS", "C_TS", "R_TL", "C_TL")
    assert "formulas of the paper's cell: R_ints, R_TS" in cell().summary()
    assert Case.from_dataframes({"a": frame()}, kind="cell").formulas == ()


def test_a_parameter_that_is_not_there_is_named() -> None:
    with pytest.raises(ParameterError, match="Did you mean 'capacity_Ah'"):
        cell(parameters={"capacity": 2.0})


def test_results_show_themselves() -> None:
    case = cell(name="bench <1>")
    assert repr(case) == "<Case bench <1>: cell, 1 fit and 1 check runs>"
    assert "bench &lt;1&gt;" in case._repr_html_()
    assert "capacity_Ah = 2 ± 0.05" in case.summary()
    simulation = simulate_case(case)
    table = simulation.to_dataframe()
    assert list(table["run"].unique()) == ["slow", "fast"]
    assert len(table) == 2 * TIME_S.size
    assert "fast: 30 rows, complete at 290 s" in simulation.summary()
    assert simulation.plot("fast").axes
    with pytest.raises(MeasurementError, match=r"no run is called 'fats'\. Did you mean 'fast'"):
        simulation.plot("fats")
