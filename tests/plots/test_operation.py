"""Pictures of `operation` draw what they are given."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jaxmodel.case.build import preset_model
from jaxmodel.operation import Compensation, Evaluation, Mission, Reference, Segment
from jaxmodel.operation.compensation import Runs
from jaxmodel.operation.state_of_charge import COUNTED, ESTIMATORS, FILTER
from jaxmodel.plots.operation import (
    compensation_gains,
    compensation_maps,
    endurance,
    estimate_errors,
    estimates,
    mission_round,
)


def lasting(minutes: list[list[float]], ended_by: list[list[str]]) -> xr.Dataset:
    dims = ("ambient_degC", "age")
    return xr.Dataset(
        {
            "time_s": (dims, 60.0 * np.array(minutes)),
            "distance_m": (dims, np.array(minutes)),
            "ended_by": (dims, np.array(ended_by)),
        },
        {"ambient_degC": [0.0, 20.0], "age": ["new", "old"]},
        {"title": "Search"},
    )


PLAIN = lasting([[10.0, 5.0], [20.0, 15.0]], [["voltage", "voltage"], ["charge", "nothing"]])


def test_endurance_is_drawn_for_each_age_with_what_ends_it() -> None:
    figure = endurance(PLAIN)
    axes = figure.axes[0]
    (new, *_), (old, *_) = ([line for line in axes.lines if line.get_label() == age] for age in ("new", "old"))
    np.testing.assert_allclose(new.get_ydata(), [10.0, 20.0])
    np.testing.assert_allclose(old.get_ydata(), [5.0, 15.0])
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {"new", "old", "ended by voltage", "ended by charge", "not ended"}
    assert axes.get_title(loc="left") == "Search"


def test_gains_are_of_the_first_age() -> None:
    more = lasting([[15.0, 0.0], [30.0, 0.0]], [["charge", "charge"]] * 2)
    time, range_m = compensation_gains({"a robot": PLAIN}, {"a robot": more}).axes
    np.testing.assert_allclose([line.get_ydata() for line in time.lines], [[10.0, 20.0], [15.0, 30.0]])
    np.testing.assert_allclose([line.get_ydata() for line in range_m.lines], [[10.0, 20.0], [15.0, 30.0]])


def test_map_of_one_model_needs_no_name() -> None:
    duty = np.array([[0.3, 0.24], [np.nan, 0.15]])
    runs = Runs(np.full((2, 2), -2e-4), np.array([[1.0, 1.0], [1.0, -1.0]]))
    map_ = Compensation(Reference(), -2e-4, np.array([0.0, 20.0]), np.array([0.1, 0.2]), duty, runs, runs)
    drawn = compensation_maps(map_).axes[0].collections[0].get_array()
    np.testing.assert_allclose(np.ma.filled(drawn, np.nan).reshape(2, 2), duty / 0.3)


def test_round_of_a_mission_is_simulated_and_its_segments_named() -> None:
    mission = Mission(step_s=10, segment=[Segment(what="up", duration_s=300, speed_m_s=0.1), Segment(duration_s=300)])
    figure = mission_round(preset_model("paper", "robot"), mission)
    duty, _, current, *_ = figure.axes
    assert [text.get_text() for text in duty.texts] == ["up", ""]
    moving, standing = (duty.lines[0].get_ydata()[row] for row in (10, 50))
    assert moving > standing == 0.0
    assert current.lines[0].get_ydata()[10] > current.lines[0].get_ydata()[50]


@pytest.fixture
def evaluation() -> Evaluation:
    rows = [
        {"run": "us06", "from": start, "offset": offset, "estimator": name, "rms": rms}
        for name in ESTIMATORS
        for start, offset, rms in (("start", 0.0, 0.01), ("start", -0.2, 0.03), ("0.8", 0.2, 0.1))
    ]
    columns = {name: np.array([0.8, 0.7]) for name in ("time_s", "soc", FILTER, COUNTED)}
    return Evaluation({}, {}, pd.DataFrame(rows), {"us06": columns})


def test_errors_are_the_worse_of_both_starts(evaluation: Evaluation) -> None:
    assert evaluation.worst_errors().loc["us06"].tolist() == [0.03] * len(ESTIMATORS)
    assert evaluation.worst_errors(from_start=False).loc["us06", FILTER] == 0.1
    axes = estimate_errors(evaluation).axes[0]
    np.testing.assert_allclose([line.get_xdata()[0] for line in axes.lines], [3.0] * len(ESTIMATORS) + [2.0])


def test_estimates_are_drawn_beside_the_reference_without_counting(evaluation: Evaluation) -> None:
    lines = estimates(evaluation).axes[0].lines
    assert [line.get_label() for line in lines] == ["reference", FILTER]
