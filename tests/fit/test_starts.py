"""Starts of fits: an amplitude with many local optima, and the other side of a standstill."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.gauss_newton import Point, descend
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.space import ModelSpec
from jaxmodel.fit.starts import best_along
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import cache_of, case_of, made_cell, run_of

DELAY_S = -7.7
OFFSET_V = 0.09
CLOCK, VOLTAGE = "clock_shift", "voltage_offset:voltage_V"


def noise_of(cache: FitCache) -> Likelihood:
    """Weights of the sensors' noise alone."""
    counts = {name: sum(rows.stop - rows.start for rows in part) for name, part in cache.view.data.by_channel.items()}
    return Likelihood({name: ChannelWeight(cache.noise[name].sd, 1.0, n) for name, n in counts.items()})


def at(cache: FitCache, label: str, numbers: tuple[float, ...]) -> np.ndarray:
    """The stated values, with an effect of these numbers."""
    candidate, x = cache.space.candidates[label], np.zeros(cache.space.layout.size)
    pairs = zip(candidate.coordinates, numbers, strict=True)
    x[list(cache.space.layout.of[label])] = [coordinate.at(number) for coordinate, number in pairs]
    return x


def mean_square(cache: FitCache, point: Point) -> float:
    """The mean square error in units of the noise."""
    return float(np.mean((point.errors / cache.view.data.sd) ** 2))


def off(cache: FitCache, spec: ModelSpec, point: Point, label: str, true: float) -> float:
    """How far the amplitude of an effect is from the truth, in its sd."""
    place = cache.space.layout.of[label][0]
    white = noise_of(cache).roots(cache.view.data)[:, None] * point.jacobian
    sd = np.sqrt(np.diag(np.linalg.inv(white.T @ white + np.diag(spec.precision))))[spec.free.index(place)]
    coordinate = cache.space.layout.coordinates[place]
    return abs(coordinate.number(point.x[place]) - true) / (coordinate.slope(point.x[place]) * sd)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> FitCache:
    """A cell whose logger is late."""
    made = made_cell(tmp_path_factory.mktemp("cells") / "late", {CLOCK: {"d": DELAY_S}})
    return cache_of(made.case, CLOCK)


def test_a_fit_at_a_wrong_local_optimum_reaches_the_best_one(late: FitCache):
    candidate, weights, spec = late.space.candidates[CLOCK], noise_of(late), late.space.spec([CLOCK])
    stuck = descend(late.view, spec, weights, at(late, CLOCK, (DELAY_S - 40.0, 1.0)), steps=15)
    assert mean_square(late, stuck) > 2.0, "the fit is to be led out of a poor place, and is in none"
    led = best_along(late.view, spec, weights, candidate, stuck)
    assert mean_square(late, led) < 1.1
    assert off(late, spec, led, CLOCK, DELAY_S) < 3.0


def test_the_best_optimum_is_kept(late: FitCache):
    candidate, weights, spec = late.space.candidates[CLOCK], noise_of(late), late.space.spec([CLOCK])
    best = descend(late.view, spec, weights, at(late, CLOCK, (DELAY_S, 1.0)), steps=15)
    assert best_along(late.view, spec, weights, candidate, best).objective <= best.objective


def test_a_late_clock_is_found_by_the_fit_of_its_model(late: FitCache):
    fit = late.fit([CLOCK])
    place = late.space.layout.of[CLOCK][0]
    assert fit.converged
    assert late.space.layout.coordinates[place].number(fit.x[place]) == pytest.approx(DELAY_S, abs=0.1)
    assert np.sqrt(fit.mean_squares(late.view)["voltage_V"]) < 1.05 * late.noise["voltage_V"].sd


def test_an_offset_beyond_a_standstill_is_found():
    """With a voltage reading that is too high the motor turns in the model: no gradient leads to standstill."""
    voltage = np.repeat([0.0, 9.0, 0.0, 12.0, 0.0], [100, 6, 100, 6, 100])
    acting = {"voltage_V": voltage, "load_torque_Nm": 0.0 * voltage, "ambient_degC": 20.0 + 0.0 * voltage}
    true = {"R_0": Known(0.118), "k_tau": Known(0.0387), "tau_0": Known(0.0105)}
    truth = case_of("motor", true, [run_of(1, acting, {"speed_rad_s": 0.0 * voltage}, step_s=1.5)])
    readings = simulate(case_model(truth), run_profile(truth.runs[0])).readings
    rng, noise = np.random.default_rng(3), {"current_A": 0.02, "speed_rad_s": 0.5}
    outputs = {name: np.asarray(readings[name]) + sd * rng.standard_normal(voltage.size) for name, sd in noise.items()}
    reported = acting | {"voltage_V": voltage + OFFSET_V}
    stated = {"R_0": Known(0.116, 0.0035), "k_tau": Known(0.0385, 0.001), "tau_0": Known(0.01, 0.0015)}
    cache = cache_of(case_of("motor", stated, [run_of(1, reported, outputs, step_s=1.5)], noise), VOLTAGE)
    weights, spec, base = noise_of(cache), cache.space.spec([VOLTAGE]), cache.space.spec([])
    start = descend(cache.view, base, weights, np.zeros(cache.space.layout.size), steps=15).x
    stuck = descend(cache.view, spec, weights, start, steps=15)
    assert mean_square(cache, stuck) > 3.0, "the fit is to be led out of a poor place, and is in none"
    led = best_along(cache.view, spec, weights, cache.space.candidates[VOLTAGE], stuck)
    assert mean_square(cache, led) < 1.2
    assert off(cache, spec, led, VOLTAGE, OFFSET_V) < 3.0
