"""What is behind a switch that is off is not computed, and what is behind one that is on is what JAX gives."""

from __future__ import annotations

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxmodel.lanes import Kernel
from jaxmodel.lanes.absent import behind_switches
from jaxmodel.lanes.outline import outlined
from jaxmodel.lanes.switch import switched
from tests.lanes.test_kernel import run

COUNT = 19
RNG = np.random.default_rng(3)


def stepped(shared, x):
    """Two switched corrections of a rate, in each of two evaluations of a step; the root is not real below 0."""

    def rate(value):
        shared_by_both = jnp.tanh(value)
        value = switched(x["first"], value, value + jnp.sqrt(x["of"]) * jnp.exp(-(shared_by_both**2)) / 3.0)
        return switched(x["second"], value, value * jnp.cos(shared_by_both + x["of"]) - 0.1 * value**2)

    def advance(value, duration):
        half = value + 0.5 * duration * rate(value)
        return value + duration * rate(half), half

    return lax.scan(advance, x["start"], shared)


def lanes(first: np.ndarray, second: np.ndarray) -> dict[str, np.ndarray]:
    return {"first": first, "second": second, "of": RNG.uniform(0.1, 1.0, COUNT), "start": RNG.uniform(0.1, 1.0, COUNT)}


@pytest.mark.parametrize("on", ["none", "all", "some", "half"])
def test_a_kernel_gives_what_jax_gives(on: str) -> None:
    first = {"none": 0.0, "all": 1.0, "some": (np.arange(COUNT) % 3 == 0) * 1.0, "half": 0.5}[on] * np.ones(COUNT)
    own, shared = lanes(first, first[::-1]), np.full(40, 0.05)
    kernel = Kernel(stepped, shared, jax.tree.map(lambda x: x[0], own))
    wanted = jax.vmap(stepped, (None, 0))(shared, own)
    found = run(kernel, kernel.shared(shared), own, COUNT)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-13)


def test_what_is_switched_off_cannot_spoil_a_lane() -> None:
    """The other lanes of its packet have it on; by XLA 0 times what is no number would be none."""
    own, shared = lanes((np.arange(COUNT) % 2) * 1.0, np.zeros(COUNT)), np.full(10, 0.05)
    own["of"][::2] = -1.0
    kernel = Kernel(stepped, shared, jax.tree.map(lambda x: x[0], own))
    last, _ = run(kernel, kernel.shared(shared), own, COUNT)
    assert np.isfinite(last).all()


def test_functions_that_are_alike_are_written_once() -> None:
    own, shared = lanes(np.ones(COUNT), np.ones(COUNT)), np.full(10, 0.05)
    text = Kernel(stepped, shared, jax.tree.map(lambda x: x[0], own)).module.text
    assert text.count("define private") == 2  # two corrections
    assert len(re.findall(r"call <\d+ x double> @aside", text)) == 4  # in two evaluations


def test_only_what_nothing_else_needs_is_put_off() -> None:
    def of(switch, value):
        base = jnp.exp(value)
        wanted_elsewhere = jnp.sin(base)
        alone = jnp.cos(base) + jnp.tanh(value) * wanted_elsewhere
        return switched(switch, base, alone) + wanted_elsewhere

    jaxpr = jax.make_jaxpr(of)(1.0, 2.0).jaxpr
    ((number, numbers),) = behind_switches(jaxpr, [True] * len(jaxpr.eqns)).items()
    names = [jaxpr.eqns[n].primitive.name for n in numbers]
    assert sorted(names) == ["add", "cos", "mul", "tanh"]
    assert jaxpr.eqns[number].params["name"] == "switched"


def test_a_derivative_by_a_switch_that_is_off_is_the_direction_of_its_effect() -> None:
    assert jax.grad(lambda switch: switched(switch, 2.0, 5.0))(0.0) == 3.0


def test_instructions_become_a_function_with_what_they_take_from_outside() -> None:
    lines = ["  %v7 = fadd double %v3, %v5", "  br label %next8", "next8:", "  %v9 = fmul double %v7, %v3"]
    types = {"%v3": "double", "%v5": "double"}
    text, given = outlined(lines, "rare6", "%v9", "double", types)
    assert given == ["%v3", "%v5"]
    assert "(double %n" in text
    moved = [line.replace("7", "17").replace("8", "18").replace("9", "19") for line in lines]
    assert outlined(moved, "rare16", "%v19", "double", types)[0] == text
