"""Expected gains of candidates against dense formulas: readings with weights, unknowns with priors."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
import pytest

from jaxmodel.case.records import Case
from jaxmodel.effects.battery import CapacityFade, EntropicOcv
from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.coordinates import Coordinate
from jaxmodel.fit.data import FitData
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.linearisation import Linearisation
from jaxmodel.fit.scores import AMPLITUDES, Scores
from jaxmodel.fit.screen import Direction, Screen
from jaxmodel.fit.space import ModelSpec, View
from tests.diagnosis.made_cases import cache_of

PRIOR_SD = np.array([1.0, 0.5, 2.0])
IS_COMMON = np.array([True, True, False])


def unit(label: str, group: str = "effect", **more) -> Candidate:
    """A candidate with an amplitude of unit normal prior at its probe."""
    return Candidate(label, group, EntropicOcv(), (Coordinate(label, 0.0, 1.0),), ((1.0,),), **more)


def curve(label: str, count: int) -> Candidate:
    coordinates = tuple(Coordinate(f"{label}[{place}]", 0.0, 1.0) for place in range(count))
    return Candidate(label, "curve", EntropicOcv(), coordinates, is_vector=True)


@dataclasses.dataclass(frozen=True)
class Given:
    """A linear model: measured = base x + ways + errors of the variance."""

    data: FitData
    scores: Scores
    fit: Fit
    screened: Screen
    base: np.ndarray
    variance: np.ndarray
    ways: dict[str, np.ndarray]

    def log_probability(self, more: np.ndarray | None = None) -> float:
        """Of what is measured, with directions of unit prior beside the base model's own."""
        columns = self.base * PRIOR_SD
        if more is not None:
            columns = np.concatenate([columns, more], axis=1)
        dense = np.diag(self.variance) + columns @ columns.T
        measured = self.fit.errors + self.base @ self.fit.free  # residual of the base model at x = 0
        return float(-0.5 * measured @ np.linalg.solve(dense, measured) - 0.5 * np.linalg.slogdet(dense)[1])


@pytest.fixture(scope="module")
def given(small_view: View) -> Given:
    """Some readings of a case, for their weights; all else is random."""
    rng, data = np.random.default_rng(0), small_view.data
    weights = Likelihood({name: ChannelWeight(0.01 * n, 2.0 * n, 300) for n, name in enumerate(data.by_channel, 1)})
    variance = weights.roots(data) ** -2.0
    sd = np.sqrt(variance)
    base = sd[:, None] * rng.standard_normal((data.count, 3)) * np.array([0.3, 0.1, 1e-3])
    ways = {
        "strong": sd[:, None] * rng.standard_normal((data.count, 1)) * 0.5,
        "weak": sd[:, None] * rng.standard_normal((data.count, 1)) * 0.01,
        "inside": base[:, :2] @ np.array([[1.0], [-2.0]]),
        "alias": base[:, :1] * 0.4 + 1e-4 * sd[:, None] * rng.standard_normal((data.count, 1)),
        "one run": sd[:, None] * np.where(data.run == 1, 0.2, 0.0)[:, None],
        "curve": sd[:, None] * rng.standard_normal((data.count, 4)) * 0.1,
    }
    measured = base @ (0.5 * rng.standard_normal(3)) + 0.4 * ways["strong"][:, 0] + sd * rng.standard_normal(data.count)
    # The base model calibrated, as every model is that is screened.
    information = (base.T / variance) @ base + np.diag(PRIOR_SD**-2.0)
    x = np.linalg.solve(information, (base.T / variance) @ measured)
    errors = measured - base @ x
    candidates = {label: unit(label) for label in ("strong", "weak", "inside", "alias")}
    candidates |= {"one run": unit("one run", "run", run=1), "curve": curve("curve", 4)}
    spec = ModelSpec((), {}, {}, (0, 1, 2), PRIOR_SD**-2.0, np.zeros(0), np.zeros((0, 0)), False)
    directions = tuple(
        Direction(label, () if candidates[label].is_vector else (1.0,), columns) for label, columns in ways.items()
    )
    screened = Screen(spec, x, errors, base, directions)
    fit = Fit(spec, (), x, errors, weights, Linearisation.of(data, x, errors, base), 0.0, 0.0)
    scores = Scores(screened, data, fit, candidates, IS_COMMON)
    return Given(data, scores, fit, screened, base, variance, ways)


def test_gains_are_those_of_the_dense_formula(given: Given):
    found = {gain.label: gain for gain in given.scores.gains()}
    without = given.log_probability()
    for label in ("strong", "weak", "one run"):
        expected = given.log_probability(given.ways[label]) - without
        assert found[label].log_evidence == pytest.approx(expected, abs=1e-6), label
    gains = [given.log_probability(a * given.ways["curve"]) - without for a in AMPLITUDES]
    assert found["curve"].log_evidence == pytest.approx(max(gains), abs=1e-6)
    assert found["curve"].amplitude == AMPLITUDES[int(np.argmax(gains))]
    assert given.scores.gains()[0].label == "strong"


def refitted(given: Given) -> tuple[np.ndarray, np.ndarray]:
    """The base model with the strong candidate, with no prior of its amplitude; also their covariance."""
    both = np.concatenate([given.base, given.ways["strong"]], axis=1)
    measured = given.fit.errors + given.base @ given.fit.free
    information = (both.T / given.variance) @ both + np.diag(np.append(PRIOR_SD**-2.0, 0.0))
    return np.linalg.solve(information, (both.T / given.variance) @ measured), np.linalg.inv(information)


