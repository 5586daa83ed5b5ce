"""Kernels of lanes that are much alike look up tables by the segment in which a packet is."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxmodel.lanes import Kernel, Pool
from jaxmodel.model.curves import MOST_SUMMED, between_knots, interpolate

RNG = np.random.default_rng(3)
STEPS = 300


def walked(shared, own):
    """A discharge whose voltage is read from tables, at every step and once more over all steps."""

    def advance(soc, current):
        rise = interpolate(soc, shared["knots"], shared["values"])
        soc = soc - current * (1.0 + 0.1 * rise + 0.05 * between_knots(soc, AT, own["curve"]))
        return soc, soc

    last, kept = lax.scan(advance, own["start"], shared["current"])
    again = jax.vmap(lambda soc: interpolate(soc, shared["knots"], own["lifted"]))(kept)
    return {"last": last, "kept": kept, "again": again}


AT = (0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0)


def given(knots: int, lanes: int, apart: float):
    shared = {
        "knots": np.concatenate([[0.0], np.sort(RNG.uniform(0.01, 0.99, knots - 2)), [1.0]]),
        "values": RNG.normal(size=knots),
        "current": RNG.uniform(-0.001, 0.007, STEPS),
    }
    own = {
        "start": 1.0 + apart * RNG.normal(size=lanes),
        "curve": RNG.normal(size=(lanes, len(AT))),
        "lifted": RNG.normal(size=(lanes, knots)),
    }
    return shared, own


def run(shared, own, alike: bool):
    one = jax.tree.map(lambda x: x[0], own)
    kernel = Kernel(walked, shared, one, alike=alike)
    with Pool(1) as pool:
        return pool.start(
            kernel, kernel.shared(shared), kernel.own(own, len(own["start"])), len(own["start"]), 1
        ).tree()


@pytest.mark.parametrize("knots", [5, 9, 40, MOST_SUMMED + 20])
@pytest.mark.parametrize("apart", [1e-6, 0.3])
def test_a_table_gives_the_same_by_segment_as_by_sum(knots, apart):
    """Also beyond its ends, and of lanes that lie in many segments."""
    shared, own = given(knots, 37, apart)
    found, expected = run(shared, own, alike=True), jax.vmap(walked, (None, 0))(shared, own)
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=1e-11, atol=1e-11)


def test_a_lane_depends_on_no_other_of_its_packet():
    """Whether they share its segment or not: to the last bit."""
    shared, own = given(40, 64, 0.2)
    order = RNG.permutation(64)
    straight, mixed = run(shared, own, True), run(shared, jax.tree.map(lambda x: x[order], own), True)
    for name, values in straight.items():
        np.testing.assert_array_equal(np.asarray(values)[order], mixed[name])


def test_a_lane_that_is_not_a_number_spoils_no_other():
    """The others of its packet are as without it."""
    shared, own = given(40, 16, 1e-6)
    sound = run(shared, own, True)
    own["start"][0] = np.nan
    found = run(shared, own, True)
    assert np.isnan(found["last"][0])
    np.testing.assert_array_equal(found["kept"][1:], sound["kept"][1:])


def test_values_at_the_knots_and_beyond_are_those_of_the_table():
    """Held at the ends."""

    def looked_up(shared, own):
        def advance(carry, x):
            value = interpolate(x + own["none"], shared["knots"], shared["values"])
            return carry, value

        return lax.scan(advance, own["none"], shared["x"])[1]

    knots = np.linspace(0.0, 1.0, 12)
    shared = {"knots": knots, "values": RNG.normal(size=12), "x": np.array([*knots, -3.0, 7.0, *knots[::-1]])}
    own = {"none": np.zeros(3)}
    kernel = Kernel(looked_up, shared, {"none": np.zeros(())}, alike=True)
    with Pool(1) as pool:
        found = pool.start(kernel, kernel.shared(shared), kernel.own(own, 3), 3, 1).tree()
    values = shared["values"]
    expected = [*values, values[0], values[-1], *values[::-1]]
    np.testing.assert_allclose(found, np.tile(expected, (3, 1)), rtol=1e-13, atol=1e-13)
    assert jnp.all(jnp.isfinite(found))
