"""A linearised model says by algebra what refits and dense covariances say."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from jaxmodel.fit.data import PIECES, FitData
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.linearisation import Gram, Linearisation, inverse, log_evidence, solved

NAMES = ("voltage_V", "soc", "cell_temperature_degC")
ROWS, RUNS, SIZE = 40, 2, 5
PRECISION = np.array([1.0, 4.0, 0.25, 1.0, 100.0])
WEIGHTS = Likelihood({"voltage_V": ChannelWeight(0.5, 2.0, 80), "cell_temperature_degC": ChannelWeight(2.0, 1.0, 80)})


@dataclasses.dataclass(frozen=True)
class Made:
    """Two channels in two runs, linear in some unknowns; the second channel of the kind is not measured."""

    data: FitData
    jacobian: np.ndarray
    target: np.ndarray
    linear: Linearisation

    @property
    def white(self) -> tuple[np.ndarray, np.ndarray]:
        """Return jacobian and target in the errors' sd."""
        root = WEIGHTS.roots(self.data)
        return root[:, None] * self.jacobian, root * self.target


@pytest.fixture(scope="module")
def made() -> Made:
    rng = np.random.default_rng(0)
    number = np.arange(2 * RUNS * ROWS)
    channel, run, row = np.where(number < RUNS * ROWS, 0, 2), (number // ROWS) % RUNS, number % ROWS
    chains = tuple(
        ((NAMES[2 * k], r), slice((k * RUNS + r) * ROWS, (k * RUNS + r + 1) * ROWS)) for k in (0, 1) for r in (0, 1)
    )
    data = FitData(0.0 * number, run, row, channel, 10.0 * row, np.full(number.size, 0.1), chains)
    jacobian = rng.standard_normal((number.size, SIZE)) * np.array([2.0, 1.0, 0.1, 1.0, 1.0])
    jacobian[:, 3] *= run == 1
    x = rng.standard_normal(SIZE)
    errors = rng.standard_normal(number.size)
    return Made(data, jacobian, errors + jacobian @ x, Linearisation.of(data, x, errors, jacobian))


def same(one: Gram, square: np.ndarray, aim: np.ndarray, power: float) -> None:
    np.testing.assert_allclose(one.square, square, atol=1e-9)
    np.testing.assert_allclose(one.aim, aim, atol=1e-9)
    assert one.power == pytest.approx(power)


def test_blocks_and_channels_sum_to_the_whole(made: Made):
    white, seen = made.white
    whole = made.linear.under(WEIGHTS)
    same(whole, white.T @ white, white.T @ seen, seen @ seen)
    assert whole.count == made.data.count
    blocks = made.linear.block_grams(WEIGHTS).values()
    same(
        whole,
        np.sum([one.square for one in blocks], axis=0),
        np.sum([one.aim for one in blocks], axis=0),
        sum(one.power for one in blocks),
    )
    assert made.linear.names == ["voltage_V", "cell_temperature_degC"]
    for name, gram in made.linear.by_channel.items():
        mine = made.data.channel == NAMES.index(name)
        same(gram, made.jacobian[mine].T @ made.jacobian[mine], made.jacobian[mine].T @ made.target[mine],
             made.target[mine] @ made.target[mine])  # fmt: skip


def test_blocks_are_pieces_of_runs(made: Made):
    assert len(made.linear.blocks) == RUNS * PIECES
    assert set(made.linear.runs.values()) == {0, 1}
    for number, block in made.linear.blocks.items():
        mine = made.data.block == number
        assert {made.linear.runs[number]} == set(made.data.run[mine])
        assert sum(one.count for one in block.values()) == mine.sum()


def test_a_block_that_counts_once_is_as_without_shares(made: Made):
    whole = made.linear.under(WEIGHTS)
    once = made.linear.resampled(WEIGHTS, np.ones((1, len(made.linear.blocks))))[0]
    same(once, whole.square, whole.aim, whole.power)


def test_a_block_counts_as_often_as_its_share_says(made: Made):
    shares = np.random.default_rng(1).integers(0, 4, len(made.linear.blocks))
    white, seen = made.white
    of_block = dict(zip(made.linear.blocks, shares, strict=True))
    often = np.array([of_block[number] for number in made.data.block])
    (found,) = made.linear.resampled(WEIGHTS, shares[None])
    same(found, (often * white.T) @ white, (often * white.T) @ seen, often @ seen**2)


def test_the_best_point_is_that_of_least_squares_with_priors(made: Made):
    white, seen = made.white
    rows = np.concatenate([white, np.diag(np.sqrt(PRECISION))])
    expected = np.linalg.lstsq(rows, np.concatenate([seen, np.zeros(SIZE)]), rcond=None)[0]
    whole = made.linear.under(WEIGHTS)
    np.testing.assert_allclose(solved(whole.square, whole.aim, PRECISION), expected, atol=1e-10)


def test_evidence_is_the_probability_of_all_readings(made: Made):
    white, seen = made.white
    marginal = multivariate_normal(np.zeros(seen.size), np.eye(seen.size) + (white / PRECISION) @ white.T)
    expected = marginal.logpdf(seen) + 0.5 * seen.size * np.log(2.0 * np.pi)
    assert log_evidence(made.linear.under(WEIGHTS), PRECISION) == pytest.approx(expected)


def test_an_unknown_that_is_held_by_its_prior_costs_no_evidence(made: Made):
    whole = made.linear.under(WEIGHTS)
    fewer = Gram(whole.square[:-1, :-1], whole.aim[:-1], whole.power, whole.count)
    held = np.append(PRECISION[:-1], 1e12)
    assert log_evidence(whole, held) == pytest.approx(log_evidence(fewer, PRECISION[:-1]), abs=1e-6)


def test_errors_of_left_out_blocks_are_those_of_refits(made: Made):
    white, seen = made.white
    block = made.data.block
    squares = np.zeros(made.data.count)
    for number in np.unique(block):
        kept = block != number
        x = np.linalg.solve(white[kept].T @ white[kept] + np.diag(PRECISION), white[kept].T @ seen[kept])
        squares[~kept] = (made.target[~kept] - made.jacobian[~kept] @ x) ** 2
    found = made.linear.left_out(WEIGHTS, PRECISION)
    for name in ("voltage_V", "cell_temperature_degC"):
        assert found[name] == pytest.approx(np.mean(squares[made.data.channel == NAMES.index(name)]))


def test_the_covariance_is_the_inverse_and_is_there_where_rounding_leaves_nothing(made: Made):
    whole = made.linear.under(WEIGHTS)
    expected = np.linalg.inv(whole.square + np.diag(PRECISION))
    np.testing.assert_allclose(inverse(whole.square, PRECISION), expected, rtol=1e-6, atol=1e-12)
    alike = np.full((2, 2), 1e18)  # of two unknowns that do the same
    assert np.isfinite(inverse(alike, np.ones(2))).all()
