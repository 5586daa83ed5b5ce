"""What decides the first lines of a diagnosis: how sure its verdict is, what speaks against it, what to measure next.

It decides on records alone; `opening` says the result in words.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterator, Mapping

import numpy as np

from jaxmodel.base.units import split_unit
from jaxmodel.diagnosis.advice.next_experiment import Proposal
from jaxmodel.diagnosis.comparison import LEAST_SD, WORSE
from jaxmodel.diagnosis.result import ChannelError, Diagnosis, Extrapolated, Immaterial, Removed
from jaxmodel.diagnosis.usual import in_usual_range
from jaxmodel.fit.candidates import specimen_ranges
from jaxmodel.model.declaration import describe

SURE, FAIRLY_SURE = 0.95, 0.8
# A proposed experiment is worth doing from this separation on, in sigma.
WORTH_SIGMA = 1.0


class Grade(enum.Enum):
    """How sure a verdict is."""

    SURE = "sure"
    FAIRLY_SURE = "fairly sure"
    NOT_SURE = "not sure"


class Doubt(enum.Enum):
    """What speaks against a verdict."""

    NO_MINIMUM = "the fit did not reach a minimum"
    UNUSUAL = "a number of an effect is outside its usual range"
    SMALL = "a number of an effect is less than 2 sd from no effect"
    RIVALS = "other effects explain the readings as well"
    ONE_RUN = "one run alone shows the effect"
    WORSE_HELD_OUT = "without the effect the check runs are predicted better"
    NO_CHECK_RUNS = "no run was held out"
    ABOVE_TOLERANCE = "an error is above the tolerance"
    OUTSIDE = "a check run with an error above the tolerance is outside the conditions of the fit runs"


# With one of these an effect is not established.
STRONG = (Doubt.NO_MINIMUM, Doubt.UNUSUAL, Doubt.SMALL)


@dataclasses.dataclass(frozen=True)
class Reservation:
    """A doubt and what it is about.

    Attributes:
        doubt: of which kind.
        subject: an effect, a number of one, a channel or a run.
        others: further names: rivals, runs, conditions.
        value: the number in question; NaN without one.
        limit: what it is held against, as (low, high).
    """

    doubt: Doubt
    subject: str = ""
    others: tuple[str, ...] = ()
    value: float = float("nan")
    limit: tuple[float, float] = (float("nan"), float("nan"))


class Next(enum.Enum):
    """What to do next, the most urgent first."""

    DIAGNOSE = "test effects"
    DECIDE = "measure what distinguishes the models"
    HOLD_OUT = "record a run that is not fitted"
    COVER = "fit a run under the conditions of the check runs"
    REPEAT = "repeat the only run that shows an effect"
    OWN_EFFECT = "find what the fitted runs lack too"
    FIT_LIKE = "fit a run like the check run with the largest error"
    STATE_TOLERANCE = "state the tolerance"
    NOTHING = "nothing"


@dataclasses.dataclass(frozen=True)
class NextStep:
    """What to do next.

    Attributes:
        what: of which kind.
        subject: a run, or a channel.
        proposal: the experiment that distinguishes the models best.
        outside: conditions of check runs that no fit run covers.
    """

    what: Next
    subject: str = ""
    proposal: Proposal | None = None
    outside: tuple[Extrapolated, ...] = ()


@dataclasses.dataclass(frozen=True)
class Headline:
    """What a reader takes away.

    Attributes:
        grade: how sure the verdict is.
        probability: of the verdict; NaN where no probability was computed.
        reservations: what speaks against it, the strongest first.
        next_step: what to do.
    """

    grade: Grade
    probability: float
    reservations: tuple[Reservation, ...]
    next_step: NextStep


def headline(diagnosis: Diagnosis) -> Headline:
    """Return how sure the verdict of a diagnosis is, what speaks against it, and what to measure next."""
    against = tuple(reservations(diagnosis))
    probability = _probability(diagnosis)
    return Headline(_grade(diagnosis, probability, against), probability, against, _next_step(diagnosis, against))


def possible(diagnosis: Diagnosis) -> tuple[Immaterial, ...]:
    """Return the effects that are significant and not named; an effect that is named is no longer only possible."""
    named = {effect.name for effect in diagnosis.effects}
    return tuple(one for one in diagnosis.immaterial if one.name not in named)


def undetectable(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return the effects that the data could not show; one that they do show is not among them."""
    seen = {effect.name for effect in diagnosis.effects} | {one.name for one in diagnosis.immaterial}
    return tuple(name for name in diagnosis.blind_to if name not in seen)


