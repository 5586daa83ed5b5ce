"""Programs are compiled once, stored, and never confused."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.diagnosis.fitting.problem import Problem
from jaxmodel.diagnosis.fitting.programs import Programs


@pytest.fixture
def folder(tmp_path):
    before = jax.config.jax_compilation_cache_dir  # type: ignore[attr-defined]
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


class _Traced:
    """A function that counts how often it is traced."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self, values: tuple[jax.Array, str]) -> jax.Array:
        self.times += 1
        array, law = values
        return jnp.sin(array) if law == "sine" else jnp.cos(array)


def _kept(folder: Path) -> list[Path]:
    return list(folder.rglob("*.program"))


def test_a_program_is_traced_once_for_a_shape_and_for_what_is_no_array(folder):
    traced = _Traced()
    programs = Programs(traced)
    for array in (jnp.arange(3.0), jnp.ones(3), jnp.arange(4.0)):
        for law, right in (("sine", np.sin), ("cosine", np.cos)):
            np.testing.assert_allclose(programs((array, law)), right(array), rtol=1e-14)
    assert traced.times == 4


def test_a_stored_program_gives_identical_results_without_tracing(folder):
    array = jnp.linspace(-3.0, 3.0, 50)
    made = Programs(_Traced())((array, "sine"))
    assert len(_kept(folder)) == 1
    traced = _Traced()
    read = Programs(traced)((array, "sine"))
    assert traced.times == 0
    assert np.array_equal(made, read)
    assert np.array_equal(Programs(traced)((array, "cosine")), jnp.cos(array))
    assert traced.times == 1


def test_an_unreadable_stored_program_is_compiled_again(folder):
    array = jnp.linspace(-3.0, 3.0, 51)
    made = Programs(_Traced())((array, "sine"))
    whole = _kept(folder)[0].read_bytes()
    for damaged in (b"", whole[:-40], whole[:100] + bytes([whole[100] ^ 1]) + whole[101:]):
        _kept(folder)[0].write_bytes(damaged)
        traced = _Traced()
        assert np.array_equal(Programs(traced)((array, "sine")), made)
        assert traced.times == 1


def test_a_program_with_a_class_of_the_user_is_not_stored(folder):
    class Own(Problem):
        pass

    Programs(_Traced())((jnp.arange(5.0), "sine"), classes=[Own])
    assert not _kept(folder)
    Programs(_Traced())((jnp.arange(5.0), "sine"), classes=[Problem])
    assert len(_kept(folder)) == 1


def test_nothing_is_stored_without_a_cache_of_jax(folder):
    jax.config.update("jax_compilation_cache_dir", None)
    assert np.array_equal(Programs(_Traced())((jnp.zeros(6), "cosine")), np.ones(6))
    assert not _kept(folder)
