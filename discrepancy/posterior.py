"""Probabilities of the hypotheses: base, each effect, each pair, and something else (step 8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import comb

import numpy as np

from discrepancy.candidates import Candidate
from discrepancy.hypothesis import Hypothesis, Labels
from discrepancy.misfit import Block
from discrepancy.screen import Screen

SOMETHING_ELSE = "something_else"

# Before any data: nothing missing, one effect, two, three (sought only far from the noise); and beside whichever of
# these it is, something in no catalogue. Assumed, as in a mixed set of benches; the shares are spread evenly over the
# effects of the kind and over their sets.
PRIOR = {0: 0.35, 1: 0.5, 2: 0.12, 3: 0.03}
PRIOR_SOMETHING_ELSE = 0.1
# Nothing is printed as surer than this.
MOST = 0.99
# Places of a standard normal, and the logs of its shares there.
_PLACES = np.linspace(-4.0, 4.0, 161)
_LOG_SHARES = -0.5 * _PLACES**2 - np.log(np.sum(np.exp(-0.5 * _PLACES**2)))


def hypothesis_name(labels: Labels) -> str:
    """Return the name of a hypothesis in the answer: 'base', 'a' or 'a+b', effects without their columns."""
    return "+".join(label.split(":")[0] for label in labels) if labels else "base"


def probabilities(
    known: Sequence[Hypothesis],
    best: Hypothesis,
    left: Mapping[Labels, Sequence[Block]],
    candidates: Mapping[str, Candidate],
    unfitted: Mapping[Labels, float] | None = None,
) -> tuple[dict[str, float], Labels]:
    """Return the probability of every hypothesis fitted and of something else, largest first, and beside what that is.

    Something else is one of the models of `left` with the strongest smooth unknown law of each channel beside it. A law
    pays for its free numbers as in the Bayesian information criterion and for having been chosen among all laws. The
    labels returned are those of the model that such laws stand beside best.

    Args:
        known: all hypotheses fitted.
        best: the one with the best evidence.
        left: deficiency maps, strongest block first, by the labels of the model they were made at; `best` among them.
        candidates: all that could be missing, by label.
        unfitted: of models that were not fitted, their log evidence as far as it is known.
    """
    count = len(candidates)
    number_of = {size: comb(count, size) for size in PRIOR}
    # The noise sd is known to some percent; where the best model leaves more or less than one, odds are scaled by what
    # it leaves.
    readings = float(np.sum(np.asarray(best.problem.readings.fit)))
    temperature = max(1.0, best.fitted.chi2 / readings) if not _wrong(left[best.labels]) else 1.0
    evidence = dict(unfitted or {}) | {one.labels: one.log_evidence for one in known}
    logs: dict[str, float] = {}
    beside: dict[Labels, float] = {}
    # The most that any law can explain of a model: down to what the best one leaves beside a law, or the noise.
    least = min(readings, best.fitted.chi2 - 2.0 * max(0.0, _gain(left[best.labels], readings)))
    chi2 = {one.labels: one.fitted.chi2 for one in known}
    for labels, log_evidence in evidence.items():
        size = len(labels)
        log = log_evidence / temperature + np.log(PRIOR[size] / max(1, number_of[size]))
        name = hypothesis_name(labels)
        logs[name] = max(logs.get(name, -np.inf), log)
        if labels in left:
            most = np.inf if labels == best.labels else 0.5 * (chi2[labels] - least)
            beside[labels] = log + _gain(left[labels], readings, most)
    basis = max(beside, key=lambda labels: beside[labels])
    logs[SOMETHING_ELSE] = beside[basis] + np.log(PRIOR_SOMETHING_ELSE / (1.0 - PRIOR_SOMETHING_ELSE))
    values = np.array(list(logs.values()))
    weights = np.exp(values - values.max())
    weights = np.minimum(weights / weights.sum(), MOST)
    return dict(sorted(zip(logs, weights.tolist(), strict=True), key=lambda pair: -pair[1])), basis


def bayes_factors(screened: Screen, candidates: Mapping[str, Candidate]) -> dict[str, float]:
    """Return the log of each candidate's Bayes factor over the model it was screened at, in the linear approximation.

    At an amplitude of a probes, readings with the score z and |P| sigma per probe are exp(z |P| a - (|P| a)^2/2) times
    as probable; the mean of that is taken over the prior of the amplitude, and over the probes. What the data cannot
    see has a factor of one: it is as probable as before.
    """
    projection = screened.table.projection
    found = {}
    for label, probes in screened.probes.items():
        logs = []
        blocks = [block for block in projection.blocks if block.candidate == label]
        for block, probe in zip(blocks, probes, strict=True):
            z, lift = 0.0, block.projected_length(1.0)
            if block.dof:
                z = float(projection.scores(block)[0] * np.sign(block.triangle[0, 0]))
            logs.append(_mean_odds(z, lift, candidates[label], probe[0]))
        found[label] = float(np.logaddexp.reduce(logs)) - float(np.log(len(logs)))
    return found


def _mean_odds(z: float, lift: float, candidate: Candidate, probe: float) -> float:
    """Return the log of the mean of exp(z s - s^2/2) over the prior of s, the sigmas by which the effect lifts."""
    if candidate.amplitude_on_grid:
        sigmas = np.full(_PLACES.size, lift)  # each probe is an amplitude of its own
    elif candidate.has_amplitude and not candidate.coordinates[0].logarithmic:
        spread = (lift * candidate.times_as_strong(np.ones(1), probe)[0]) ** 2
        return float(0.5 * z**2 * spread / (1.0 + spread) - 0.5 * np.log1p(spread))
    else:
        sigmas = lift * candidate.times_as_strong(_PLACES, probe)
    return float(np.logaddexp.reduce(z * sigmas - 0.5 * sigmas**2 + _LOG_SHARES))


def _gain(blocks: Sequence[Block], readings: float, most: float = np.inf) -> float:
    """Return what unknown laws add to a model's log evidence: one in an equation, or one for each channel in need.

    Together they explain no more than `most`: channels' laws share what the model's own unknowns could take.
    """
    gains: dict[str, tuple[float, float]] = {}
    in_equation = -np.inf
    for block in blocks:
        # In no unit may a law explain more than there was: where the noise is overstated its own scatter says too much.
        explained = 0.5 * min(block.chi2, block.drop)
        price = 0.5 * block.rank * np.log(readings) + np.log(len(blocks))
        if block.in_equation:
            in_equation = max(in_equation, min(explained, most) - price)
        else:
            one = (explained, price)
            gains[block.channel] = max(gains.get(block.channel, one), one, key=lambda each: each[0] - each[1])
    needed = [one for one in gains.values() if one[0] > one[1]]
    if not needed:
        return max(in_equation, max((one[0] - one[1] for one in gains.values()), default=0.0))
    explained, price = np.sum(needed, axis=0)
    return max(in_equation, min(float(explained), most) - float(price))


def _wrong(left: Sequence[Block]) -> bool:
    return any(block.significant for block in left)
