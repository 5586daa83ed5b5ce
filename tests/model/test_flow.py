"""The one integrator: exact for a relaxation and for an integral, over any step, in one piece or many."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.model.flow import Flow, advance, integral, mean_exponential, relaxation

durations = st.floats(1e-6, 1e4)


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(1e-3, 1e4), durations)
def test_relaxation_is_exact(start: float, target: float, tau: float, duration: float):
    moved = advance({"x": jnp.asarray(start)}, {"x": relaxation(target, tau)}, duration)
    exact = target + (start - target) * np.exp(-duration / tau)
    assert float(moved["x"]) == pytest.approx(exact, abs=1e-14 * 10.0)


@given(st.floats(-5.0, 5.0), st.floats(-1e-3, 1e-3), durations)
def test_integral_is_exact(start: float, rate: float, duration: float):
    moved = advance({"x": jnp.asarray(start)}, {"x": integral(rate)}, duration)
    assert float(moved["x"]) == pytest.approx(start + rate * duration, rel=1e-15, abs=1e-15)


@given(st.floats(1e-3, 1e4), durations, st.floats(0.0, 1.0))
def test_two_steps_are_one(tau: float, duration: float, share: float):
    flows = {"x": relaxation(1.0, tau), "y": integral(2.0)}
    start = {"x": jnp.asarray(-1.0), "y": jnp.asarray(0.5)}
    once = advance(start, flows, duration)
    twice = advance(advance(start, flows, share * duration), flows, (1.0 - share) * duration)
    np.testing.assert_allclose([twice["x"], twice["y"]], [once["x"], once["y"]], rtol=1e-13, atol=1e-14)


def test_no_time_changes_no_bit():
    start = {"x": jnp.asarray(0.1), "y": jnp.asarray(1e-300), "z": jnp.asarray(-7.0)}
    flows = {"x": relaxation(3.0, 1e-3), "y": integral(1e6), "z": Flow(jnp.asarray(2.0), jnp.asarray(1e9))}
    assert {name: float(value) for name, value in advance(start, flows, 0.0).items()} == {
        "x": 0.1,
        "y": 1e-300,
        "z": -7,
    }


def test_a_state_without_a_flow_stays_and_a_relaxation_may_stop():
    moved = advance({"x": jnp.asarray(2.0), "h": jnp.asarray(0.3)}, {"h": Flow(jnp.zeros(()), jnp.zeros(()))}, 50.0)
    assert (float(moved["x"]), float(moved["h"])) == (2.0, 0.3)


def test_mean_exponential_is_smooth_through_zero():
    z = np.concatenate([-np.geomspace(1e-12, 5.0, 60), [0.0], np.geomspace(1e-12, 700.0, 60), [9.999e-5, 1.0001e-4]])
    safe = np.where(z == 0.0, 1.0, z).astype(np.longdouble)
    np.testing.assert_allclose(
        jax.vmap(mean_exponential)(jnp.asarray(z)), np.where(z == 0.0, 1.0, -np.expm1(-safe) / safe), rtol=1e-13
    )
    small = z[np.abs(z) < 1e-2]
    slope = jax.vmap(jax.grad(mean_exponential))(jnp.asarray(small))
    series = -1 / 2 + small / 3 - small**2 / 8 + small**3 / 30 - small**4 / 144
    np.testing.assert_allclose(slope, series, rtol=1e-9)
