"""The criteria that a refitted candidate must meet to be added to the model."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from jaxmodel.diagnosis.evidence.left_out import expected_gain
from jaxmodel.diagnosis.evidence.linear import Gain
from jaxmodel.diagnosis.evidence.trial import Trial
from jaxmodel.diagnosis.fitting.candidates import Candidate
from jaxmodel.diagnosis.settings import Settings
from jaxmodel.diagnosis.workings import Workings


@dataclasses.dataclass(frozen=True)
class Addition:
    """A refitted candidate and the results of the criteria.

    Attributes:
        label: the candidate.
        trial: the model with it.
        gain: gain of log evidence over the model without it.
        odds: log odds that the gain must exceed.
        score_gain: gain of log score on left-out data.
        expected_score_gain: the same if the candidate is true.
        material: it reduces the error of a channel by enough.
        harmful: it increases the error on left-out data.
        plausible: its size is physically usual.
        obvious: it removes most of one channel's error on left-out data.
        share_left: product over channels of the share of the error that it leaves on left-out data.
    """

    label: str
    trial: Trial
    gain: float
    odds: float
    score_gain: float
    expected_score_gain: float
    material: bool = True
    harmful: bool = False
    plausible: bool = True
    obvious: bool = False
    share_left: float = 1.0

    @property
    def significant(self) -> bool:
        """Return True if its evidence exceeds the odds against so many candidates."""
        return self.gain > self.odds

    @property
    def merit(self) -> float:
        """Return the rank of additions that pass: gain of evidence plus gain of log score on left-out data."""
        return self.gain + max(self.score_gain, 0.0)

    def predicts_better(self, least_expected_score: float) -> bool:
        """Return True if it improves the prediction of left-out data, or these could not show it."""
        return self.score_gain > 0.0 or self.expected_score_gain < least_expected_score


def addition(inv: Workings, model: Trial, gain: Gain) -> Addition:
    """Return one addition, refitted under the model's weights, with the results of the criteria."""
    candidate = inv.space.candidates[gain.label]
    trial = inv.trial((*model.labels, gain.label), model, gain)
    if candidate.is_vector:
        trial = inv.at_its_best(trial)
    score_gain, expected_score_gain = score_gains(inv, trial, model)
    gained = trial.log_evidence - model.log_evidence
    material, harmful = is_material(inv, trial, model), harms(inv, trial, model)
    plausible, obvious = is_plausible(inv, trial, gain.label), is_obvious(inv, trial, model)
    # For the first addition the odds are even: with less evidence the verdict is undecided, not adequate.
    odds = odds_of(inv, candidate, model) - (0.0 if model.labels else inv.settings.least_odds)
    return Addition(
        gain.label,
        trial,
        gained,
        odds,
        score_gain,
        expected_score_gain,
        material,
        harmful,
        plausible,
        obvious,
        share_left(inv, trial, model),
    )


def odds_of(inv: Workings, candidate: Candidate, model: Trial) -> float:
    """Return the log odds that the gain of a candidate must exceed, more if the form of a model error is assumed."""
    penalty = inv.settings.odds_beside_model_error if model.scale.error.sd else 0.0
    return prior_odds(candidate, inv.space.candidates.values(), inv.settings) + penalty


def prior_odds(candidate: Candidate, candidates: Iterable[Candidate], settings: Settings) -> float:
    """Return the log odds against a candidate before the data; they grow with the number of similar candidates.

    Args:
        candidate: one of the candidates.
        candidates: all that compete; a rare one counts for its share.
        settings: the constants.
    """
    group = ("effect", "sensor") if candidate.group in ("effect", "sensor") else (candidate.group,)
    similar = sum(np.exp(-settings.rare_odds * one.effect.rare) for one in candidates if one.group in group)
    return settings.least_odds + float(np.log(max(1.0, similar))) + settings.rare_odds * candidate.effect.rare


def passes(inv: Workings, addition: Addition) -> bool:
    """Return True if an addition meets all criteria."""
    score_gains = addition.predicts_better(inv.settings.least_expected_score) and not addition.harmful
    return addition.significant and score_gains and addition.material and addition.plausible


def in_order(inv: Workings, some: Sequence[Addition]) -> list[Addition]:
    """Return additions in the order in which they are tried: obvious ones first, then by merit.

    Of obvious ones, those that leave much more of the error than the best of them come later: a constant offset of a
    thermometer may have the evidence of a cell that warms, and leaves twice its error.
    """
    least = min((one.share_left for one in some if one.obvious), default=0.0)

    def rank(one: Addition) -> tuple[bool, bool, float]:
        return not one.obvious, one.obvious and one.share_left > inv.settings.obvious_lead * least, -one.merit

    return sorted(some, key=rank)


def is_material(inv: Workings, trial: Trial, lacking: Trial) -> bool:
    """Return True if an addition reduces the error of a channel by enough, as the root of the removed mean square.

    Enough is a tenth of a stated tolerance on fitted data or, without a tolerance, a share of the error above noise on
    left-out data: of the error of all runs, or of its geometric mean over runs. In that mean an effect counts that
    takes most of the error of some runs, although others have a larger error with another cause. Errors of a voltage
    count as they are or divided by their steepness: otherwise the last minutes of a discharge outweigh all else, and no
    effect is material unless it acts there.
    """
    return _removes_enough(inv, trial, lacking, level=False) or _removes_enough(inv, trial, lacking, level=True)


