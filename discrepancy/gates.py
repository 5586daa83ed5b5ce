"""The gates: whether a candidate, refitted, may enter the model."""

from __future__ import annotations

import dataclasses

import numpy as np

from discrepancy.evidence.left_out import expected_gain
from discrepancy.evidence.linear import Gain
from discrepancy.evidence.trial import Trial
from discrepancy.fitting.candidates import Candidate
from discrepancy.workings import Workings


@dataclasses.dataclass(frozen=True)
class Addition:
    """One addition that was refitted, and what the gates say of it.

    Attributes:
        label: the candidate.
        trial: the model with it.
        gain: of log evidence over the model without it.
        odds: log odds that it had to gain.
        paid: log score gained on runs left out.
        expected: what it should gain there if it is true.
        material: it takes enough off a channel's error.
        harmful: runs left out are missed by more with it.
        plausible: it is about as large as physics knows it.
        obvious: it takes most of one channel's error on runs left out.
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

    @property
    def significant(self) -> bool:
        """Return True where its evidence is for it, among so many."""
        return self.gain > self.odds

    @property
    def merit(self) -> float:
        """Return by what additions that pass are ranked: the evidence, and what it pays on runs left out."""
        return self.gain + max(self.score_gain, 0.0)

    def predicts_better(self, least_expected_score: float) -> bool:
        """Return True where runs left out are foretold better with it, or none of them could show it."""
        return self.score_gain > 0.0 or self.expected_score_gain < least_expected_score


def addition(inv: Workings, model: Trial, gain: Gain) -> Addition:
    """Return what the gates say of one addition, refitted under the model's weights."""
    candidate = inv.space.candidates[gain.label]
    trial = inv.trial((*model.labels, gain.label), model, gain)
    if candidate.is_vector:
        trial = inv.at_its_best(trial)
    score_gain, expected_score_gain = score_gains(inv, trial, model)
    gained = trial.log_evidence - model.log_evidence
    material, harmful = is_material(inv, trial, model), harms(inv, trial, model)
    plausible, obvious = is_plausible(inv, trial, gain.label), is_obvious(inv, trial, model)
    # Of a first one the odds are even: below them the answer is undecided, not adequate.
    odds = odds_of(inv, candidate, model) - (0.0 if model.labels else inv.settings.least_odds)
    return Addition(
        gain.label, trial, gained, odds, score_gain, expected_score_gain, material, harmful, plausible, obvious
    )


def odds_of(inv: Workings, candidate: Candidate, model: Trial) -> float:
    """Return the log odds that a candidate must gain beside a model: the fewer are like it, the less."""
    group = ("effect", "sensor") if candidate.group in ("effect", "sensor") else (candidate.group,)
    rare_odds = inv.settings.rare_odds
    alike = sum(np.exp(-rare_odds * _is_rare(one)) for one in inv.space.candidates.values() if one.group in group)
    unsure = inv.settings.odds_beside_model_error if model.scale.error.sd else 0.0
    return inv.settings.least_odds + float(np.log(max(1.0, alike))) + rare_odds * _is_rare(candidate) + unsure


def _is_rare(candidate: Candidate) -> bool:
    """Return True for what benches show more rarely: effects of the further modules of the catalogue."""
    return type(candidate.effect).__module__.rpartition(".")[2].startswith("further")


def passes(inv: Workings, addition: Addition) -> bool:
    """Return True where an addition may enter."""
    score_gains = addition.predicts_better(inv.settings.least_expected_score) and not addition.harmful
    return addition.significant and score_gains and addition.material and addition.plausible


