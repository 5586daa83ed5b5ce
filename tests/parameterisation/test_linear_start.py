"""Where the calibration of a cell starts: near enough to the curves of a made cell, from assumed energies alone."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.parameterisation.linear_start import LinearStart, linear_start
from jaxmodel.parameterisation.rows import Rows, rows_of
from tests.parameterisation import made


def runs() -> list[Rows]:
    frames = made.measured({"slow": made.slow(1.0), "pulses": made.pulses(25.0)})
    return [rows_of(run) for run in made.raw_cell(frames).runs]


@pytest.fixture(scope="module")
def start() -> LinearStart:
    rows = runs()
    soc = {one.name: 1.0 - one.drawn_Ah / made.CAPACITY_AH for one in rows}
    return linear_start(rows, soc, None, dict.fromkeys(("R_0", "R_S", "R_L"), 0.0), made.R_0)


def test_the_curves_are_near_those_of_the_cell(start: LinearStart) -> None:
    assert np.max(np.abs(start.ocv_V - made.open_V(start.soc))) < 0.02
    for name, ohm in (("R_0", made.R_0), ("R_S", made.R_S), ("R_L", made.R_L)):
        assert np.median(start.ohm[name]) == pytest.approx(ohm, rel=0.3)
    assert start.rms_V < 5.0 * made.NOISE_V


def test_the_time_constants_are_found_between_those_that_are_tried_first(start: LinearStart) -> None:
    assert start.tau_s[0] == pytest.approx(made.TAU_S, rel=0.3)
    assert start.tau_s[1] == pytest.approx(made.TAU_L, rel=0.3)


def test_no_resistance_is_nothing(start: LinearStart) -> None:
    """A factor on nothing leaves nothing, and the calibration could not raise it again."""
    for ohm in start.ohm.values():
        assert np.min(ohm) > 0.01 * made.R_S


def test_knots_are_within_0_to_1_and_dense_at_both_ends(start: LinearStart) -> None:
    steps = np.diff(start.soc)
    assert start.soc[0] >= 0.0
    assert start.soc[-1] <= 1.0
    assert max(steps[0], steps[-1]) < 0.1 * np.median(steps)
