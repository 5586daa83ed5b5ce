"""Expected gains of candidates against dense formulas: readings with a covariance, unknowns with priors."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
import pytest

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.evidence.linear import AMPLITUDES, AS_FAR, Linear
from jaxmodel.diagnosis.fitting.candidates import Candidate
from jaxmodel.diagnosis.fitting.coordinates import Coordinate
from jaxmodel.diagnosis.fitting.fit import fit
from jaxmodel.diagnosis.fitting.model import ModelSpace, Setting, View
from jaxmodel.diagnosis.fitting.readings import Weights
from jaxmodel.diagnosis.noise.contract import noise_of_case
from jaxmodel.diagnosis.noise.model_error import NONE, ModelError
from jaxmodel.diagnosis.screening.screen import Direction, Screen, screen
from jaxmodel.effects.battery import CapacityFade, EntropicOcv

READINGS = 60


def unit(label: str, group: str = "effect", **more) -> Candidate:
    """A candidate with an amplitude of unit normal prior at its probe."""
    return Candidate(label, group, EntropicOcv(), (Coordinate(label, 0.0, 1.0),), ((1.0,),), **more)


def curve(label: str, count: int) -> Candidate:
    coordinates = tuple(Coordinate(f"{label}[{place}]", 0.0, 1.0) for place in range(count))
    return Candidate(label, "curve", EntropicOcv(), coordinates, is_vector=True)


@dataclasses.dataclass(frozen=True)
class Given:
    """A linear model: measured = base x + ways + errors of the covariance."""

    linear: Linear
    base: np.ndarray
    errors: np.ndarray
    covariance: np.ndarray
    ways: dict[str, np.ndarray]
    prior_sd: np.ndarray
    pulls: np.ndarray

    def log_probability(self, more: np.ndarray | None = None) -> float:
        """Of what is measured, with directions of unit prior beside the base model's own."""
        columns = self.base * self.prior_sd
        if more is not None:
            columns = np.concatenate([columns, more], axis=1)
        dense = self.covariance + columns @ columns.T
        measured = self.errors + self.base @ self.pulls  # residual of the base model at x = 0
        return float(-0.5 * measured @ np.linalg.solve(dense, measured) - 0.5 * np.linalg.slogdet(dense)[1])


@pytest.fixture(scope="module")
def given(small_view: View, small_weights: Weights) -> Given:
    """Some readings of a case, for their noise and model error; all else is random."""
    rng = np.random.default_rng(0)
    readings = small_view.readings
    error = ModelError({("voltage_V", 0): 0.004, ("voltage_V", 1): 0.002}, {"voltage_V": 100.0})
    weights = Weights(readings, error)
    white = weights.whiten(np.eye(readings.count))
    covariance = np.linalg.inv(white.T @ white)
    sd = np.sqrt(np.diag(covariance))
    prior_sd, pulls = np.array([1.0, 0.5, 2.0]), np.zeros(3)
    base = sd[:, None] * rng.standard_normal((readings.count, 3)) * np.array([0.3, 0.1, 1e-3])
    ways = {
        "strong": sd[:, None] * rng.standard_normal((readings.count, 1)) * 0.5,
        "weak": sd[:, None] * rng.standard_normal((readings.count, 1)) * 0.01,
        "inside": base[:, :2] @ np.array([[1.0], [-2.0]]),
        "alias": base[:, :1] * 0.4 + 1e-4 * sd[:, None] * rng.standard_normal((readings.count, 1)),
        "one run": sd[:, None] * np.where(readings.run == 1, 0.2, 0.0)[:, None],
        "curve": sd[:, None] * rng.standard_normal((readings.count, 4)) * 0.1,
    }
    noise = np.linalg.cholesky(covariance) @ rng.standard_normal(readings.count)
    measured = base @ (0.5 * rng.standard_normal(3)) + 0.4 * ways["strong"][:, 0] + noise
    # The base model calibrated, as every model is that is screened.
    inverse = np.linalg.inv(covariance)
    pulls = np.linalg.solve(base.T @ inverse @ base + np.diag(prior_sd**-2.0), base.T @ inverse @ measured)
    candidates = {label: unit(label) for label in ("strong", "weak", "inside", "alias")}
    candidates |= {"one run": unit("one run", "run", run=1), "curve": curve("curve", 4)}
    setting = Setting((), (0, 1, 2), prior_sd, np.zeros(0), np.zeros((0, 0)), False)
    directions = tuple(
        Direction(label, () if candidates[label].is_vector else (1.0,), columns) for label, columns in ways.items()
    )
    errors = measured - base @ pulls
    screened = Screen(setting, pulls, errors, -base, directions)
    linear = Linear(screened, weights, candidates, pulls, np.array([True, True, False]))
    return Given(linear, base, errors, covariance, ways, prior_sd, pulls)


