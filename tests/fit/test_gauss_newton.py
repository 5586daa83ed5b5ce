"""Descents end at a minimum, never above their start, and find what is true."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.gauss_newton import Point, descend, errors_at, linearised
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.space import ModelSpace, ModelSpec, View
from tests.diagnosis.made_cases import SMALL_KEPT, SMALL_NOISE, SMALL_TRUE, cache_of, small_cell

DRAWS = 30


@pytest.fixture(scope="module")
def base(small_space: ModelSpace) -> ModelSpec:
    return small_space.spec([])


@pytest.fixture(scope="module")
def noise() -> Likelihood:
    return Likelihood({name: ChannelWeight(sd, 1.0, 300) for name, sd in SMALL_NOISE.items()})


@pytest.fixture(scope="module")
def found(small_view: View, base: ModelSpec, noise: Likelihood) -> Point:
    return descend(small_view, base, noise, np.zeros(small_view.space.layout.size), steps=20)


def objective(view: View, spec: ModelSpec, weights: Likelihood, x: np.ndarray) -> float:
    errors = errors_at(view, view.space.problem(spec), spec, x[None])[:, 0]
    return float(np.sum((weights.roots(view.data) * errors) ** 2) + np.sum(spec.precision * x[list(spec.free)] ** 2))


def sds(point: Point, spec: ModelSpec, root: np.ndarray) -> np.ndarray:
    white = root[:, None] * point.jacobian
    return np.sqrt(np.diag(np.linalg.inv(white.T @ white + np.diag(spec.precision))))


def test_a_descent_ends_at_a_minimum(small_view: View, base: ModelSpec, noise: Likelihood, found: Point):
    assert found.converged
    assert found.objective == pytest.approx(objective(small_view, base, noise, found.x))
    rng, own = np.random.default_rng(0), list(base.free)
    for _ in range(8):
        away = np.zeros(found.x.size)
        away[own] = 0.3 * rng.standard_normal(len(own))
        assert objective(small_view, base, noise, found.x + away) > found.objective
    assert found.objective == pytest.approx(small_view.data.count, rel=0.2)


def test_true_numbers_are_found(small_view: View, base: ModelSpec, noise: Likelihood, found: Point):
    layout, sd = small_view.space.layout, sds(found, base, noise.roots(small_view.data))
    for name, true in SMALL_TRUE.items():
        place = layout.names.index(name)
        coordinate = layout.coordinates[place]
        own = coordinate.slope(found.x[place]) * sd[base.free.index(place)]
        assert coordinate.number(found.x[place]) == pytest.approx(true, abs=4.0 * own), name


def test_sds_are_those_of_repeated_measurements(small_view: View, base: ModelSpec, noise: Likelihood):
    rng, own, data = np.random.default_rng(1), list(base.free), small_view.data
    away, objectives = [], []
    for _ in range(DRAWS):
        truth = np.zeros(small_view.space.layout.size)
        truth[own] = rng.standard_normal(len(own))
        clean = data.value - errors_at(small_view, small_view.space.problem(base), base, truth[None])[:, 0]
        anew = dataclasses.replace(data, value=clean + data.sd * rng.standard_normal(clean.size))
        point = descend(View(small_view.space, anew), base, noise, truth, steps=10)
        away.append((point.x[own] - truth[own]) / sds(point, base, noise.roots(data)))
        objectives.append(point.objective)
    low, high = chi2.interval(1.0 - 1e-3 / len(own), DRAWS)
    spread = np.sum(np.square(away), axis=0)
    assert np.all((spread > low) & (spread < high))
    # Of all readings and priors each is standard normal, and each unknown takes one.
    assert np.sum(objectives) == pytest.approx(DRAWS * data.count, rel=0.03)


@pytest.mark.parametrize("steps", [0, 1, 3])
def test_no_descent_ends_higher_than_its_start(
    small_view: View, small_space: ModelSpace, noise: Likelihood, steps: int
):
    spec = small_space.spec(["self_heating", "ocv_hysteresis"])
    rng = np.random.default_rng(2)
    for spread in (0.1, 1.0, 5.0):
        start = np.zeros(small_space.layout.size)
        start[list(spec.free)] = spread * rng.standard_normal(len(spec.free))
        point = descend(small_view, spec, noise, start, steps=steps)
        at_start = objective(small_view, spec, noise, start)
        assert point.objective <= at_start * (1.0 + 1e-14)  # summed in another order
        assert point.objective == pytest.approx(objective(small_view, spec, noise, point.x))


def test_a_minimum_is_reached_from_afar(small_view: View, base: ModelSpec, noise: Likelihood, found: Point):
    """Where a Newton step would lead beyond what the model stands, a damped one does not."""
    rng, own = np.random.default_rng(4), list(base.free)
    for _ in range(4):
        start = np.zeros(found.x.size)
        start[own] = 6.0 * rng.standard_normal(len(own))
        point = descend(small_view, base, noise, start, steps=40)
        assert point.objective == pytest.approx(found.objective, abs=0.1)


def test_only_free_unknowns_move(small_view: View, base: ModelSpec, noise: Likelihood):
    alone = base.with_free([base.free[1]])
    assert (alone.free, alone.precision.size) == ((base.free[1],), 1)
    start = 0.2 * np.ones(small_view.space.layout.size)
    point = descend(small_view, alone, noise, start, steps=5)
    np.testing.assert_array_equal(np.delete(point.x, base.free[1]), np.delete(start, base.free[1]))
    assert point.x[base.free[1]] != 0.2
    assert point.jacobian.shape == (small_view.data.count, 1)


def test_a_model_without_free_unknowns_stays_where_it_is(small_view: View, base: ModelSpec, noise: Likelihood):
    """As where the profile of a case's only unknown is computed."""
    start = 0.2 * np.ones(small_view.space.layout.size)
    point = descend(small_view, base.with_free([]), noise, start, steps=5)
    np.testing.assert_array_equal(point.x, start)
    assert point.converged