def consistent(removes: Mapping[str, Removed], diagnosis: Diagnosis) -> dict[str, Removed]:
    """Return the changes of errors by an addition that agree with those of the final model.

    A change is computed on models that are fitted anew. Where the final model was fitted further, the error without
    the addition, that of the final model and the change together, may come out negative: such a change tells nothing.
    """
    found = {}
    for name, one in removes.items():
        error = diagnosis.final.errors[name]
        fit, check = (
            change if not now + change < 0.0 else float("nan")
            for now, change in ((error.fit, one.fit), (error.check, one.check))
        )
        found[name] = Removed(fit, check)
    return found


def held_out(error: ChannelError) -> float:
    """Return a channel's error on check runs, on fit runs where no check run has it."""
    return error.check if np.isfinite(error.check) else error.fit


def above_tolerance(diagnosis: Diagnosis) -> dict[str, float]:
    """Return the channels whose error is above the tolerance, on fit runs or on check runs, with the larger error."""
    found = {}
    for channel, tolerance in diagnosis.tolerance.items():
        error = diagnosis.final.errors[channel]
        worst = float(np.nanmax([error.fit, error.check, 0.0]))
        if worst > tolerance.rms:
            found[channel] = worst
    return found


def telling_channels(diagnosis: Diagnosis) -> tuple[str, str]:
    """Return the channel whose error changes most from the base model, and the one furthest beyond its tolerance.

    The second is the one nearest to its tolerance where all are within it.
    """

    def change(name: str) -> float:
        before, after = held_out(diagnosis.base.errors[name]), held_out(diagnosis.final.errors[name])
        return before / after if after > 0.0 else 1.0

    def share(name: str) -> float:
        tolerance = diagnosis.tolerance.get(name)
        limit = diagnosis.noise[name].sd if tolerance is None else tolerance.rms
        return held_out(diagnosis.final.errors[name]) / max(limit, 1e-300)

    return max(diagnosis.noise, key=change), max(diagnosis.noise, key=share)


def failing_runs(diagnosis: Diagnosis) -> dict[str, tuple[str, ...]]:
    """Return the check runs that are not within tolerance, by channel; channels without one are left out."""
    failing = {
        channel: tuple(run for run, within in of_run.items() if not within)
        for channel, of_run in diagnosis.fit_for_purpose.items()
    }
    return {channel: runs for channel, runs in failing.items() if runs}


def is_adequate(diagnosis: Diagnosis) -> bool:
    """Return True if every channel has a tolerance, and no error and no check run is above it."""
    return bool(diagnosis.tolerance) and not above_tolerance(diagnosis) and not failing_runs(diagnosis)


def reservations(diagnosis: Diagnosis) -> Iterator[Reservation]:
    """Give everything that speaks against the verdict, the strongest first."""
    if not diagnosis.final.converged:
        yield Reservation(Doubt.NO_MINIMUM)
    yield from _of_numbers(diagnosis)
    for effect in diagnosis.effects:
        if effect.cannot_tell_apart_from:
            yield Reservation(Doubt.RIVALS, effect.label, effect.cannot_tell_apart_from)
    for effect in diagnosis.effects:
        if effect.rests_on:
            yield Reservation(Doubt.ONE_RUN, effect.label, (effect.rests_on,))
    for effect in diagnosis.effects:
        worse = tuple(
            split_unit(name)[0]
            for name, one in consistent(effect.removes, diagnosis).items()
            if name in diagnosis.tolerance and -one.check > WORSE * diagnosis.tolerance[name].rms
        )
        if worse:
            yield Reservation(Doubt.WORSE_HELD_OUT, effect.label, worse)
    if not any(run.split == "check" for run in diagnosis.case.runs):
        yield Reservation(Doubt.NO_CHECK_RUNS)
    failing = failing_runs(diagnosis)
    above = above_tolerance(diagnosis)
    for channel in dict.fromkeys((*above, *failing)):
        limit = diagnosis.tolerance[channel].rms
        value = above.get(channel, held_out(diagnosis.final.errors[channel]))
        yield Reservation(Doubt.ABOVE_TOLERANCE, channel, failing.get(channel, ()), value, (0.0, limit))
    outside = _outside(diagnosis)
    if outside:
        yield Reservation(Doubt.OUTSIDE, others=tuple(dict.fromkeys(one.file for one in outside)))