def is_material(inv: Workings, trial: Trial, lacking: Trial) -> bool:
    """Return True where what a model has more takes enough off a channel's error, as the mean square removed.

    Enough is a tenth of a stated tolerance on what is fitted, or without one a share of the error beyond noise on
    what is left out.
    """
    settings, stated = inv.settings, inv.case.tolerance
    before, after = left_out_error(inv, lacking), left_out_error(inv, trial)
    share = settings.least_share if len(lacking.labels) < 2 else settings.later_share
    fitted = inv.errors_of(lacking) ** 2 - inv.errors_of(trial) ** 2 if stated else np.zeros(0)
    for place, channel in enumerate(inv.space.coarse.channels):
        if channel in stated and channel in before:
            removed = float(np.mean(fitted[trial.scale.view.readings.channel == place]))
            if removed >= (settings.material_share * stated[channel].rms) ** 2:
                return True
        elif channel in before and before[channel] > after[channel] + share * max(before[channel], 0.0):
            return True
    return False


def is_obvious(inv: Workings, trial: Trial, lacking: Trial) -> bool:
    """Return True where what a model has more takes most of one channel's error on what is left out."""
    return bool(np.any(_missed(inv, trial) < inv.settings.obvious * _missed(inv, lacking)))


def harms(inv: Workings, trial: Trial, lacking: Trial) -> bool:
    """Return True where what is left out is missed by more with what a model has more, in units of tolerances.

    A channel may lose where all channels together gain: a cell that warms in the model too has other resistances.
    """
    before, after = _missed(inv, lacking), _missed(inv, trial)
    together, most = share_left(inv, trial, lacking), 1.0 + inv.settings.largest_increase
    return together > most or (together > 1.0 and bool(np.any(after > most * before)))


def share_left(inv: Workings, trial: Trial, lacking: Trial) -> float:
    """Return the product over channels of the share of the error on what is left out that remains with an addition.

    A product: what takes most of one channel's error counts, however large that of another still is.
    """
    return float(np.prod(_missed(inv, trial) / _missed(inv, lacking)))


def _missed(inv: Workings, trial: Trial) -> np.ndarray:
    """Return the error on what is left out by channel; what is small beside the tolerance counts as that small."""
    return np.maximum(list(left_out_error(inv, trial).values()), 0.0) + inv.settings.negligible_share**2


def is_plausible(inv: Workings, trial: Trial, label: str) -> bool:
    """Return True where an addition is about as large as physics knows it: of a curve, on the average of modes."""
    x = trial.fitted.x[list(inv.space.layout.of[label])]
    size = np.sqrt(np.mean(x**2)) if inv.space.candidates[label].is_vector else abs(x[0])
    return float(size) <= inv.settings.implausible


def left_out_error(inv: Workings, trial: Trial) -> dict[str, float]:
    """Return, by channel, the mean square error beyond noise on what is left out, in units of its tolerance.

    The log score of what is left out holds what is foretold against what the model knows of it; this holds it
    against what the user can bear. It is the square of the mean over pieces of their root mean square: one piece
    that ends where the cell is empty, and is foretold with another charge, would outweigh all others.
    """
    readings, found = trial.scale.view.readings, {}
    beyond, block = inv.cross_validation(trial).errors ** 2 - readings.sd**2, readings.blocks(inv.pieces)
    for place, channel in enumerate(inv.space.coarse.channels):
        mine = readings.channel == place
        if channel in inv.noise and mine.any():
            count = np.bincount(block[mine])
            of_pieces = np.bincount(block[mine], beyond[mine])[count > 0] / count[count > 0]
            rms = np.average(np.sqrt(np.maximum(of_pieces, 0.0)), weights=count[count > 0])
            found[channel] = float(rms / inv.tolerances[channel]) ** 2
    return found


def score_gains(inv: Workings, trial: Trial, lacking: Trial) -> tuple[float, float]:
    """Return the log score that a model gains over another on what is left out, and what it should if it is true.

    Args:
        inv: the investigation.
        trial: the model.
        lacking: the other, under the same weights.
    """
    own, others = inv.cross_validation(trial), inv.cross_validation(lacking).left_out
    expected_score_gain = expected_gain(trial.fitted, others, own.left_out, own.block)
    return float(np.sum(own.left_out.log_score - others.log_score)), float(np.sum(expected_score_gain))
