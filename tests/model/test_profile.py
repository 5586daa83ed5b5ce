"""Profiles and their grids: every second in exactly one step, milliseconds after a jump."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.base.errors import MeasurementError
from jaxmodel.model.profile import FIRST_STEP_SHARE, GROWTH, Profile, constant, make_grid

TAU = 0.7e-3


def voltages(*levels: float, ambient: float = 20.0) -> Profile:
    time = np.arange(len(levels)) * 1.0
    drive = {"voltage_V": np.array(levels), "load_torque_Nm": np.zeros(len(levels))}
    return Profile(time, drive | {"ambient_degC": np.linspace(ambient, ambient + 1.0, len(levels))})


@given(st.floats(1e-4, 1e4), st.floats(1e-6, 1e3))
def test_growing_steps_fill_their_span(span: float, first: float):
    drive = {"voltage_V": np.ones(2), "load_torque_Nm": np.zeros(2), "ambient_degC": np.zeros(2)}
    steps = make_grid(Profile(np.array([0.0, span]), drive), first / FIRST_STEP_SHARE).duration_s
    assert steps.sum() == pytest.approx(span, rel=1e-12)
    np.testing.assert_allclose(steps[1:] / steps[:-1], GROWTH)
    assert steps[0] <= first * (1.0 + 1e-9)
    assert steps.size == 1 or steps[0] > first / (2.0 * GROWTH)


@pytest.mark.parametrize("bending", [None, (0.05, 0.4)])
def test_a_grid_laid_in_parts_is_the_whole_grid_to_the_bit(bending: tuple[float, float] | None):
    levels = np.repeat(np.random.default_rng(0).choice([0.0, 6.0, 12.0], 60), 3)
    whole = voltages(*levels)
    grid = make_grid(whole, TAU, bending)
    parts, jumped = [], None
    for first in (0, 7, 8, 90):
        rows = slice(first, {0: 7, 7: 8, 8: 90, 90: 179}[first] + 1)
        part = Profile(whole.time_s[rows], {name: values[rows] for name, values in whole.inputs.items()})
        parts.append(make_grid(part, TAU, bending, jumped_s=jumped))
        jumped = parts[-1].jumped_s
    np.testing.assert_array_equal(np.concatenate([part.duration_s for part in parts]), grid.duration_s)
    assert sum(part.row.size for part in parts) == grid.row.size
    assert jumped == grid.jumped_s


@given(st.lists(st.sampled_from([0.0, 6.0, 12.0]), min_size=2, max_size=30))
def test_a_grid_cuts_each_row_into_its_own_steps(levels: list[float]):
    profile = voltages(*levels)
    grid = make_grid(profile, TAU)
    ends = np.cumsum(grid.duration_s)
    np.testing.assert_allclose(ends[grid.last_step], profile.time_s[1:], rtol=1e-12)
    np.testing.assert_array_equal(np.unique(grid.row), np.arange(1, len(levels)))
    np.testing.assert_array_equal(grid.row[grid.last_step], np.arange(1, len(levels)))
    assert np.all(np.diff(grid.row) >= 0)


def test_only_a_jump_that_moves_the_motor_is_resolved():
    """The first interval starts the motor; the ambient changes at every row and moves nothing."""
    grid = make_grid(voltages(6.0, 6.0, 6.0, 9.0, 9.0), TAU)
    counts = np.bincount(grid.row)[1:]
    np.testing.assert_array_equal(counts > 1, [True, False, True, False])
    assert grid.duration_s[0] <= FIRST_STEP_SHARE * TAU
    cell = make_grid(voltages(6.0, 9.0, 6.0), None)
    np.testing.assert_array_equal(cell.duration_s, [1.0, 1.0])


def test_padding_appends_steps_of_no_length():
    grid = make_grid(voltages(0.0, 5.0, 5.0), TAU)
    longer = grid.padded(grid.duration_s.size + 7)
    np.testing.assert_array_equal(longer.duration_s[:-7], grid.duration_s)
    np.testing.assert_array_equal(longer.duration_s[-7:], 0.0)
    np.testing.assert_array_equal(longer.last_step, grid.last_step)


def test_the_signal_becomes_a_duty():
    profile = Profile(np.array([0.0, 1.0]), {"V_set": np.array([2.5, 4.0])})
    assert list(profile.inputs) == ["duty"]
    np.testing.assert_allclose(profile.inputs["duty"], [0.0, 0.6])


def test_a_constant_profile_ends_at_its_duration():
    profile = constant(3.0, 0.5, current_A=2.0, ambient_degC=20.0)
    np.testing.assert_array_equal(profile.time_s, np.arange(7) * 0.5)
    assert {name: set(values) for name, values in profile.inputs.items()} == {
        "current_A": {2.0},
        "ambient_degC": {20.0},
    }


@pytest.mark.parametrize("time", [[0.0], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0]])
def test_times_must_increase(time: list[float]):
    with pytest.raises(MeasurementError, match="each later than the one before"):
        Profile(np.array(time), {"current_A": np.zeros(len(time))})