def test_amplitude_score_and_base_step_are_those_of_a_refit(given: Given):
    x, covariance = refitted(given)
    gain = next(gain for gain in given.scores.gains() if gain.label == "strong")
    assert gain.start[0] == pytest.approx(x[-1])
    np.testing.assert_allclose(given.fit.free + gain.base_step, x[:-1], atol=1e-8)
    assert gain.z == pytest.approx(x[-1] / np.sqrt(covariance[-1, -1]))
    assert gain.chi2 == pytest.approx(gain.z**2)


def test_errors_with_a_candidate_are_those_of_a_refit(given: Given):
    x, _ = refitted(given)
    measured = given.fit.errors + given.base @ given.fit.free
    expected = measured - np.concatenate([given.base, given.ways["strong"]], axis=1) @ x
    np.testing.assert_allclose(given.scores.left_with("strong"), expected, atol=1e-8)
    assert given.scores.left_with("inside") is None


def test_gains_of_a_channel_are_those_without_the_others(given: Given):
    """As if the readings of all other channels had no error and no sensitivity."""
    channel = given.data.channel
    for one, found in zip(np.unique(channel), given.scores.gains_by_channel(), strict=True):
        mine = (channel == one)[:, None]
        directions = tuple(dataclasses.replace(way, columns=way.columns * mine) for way in given.scores.directions)
        screened = dataclasses.replace(
            given.screened, errors=given.fit.errors * mine[:, 0], base=given.base * mine, directions=directions
        )
        alone = Scores(screened, given.data, given.fit, given.scores.candidates, IS_COMMON).gains()
        expected = {gain.label: gain.log_evidence for gain in alone}
        by_label = {gain.label: gain.log_evidence for gain in found}
        for label in ("strong", "weak", "one run", "curve"):
            assert by_label[label] == pytest.approx(expected[label], abs=1e-6), label


def test_a_channel_without_weight_says_nothing(given: Given):
    channels = dict(given.fit.likelihood.channels)
    channels["voltage_V"] = dataclasses.replace(channels["voltage_V"], sd=1e6)
    scores = Scores(given.screened, given.data, given.fit, given.scores.candidates, IS_COMMON, Likelihood(channels))
    found = {gain.label: gain.log_evidence for gain in scores.gains()}
    by_channel = dict(zip(given.data.by_channel, given.scores.gains_by_channel(), strict=True))
    expected = {gain.label: gain.log_evidence for gain in by_channel["cell_temperature_degC"]}
    for label in ("strong", "weak", "one run", "curve"):
        assert found[label] == pytest.approx(expected[label], abs=1e-3), label


def test_what_the_base_model_can_imitate_is_no_effect(given: Given):
    """In its span, or all but in it where a number of all runs may be stated wrongly."""
    labels = {gain.label for gain in given.scores.gains()}
    assert labels == {"strong", "weak", "one run", "curve"}


def test_scores_beyond_the_critical_one_are_rare_by_chance(given: Given):
    """As the largest of a few normal draws."""
    assert 1.9 < given.scores.critical_z() < 2.6
    assert given.scores.critical_z() == given.scores.critical_z()


def test_detectable_candidates_are_listed(given: Given):
    seen = given.scores.visible()
    assert "strong" in seen
    assert "weak" not in seen


class Fade(CapacityFade):
    """A user's effect that declares no parameter to distinguish it from another capacity."""

    name: ClassVar[str] = "fade"
    distinguished_by: ClassVar[str] = ""


def test_an_effect_that_imitates_a_parameter_of_all_runs_is_excluded(small: Case) -> None:
    """A capacity that fades with cycles is another capacity where all runs have one cycle count."""
    cache = cache_of(dataclasses.replace(small, own_effects={"fade": Fade}), "fade", "self_heating")
    scores = cache.scores(())
    assert {way.label for way in scores.directions} == {"fade", "self_heating"}
    gains = {gain.label: gain for gain in scores.gains()}
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
    scores = object.__new__(Scores)
    off = scores._off(gram, slice(0, 1), np.ones(1))
    again = scores._off(off, slice(1, 4), np.full(3, 1e-2))
    assert np.isfinite(again).all()
    assert again[-1, -1] <= 1.000001 * gram[-1, -1]
    gain = scores._vector_gain("alike", off[1:4, 1:4], off[1:4, -1], float(gram[1, 1]))
    assert gain.log_evidence < 10.0


def test_gain_where_weights_follow_the_errors(given: Given):
    """By hand, from the errors that are left: n/2 log(Q / Q') of each channel, in place of the drop of chi-square."""
    reweighed = given.scores.gains_reweighed()
    assert list(reweighed.values()) == sorted(reweighed.values(), reverse=True)
    gains = {one.label: one for one in given.scores.gains()}
    roots = given.fit.likelihood.roots(given.data)
    for label in ("strong", "weak", "one run"):
        gain = gains[label]
        left = given.fit.errors - given.base @ gain.base_step - given.ways[label] @ gain.step
        expected = gain.log_evidence - 0.5 * gain.chi2
        for channel in np.unique(given.data.channel):
            rows = given.data.channel == channel
            before, after = (float(np.sum((roots * errors)[rows] ** 2)) for errors in (given.fit.errors, left))
            floor = float(np.sum((roots * given.data.sd)[rows] ** 2))
            if before > floor:
                expected += 0.5 * before * np.log(before / max(after, floor))
        assert reweighed[label] == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert next(iter(reweighed)) == "strong"
