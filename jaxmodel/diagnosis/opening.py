"""The first three lines of a diagnosis in words: what is missing, how sure that is and why, what to measure next."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.base.units import split_unit
from jaxmodel.diagnosis.advice.next_experiment import in_words
from jaxmodel.diagnosis.headline import (
    Doubt,
    Grade,
    Headline,
    Next,
    Reservation,
    above_tolerance,
    failing_runs,
    headline,
    held_out,
    possible,
    telling_channels,
    undetectable,
)
from jaxmodel.diagnosis.result import Diagnosis, Extrapolated
from jaxmodel.diagnosis.wording import (
    MOST_CHANNELS,
    amount,
    candidate_name,
    effect_name,
    going_on,
    join,
    most_probable,
    number,
    physics_of,
    run_in_short,
    verdict_sentence,
)

_MOST = 3  # tables, runs or conditions that are named one by one


@dataclasses.dataclass(frozen=True)
class Opening:
    """The first three lines of a diagnosis.

    Attributes:
        missing: what is missing, or that nothing is.
        sure: how sure that is, and why.
        measure: what to measure next.
    """

    missing: str
    sure: str
    measure: str

    def lines(self) -> list[tuple[str, str]]:
        """Return each line with the question that it answers."""
        return [("Missing", self.missing), ("How sure", self.sure), ("Measure next", self.measure)]


def opening(diagnosis: Diagnosis) -> Opening:
    """Return the first three lines of a diagnosis or comparison."""
    decided = headline(diagnosis)
    return Opening(_missing(diagnosis), _sure(diagnosis, decided), _measure(diagnosis, decided))


def _missing(diagnosis: Diagnosis) -> str:
    said = [verdict_sentence(diagnosis, plain=True)]
    catalogue = diagnosis.case.catalogue
    physics = {one.label: physics_of(catalogue[one.name]) for one in diagnosis.effects if one.name in catalogue}
    if len(physics) == 1 and diagnosis.verdict == "missing_effect" and not diagnosis.unexplained:
        said = [f"{said[0].rstrip('.')}: {going_on(*physics.values())}"]
    else:
        said += [f"{effect_name(label)}: {going_on(sentence)}" for label, sentence in physics.items()]
    tables = [curve.relation for curve in diagnosis.curves if curve.stated]
    if tables:
        which = join(tables) if len(tables) <= _MOST else f"{len(tables)} tables of the case"
        said.append(f"Corrected as well: {which}.")
    if diagnosis.runs:
        runs = [run_in_short(run) for run in diagnosis.runs[:_MOST]]
        rest = len(diagnosis.runs) - _MOST
        said.append(f"Single runs differ: {join([*runs, *([f'{rest} more'] if rest > 0 else [])])}.")
    return " ".join(said)


def _sure(diagnosis: Diagnosis, decided: Headline) -> str:
    if not diagnosis.verdict:
        return f"No effects were tested, so nothing is known of what is missing. {_errors(diagnosis)}"
    grade = {Grade.SURE: "Sure", Grade.FAIRLY_SURE: "Fairly sure", Grade.NOT_SURE: "Not sure"}[decided.grade]
    said = [grade if not np.isfinite(decided.probability) else f"{grade}: {_probability(diagnosis, decided)}"]
    said[0] += "."
    said.append(_errors(diagnosis))
    against = [_reservation(one) for one in decided.reservations if one.doubt is not Doubt.ABOVE_TOLERANCE]
    if any(one.doubt is Doubt.ABOVE_TOLERANCE for one in decided.reservations):
        against.insert(0, f"errors above the tolerance ({', '.join(_too_large(diagnosis))})")
    if against:
        said.append(f"Against it: {'; '.join(against)}.")
    hidden = len(undetectable(diagnosis))
    if hidden:
        said.append(f"{hidden} kind{'s' if hidden > 1 else ''} of effect would not show in these data (listed below).")
    if possible(diagnosis):
        said.append(f"Possible, but not named: {join([effect_name(one.name) for one in possible(diagnosis)])}.")
    return " ".join(said)


def _probability(diagnosis: Diagnosis, decided: Headline) -> str:
    """Return of what the probability is, and the probability."""
    if diagnosis.effects:
        least = "the least certain effect has probability" if len(diagnosis.effects) > 1 else "probability"
        return f"{least} {decided.probability:.2f}"
    return f"the most probable model is {most_probable(diagnosis)}, probability {decided.probability:.2f}"


def _errors(diagnosis: Diagnosis) -> str:
    """Say the errors before and after on check runs, on fit runs where there are none."""
    has_checks = any(np.isfinite(diagnosis.final.errors[name].check) for name in diagnosis.noise)
    where = "On the check runs, which were not fitted," if has_checks else "On the fit runs"
    changes = []
    shown = list(diagnosis.noise)
    if len(shown) > MOST_CHANNELS:
        shown = list(dict.fromkeys(telling_channels(diagnosis)))
    for name in shown:
        before, after = held_out(diagnosis.base.errors[name]), held_out(diagnosis.final.errors[name])
        limit = diagnosis.tolerance.get(name)
        (was, becomes, *rest), unit = amount(name, [before, after, *([limit.rms] if limit else [])])
        quantity = split_unit(name)[0]
        unit = f" {unit}" if unit else ""
        assumed = ", assumed" if limit and limit.assumed else ""
        tolerance = f" (tolerance {rest[0]}{unit}{assumed})" if rest else ""
        if was == becomes:
            changes.append(f"the error of {quantity} is {becomes}{unit}{tolerance}")
        else:
            way = "falls" if after < before else "rises"
            changes.append(f"the error of {quantity} {way} from {was} to {becomes}{unit}{tolerance}")
    rest = ""
    if len(shown) < len(diagnosis.noise):
        changed, worst = (split_unit(name)[0] for name in telling_channels(diagnosis))
        rest = f" Of {len(diagnosis.noise)} channels {worst} is the worst against its tolerance"
        rest += f", and {changed} changes most." if changed != worst else "."
    return f"{where} {join(changes)}.{rest}"


def _too_large(diagnosis: Diagnosis) -> list[str]:
    """Return the quantities whose error is above the tolerance, with the check runs where only these are."""
    above, failing = above_tolerance(diagnosis), failing_runs(diagnosis)
    names = []
    for name in dict.fromkeys((*above, *failing)):
        said = split_unit(name)[0]
        if name not in above:
            runs = failing[name]
            said += f" in {join(runs) if len(runs) <= _MOST else f'{len(runs)} check runs'}"
        mostly = diagnosis.remaining[name].mostly if name in diagnosis.remaining else ""
        names.append(f"{said} mostly at {mostly}" if mostly else said)
    return names


def _reservation(one: Reservation) -> str:
    match one.doubt:
        case Doubt.NO_MINIMUM:
            return "the fit did not reach a minimum"
        case Doubt.UNUSUAL:
            low, high = map(number, one.limit)
            return f"{one.subject} = {number(one.value)} is outside its usual range, {low} to {high}"
        case Doubt.SMALL:
            return f"{one.subject} is only {one.value:.1f} standard deviations from no effect"
        case Doubt.RIVALS:
            others = join([effect_name(other) for other in one.others], "or")
            return f"{others} would do as well as {effect_name(one.subject)}"
        case Doubt.ONE_RUN:
            return f"only {one.others[0]} shows {effect_name(one.subject)}"
        case Doubt.WORSE_HELD_OUT:
            return f"without {effect_name(one.subject)} the check runs would be predicted better ({join(one.others)})"
        case Doubt.NO_CHECK_RUNS:
            return "no run was held out, so nothing shows how well other runs are predicted"
        case Doubt.OUTSIDE:
            files = join(one.others) if len(one.others) <= _MOST else f"{len(one.others)} check runs"
            return f"{files} {'lies' if len(one.others) == 1 else 'lie'} outside the conditions of the fit runs"
    raise AssertionError(one.doubt)


def _measure(diagnosis: Diagnosis, decided: Headline) -> str:
    step = decided.next_step
    match step.what:
        case Next.DIAGNOSE:
            return "Nothing yet: a diagnosis (jaxmodel diagnose) tests what is missing, and says what to measure."
        case Next.DECIDE:
            return in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals])
        case Next.HOLD_OUT:
            return 'Another run, listed with split = "check": it shows how well the model predicts what was not fitted.'
        case Next.COVER:
            return f"A run to be fitted that covers what the check runs cover: {join(_conditions(step.outside))}."
        case Next.REPEAT:
            return f"Another run like {step.subject}: it is the only one that shows the effect."
        case Next.FIT_LIKE:
            return f"Another run like {step.subject}, to be fitted: its error is above the tolerance."
        case Next.OWN_EFFECT:
            return (
                "Not another run of this kind: the fitted runs are not within tolerance either, so something else is "
                "missing. See where the remaining error is, and test an effect of your own (--effect)."
            )
        case Next.STATE_TOLERANCE:
            assumed = [split_unit(name)[0] for name, one in diagnosis.tolerance.items() if one.assumed]
            which = join(assumed) if len(assumed) <= MOST_CHANNELS else f"{len(assumed)} channels"
            return (
                "Nothing, for use under the conditions of these runs. "
                f"The tolerance of {which} was assumed: state the error that you can live with."
            )
    return "Nothing, for use under the conditions of these runs."


def _conditions(outside: tuple[Extrapolated, ...]) -> list[str]:
    """Return the widest span of each condition: 'load torque to 0.442 N m (fitted: 0 to 0.324)'."""
    widest: dict[str, Extrapolated] = {}
    for one in outside:
        before = widest.get(one.condition)
        span = one.span if before is None else (min(before.span[0], one.span[0]), max(before.span[1], one.span[1]))
        widest[one.condition] = dataclasses.replace(one, span=span)
    said = []
    for name, one in list(widest.items())[:_MOST]:
        quantity, unit = split_unit(name.strip("|"))
        unit = f" {unit}" if unit else ""
        low, high = map(number, one.span)
        span = low if low == high else f"{low} to {high}"
        first, last = map(number, one.span_fitted)
        fitted = first if first == last else f"{first} to {last}"
        said.append(f"{quantity} {span}{unit} (fitted so far: {fitted}{unit})")
    return said
