"""A kernel for GPUs: its text, and what passes between it and the driver. No GPU is needed, and none is used."""

from __future__ import annotations

import gc
import re

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.lanes import CudaError, CudaKernel, NotNative, cuda
from tests.lanes.driver import Driver


def _stepped(shared, own):
    """A function of every sort of argument: with a loop, a table, working memory, and results over steps."""
    import jax

    gained, course = jax.lax.scan(
        lambda total, x: (total + own["rate"] * jnp.exp(-x), total), own["start"], shared["course"]
    )
    return {"last": gained, "at": jnp.interp(gained, shared["x"], shared["y"]), "course": course, "whole": own["n"] + 1}


SHARED = {"course": np.linspace(0.0, 1.0, 700), "x": np.array([0.0, 1.0, 400.0]), "y": np.array([1.0, 2.0, 5.0])}
OWN = {"rate": np.linspace(0.1, 1.0, 300), "start": np.linspace(-1.0, 1.0, 300), "n": np.arange(300)}


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Driver:
    driver = Driver()
    monkeypatch.setattr(cuda, "_driver", lambda: driver)
    return driver


@pytest.fixture(scope="module")
def kernel() -> CudaKernel:
    return CudaKernel(_stepped, SHARED, {name: x[0] for name, x in OWN.items()})


def test_text_has_an_entry_and_calls_nothing_outside(kernel: CudaKernel) -> None:
    assert kernel.ptx.count(".visible .entry") == 1
    assert ".extern" not in kernel.ptx
    assert not re.search(r"\bcall\b", kernel.ptx)


def test_lanes_have_what_the_function_gives(kernel: CudaKernel, driver: Driver) -> None:
    driver.knows(kernel)
    found = kernel.on(0, SHARED).start(OWN, 300).tree()
    assert driver.launches == [300]
    np.testing.assert_array_equal(found["whole"], OWN["n"] + 1)
    for lane in (0, 17, 299):
        wanted = _stepped(
            {name: jnp.asarray(x) for name, x in SHARED.items()},
            {name: jnp.asarray(x[lane]) for name, x in OWN.items()},
        )
        for name in ("last", "at", "course"):
            np.testing.assert_allclose(found[name][lane], wanted[name], rtol=1e-13, atol=1e-13)


def test_memory_of_the_gpu_is_given_back(kernel: CudaKernel, driver: Driver) -> None:
    driver.knows(kernel)
    loaded = kernel.on(0, SHARED)
    before = len(driver.held)
    loaded.start(OWN, 300).tree()
    gc.collect()
    assert len(driver.held) == before
    del loaded
    gc.collect()
    assert not driver.held


def test_too_little_memory_of_the_gpu_is_a_memory_error(kernel: CudaKernel, driver: Driver) -> None:
    driver.knows(kernel)
    loaded = kernel.on(0, SHARED)
    driver.allowed = 100_000
    with pytest.raises(MemoryError, match="cuMemAlloc_v2: out of memory"):
        loaded.start(OWN, 300)


@pytest.mark.parametrize(("function", "most"), [(np.sin, 1e12), (np.cos, 1e12), (np.sin, 1e3), (np.cos, 1e3)])
def test_angles_need_no_library(driver: Driver, function: np.ufunc, most: float) -> None:
    angles = np.random.default_rng(0).uniform(-most, most, 5_000)
    kernel = CudaKernel(lambda shared, own: getattr(jnp, function.__name__)(own), (), angles[0])
    driver.knows(kernel)
    found = kernel.on(0, ()).start(angles, angles.size).tree()
    np.testing.assert_allclose(found, function(angles), rtol=1e-15, atol=2e-16)


def test_angle_too_large_to_have_a_sine_is_not_a_number(driver: Driver) -> None:
    kernel = CudaKernel(lambda shared, own: jnp.sin(own), (), np.zeros(()))
    driver.knows(kernel)
    assert np.isnan(kernel.on(0, ()).start(np.array([1e16]), 1).tree()).all()


def test_remainder_needs_no_library(driver: Driver) -> None:
    random = np.random.default_rng(0)
    x, y = random.uniform(-1e3, 1e3, 5_000), random.uniform(-3.0, 3.0, 5_000)
    x[:3_000] = y[:3_000] * random.integers(-900, 900, 3_000)  # quotients that are whole but for rounding
    kernel = CudaKernel(lambda shared, own: jnp.fmod(own["x"], own["y"]), (), {"x": x[0], "y": y[0]})
    driver.knows(kernel)
    np.testing.assert_array_equal(kernel.on(0, ()).start({"x": x, "y": y}, x.size).tree(), np.fmod(x, y))


def test_function_that_only_a_library_has_is_not_native() -> None:
    with pytest.raises(NotNative, match='the function "tan" on a GPU'):
        CudaKernel(lambda shared, own: jnp.tan(own), (), np.zeros(()))


def test_without_a_driver_it_is_said(kernel: CudaKernel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cuda, "_LIBRARY", "libno_such_driver.so.1")
    cuda._driver.cache_clear()
    with pytest.raises(CudaError, match="no driver of a GPU was found"):
        kernel.on(0, SHARED)