def _of_numbers(diagnosis: Diagnosis) -> Iterator[Reservation]:
    """Give the numbers of named effects that are small, or outside their usual range."""
    for effect in diagnosis.effects:
        cls = diagnosis.case.catalogue.get(effect.name)
        if cls is None:
            continue
        of_specimen = specimen_ranges(diagnosis.case, cls)
        for name, about in describe(cls).items():
            estimate = effect.parameters.get(name)
            if estimate is None:
                continue
            usual = of_specimen.get(name) or about.typical
            if usual is not None and not in_usual_range(estimate.value, *usual):
                yield Reservation(Doubt.UNUSUAL, f"{effect.label}.{name}", (), estimate.value, usual)
            if about.null is not None and estimate.sd > 0.0 and np.isfinite(about.null):
                away = abs(estimate.value - about.null) / estimate.sd
                if away < LEAST_SD:
                    yield Reservation(Doubt.SMALL, f"{effect.label}.{name}", (), away, (LEAST_SD, np.inf))


def _outside(diagnosis: Diagnosis) -> tuple[Extrapolated, ...]:
    """Return the conditions outside the fit runs of those check runs that are not within tolerance."""
    failing = {run for runs in failing_runs(diagnosis).values() for run in runs}
    files = {run.file for run in diagnosis.case.runs if run.name in failing}
    return tuple(one for one in diagnosis.extrapolated if one.file in files)


def _probability(diagnosis: Diagnosis) -> float:
    """Return the probability of the verdict: the smallest of its effects', or that of the most probable model."""
    if diagnosis.effects:
        return min(effect.probability for effect in diagnosis.effects)
    return diagnosis.candidates[0][1] if diagnosis.candidates else float("nan")


def _grade(diagnosis: Diagnosis, probability: float, against: tuple[Reservation, ...]) -> Grade:
    if diagnosis.verdict == "undecided" or any(one.doubt in STRONG for one in against):
        return Grade.NOT_SURE
    if probability >= SURE and not against:
        return Grade.SURE
    return Grade.FAIRLY_SURE if probability >= FAIRLY_SURE else Grade.NOT_SURE


def _next_step(diagnosis: Diagnosis, against: tuple[Reservation, ...]) -> NextStep:
    doubts = {one.doubt: one for one in reversed(against)}  # the first of each kind
    if not diagnosis.verdict:
        return NextStep(Next.DIAGNOSE)
    if diagnosis.proposals and diagnosis.proposals[0].sigma >= WORTH_SIGMA:
        return NextStep(Next.DECIDE, proposal=diagnosis.proposals[0])
    if Doubt.NO_CHECK_RUNS in doubts:
        return NextStep(Next.HOLD_OUT)
    if Doubt.OUTSIDE in doubts:
        return NextStep(Next.COVER, outside=_outside(diagnosis))
    if Doubt.ONE_RUN in doubts:
        return NextStep(Next.REPEAT, doubts[Doubt.ONE_RUN].others[0])
    if any(diagnosis.final.errors[name].fit > diagnosis.tolerance[name].rms for name in above_tolerance(diagnosis)):
        return NextStep(Next.OWN_EFFECT)
    if Doubt.ABOVE_TOLERANCE in doubts:
        return NextStep(Next.FIT_LIKE, _worst_run(diagnosis, doubts[Doubt.ABOVE_TOLERANCE].subject))
    if any(one.assumed for one in diagnosis.tolerance.values()):
        return NextStep(Next.STATE_TOLERANCE)
    return NextStep(Next.NOTHING)


def _worst_run(diagnosis: Diagnosis, channel: str) -> str:
    """Return the run in which the final model has the largest error of a channel, a check run if it has one."""
    by_run = diagnosis.final.by_run.get(channel, {})
    checks = {run.name for run in diagnosis.case.runs if run.split == "check"} & set(by_run)
    return max(checks or by_run, key=lambda name: by_run[name].rms, default="")
