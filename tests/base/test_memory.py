"""Freed memory goes back to the system, and models that are kept do not keep the matrices that they came from."""

from __future__ import annotations

import numpy as np

from jaxmodel.base.memory import give_back
from jaxmodel.fit.gauss_newton import descend, linearised
from tests.diagnosis.made_cases import cache_of, small_cell


def test_memory_is_given_back_wherever_it_runs() -> None:
    give_back()  # without glibc it does nothing


def test_errors_of_a_model_are_no_column_of_a_matrix() -> None:
    cache = cache_of(small_cell())
    spec = cache.space.spec(())
    start = np.zeros(cache.space.layout.size)
    errors, _ = linearised(cache.view, cache.space.problem(spec), spec, start)
    assert errors.base is None
    assert descend(cache.view, spec, cache.weights_of_tolerances, start, steps=2).errors.base is None
