"""The automatic diagnosis: score candidates, refit the best, add what meets the criteria, drop and exchange."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from jaxmodel.diagnosis.evidence.linear import Gain, Linear
from jaxmodel.diagnosis.evidence.trial import Settled, Trial
from jaxmodel.diagnosis.fitting.lanes import at_once
from jaxmodel.diagnosis.gates import Addition, addition, harms, in_order, is_plausible, odds_of, passes
from jaxmodel.diagnosis.workings import Workings

CLOCK = "time_s"
# If a refit gained so many times the expected gain of the others, these are not refitted.
FAR_MORE = 2.0
# Log evidence lost without an addition above which it is not tested for removal again.
MUCH_NEEDED = 50.0


@dataclasses.dataclass(frozen=True)
class Found:
    """The result of the automatic diagnosis.

    Attributes:
        final: the final model.
        path: all models on the way, the base model first.
        refused: significant candidates that were not added, by label.
        laws: accepted unknown laws, in order.
        compared: all models fitted under the final model's weights, itself included.
    """

    final: Settled
    path: tuple[Settled, ...]
    refused: dict[str, Addition]
    laws: tuple[Addition, ...]
    compared: tuple[Trial, ...]


def run(
    investigation: Workings,
    start: Sequence[str] = (),
    seek: bool = True,
    each: Callable[[Settled], None] = lambda _: None,
) -> Found:
    """Diagnose a case automatically.

    Args:
        investigation: of the case.
        start: candidates that are in the model from the start, and stay.
        seek: False to test no other candidate.
        each: is called with every model after the first as it is accepted.
    """
    inv, settings = investigation, investigation.settings
    model = inv.settled(start)
    path = [inv.base] if not model.labels else [inv.base, model]
    refused: dict[str, Addition] = {}
    seen, needed = {model.labels}, dict[str, float]()
    for _ in range(settings.most_rounds if seek else 0):
        passing, tried = _additions(inv, model)
        best, added = _first_that_holds(inv, model, passing)
        if best is not None and added is not None:
            model = _without_unneeded(inv, added, (*start, best.label), needed)
        else:
            refused = {one.label: one for one in tried if one.significant}
            model = _without_unneeded(inv, _swapped(inv, model, start), start)
        if model.labels in seen:
            break
        path.append(model)
        seen.add(model.labels)
        each(model)
    laws, model = _laws(inv, model) if seek else ((), model)
    if laws:
        path.append(model)
        each(model)
    refused = {label: one for label, one in refused.items() if label not in model.labels}
    return Found(model, tuple(path), refused, laws, tuple(_rivals_of(inv, model, start)))


def _additions(inv: Workings, model: Settled) -> tuple[list[Addition], list[Addition]]:
    """Return the additions that meet the criteria, in order of preference, and all that were refitted.

    An effect is preferred to a curve that gains not much more: a curve is no new physics. An effect that does the work
    of a material shift of a single run is material too: a contact in the only cold run does most of what the
    temperature does.
    """
    settings = inv.settings
    linear = inv.linear(model)
    gains = [gain for gain in linear.gains() if _may_enter(inv, model, gain.label)]

    def promising(groups: Sequence[str], count: int) -> list[Gain]:
        some = [gain for gain in gains if inv.space.candidates[gain.label].group in groups]
        return [g for g in some if g.log_evidence > 0.5 * odds_of(inv, inv.space.candidates[g.label], model)][:count]

    def passing(some: Sequence[Addition]) -> list[Addition]:
        return in_order(inv, [one for one in some if passes(inv, one)])

    effects = _leading(inv, model, linear, gains)
    joint = [one for one in promising(("effect", "sensor"), settings.refitted_effects) if one not in effects]
    effects += joint[: max(1, settings.refitted_effects - len(effects))]
    others = promising(("curve",), settings.refitted_curves) + promising(("run",), settings.refitted_runs)
    tried = _refitted(inv, model, effects)
    first = passing(tried)
    most = max((gain.log_evidence for gain in others), default=0.0)
    if first and first[0].gain > settings.preference * most:
        return first, tried
    more = _refitted(inv, model, others)
    second = passing(more)
    shifts = [one for one in second if inv.space.candidates[one.label].group == "run"]
    better = [dataclasses.replace(one, material=one.material or _does_the_work(inv, one, shifts)) for one in tried]
    first = passing(better)
    if first and second and first[0].gain > settings.preference * second[0].gain:
        return first + second, better + more
    return in_order(inv, first + second), better + more


def _does_the_work(inv: Workings, one: Addition, shifts: Sequence[Addition]) -> bool:
    """Return True if an effect gains more evidence than shifts of single runs, and removes most of what they remove."""
    share = inv.settings.work_of_a_shift
    return bool(shifts) and all(
        one.gain > shift.gain and 1.0 - one.share_left > share * (1.0 - shift.share_left) for shift in shifts
    )


def _leading(inv: Workings, model: Settled, linear: Linear, gains: Sequence[Gain]) -> list[Gain]:
    """Return the effects, and the sensor faults, with the best score in each single channel.

    They are counted separately: three faults of a thermometer may look like a cell that warms.
    """
    together = {gain.label: gain for gain in gains}
    most = {"effect": inv.settings.leading_effects, "sensor": inv.settings.leading_faults}
    found: dict[str, Gain] = {}
    for of_channel in linear.gains_by_channel():
        likely = [one for one in of_channel if one.log_evidence > odds_of(inv, inv.space.candidates[one.label], model)]
        for group, count in most.items():
            mine = [one.label for one in likely if inv.space.candidates[one.label].group == group]
            found |= {label: together[label] for label in [one for one in mine if one in together][:count]}
    return list(found.values())


def _first_that_holds(
    inv: Workings, model: Settled, passing: Sequence[Addition]
) -> tuple[Addition, Settled] | tuple[None, None]:
    """Return the first addition that also meets the criteria under its own weights, and the model with it."""
    for one in passing:
        inv.report(f"adding {one.label}")
        added = inv.settled(one.trial.labels, one.trial)
        if is_plausible(inv, added, one.label) and not harms(inv, added, model):
            return one, added
    return None, None


def _refitted(inv: Workings, model: Settled, gains: Sequence[Gain]) -> list[Addition]:
    """Refit some candidates, and stop when one has gained far more than the others are expected to."""
    found: list[Addition] = []
    for place in range(0, len(gains), 2):
        some = gains[place : place + 2]
        best = max((one.gain for one in found if passes(inv, one)), default=0.0)
        if best > FAR_MORE * max(0.0, *(gain.log_evidence for gain in gains[place:])):
            break
        inv.report(f"refitting with {', '.join(gain.label for gain in some)}")
        found += at_once(lambda gain: addition(inv, model, gain), some)
    return found


def _may_enter(inv: Workings, model: Settled, label: str) -> bool:
    """Return True if a candidate may be tested: every effect that it needs is in the model, or is no candidate."""
    candidates = inv.space.candidates
    needed = {one for one, candidate in candidates.items() if candidate.name in candidates[label].effect.needs}
    return all(any(candidates[one].name == candidates[other].name for one in model.labels) for other in needed)


def _without_unneeded(
    inv: Workings, model: Settled, keep: Sequence[str], needed: dict[str, float] | None = None
) -> Settled:
    """Return the model without earlier additions that are no longer needed, the least needed first.

    Args:
        inv: the investigation.
        model: the model.
        keep: additions that stay.
        needed: log evidence lost without each addition when last tested; additions with a large loss are not tested
            again.
    """
    needed = {} if needed is None else needed
    while True:
        others = [label for label in model.labels if label not in keep and needed.get(label, 0.0) < MUCH_NEEDED]
        if not others:
            return model
        without = at_once(partial(_lacking, inv, model), others)
        lost = {label: model.log_evidence - one.log_evidence for label, one in zip(others, without, strict=True)}
        needed |= lost
        label = min(others, key=lambda one: lost[one] - odds_of(inv, inv.space.candidates[one], model))
        alone = inv.settings.least_odds if len(model.labels) == 1 else 0.0
        if lost[label] > odds_of(inv, inv.space.candidates[label], model) - alone:
            return model
        inv.report(f"dropping {label}")
        model = inv.settled(without[others.index(label)].labels, without[others.index(label)])


def _lacking(inv: Workings, model: Trial, label: str) -> Trial:
    return inv.trial([one for one in model.labels if one != label], model)


def _with(inv: Workings, model: Trial, gain: Gain) -> Trial:
    return inv.trial((*model.labels, gain.label), model, gain)


def _swapped(inv: Workings, model: Settled, keep: Sequence[str]) -> Settled:
    """Return the model with one addition exchanged for another if that gains evidence."""
    for label in [one for one in model.labels if one not in keep]:
        lacking = _lacking(inv, model, label)
        gains = inv.gains_at(lacking)
        rivals = [gain for gain in gains if gain.label != label and _may_enter(inv, model, gain.label)]
        rivals = [gain for gain in rivals if gain.label not in model.labels][: inv.settings.refitted_curves]
        promised = model.log_evidence - lacking.log_evidence
        rivals = [gain for gain in rivals if gain.log_evidence > 0.5 * promised]
        tried = at_once(partial(addition, inv, lacking), rivals) if rivals else []
        better = [one for one in tried if one.trial.log_evidence > model.log_evidence + _swap_price(inv, label, one)]
        better = [one for one in better if passes(inv, one) and not harms(inv, one.trial, model)]
        if better:
            best = max(better, key=lambda one: one.gain)
            inv.report(f"replacing {label} by {best.label}")
            model = inv.settled(best.trial.labels, best.trial)
    return model


def _swap_price(inv: Workings, label: str, other: Addition) -> float:
    """Return the gain required of an exchange: small, but larger if a curve or shift replaces an effect."""
    groups = [inv.space.candidates[one].group for one in (label, other.label)]
    new = groups[1] not in ("effect", "sensor") and groups[0] in ("effect", "sensor")
    return inv.settings.least_odds + (0.3 * max(other.gain, 0.0) if new else 0.0)


def _laws(inv: Workings, model: Settled) -> tuple[tuple[Addition, ...], Settled]:
    """Return the unknown laws that meet the criteria, and the model with them; laws over time come last."""
    if not model.scale.error.sd or not _may_be_a_law(inv, model):
        return (), model
    linear = inv.linear_at(model, groups=("law",))
    gains = [one for one in linear.gains() if one.log_evidence > odds_of(inv, inv.space.candidates[one.label], model)]
    of_clock = [one for one in gains if inv.space.candidates[one.label].over == CLOCK]
    for some in ([one for one in gains if one not in of_clock], of_clock):
        if not some:
            continue
        chosen = some[: inv.settings.refitted_laws]
        inv.report(f"refitting the law {', '.join(one.label for one in chosen)}")
        tried = at_once(lambda gain: addition(inv, model, gain), chosen)
        passing = sorted([one for one in tried if passes(inv, one)], key=lambda one: -one.gain)
        if passing:
            return tuple(passing[:1]), inv.settled(passing[0].trial.labels, passing[0].trial)
    return (), model


def _may_be_a_law(inv: Workings, model: Settled) -> bool:
    """Return True if an unknown law may explain the remaining error: it is a large share, or close to the noise.

    If most of the error is explained and the rest is far above the noise, the rest of a real case is usually no law.
    """
    settings = inv.settings
    before, after = inv.errors_of(inv.base), inv.errors_of(model)
    channel = model.scale.view.readings.channel
    for place in np.unique(channel):
        mine = channel == place
        noise = float(np.mean(model.scale.view.readings.sd[mine] ** 2))
        left = float(np.mean(after[mine] ** 2))
        share = (left - noise) / max(float(np.mean(before[mine] ** 2)) - noise, 1e-300)
        if share > settings.law_share or (share > settings.faint_law and left < settings.near_noise**2 * noise):
            return True
    return False


def _rivals_of(inv: Workings, model: Settled, keep: Sequence[str]) -> list[Trial]:
    """Return the rivals of the final model under its weights: without each addition, and with others in its place.

    A rival that predicts left-out data worse than the final model is none, whatever its evidence: beside a model error
    the evidence of two models differs by hundreds, most of it from the form that is assumed for the model error.
    """
    found: list[Trial] = [model]
    for label in [one for one in model.labels if one not in keep]:
        lacking = _lacking(inv, model, label)
        found.append(lacking)
        near = [gain for gain in inv.gains_at(lacking) if gain.label not in model.labels]
        near = [gain for gain in near if inv.space.candidates[gain.label].group in ("effect", "sensor")]
        needed = model.log_evidence - lacking.log_evidence
        near = [gain for gain in near if gain.log_evidence > needed - 20.0][:3]
        tried = at_once(partial(_with, inv, lacking), near) if near else []
        found += [one for one in tried if not harms(inv, one, model)]
    if not model.labels:
        gains = [
            one for one in inv.linear(model).gains() if inv.space.candidates[one.label].group in ("effect", "sensor")
        ]
        near = [gain for gain in gains if gain.log_evidence > -3.0][:3]
        found += at_once(lambda gain: inv.trial((gain.label,), model, gain), near) if near else []
    else:
        found.append(inv.trial((), model))
    return found
