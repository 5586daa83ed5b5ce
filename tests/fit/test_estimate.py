"""Calibration: weights, amplitudes of curves and unknowns together, and never worse than what was stated."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.case.known import Known
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import NONE, Fit, best_amplitudes, calibrate, degrees_of_freedom, evidence
from jaxmodel.fit.gauss_newton import errors_at, linearised
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.linearisation import Linearisation
from jaxmodel.fit.space import View
from tests.diagnosis.made_cases import SMALL_NOISE, cache_of, small_cell

TABLES = ("ocv_curve", "series_resistance_curve", "short_resistance_curve", "long_resistance_curve")
OFF_V = 0.012


@pytest.fixture(scope="module")
def exact() -> FitCache:
    """A cell whose tables are exact."""
    return cache_of(small_cell(), *TABLES)


@pytest.fixture(scope="module")
def wrong() -> FitCache:
    """A cell whose voltages are those of another open-circuit voltage: a bump about the middle."""
    return cache_of(with_wrong_table(small_cell()), *TABLES)


def off(soc: np.ndarray) -> np.ndarray:
    return OFF_V * np.exp(-(((soc - 0.8) / 0.12) ** 2))


def with_wrong_table(case: Case) -> Case:
    """Return the case with the voltages of a cell whose open-circuit voltage is higher about a state of charge."""
    runs = []
    for run in case.runs:
        measured = run.measured
        charge = np.cumsum(measured.inputs["current_A"] * np.diff(measured.time_s, append=measured.time_s[-1]))
        soc = run.initial_soc.value - np.append(0.0, charge[:-1]) / 3600.0 / 2.03
        outputs = measured.outputs | {"voltage_V": measured.outputs["voltage_V"] + off(soc)}
        runs.append(dataclasses.replace(run, measured=dataclasses.replace(measured, outputs=outputs)))
    return dataclasses.replace(case, runs=tuple(runs))


def test_amplitudes_go_to_nothing_where_tables_are_exact(exact: FitCache):
    assert exact.base.spec.amplitudes == dict.fromkeys(TABLES, NONE)
    for name, error in exact.calibrated.mean_squares(exact.view).items():
        assert exact.base.mean_squares(exact.view)[name] == pytest.approx(error, rel=1e-3)
    for name in SMALL_NOISE:
        assert exact.base.likelihood.channels[name].sd == pytest.approx(SMALL_NOISE[name], rel=0.1)
        assert exact.base.likelihood.channels[name].inflation == pytest.approx(1.0, abs=0.3)


def test_a_wrong_table_is_found_and_no_other(wrong: FitCache):
    base = wrong.base
    assert base.spec.amplitudes["ocv_curve"] >= 0.5
    assert max(base.spec.amplitudes[name] for name in TABLES[1:]) <= 0.2
    candidate = wrong.space.candidates["ocv_curve"]
    values = candidate.mix @ base.x[list(wrong.space.layout.of["ocv_curve"])]
    knots = candidate.effect.knots
    inside = (knots > 0.6) & (knots < 0.93)
    error = values[inside] - off(knots[inside])
    # The initial charges take part of it, as a level and a slope.
    error -= np.polyval(np.polyfit(knots[inside], error, 1), knots[inside])
    assert np.max(np.abs(error)) < 0.25 * OFF_V
    before, after = (np.sqrt(fit.mean_squares(wrong.view)["voltage_V"]) for fit in (wrong.calibrated, base))
    assert after < 1.1 * SMALL_NOISE["voltage_V"] < 1.5 * SMALL_NOISE["voltage_V"] < before


def test_the_evidence_of_amplitudes_is_no_less_than_where_the_search_began(wrong: FitCache):
    base, view = wrong.base, wrong.view
    start = wrong.space.spec(base.spec.labels, dict.fromkeys(TABLES, NONE))
    found = best_amplitudes(view, start, base.linear, base.likelihood)
    specs = (start, found, base.spec)
    before, after, of_base = (dataclasses.replace(base, spec=spec).log_evidence() for spec in specs)
    assert after > before + 10.0
    # A wider curve beside a charge that is held, or a narrower one beside a free one: the search may end at either.
    assert after == pytest.approx(of_base, abs=0.5)


def test_no_amplitude_exceeds_what_physics_allows(wrong: FitCache):
    """However much the readings ask for it: of a factor here for the logarithm of 20 times the usual one."""
    base, view, name = wrong.base, wrong.view, "series_resistance_curve"
    _, jacobian = linearised(view, wrong.space.problem(base.spec), base.spec, base.x)
    x = np.zeros(base.x.size)
    x[list(wrong.space.layout.of[name])] = 20.0
    free = x[list(base.spec.free)]
    linear = Linearisation.of(view.data, free, 0.0 * base.errors, jacobian)
    found = best_amplitudes(view, base.spec, linear, base.likelihood).amplitudes[name]
    assert found == pytest.approx(CURVES[name].largest / CURVES[name].typical)


def test_weights_are_those_of_the_errors_that_are_left(wrong: FitCache):
    fit = wrong.calibrated
    assert fit.converged
    used = degrees_of_freedom(fit.linear, fit.likelihood, fit.spec)
    assert sum(used.values()) <= len(fit.spec.free)
    for name, mean_square in fit.mean_squares(wrong.view).items():
        channel = fit.likelihood.channels[name]
        left = channel.independent - used[name]
        expected = max(SMALL_NOISE[name], np.sqrt(mean_square * channel.independent / left))
        assert channel.sd == pytest.approx(expected, rel=0.1)
    assert fit.likelihood.channels["voltage_V"].inflation > 3.0, "a wrong table is wrong for minutes"


def test_given_weights_stay(wrong: FitCache):
    weights = Likelihood({name: ChannelWeight(3.0 * sd, 2.0, 300) for name, sd in SMALL_NOISE.items()})
    one = wrong.calibrated
    found = calibrate(wrong.view, one.spec, one.x, wrong.tolerances, weights, held=weights.channels)
    assert found.likelihood is weights
    assert found.converged


def test_the_weight_of_one_channel_can_be_held(wrong: FitCache):
    weights = Likelihood({name: ChannelWeight(3.0 * sd, 2.0, 300) for name, sd in SMALL_NOISE.items()})
    one = wrong.calibrated
    found = calibrate(wrong.view, one.spec, one.x, wrong.tolerances, weights, held=["voltage_V"]).likelihood.channels
    assert found["voltage_V"] == weights.channels["voltage_V"]
    assert all(found[name] != weights.channels[name] for name in found if name != "voltage_V")


def test_more_unknowns_leave_less_and_have_more_evidence_under_the_same_weights(wrong: FitCache):
    """Objectives cannot be compared: beside curves a stated charge is held tighter, which the evidence pays for."""
    few, base = wrong.calibrated, wrong.base
    under = calibrate(wrong.view, base.spec, base.x, wrong.tolerances, few.likelihood, held=few.likelihood.channels)
    assert evidence(wrong.view, under, few.likelihood) > evidence(wrong.view, few, few.likelihood)
    assert under.mean_squares(wrong.view)["voltage_V"] < few.mean_squares(wrong.view)["voltage_V"]


def pooled(view: View, weights: Likelihood, errors: np.ndarray) -> float:
    return float(np.sum((weights.roots(view.data) * errors) ** 2))


def never_worse(cache: FitCache) -> Fit:
    """Hold the calibrated model against the stated one under its own weights; return it."""
    fit, view = cache.calibrated, cache.view
    stated = errors_at(view, cache.space.problem(fit.spec), fit.spec, np.zeros((1, fit.x.size)))[:, 0]
    assert pooled(view, fit.likelihood, fit.errors) <= pooled(view, fit.likelihood, stated)
    return fit


def test_a_calibrated_model_is_no_worse_than_the_stated_one(exact: FitCache, wrong: FitCache):
    never_worse(exact)
    never_worse(wrong)


@pytest.mark.parametrize("name", ["dev-01", "dev-02", "dev-03"])
def test_a_calibrated_model_of_a_shared_case_is_no_worse_than_the_stated_one(shared: Path, name: str):
    case = read_case(shared / "cases" / name)
    without = [label for label, one in FitCache(case).space.candidates.items() if one.name != "voltage_offset"]
    never_worse(FitCache(case, without=without))


def test_intervals_over_runs_are_no_narrower_than_the_posterior(wrong: FitCache):
    fit = wrong.calibrated
    posterior = np.sqrt(np.diag(fit.covariance))
    assert np.all(fit.sd >= posterior)
    assert np.all(fit.sd <= np.maximum(posterior, fit.spec.precision**-0.5) * (1.0 + 1e-12))
    np.testing.assert_allclose(fit.pulls, fit.free * np.sqrt(fit.spec.precision))


def test_a_stated_number_that_is_far_off_is_found():
    case = small_cell()
    far = case.parameters | {"series_resistance_scale": Known(1.6, 0.2)}
    cache = cache_of(dataclasses.replace(case, parameters=far), "self_heating")
    fit = never_worse(cache)
    place = cache.space.layout.names.index("series_resistance_scale")
    assert cache.space.layout.coordinates[place].number(fit.x[place]) == pytest.approx(1.05, abs=0.05)
