"""Functions in vector instructions against NumPy's in 80 bits, and against its own at the ends of their range."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

from jaxmodel.lanes import Kernel, Pool

COUNT = 20_000
EXTREME = np.array([0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5, 3.0, -3.0, 1e308, -1e308, np.inf, -np.inf, np.nan])


def by_vectors(function: Callable, *arguments: np.ndarray) -> np.ndarray:
    kernel = Kernel(lambda _, own: function(*own), (), tuple(x[0] for x in arguments))
    with Pool(1) as pool:
        return pool.start(kernel, (), arguments, arguments[0].size, packets=100).tree()


def spread(low: float, high: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, COUNT)


def powers(low: float, high: float) -> np.ndarray:
    """Both signs, over orders of magnitude."""
    size = 10.0 ** spread(low, high)
    return np.concatenate([size, -size])


CASES = {
    "exp": (jnp.exp, np.exp, spread(-708.0, 709.0), 1.5),
    "exp near 0": (jnp.exp, np.exp, powers(-20, 0), 1.5),
    "expm1": (jnp.expm1, np.expm1, spread(-50.0, 700.0), 2.5),
    "expm1 near 0": (jnp.expm1, np.expm1, powers(-20, 0.3), 2.5),
    "log": (jnp.log, np.log, 10.0 ** spread(-307.0, 308.0), 1.0),
    "log near 1": (jnp.log, np.log, spread(0.5, 2.0), 1.0),
    "log1p": (jnp.log1p, np.log1p, np.concatenate([10.0 ** spread(-20, 20), -(10.0 ** spread(-20, -1e-6))]), 2.0),
    "tanh": (jnp.tanh, np.tanh, powers(-20, 2), 3.0),
    "asinh": (jnp.arcsinh, np.arcsinh, powers(-20, 200), 2.5),
    "sin": (jnp.sin, np.sin, spread(-1e3, 1e3), 2.0),
    "cos": (jnp.cos, np.cos, spread(-1e3, 1e3), 2.0),
    "sin of large angles": (jnp.sin, np.sin, spread(-1e12, 1e12), 2.0),
}


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="no floats of 80 bits to compare with")
@pytest.mark.parametrize("name", CASES)
def test_functions_are_right_to_the_last_places(name: str) -> None:
    function, exact, x, most = CASES[name]
    found, wanted = by_vectors(function, x), exact(x.astype(np.longdouble))
    off = np.abs(found - wanted) / np.spacing(np.abs(wanted.astype(float)))
    assert float(off.max()) < most, (x[off.argmax()], found[off.argmax()])


@pytest.mark.skipif(np.finfo(np.longdouble).nmant < 60, reason="no floats of 80 bits to compare with")
def test_powers_are_right_to_the_last_places() -> None:
    x, y = 10.0 ** spread(-5.0, 5.0), spread(-50.0, 50.0, seed=1)
    found, wanted = by_vectors(jnp.power, x, y), x.astype(np.longdouble) ** y.astype(np.longdouble)
    assert float(np.max(np.abs(found - wanted) / np.spacing(wanted.astype(float)))) < 2.5


@pytest.mark.parametrize("name", ["exp", "expm1", "log", "log1p", "tanh", "asinh", "sin", "cos"])
def test_functions_in_single_precision(name: str) -> None:
    function, exact, *_ = CASES[name]
    x = np.abs(powers(-6, 1.5)) if name.startswith("log") else powers(-6, 1.5)
    x = x.astype(np.float32)
    found, wanted = by_vectors(function, x), exact(x.astype(float))
    assert found.dtype == np.float32
    assert np.max(np.abs(found - wanted) / np.spacing(np.abs(wanted.astype(np.float32)))) < 4.0


@pytest.mark.parametrize("name", ["exp", "expm1", "log", "log1p", "tanh", "asinh", "sin", "cos"])
def test_functions_at_the_ends_of_their_range(name: str) -> None:
    function, exact, *_ = CASES[name]
    with np.errstate(all="ignore"):
        wanted = exact(EXTREME)
    wanted = np.where(np.abs(wanted) < np.finfo(float).tiny, np.copysign(0.0, wanted), wanted)
    np.testing.assert_allclose(by_vectors(function, EXTREME), wanted, rtol=1e-14, atol=1e-307)


def test_powers_at_the_ends_of_their_range_are_those_of_c() -> None:
    x, y = (grid.ravel() for grid in np.meshgrid(EXTREME, EXTREME))
    with np.errstate(all="ignore"):
        wanted = np.power(x, y)
    np.testing.assert_allclose(by_vectors(jnp.power, x, y), wanted, rtol=1e-14, atol=1e-307)


def _whole(x: jax.Array) -> jax.Array:
    return jnp.where(jnp.abs(x) < 5, x, 0.0).astype(int)


OPERATIONS = {
    "larger": jnp.maximum,
    "smaller": jnp.minimum,
    "larger than a constant": lambda x, y: jnp.maximum(x, 0.25) + jnp.maximum(0.25, y),
    "sign": lambda x, y: jnp.sign(x),
    "nearest": lambda x, y: jnp.round(x),
    "floor": lambda x, y: jnp.floor(x),
    "ceiling": lambda x, y: jnp.ceil(x),
    "whole": lambda x, y: x.astype(int) * 1.0,
    "remainder": jnp.fmod,
    "angle": jnp.arctan2,
    "logistic": lambda x, y: jax.nn.sigmoid(x),
    "clip": lambda x, y: jnp.clip(x, -1.0, 2.0),
    "error function": lambda x, y: jax.lax.erf(x),
    "powers": lambda x, y: x**3 + x**-2,
    "roots": lambda x, y: jnp.sqrt(x) + jax.lax.rsqrt(y),
    "truth": lambda x, y: jnp.where((x > y) & ~(y == 0.5) | jnp.isnan(x), 1.0, -1.0),
    "finite": lambda x, y: jnp.isfinite(x) + 2.0 * (x != x),
    "quotients of whole numbers": lambda x, y: lax.div(_whole(x), _whole(y)) + 10 * lax.rem(_whole(x), _whole(y)) + 0.0,
    "whole numbers": lambda x, y: jnp.where(jnp.abs(x) < 5, x, 0.0).astype(int) % 3 - jnp.abs(jnp.sign(y)).astype(int),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_are_those_of_xla(name: str) -> None:
    x, y = (grid.ravel() for grid in np.meshgrid(EXTREME, EXTREME))
    with np.errstate(all="ignore"):
        wanted = np.asarray(jax.vmap(OPERATIONS[name])(x, y))
    np.testing.assert_allclose(by_vectors(OPERATIONS[name], x, y), wanted, rtol=1e-14, atol=1e-307)
