"""Identifiability against the spread of estimates from simulated readings."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.advice.identifiability import (
    Identifiability,
    calibrated,
    deeper,
    identifiability,
    names_of,
    profile_likelihood,
)
from jaxmodel.fit.asked import asking_for
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.data import FitData
from jaxmodel.fit.estimate import Fit, calibrate
from jaxmodel.fit.gauss_newton import descend, linearised
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.linearisation import Linearisation
from jaxmodel.fit.problem import Lane, Problem
from jaxmodel.fit.space import View
from tests.diagnosis.made_cases import TRUE, MadeCell, cache_of, made_cell, made_cell_with_unknown_law

DRAWS = 25
WIDER = 30.0
CHECK_RUN = 3


def models_of(case: Case) -> FitCache:
    """With two effects alone to choose from, of which the programs are those of other tests."""
    return cache_of(case, "capacity_temperature", "entropic_ocv")


def as_noise(cache: FitCache, fit: Fit) -> Fit:
    """The model calibrated as if what it leaves were the sensors' noise."""
    weights = {n: ChannelWeight(cache.noise[n].sd, 1.0, one.count) for n, one in fit.likelihood.channels.items()}
    return calibrate(cache.view, fit.spec, fit.x, cache.tolerances, Likelihood(weights), held=weights)


@pytest.fixture(scope="module")
def plain(plain_cell: MadeCell) -> FitCache:
    return models_of(plain_cell.case)


@pytest.fixture(scope="module")
def model(plain: FitCache) -> Fit:
    fit, misfit = calibrated(plain)
    assert misfit == pytest.approx(1.0, abs=0.05)
    assert fit.likelihood.channels["voltage_V"].inflation == pytest.approx(1.0, abs=0.2)
    assert fit.added == fit.spec.labels == ()
    return as_noise(plain, fit)


@pytest.fixture(scope="module")
def found(plain: FitCache, model: Fit) -> Identifiability:
    return identifiability(plain, model)


def asked(plain: FitCache) -> list[int]:
    """The reported unknowns: without those of check runs, and initial states that affect no reading."""
    layout = plain.space.layout
    unstated = ("initial_hysteresis", "initial_temperature_rise_K")
    return [i for i in range(layout.base) if layout.runs[i] != CHECK_RUN and layout.names[i] not in unstated]


def test_information_of_all_runs_is_that_of_the_fit(found: Identifiability, model: Fit, plain: FitCache) -> None:
    own = asked(plain)
    places = [model.spec.free.index(i) for i in own]
    expected = model.gram.square[np.ix_(places, places)]
    outer = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found.information.total / outer, expected / outer, atol=1e-3)
    assert found.names == tuple(names_of(plain)[i] for i in own)
    assert found.runs == ("run-01", "run-02", "run-03")
    assert len(found.information.parts) == len(found.runs) * len(found.sensors)


def test_estimates_scatter_as_the_data_alone_say(found: Identifiability, model: Fit, plain: FitCache) -> None:
    """Readings made anew of one truth, fitted with priors 30 times as wide: what is left is the Cramer-Rao bound."""
    generator = np.random.default_rng(5)
    truth, view, weights = model.x, plain.view, model.likelihood
    clean = view.at(plain.space.problem(model.spec), [model.spec.lane(truth)])[0]
    wide = dataclasses.replace(model.spec, precision=model.spec.precision / WIDER**2)
    away = []
    for _ in range(DRAWS):
        data = view.data
        anew = dataclasses.replace(data, value=clean + data.sd * generator.standard_normal(clean.size))
        refit = descend(View(plain.space, anew), wide, weights, truth, steps=15)
        assert refit.converged
        away.append(refit.x - truth)
    own = asked(plain)
    away = np.array(away)[:, own]
    bound = found.information.sd_of_data()
    scatter = np.sum((away / bound) ** 2, axis=0)
    low, high = chi2.interval(1.0 - 1e-4 / len(own), DRAWS)
    assert np.all((low < scatter) & (scatter < high))
    whole = np.einsum("di,ij,dj->", away, found.information.total, away)  # correlations too
    low, high = chi2.interval(1.0 - 1e-4, DRAWS * len(own))
    assert low < whole < high


def test_shares_of_runs_and_sensors_add_up(found: Identifiability) -> None:
    before = found.shares_known_before().sum(axis=0)
    np.testing.assert_allclose(found.shares_by_run().sum(axis=0) + before, 1.0, rtol=1e-9)
    np.testing.assert_allclose(found.shares_by_sensor(), found.shares_by_run().sum(axis=0)[None], rtol=1e-12)
    # Only the run itself determines its initial state; no bound falls when a run is left out.
    for run, name in enumerate(("initial_soc[run-01]", "initial_soc[run-02]", "initial_soc[run-03]")):
        i = found.place(name)
        assert np.argmax(found.shares_by_run()[:, i]) == run
        assert found.sd_without_run()[run, i] == pytest.approx(found.prior_sd[i], rel=1e-9)
    assert np.all(found.sd_without_run() >= found.sd * (1.0 - 1e-9))
    np.testing.assert_allclose(found.sd_without_sensor()[0], found.prior_sd)  # there is but one


def test_answer_says_yes_with_the_source(found: Identifiability) -> None:
    said = found.answer("capacity_Ah")
    i = found.place("capacity_Ah")
    assert said.startswith(f"Yes: capacity_Ah = {found.values[i]:.4g} ± {found.sd[i]:.2g} A h")
    assert "voltage_V in run-0" in said
    with pytest.raises(ParameterError, match="Did you mean 'capacity_Ah'"):
        found.answer("capacity")