def test_gains_are_those_of_the_dense_formula(given: Given):
    found = {gain.label: gain for gain in given.linear.gains()}
    without = given.log_probability()
    for label in ("strong", "weak", "one run"):
        expected = given.log_probability(given.ways[label]) - without
        assert found[label].log_evidence == pytest.approx(expected, abs=1e-6), label
    for label in ("curve",):
        gains = [given.log_probability(a * given.ways[label]) - without for a in AMPLITUDES]
        assert found[label].log_evidence == pytest.approx(max(gains), abs=1e-6)
        assert found[label].amplitude == AMPLITUDES[int(np.argmax(gains))]
    assert given.linear.gains()[0].label == "strong"


def test_amplitude_score_and_base_step_are_those_of_a_refit(given: Given):
    """With no prior of the amplitude, as a score has none."""
    inverse = np.linalg.inv(given.covariance)
    both = np.concatenate([given.base, given.ways["strong"]], axis=1)
    measured = given.errors + given.base @ given.pulls
    precision = np.diag(np.append(given.prior_sd**-2.0, 0.0))
    information = both.T @ inverse @ both + precision
    refitted = np.linalg.solve(information, both.T @ inverse @ measured)
    gain = next(gain for gain in given.linear.gains() if gain.label == "strong")
    assert gain.start[0] == pytest.approx(refitted[-1])
    np.testing.assert_allclose(given.pulls + gain.base_step, refitted[:-1], atol=1e-8)
    assert gain.z == pytest.approx(refitted[-1] / np.sqrt(np.linalg.inv(information)[-1, -1]))
    assert gain.chi2 == pytest.approx(gain.z**2)


def test_gains_of_a_channel_are_those_without_the_others(given: Given, small_view: View, small_weights: Weights):
    """As if the readings of all other channels had no error and no sensitivity."""
    linear, channel = given.linear, small_view.readings.channel
    weights = Weights(
        small_view.readings, ModelError({("voltage_V", 0): 0.004, ("voltage_V", 1): 0.002}, {"voltage_V": 100.0})
    )
    for one, found in zip(np.unique(channel), linear.gains_by_channel(), strict=True):
        mine = (channel == one)[:, None]
        directions = tuple(dataclasses.replace(way, columns=way.columns * mine) for way in linear.directions)
        setting = Setting((), (0, 1, 2), given.prior_sd, np.zeros(0), np.zeros((0, 0)), False)
        screened = Screen(setting, given.pulls, given.errors * mine[:, 0], -given.base * mine, directions)
        alone = Linear(screened, weights, linear.candidates, given.pulls, np.array([True, True, False])).gains()
        expected = {gain.label: gain.log_evidence for gain in alone}
        by_label = {gain.label: gain.log_evidence for gain in found}
        for label in ("strong", "weak", "one run", "curve"):
            assert by_label[label] == pytest.approx(expected[label], abs=1e-6), label


def test_what_the_base_model_can_imitate_is_no_effect(given: Given):
    """In its span, or all but in it where a number of all runs may be stated wrongly."""
    labels = {gain.label for gain in given.linear.gains()}
    assert labels == {"strong", "weak", "one run", "curve"}
    assert AS_FAR > 1.0