def _removes_enough(inv: Workings, trial: Trial, lacking: Trial, level: bool) -> bool:
    settings, stated = inv.settings, inv.case.tolerance
    share = settings.least_share if len(lacking.labels) < 2 else settings.later_share
    before, after = left_out_error_of_runs(inv, lacking, level), left_out_error_of_runs(inv, trial, level)
    pooled_before, pooled_after = left_out_error(inv, lacking, level), left_out_error(inv, trial, level)
    scale = trial.scale.view.readings.steepness if level else 1.0
    fitted = (inv.errors_of(lacking) ** 2 - inv.errors_of(trial) ** 2) / scale**2 if stated else np.zeros(0)
    least = settings.negligible_share**2
    for place, channel in enumerate(inv.space.coarse.channels):
        if channel in stated and channel in before:
            removed = float(np.mean(fitted[trial.scale.view.readings.channel == place]))
            if removed >= (settings.material_share * stated[channel].rms) ** 2:
                return True
        elif channel in before:
            pooled = pooled_before[channel] - pooled_after[channel] > share * max(pooled_before[channel], 0.0)
            left = np.exp(np.mean(np.log((after[channel] + least) / (before[channel] + least))))
            if pooled or left < 1.0 - share:
                return True
    return False


def is_obvious(inv: Workings, trial: Trial, lacking: Trial) -> bool:
    """Return True if an addition removes most of one channel's error on left-out data."""
    return bool(np.any(_error_on_left_out(inv, trial) < inv.settings.obvious * _error_on_left_out(inv, lacking)))


def harms(inv: Workings, trial: Trial, lacking: Trial) -> bool:
    """Return True if an addition increases the error on left-out data, in units of tolerances.

    One channel may get worse if all channels together improve: if a cell warms in the model too, its resistances
    change.
    """
    before, after = _error_on_left_out(inv, lacking), _error_on_left_out(inv, trial)
    together, most = share_left(inv, trial, lacking), 1.0 + inv.settings.largest_increase
    return together > most or (together > 1.0 and bool(np.any(after > most * before)))


def share_left(inv: Workings, trial: Trial, lacking: Trial) -> float:
    """Return the product over channels of the remaining share of the error on left-out data.

    A product, so that a large improvement in one channel counts however large the error of another is.
    """
    return float(np.prod(_error_on_left_out(inv, trial) / _error_on_left_out(inv, lacking)))


def _error_on_left_out(inv: Workings, trial: Trial) -> np.ndarray:
    """Return the error on left-out data by channel, at least a small share of the tolerance."""
    return np.maximum(list(left_out_error(inv, trial).values()), 0.0) + inv.settings.negligible_share**2


def is_plausible(inv: Workings, trial: Trial, label: str) -> bool:
    """Return True if the size of an addition is physically usual; for a curve, the average over modes."""
    x = trial.fitted.x[list(inv.space.layout.of[label])]
    size = np.sqrt(np.mean(x**2)) if inv.space.candidates[label].is_vector else abs(x[0])
    return float(size) <= inv.settings.implausible


def left_out_error(inv: Workings, trial: Trial, level: bool = False) -> dict[str, float]:
    """Return, by channel, the mean square error above noise on left-out data, in units of its tolerance.

    The log score compares the prediction with its own uncertainty; this compares it with the tolerance. It is the
    square of the mean over blocks of their RMS error: in a mean square, one block at the steep end of a discharge would
    outweigh all others.

    Args:
        inv: the investigation.
        trial: the model.
        level: divide errors by their steepness.
    """
    return {
        channel: float(np.average(rms, weights=count)) ** 2
        for channel, (_, rms, count) in _rms_of_blocks(inv, trial, level).items()
    }


def left_out_error_of_runs(inv: Workings, trial: Trial, level: bool = False) -> dict[str, np.ndarray]:
    """Return the same for each run that has the channel, by channel, (runs,)."""
    return {
        channel: (np.bincount(run, rms * count)[np.unique(run)] / np.bincount(run, count)[np.unique(run)]) ** 2
        for channel, (run, rms, count) in _rms_of_blocks(inv, trial, level).items()
    }


def _rms_of_blocks(inv: Workings, trial: Trial, level: bool) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return, by channel, run, RMS error above noise in tolerances, and number of readings of each block."""
    readings, found = trial.scale.view.readings, {}
    beyond, block = inv.cross_validation(trial).errors ** 2 - readings.sd**2, readings.blocks(inv.pieces)
    beyond = beyond / readings.steepness**2 if level else beyond
    for place, channel in enumerate(inv.space.coarse.channels):
        mine = readings.channel == place
        if channel in inv.noise and mine.any():
            numbers, of_reading, count = np.unique(block[mine], return_inverse=True, return_counts=True)
            square = np.bincount(of_reading, beyond[mine]) / count
            rms = np.sqrt(np.maximum(square, 0.0)) / inv.tolerances[channel]
            found[channel] = (numbers // inv.pieces, rms, count)
    return found


def score_gains(inv: Workings, trial: Trial, lacking: Trial) -> tuple[float, float]:
    """Return the gain of log score over another model on left-out data, and its expectation if the model is true.

    Args:
        inv: the investigation.
        trial: the model.
        lacking: the other model, under the same weights.
    """
    own, others = inv.cross_validation(trial), inv.cross_validation(lacking).left_out
    expected_score_gain = expected_gain(trial.fitted, others, own.left_out, own.block)
    return float(np.sum(own.left_out.log_score - others.log_score)), float(np.sum(expected_score_gain))
