"""The joint refit of a cell: what is left out is predicted from what is stated, and curves bend where cells do."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.parameterisation.cell import grid_of
from jaxmodel.parameterisation.design import FINE, Shape, Start
from jaxmodel.parameterisation.joint import JointFit, _Problem, fit_joint
from jaxmodel.parameterisation.rows import Rows, rows_of
from jaxmodel.parameterisation.search import Parts, search
from tests.parameterisation import made

SHAPE = Shape(made.TAU_S, made.TAU_L)


def rows(offset_V: float = 0.0) -> list[Rows]:
    frames = made.measured({"slow": made.slow(1.0), "first": made.pulses(25.0), "second": made.pulses(25.0)})
    frames["second"]["voltage_V"] += offset_V
    return [rows_of(run) for run in made.raw_cell(frames).runs]


def problem(offset_V: float = 0.0) -> _Problem:
    runs = rows(offset_V)
    starts = {one.name: Start(1.0, 0.01) for one in runs}
    grid = grid_of(runs, starts, made.CAPACITY_AH)
    found = _Problem(runs, grid, made.CAPACITY_AH, starts, made.R_0, 5000, ["tau_S", "tau_L"])
    found.solved(SHAPE)
    return found


def parts(offset_V: float = 0.0) -> Parts:
    one = problem(offset_V)
    return one.parts(one.columns())


def fitted(start_soc: float) -> JointFit:
    runs = rows()
    starts = {one.name: Start(start_soc, 0.01) for one in runs}
    grid = grid_of(runs, starts, made.CAPACITY_AH)
    return fit_joint(runs, grid, made.CAPACITY_AH, starts, SHAPE, ["tau_S", "tau_L"], made.R_0)


def test_points_of_the_open_circuit_voltage_follow_a_steep_end() -> None:
    soc = np.linspace(0.0, 1.0, 5001)
    steep = 0.8 * np.exp(-soc / 0.015)
    assert np.max(np.abs(np.interp(soc, FINE, 0.8 * np.exp(-FINE / 0.015)) - steep)) < 0.012


def test_a_run_that_is_left_out_has_no_part_in_its_prediction() -> None:
    offset_V = 0.1
    _, runs = parts(offset_V).missed(SHAPE)
    assert runs[2] == pytest.approx(np.log(offset_V**2), abs=0.2)


def test_the_search_lowers_the_error_at_readings_left_out() -> None:
    one, first = parts(), Shape(30.0, 600.0)
    shape, _ = search(one, first)
    assert one.score(shape) < one.score(first)
    assert np.mean(np.concatenate(one.missed(shape))) < 2.0 * np.log(2.0 * made.NOISE_V)


def test_runs_that_start_as_stated_keep_their_start_and_capacity() -> None:
    for start in fitted(1.0).starts.values():
        assert abs(start.soc - 1.0) < 5e-4
        assert abs(start.fade) < 1e-3