def test_richest_model_takes_significant_candidates_and_leaves_the_noise(given: Given):
    left = given.linear.richest(least=5.0)
    inverse = np.linalg.inv(given.covariance)
    assert left @ inverse @ left < given.errors @ inverse @ given.errors - 20.0
    assert left @ inverse @ left == pytest.approx(left.size, rel=0.2)
    np.testing.assert_allclose(given.linear.richest(least=1e9), given.errors, atol=1e-9)


def test_few_rows_have_the_same_inner_products(given: Given):
    base, errors, ways = given.linear.rows()
    inverse = np.linalg.inv(given.covariance)
    precision = np.diag(given.prior_sd**-2.0)
    np.testing.assert_allclose(base.T @ base, given.base.T @ inverse @ given.base + precision, rtol=1e-6, atol=1e-7)
    for columns, way in zip(ways, given.linear.directions, strict=True):
        np.testing.assert_allclose(columns.T @ columns, way.columns.T @ inverse @ way.columns, rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(columns.T @ errors, way.columns.T @ inverse @ given.errors, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(base.T @ columns, given.base.T @ inverse @ way.columns, rtol=1e-6, atol=1e-7)
    # The base model is at its minimum: with the priors' rows nothing is left along its own unknowns.
    np.testing.assert_allclose(base.T @ errors, 0.0, atol=1e-6)


def test_scores_beyond_the_critical_one_are_rare_by_chance(given: Given):
    """As the largest of a few normal draws."""
    assert 1.9 < given.linear.critical_z() < 2.6
    assert given.linear.critical_z() == given.linear.critical_z()


def test_detectable_candidates_are_listed(given: Given):
    seen = given.linear.visible()
    assert "strong" in seen
    assert "weak" not in seen


class Fade(CapacityFade):
    """A user's effect that declares no parameter to distinguish it from another capacity."""

    name: ClassVar[str] = "fade"
    distinguished_by: ClassVar[str] = ""


def test_an_effect_that_imitates_a_parameter_of_all_runs_is_excluded(small: Case, small_view: View) -> None:
    """A capacity that fades with cycles is another capacity where all runs have one cycle count."""
    small = dataclasses.replace(small, own_effects={"fade": Fade})
    others = [label for label in ModelSpace(small).candidates if label not in ("fade", "self_heating")]
    space = ModelSpace(small, others)
    view, setting = View(space, small_view.readings), space.setting([])
    weights = Weights(view.readings, NONE)
    fitted = fit(view, setting, weights, np.zeros(space.layout.size))
    screened = screen(view, setting, fitted.x, noise_of_case(small))
    assert {way.label for way in screened.directions} == {"fade", "self_heating"}
    is_common = np.array([space.layout.runs[place] < 0 for place in setting.free])
    linear = Linear(screened, weights, space.candidates, fitted.x[list(setting.free)], is_common)
    gains = {gain.label: gain for gain in linear.gains()}
    assert gains.keys() == {"self_heating"}
    # Nothing is hidden, and no expected gain is material.
    assert gains["self_heating"].log_evidence < 5.0


def test_rounding_in_columns_that_others_absorb_makes_no_evidence() -> None:
    """A million readings of a fine sensor: inner products of 1e19, of which rounding leaves a thousand."""
    rng = np.random.default_rng(4)
    first, errors = rng.standard_normal(500), 1e3 * rng.standard_normal(500)
    alike = first[:, None] + 1e-9 * rng.standard_normal((500, 3))
    columns = np.column_stack([1e9 * first, 1e9 * alike, errors])
    gram = columns.T @ columns
    linear = object.__new__(Linear)
    off = linear._off(gram, slice(0, 1), np.ones(1))
    again = linear._off(off, slice(1, 4), np.full(3, 1e-2))
    assert np.isfinite(again).all()
    assert again[-1, -1] <= 1.000001 * gram[-1, -1]
    gain = linear._vector_gain("alike", off[1:4, 1:4], off[1:4, -1], float(gram[1, 1]))
    assert gain.log_evidence < 10.0
