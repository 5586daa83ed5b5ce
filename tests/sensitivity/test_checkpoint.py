"""Steps computed anew change no value and no derivative, and a gradient through a long run stays small in memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import constant
from jaxmodel.sensitivity import checkpoint
from jaxmodel.sensitivity.checkpoint import in_blocks
from jaxmodel.sensitivity.response import make_response


def course(parameters):
    """A nonlinear recursion whose every step counts: its end, and all it went through."""

    def step(carry, drive):
        position, speed = carry
        speed = speed + 0.1 * (drive - parameters[0] * jnp.sin(position) - parameters[1] * speed)
        position = position + 0.1 * speed
        return (position, speed), position**2

    drives = jnp.sin(jnp.arange(LENGTH) / 7.0)
    (position, _), squares = jax.lax.scan(step, (parameters[2], jnp.zeros(())), drives)
    return position + jnp.mean(squares) + squares[3]


LENGTH = 131  # prime: a rest is left over by any block


@pytest.mark.slow
@pytest.mark.parametrize("longest", [10**6, 40])
def test_values_and_derivatives_are_those_of_the_plain_run(longest: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(checkpoint, "LONGEST", longest)
    at = jnp.array([1.3, 0.2, 0.4])
    np.testing.assert_array_equal(in_blocks(course, at), course(at))
    again = jax.grad(lambda x: in_blocks(course, x))
    np.testing.assert_allclose(again(at), jax.grad(course)(at), rtol=1e-12)
    np.testing.assert_allclose(jax.jacfwd(lambda x: in_blocks(course, x))(at), again(at), rtol=1e-12)
    lanes = jnp.stack([at, 0.5 * at])
    np.testing.assert_allclose(jax.vmap(again)(lanes), jnp.stack([again(at), again(0.5 * at)]), rtol=1e-12)


@pytest.mark.slow
def test_a_long_run_is_cut_and_what_is_kept_grows_with_its_root(monkeypatch: pytest.MonkeyPatch):
    """Bytes that the compiled gradient of 400 and of 6,400 steps needs: four times, not sixteen, between them."""

    def needed(steps: int) -> int:
        response = make_response(
            Model("cell"), constant(float(steps), 1.0, current_A=0.1, ambient_degC=20.0), ("capacity_Ah",),
            ("delivered_energy_Wh",), (),
        )  # fmt: skip
        lanes = jnp.full((64, 1), 5.2)
        gradient = jax.vmap(jax.grad(lambda at: in_blocks(response, at).metrics[0]))
        return jax.jit(gradient).lower(lanes).compile().memory_analysis().temp_size_in_bytes

    monkeypatch.setattr(checkpoint, "LONGEST", 100)
    assert needed(6400) < 6.0 * needed(400)


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read from Linux's /proc")
def test_gradient_of_a_day_in_seconds_fits_in_a_gibibyte():
    """All parameters of a cell through 100,000 steps: the whole process, JAX included."""
    result = subprocess.run(
        [sys.executable, "-m", "benchmarks.long_gradient"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    peak_KiB, elasticity = map(float, result.stdout.split())
    assert peak_KiB < 2**20
    assert elasticity == pytest.approx(1.0, abs=0.1)  # energy goes nearly as the current
