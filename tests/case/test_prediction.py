"""`Case.predict`: what a case says of a table of new inputs, and of a table that cannot be used."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, read_case, simulate_case
from jaxmodel.base.errors import MeasurementError, ParameterError


@pytest.fixture(scope="module")
def case() -> Case:
    return read_case("examples/samsung_30q")


def table_of(case: Case) -> pd.DataFrame:
    return pd.concat(case.to_dataframes(), names=["run"]).reset_index("run")


def new(rows: int = 4, **columns: object) -> pd.DataFrame:
    return pd.DataFrame({"time_s": 60.0 * np.arange(rows), "current_A": 3.0, "ambient_degC": 25.0} | columns)


def test_runs_of_the_case_are_predicted_as_they_are_simulated(case: Case) -> None:
    """By their names they begin as they are stated: not one of them is charged to 1."""
    found = case.predict(table_of(case))
    expected = simulate_case(case, progress=False).to_dataframe()
    pd.testing.assert_frame_equal(found.reset_index(drop=True), expected.drop(columns=["run", "time_s"]))


def test_rows_keep_their_place_and_their_index(case: Case) -> None:
    table = table_of(case).set_index(pd.Index(range(1000, 1000 + len(table_of(case)))))
    mixed = table.sample(frac=1.0, random_state=0).sort_values("time_s", kind="stable")
    pd.testing.assert_frame_equal(case.predict(mixed).sort_index(), case.predict(table))


def test_a_cutoff_ends_a_run(case: Case) -> None:
    ends = dataclasses.replace(case, cutoff={"voltage_V": 3.0})
    found = ends.predict(new(rows=200), initial_soc=1.0)
    voltage = found["voltage_V"].to_numpy()
    last = int(np.flatnonzero(np.isfinite(voltage))[-1])
    assert voltage[last] < 3.0 <= voltage[last - 1]
    assert last < 199


def test_what_a_run_states_is_a_column_or_a_keyword(case: Case) -> None:
    half = case.predict(new(), initial_soc=0.5, cycles=500)
    pd.testing.assert_frame_equal(half, case.predict(new(initial_soc=0.5, cycles=500)))
    assert half["soc"].iloc[0] == 0.5
    assert case.predict(new(), initial_soc=0.5)["voltage_V"].iloc[1] > half["voltage_V"].iloc[1]
    two = case.predict(pd.concat([new(run="a", initial_soc=0.5), new(run="b", initial_soc=0.9)]))
    assert two["soc"].iloc[[0, 4]].tolist() == [0.5, 0.9]
    warm = case.predict(new().drop(columns="ambient_degC"), ambient_degC=31.0)
    assert warm["cell_temperature_degC"].iloc[0] == 31.0


def test_the_time_may_be_the_index(case: Case) -> None:
    found = case.predict(new().set_index("time_s"))
    assert found.index.tolist() == [0.0, 60.0, 120.0, 180.0]
    np.testing.assert_array_equal(found.to_numpy(float), case.predict(new()).to_numpy(float))


def test_a_motor_begins_with_the_current_of_its_first_row() -> None:
    rows = {"time_s": 0.1 * np.arange(20), "voltage_V": 6.0, "speed_rad_s": 80.0, "ambient_degC": 20.0}
    frame = pd.DataFrame(rows | {"current_A": 2.0})
    motor = Case.from_dataframes({"spin": frame}, kind="motor", load="unknown")
    assert motor.predict(frame)["current_A"].iloc[0] == pytest.approx(2.0)
    expected = simulate_case(motor, progress=False)[0].table["winding_temperature_degC"]
    pd.testing.assert_series_equal(motor.predict(frame)["winding_temperature_degC"], expected)


def test_a_run_of_several_like_motors_names_its_own() -> None:
    rows = {"time_s": 0.1 * np.arange(20), "voltage_V": 6.0, "speed_rad_s": 80.0, "ambient_degC": 20.0}
    frame = pd.DataFrame(rows)
    motor = Case.from_dataframes(
        {side: frame.assign(current_A=2.0) for side in ("left", "right")},
        kind="motor",
        load="unknown",
        runs={side: {"specimen": side} for side in ("left", "right")},
        specimens={"right": {"R_0": 3.0}},
    )
    both = pd.concat([frame.assign(run=side, specimen=side) for side in ("left", "right")], ignore_index=True)
    current = motor.predict(both)["current_A"].to_numpy()
    assert current[19] != current[39]
    np.testing.assert_array_equal(motor.predict(both.drop(columns="specimen"))["current_A"], current)
    with pytest.raises(MeasurementError, match=r"knows no specimen 'rigt'\. Did you mean 'right'"):
        motor.predict(frame, specimen="rigt")


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        (new().drop(columns="current_A"), "run 'new': a cell needs the column 'current_A'; add it."),
        (new().drop(columns="time_s"), "no column 'time_s'"),
        (new(curent_A=1.0), "no column 'curent_A'. Did you mean 'current_A'?"),
        (new(ambient_degC=298.0), "if it is in kelvin, subtract 273.15"),
        (new(initial_soc=[0.1, 0.2, 0.3, 0.4]), "'initial_soc' is stated once for a run, and it changes"),
        (new(initial_soc=120.0), "'initial_soc' = 120 is outside its range 0 to 1.1"),
        (new(run=["a", None, "a", "a"]), "'run' is empty in row 1"),
        (new(rows=1), "a run needs at least two"),
        (new(rows=0), "the table has no rows"),
        (pd.concat([new(), new()[["current_A"]]], axis=1), "two columns 'current_A'"),
    ],
)
def test_a_table_that_cannot_be_used_gets_one_sentence(case: Case, frame: pd.DataFrame, sentence: str) -> None:
    with pytest.raises((MeasurementError, ParameterError), match=re.escape(sentence)):
        case.predict(frame)


def test_what_no_run_can_state_is_refused(case: Case) -> None:
    with pytest.raises(MeasurementError, match=r"knows no 'initial_sock'\. Did you mean 'initial_soc'"):
        case.predict(new(), initial_sock=0.5)
