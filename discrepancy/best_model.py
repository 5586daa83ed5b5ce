"""The best model of a case under its sensors' noise; where none comes near that, under what the best one leaves."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import jax
import numpy as np

from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import predict
from discrepancy.leftover import leftover_laws
from discrepancy.misfit import Block
from discrepancy.search import Progress, another, search, strongest, tell
from discrepancy.session import Session

# A channel whose residual is this many times its sensor's noise is not explained by any means.
FAR_FROM_FLOOR = 3.0
# Where the base model leaves this many times the noise, weights by the noise would let one fine sensor decide alone.
HOPELESS = 15.0


@dataclasses.dataclass(frozen=True)
class BestModel:
    """The best model.

    Attributes:
        session: in which it is fitted.
        best: the model.
        far: channels whose noise no model comes near.
        evidence: the session in which effects were weighed against each other, where it is another.
    """

    session: Session
    best: Hypothesis
    far: tuple[str, ...] = ()
    evidence: Session | None = None

    @property
    def judge(self) -> Session:
        """Return the session in which effects were weighed against each other; the best model is known to it."""
        return self.evidence or self.session

    @functools.cached_property
    def laws(self) -> list[Block]:
        """What could explain what it leaves."""
        return leftover_laws(self.session, self.best, self.session.screen(self.best))


def find_best_model(session: Session, progress: Progress | None, wanted: Sequence[str]) -> BestModel:
    """Search for the best model under the sensors' noise, or, where none comes near it, for what explains most."""
    tell(progress, "calibrating the base model")
    seeds: list[Hypothesis] = []
    hopeless = bool(_beyond(session, session.hypothesis(), HOPELESS))
    if not hopeless:
        session = session.with_noise_left_by(session.hypothesis()) or session
    if wanted:
        best = _fitted(session, progress, wanted)
    elif hopeless:
        tell(progress, "the base model is far from the sensors' noise; looking for what explains most")
        coarse = _explaining_most(session, session.hypothesis(), progress)
        if coarse.far and _far_beside_any_law(coarse):
            return coarse
        seeds = strongest(coarse.judge)
        best = search(session, progress, seeds=seeds)
    else:
        best = search(session, progress)
    finer = _with_noise_beside(session, best)
    if finer is not None:
        seeds, session = strongest(session), finer
        best = _fitted(session, progress, wanted) if wanted else search(session, progress, seeds=seeds)
    if wanted:
        return BestModel(session, best)
    if not session.screen(session.hypothesis()).table.significant:
        best = session.hypothesis()
    found = BestModel(session, best)
    if not _far_beside_any_law(found):
        return found
    coarse = _explaining_most(session, best, progress)
    return coarse if coarse.far else BestModel(session, search(session, progress, seeds=strongest(coarse.judge)))


def _with_noise_beside(session: Session, best: Hypothesis) -> Session | None:
    """Return a session with the noise that the best model leaves and passes on; None where that is assumed."""
    left = session.with_noise_left_by(best)
    return (left or session).with_noise_of_inputs(best) or left


def _explaining_most(session: Session, best: Hypothesis, progress: Progress | None) -> BestModel:
    """Search by what models leave in place of noise: first by its size in each channel, then by its memory too.

    What the base model leaves is no measure of memory: it may be one effect's, from end to end.
    """
    coarse = session.reweighted(best)
    single = search(coarse, progress, effects=1)
    if not _beyond(coarse, single, FAR_FROM_FLOOR):
        return BestModel(coarse, single)
    by_time = coarse.reweighted(single, by_time=True)
    best = search(by_time, progress, seeds=strongest(coarse))
    far = tuple(_beyond(by_time, best, FAR_FROM_FLOOR))
    if not far:
        return BestModel(by_time, best)
    best = another(by_time, progress, best)
    # What to add is told by time; the numbers are those that come nearest to all readings.
    fitted = coarse.reweighted(single)
    return BestModel(fitted, fitted.hypothesis(best.labels, [best.start]), far, by_time)


def _far_beside_any_law(found: BestModel) -> bool:
    """Return True where the best model leaves far more than noise in a channel, and so does any law beside it."""
    far = _beyond(found.session, found.best, FAR_FROM_FLOOR)
    if not far:
        return False
    weights, noise = found.session.weights, found.session.noise
    plainer = _plain_over_whitened(found.best)

    def left(name: str) -> float:
        number = found.best.problem.channels.index(name)
        least = min((law.leaves[number] for law in found.laws if number in law.leaves), default=np.inf)
        return least * plainer[number] * weights[name].sd / noise[name].sd

    return any(left(name) > FAR_FROM_FLOOR for name in far)


def _plain_over_whitened(model: Hypothesis) -> dict[int, float]:
    """Return how many times larger a model's errors are before they are whitened, by number of each channel read.

    Of noise it is one. Coloured noise forgives slow errors, and those of a wrong model are slow: they are taken for it.
    """
    problem = model.problem
    readings = jax.tree.map(np.asarray, problem.readings)
    predicted = predict(problem, model.fitted.x).reshape(-1)[readings.index]
    plain = (readings.value - predicted) / readings.sd
    white = readings.without_colour(plain)
    channel = np.where(readings.fit > 0.0, readings.index % len(problem.channels), -1)
    return {
        int(one): float(np.linalg.norm(plain[channel == one]) / np.linalg.norm(white[channel == one]))
        for one in np.unique(channel[channel >= 0])
    }


def _beyond(session: Session, hypothesis: Hypothesis, times: float) -> list[str]:
    """Return the channels in which a model leaves more than so many times their sensors' noise."""
    errors = session.rung("", hypothesis).errors
    return [name for name, model in session.noise.items() if errors[name].fit > times * model.sd]


def _fitted(session: Session, progress: Progress | None, labels: Sequence[str]) -> Hypothesis:
    """Return the model with the effects that the user wants."""
    first = session.screen(session.hypothesis())
    tell(progress, f"fitting {', '.join(labels)}")
    starts = [session.starts(first, label) for label in labels]
    tries = [{label: x for own in starts for label, x in own[min(number, len(own) - 1)].items()} for number in range(2)]
    return session.hypothesis(labels, tries)