def test_a_point_that_is_known_is_a_start(small_view: View, base: ModelSpec, noise: Likelihood, found: Point):
    again = descend(small_view, base, noise, found, steps=5)
    assert again.objective <= found.objective
    np.testing.assert_allclose(again.x, found.x, atol=1e-2)


def test_derivatives_are_those_of_the_predictions(small_view: View, base: ModelSpec, found: Point):
    problem = small_view.space.problem(base)
    errors, jacobian = linearised(small_view, problem, base, found.x)
    np.testing.assert_array_equal(errors, found.errors)
    for number, place in enumerate(base.free[:4]):
        x = np.stack([found.x, found.x])
        x[:, place] += (1e-3, -1e-3)
        predicted = small_view.data.value[:, None] - errors_at(small_view, problem, base, x)
        slope = (predicted[:, 0] - predicted[:, 1]) / 2e-3
        np.testing.assert_allclose(jacobian[:, number], slope, atol=1e-5 + 2e-3 * np.max(np.abs(slope)))


def reordered(cache: FitCache, order: list[int]) -> FitCache:
    return cache_of(dataclasses.replace(cache.case, runs=tuple(cache.case.runs[n] for n in order)), *SMALL_KEPT)


def test_the_order_of_runs_does_not_matter(small_cache: FitCache):
    other = reordered(FitCache(small_cell()), [2, 1, 0])
    for labels in ((), ("self_heating",)):
        one, two = small_cache.fit(labels), other.fit(labels)
        assert two.objective == pytest.approx(one.objective, rel=1e-6)
        for name in SMALL_TRUE:
            place = small_cache.space.layout.names.index(name)
            same = other.space.layout.names.index(name)
            assert two.x[same] == pytest.approx(one.x[place], abs=1e-2)


def test_a_model_that_cannot_be_has_a_large_error_and_raises_nothing(
    small_view: View, base: ModelSpec, noise: Likelihood, found: Point
):
    far = found.x.copy()
    far[0] = -1e4  # a capacity that the first second uses up
    point = descend(small_view, base, noise, far, steps=5)
    assert np.isfinite(point.objective)
    assert point.objective > found.objective
