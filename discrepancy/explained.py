"""How much of the base model's excess error a model explains, channel by channel, and what follows beside a law."""

from __future__ import annotations

import dataclasses

import numpy as np

from discrepancy.best_model import BestModel
from discrepancy.hypothesis import Hypothesis
from discrepancy.search import THIRD_SHARE, by_strength
from discrepancy.session import Session

# A channel in which the base model leaves less above the noise, in shares of the noise's mean square, does not fail.
FAILS_BY = 0.1


def explained(session: Session, model: Hypothesis) -> float:
    """Return the share of the base model's excess error (mean square above the sensors' noise) that a model removes.

    The mean over the channels in which the base model fails, so that no unit outweighs another.
    """
    shares = shares_left(session, model)
    return 1.0 - float(np.mean(shares)) if shares.size else 0.0


def shares_left(session: Session, model: Hypothesis) -> np.ndarray:
    """Return the share of the base model's excess error that a model leaves in each channel in which that fails."""
    before, after = session.rung("", session.hypothesis()).errors, session.rung("", model).errors
    shares = []
    for name, noise in session.noise.items():
        excess = before[name].fit ** 2 - noise.sd**2
        if excess > FAILS_BY * noise.sd**2:
            shares.append(max(0.0, after[name].fit ** 2 - noise.sd**2) / excess)
    return np.array(shares)


def explains_all_but_little(session: Session, model: Hypothesis) -> bool:
    """Return True where a model's effects leave less than little of the excess error in every channel that has any.

    What a law then adds is the form of these effects, or something too small to be what was asked for.
    """
    shares = shares_left(session, model)
    return bool(model.labels) and shares.size > 0 and float(np.max(shares)) < THIRD_SHARE


def without_small_additions(found: BestModel) -> BestModel:
    """Return the best model without the effects that explain little beside the stronger ones, where a law is left.

    They make up for that law, as an effect of a form other than the catalogue's needs one: with them it is a patchwork.
    """
    session, kept = found.session, []
    shares = shares_left(session, session.hypothesis())
    for label in by_strength(session, found.best):
        then = shares_left(session, session.hypothesis([*kept, label]))
        if not kept or np.max(shares - then, initial=0.0) >= THIRD_SHARE:
            kept, shares = [*kept, label], then
    return dataclasses.replace(found, best=session.hypothesis(kept))
