"""What files of one tester tell of each other: names of columns, clocks that go back to a mark, ambients by name."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

BARE = cell_log().drop(columns=["step", "temperature_degC"])


def written(folder: Path, frame: pd.DataFrame, name: str, header: bool = True) -> Path:
    path = folder / name
    frame.to_csv(path, index=False, header=header)
    return path


def test_a_file_without_names_has_those_of_the_file_beside_it(tmp_path: Path):
    named = BARE.rename(columns={"time_s": "Time(s)", "current_A": "Current(A)", "voltage_V": "Voltage(V)"})
    paths = [written(tmp_path, named, "a.csv"), written(tmp_path, named, "b.csv", header=False)]
    imported = import_case(paths, "cell", ambient=25.0)
    first, second = (run.log for run in imported.runs)
    np.testing.assert_allclose(second.columns["voltage_V"], first.columns["voltage_V"])
    np.testing.assert_allclose(second.time_s, first.time_s)
    (decision,) = [one for one in imported.decisions if one.about == "names of columns"]
    assert decision.value == "those of a.csv"


def test_files_of_another_width_or_with_other_names_lend_none(tmp_path: Path):
    other = BARE.assign(power_W=BARE.voltage_V * BARE.current_A)
    paths = [written(tmp_path, other, "a.csv"), written(tmp_path, BARE, "b.csv", header=False)]
    imported = import_case(paths, "cell", ambient=25.0)
    assert "names of columns" not in [one.about for one in imported.decisions]


@pytest.mark.parametrize("pattern", ["*_10c*", "b_10c.csv"])
def test_each_file_has_the_ambient_of_its_pattern(tmp_path: Path, pattern: str):
    paths = [written(tmp_path, BARE, name) for name in ("a_x.csv", "b_10c.csv")]
    imported = import_case(paths, "cell", ambient=30.0, ambients={pattern: 10.0})
    assert [run.ambient_degC for run in imported.runs] == [30.0, 10.0]


@pytest.mark.parametrize(
    ("ambients", "said"),
    [
        ({"c*": 10.0}, r"ambient: no file is called 'c\*'; correct the pattern\. The files are a\.csv\."),
        ({"a*": 10.0, "*.csv": 20.0}, r"ambient: it is of a\*=10 and \*\.csv=20; keep one of them"),
        ({"a*": 300.0}, "it is in degC: if this is kelvin, state 26.85"),
    ],
)
def test_a_wrong_pattern_is_one_sentence(tmp_path: Path, ambients: dict[str, float], said: str):
    with pytest.raises(MeasurementError, match=said):
        import_case(written(tmp_path, BARE, "a.csv"), "cell", ambients=ambients)


def test_parts_of_a_clock_that_goes_back_to_a_mark_follow_each_other(tmp_path: Path):
    """A pulse, its rest and the next discharge each count from the end of the last long step."""
    log, parts, mark = cell_log(), [], 0.0
    edges = np.linspace(0, len(log), 10).astype(int)
    for number, (first, last) in enumerate(itertools.pairwise(edges)):
        part = log[first:last].copy()
        part["time_s"] += mark - part.time_s.iloc[0]
        if number % 3 == 2:
            mark = float(part.time_s.iloc[-1]) - 20.0
        parts.append(part)
    frame = pd.concat(parts).drop(columns="step")
    imported = import_case(written(tmp_path, frame, "marks.csv"), "cell")
    (run,) = imported.runs
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V)
    assert np.all(np.diff(run.log.time_s) > 0.0)
    assert run.log.time_s[-1] == pytest.approx(log.time_s.iloc[-1], rel=0.01)


def test_files_without_names_have_their_columns_where_most_have_them(tmp_path: Path):
    """A strain goes through zero, as a current does; in one file the current itself has no row of rest."""
    rng = np.random.default_rng(0)
    for number, rested in enumerate((True, True, False)):
        time, rate = np.arange(200.0), 3.0 * (number + 1)
        current = np.full(200, rate) + 0.01 * rng.standard_normal(200)
        current[: 8 * rested] = 0.0
        voltage = 4.1 - 0.03 * current - 0.002 * time
        strain = 1e-4 * np.linspace(-1.0, 2.0, 200) + 1e-6 * rng.standard_normal(200)
        rows = np.stack([time, current, voltage, strain], axis=1)
        np.savetxt(tmp_path / f"run_{number}.csv", rows, delimiter=",", fmt="%.6g")
    imported = import_case(sorted(tmp_path.glob("*.csv")), "cell", ambient=22.0, capacity_Ah=3.0)
    for number, run in enumerate(imported.runs):
        assert np.median(run.log.columns["current_A"]) == pytest.approx(3.0 * (number + 1), rel=0.01)
    why = {one.where: one.why for one in imported.decisions if one.about == "current_A"}
    assert why[f"{tmp_path.name}/run_2.csv"] == "as in the files beside it"
