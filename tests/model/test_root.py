"""The root of a rising function: met to rounding wherever the bend lies, with the derivative of the root."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.model.root import rising_root


@jax.jit
@jax.value_and_grad
def root(place, height, width, near, tilt):
    """Where x - place + height tanh(x / width) is zero, as a step over the bend of a brush drop asks."""
    return rising_root(
        lambda x: x - place + height * (jnp.tanh(x / width) - tilt * (x - near)), near, 1.0 - height * tilt
    )


@given(st.floats(-30.0, 30.0), st.floats(1e-3, 30.0), st.floats(0.02, 1.0), st.floats(-1.5, 1.5), st.floats(0.0, 0.9))
def test_a_bend_is_met_from_wherever_one_looks(place: float, height: float, width: float, side: float, share: float):
    """Far on either side the function is straight, and a step of Newton's from there lands as far on the other."""
    near, tilt = place + side * height, share / height
    found, slope = (float(x) for x in root(*(jnp.asarray(x) for x in (place, height, width, near, tilt))))
    inner = height / width / np.cosh(np.clip(found / width, -300.0, 300.0)) ** 2
    rest = found - place + height * (np.tanh(found / width) - tilt * (found - near))
    assert abs(rest) <= 1e-9 * (1.0 + inner)
    assert slope == pytest.approx(1.0 / (1.0 + inner - share), rel=1e-4)


def test_a_lane_that_is_no_number_does_not_touch_the_others():
    nears = jnp.array([3.0, jnp.nan, -20.0, 0.0])
    found, slopes = jax.vmap(root, (None, None, None, 0, None))(0.5, 2.0, 0.1, nears, 0.1)
    whole = jax.vmap(root, (None, None, None, 0, None))(0.5, 2.0, 0.1, nears[jnp.array([0, 2, 3])], 0.1)
    np.testing.assert_array_equal(np.isnan(found), [False, True, False, False])
    np.testing.assert_array_equal(np.asarray((found, slopes))[:, [0, 2, 3]], whole)


def test_a_law_that_ends_within_the_bracket_has_its_root_all_the_same():
    def law(x):
        return jnp.where(x < 1.5, x - 0.5 + 0.3 * x**3, jnp.nan)

    found = float(rising_root(law, jnp.asarray(-1.0), jnp.asarray(0.3)))
    assert float(law(found)) == pytest.approx(0.0, abs=1e-12)