def test_capacity_and_storage_are_determined_only_together(plain_cell: MadeCell) -> None:
    """Eq. 8 multiplies the capacity of eq. 1: no reading can distinguish the two factors."""
    case, assumed = asking_for(plain_cell.case, ["storage_months", "R_0"])
    assert assumed == ("storage_months", "R_0")
    cache = models_of(case)
    spec, stated = cache.spec((), "none"), np.zeros(cache.space.layout.size)
    errors, jacobian = linearised(cache.view, cache.space.problem(spec), spec, stated)
    linear = Linearisation.of(cache.view.data, stated[list(spec.free)], errors, jacobian)
    weights = Likelihood({"voltage_V": ChannelWeight(cache.noise["voltage_V"].sd, 1.0, errors.size)})
    as_stated = Fit(spec, (), stated, errors, weights, linear, 0.0, 0.0)
    found = identifiability(cache, as_stated, assumed=assumed)
    assert np.isinf(found.sd_of_data[[found.place("capacity_Ah"), found.place("storage_months")]]).all()
    assert np.isfinite(found.sd_of_data[found.place("rc_resistance_scale")])
    words = [words for _, words in found.sloppy()]
    assert "R_0 alone" in words
    together = [one for one in words if "capacity_Ah" in one]
    assert len(together) == 1
    assert "storage_months" in together[0]
    assert found.answer("R_0") == "No: no reading depends on R_0."
    assert found.answer("capacity_Ah").startswith("No: ")  # its own sd is far less than what storage could make up for
    assert "they do not determine storage_months, capacity_Ah up together" in found.answer("capacity_Ah")


def test_parameters_stated_with_an_sd_are_unchanged(plain_cell: MadeCell) -> None:
    case, assumed = asking_for(plain_cell.case, ["capacity_Ah", "initial_soc"])
    assert assumed == ()
    assert case.parameters == plain_cell.case.parameters
    with pytest.raises(ParameterError, match="Did you mean 'k_tau'"):
        asking_for(plain_cell.case, ["k_tao"])


class Curved(View):
    """Readings that are sinh(2 x) of the first unknown and straight in the second."""

    def at(self, problem: Problem, lanes: Sequence[Lane]) -> np.ndarray:
        x = np.array([lane.x for lane in lanes])
        first, second = np.sinh(2.0 * x[:, 0]), x[:, 1]
        return np.stack([-first, first - 3.0 * second], axis=1)


def test_profile_agrees_with_the_quadratic_or_shows_that_it_is_wrong(plain: FitCache, model: Fit) -> None:
    nothing, number = np.zeros(2), np.arange(2)
    chain = ((("voltage_V", 0), slice(0, 2)),)
    data = FitData(nothing, 0 * number, number, 0 * number, nothing, nothing + 1.0, chain)
    view, weights = Curved(plain.space, data), Likelihood({"voltage_V": ChannelWeight(1.0, 1.0, 2)})
    toys = copy.copy(plain)
    toys.view = view
    size = plain.space.layout.size
    toy = calibrate(view, model.spec, np.zeros(size), plain.tolerances, weights, held=weights.channels)
    first, second, third, *_ = names_of(plain)
    curved = profile_likelihood(toys, toy, first)
    x = np.linspace(-3.0, 3.0, 9) * np.sqrt(toy.covariance[0, 0])
    s = np.sinh(2.0 * x)
    expected = s**2 + (s - 3.0 * (0.3 * s)) ** 2 + (0.3 * s) ** 2 + x**2  # at the best second unknown, 3 s / 10
    np.testing.assert_allclose(curved.rise, expected, rtol=1e-3, atol=1e-6)
    assert curved.is_not_quadratic
    straight = profile_likelihood(toys, toy, third)
    np.testing.assert_allclose(straight.rise, straight.quadratic, atol=1e-6)
    assert not straight.is_not_quadratic
    assert deeper(toys, toy, curved) is None
    # A calibration that has not converged is detected, and started again.
    x = np.full(size, 0.5)
    short = dataclasses.replace(toy, x=x, objective=descend(view, model.spec, weights, x, steps=0).objective)
    again = deeper(toys, short, profile_likelihood(toys, short, second))
    assert again is not None
    np.testing.assert_allclose(again.free, 0.0, atol=1e-3)


def test_a_model_error_widens_the_bounds(tmp_path: Path) -> None:
    """A law that is in no model: its error, shared by many readings, is not averaged away as noise would be."""
    _held_to_the_truth(made_cell_with_unknown_law(tmp_path, 0.05).case)


def test_a_missing_effect_widens_them_too(tmp_path: Path) -> None:
    _held_to_the_truth(made_cell(tmp_path, {"capacity_temperature": {"a": 0.006}}).case)


def _held_to_the_truth(case: Case) -> None:
    cache = models_of(case)
    fit, misfit = calibrated(cache)
    assert misfit > 1.5
    assert fit.likelihood.channels["voltage_V"].inflation > 2.0
    found = identifiability(cache, fit, misfit)
    without = identifiability(cache, as_noise(cache, fit), misfit)
    i = found.place("capacity_Ah")
    assert found.sd[i] > 2.0 * without.sd[i]
    assert abs(found.values[i] - TRUE["capacity_Ah"]) < 3.0 * found.sd[i]
    assert "the RMS residual is" in found.answer("capacity_Ah")
