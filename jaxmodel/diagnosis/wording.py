"""Verdicts, models, candidates and numbers in words, the same in the terminal and in the report."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.case.specimens import in_words
from jaxmodel.diagnosis.headline import STRONG, Doubt, above_tolerance, failing_runs, reservations, undetectable
from jaxmodel.diagnosis.result import (
    ChannelError,
    CurveFound,
    Diagnosis,
    Estimate,
    NamedEffect,
    Removed,
    RunFound,
    Rung,
    SpecimenFound,
)
from jaxmodel.effects.differences import WHAT
from jaxmodel.model.ports import Effect

VERDICT_TITLES = {
    "adequate": "Nothing is missing",
    "missing_effect": "An effect is missing",
    "sensor_fault": "A sensor is faulty",
    "unknown_effect": "Unknown physics is missing",
    "undecided": "The data do not decide",
    "": "Calibrated",
}

# Channels that a sentence names one by one.
MOST_CHANNELS = 3
# A change of an error by less than this share of the noise is not worth a word beside a difference of a specimen.
_SEEN = 0.02
_ONE_LINE = 48  # letters in a legend or at the head of a column


def join(parts: Sequence[str], last: str = "and") -> str:
    """Return 'a, b and c'."""
    parts = list(parts)
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}" if parts else ""


def verdict_title(diagnosis: Diagnosis) -> str:
    """Return the verdict in a few words, which no error and no doubt of the diagnosis contradicts."""
    if diagnosis.stays_as_stated:
        return "The model stays as stated"
    if diagnosis.verdict == "adequate" and not _is_good_enough(diagnosis):
        return "No missing effect found, but an error is above tolerance"
    if diagnosis.verdict == "adequate" and (diagnosis.curves or diagnosis.runs or diagnosis.specimens):
        specimens = dict.fromkeys(one.specimen for one in diagnosis.specimens)
        differs = [in_words(diagnosis.case.kind, name) for name in specimens]
        differs += [*(["a table"] if diagnosis.curves else []), *(["a run"] if diagnosis.runs else [])]
        return f"No effect is missing, but {join(differs)} {'differ' if len(differs) > 1 else 'differs'}"
    title = VERDICT_TITLES[diagnosis.verdict]
    if diagnosis.verdict in ("missing_effect", "sensor_fault") and not is_established(diagnosis):
        title = "An effect may be missing" if diagnosis.verdict == "missing_effect" else "A sensor may be faulty"
    return f"Within tolerance; below it, {going_on(title)}" if _is_below_tolerance(diagnosis) else title


def is_established(diagnosis: Diagnosis) -> bool:
    """Return False if a number of a named effect is unusual or may be nothing, or the fit reached no minimum.

    Nor is a sensor faulty where something else would do as well: what is in question then is another sensor, the
    surroundings, or one run.
    """
    against = (*STRONG, Doubt.RIVALS) if diagnosis.verdict == "sensor_fault" else STRONG
    return not any(one.doubt in against for one in reservations(diagnosis))


def verdict_sentence(diagnosis: Diagnosis, *, plain: bool = False) -> str:
    """Return the verdict in one sentence; a plain one has no probability, and calls the base model the model.

    A sentence for each specimen that differs comes before it.
    """
    differ = specimen_sentences(diagnosis, with_errors=False)
    return " ".join([*differ, _verdict(diagnosis, plain)])


def _verdict(diagnosis: Diagnosis, plain: bool) -> str:
    named = _names(diagnosis.effects, plain)
    if diagnosis.verdict == "sensor_fault":
        catalogue = diagnosis.case.catalogue
        faults = [one for one in diagnosis.effects if one.name not in catalogue or catalogue[one.name].is_sensor]
        others = [one for one in diagnosis.effects if one not in faults]
        named = _names(faults, plain) + (f", beside {_names(others, plain)}, which every cell has" if others else "")
    model = "model" if plain else "base model"
    found = _found(diagnosis, named, model)
    if _is_below_tolerance(diagnosis):
        return f"The calibrated {model} is adequate{_for_limits(diagnosis)}; below that, {found}"
    return _capital(found)


def _names(effects: Sequence[NamedEffect], plain: bool) -> str:
    return join([effect_name(one.label) if plain else _with_probability(one) for one in effects])


def _found(diagnosis: Diagnosis, named: str, model: str) -> str:
    established = not diagnosis.effects or is_established(diagnosis)
    match diagnosis.verdict:
        case _ if diagnosis.stays_as_stated:
            return "The model stays as stated: calibrated, it predicts the check runs worse, and no effect is named."
        case "adequate":
            return _adequate(diagnosis, model)
        case "missing_effect":
            lacks = "lacks" if established else "may lack"
            return f"the {model} {lacks} {named}{_of_another_form(diagnosis)}."
        case "sensor_fault":
            fault = f"a sensor {'is' if established else 'may be'} faulty: {named}"
            if not _is_good_enough(diagnosis):
                return f"{fault}; the data show no missing effect, but {exceeding(diagnosis)}."
            alone = "" if _is_below_tolerance(diagnosis) else "the model needs no further physics; "
            return f"{alone}{fault}{_of_another_form(diagnosis)}."
        case "unknown_effect":
            besides = f"besides {named}, the" if named else "the"
            what = f": {diagnosis.unexplained.rstrip('.')}" if diagnosis.unexplained else ""
            hidden = len(undetectable(diagnosis))
            untold = f" ({hidden} of them would not show in these data)" if hidden else ""
            return f"{besides} {model} lacks something that no effect of the catalogue explains{untold}{what}."
        case "undecided" if diagnosis.unexplained:
            return f"The {model} predicts the fit runs, but not the check runs: {diagnosis.unexplained.rstrip('.')}."
        case "undecided":
            rivals = [candidate_name(name) for name, p in diagnosis.candidates if p >= 0.05] or ["the candidates"]
            found = f"The data show {named}, but do not" if named else "The data do not"
            return (
                f"{found} distinguish between {join(rivals)}." if len(rivals) > 1 else f"{found} confirm {rivals[0]}."
            )
    return f"The {model} is calibrated; no effects were tested."


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"


def going_on(sentence: str) -> str:
    """Return a sentence that goes on after a colon or a comma: without its capital, but for an abbreviation."""
    return sentence[:1].lower() + sentence[1:] if sentence[1:2].islower() or sentence[1:2] == " " else sentence


def _is_good_enough(diagnosis: Diagnosis) -> bool:
    """Return True if no error and no check run is above its tolerance."""
    return not above_tolerance(diagnosis) and not failing_runs(diagnosis)


def _adequate(diagnosis: Diagnosis, base: str) -> str:
    if not _is_good_enough(diagnosis):
        return f"The data show no missing effect, but {exceeding(diagnosis)}."
    corrected = diagnosis.curves or diagnosis.runs or diagnosis.specimens
    model = "with the corrections below the model" if corrected else "the final model"
    if _base_is_good_enough(diagnosis):
        model = f"the calibrated {base}"
    return _capital(f"{model} is adequate{_for_limits(diagnosis)}: the data show no missing effect.")


def _is_below_tolerance(diagnosis: Diagnosis) -> bool:
    """Return True if what was found is of no matter for the tolerances: without it the errors are within them."""
    found = not diagnosis.stays_as_stated and diagnosis.verdict in ("missing_effect", "sensor_fault", "unknown_effect")
    return found and bool(diagnosis.tolerance) and _base_is_good_enough(diagnosis)


def _base_is_good_enough(diagnosis: Diagnosis) -> bool:
    """Return True if the calibrated base model is within all tolerances, on fit runs and on check runs."""
    errors = diagnosis.base.errors
    return not any(_exceeds(errors[name], one.rms) for name, one in diagnosis.tolerance.items())


def _for_limits(diagnosis: Diagnosis) -> str:
    """Return ' for 16.5 mV of voltage (assumed) and 1 K of cell temperature (assumed)'; '' without tolerances."""
    limits = []
    if len(diagnosis.tolerance) > MOST_CHANNELS:
        assumed = ", assumed" if all(one.assumed for one in diagnosis.tolerance.values()) else ""
        limits = [f"the tolerances of all {len(diagnosis.tolerance)} channels (below{assumed})"]
    else:
        for name, one in diagnosis.tolerance.items():
            (value,), unit = amount(name, [one.rms])
            limits.append(f"{value} {unit} of {split_unit(name)[0]}{' (assumed)' if one.assumed else ''}")
    return f" for {join(limits)}" if limits else ""


def _exceeds(error: ChannelError, limit: float) -> bool:
    return max(error.fit, error.check if np.isfinite(error.check) else 0.0) > limit


def exceeding(diagnosis: Diagnosis) -> str:
    """Say which errors of the final model are above their tolerance, or in which check runs they are."""
    above, failing = above_tolerance(diagnosis), failing_runs(diagnosis)
    parts = []
    for name in dict.fromkeys((*above, *failing)):
        one, error = diagnosis.tolerance[name], diagnosis.final.errors[name]
        assumed = ", assumed" if one.assumed else ""
        if name in above:
            (value, limit), unit = amount(name, [above[name], one.rms])
            where = "check" if np.isfinite(error.check) and error.check == above[name] else "fit"
            error_is = f"the error of {split_unit(name)[0]} on {where} runs is {value} {unit}"
            parts.append(f"{error_is} (tolerance {limit} {unit}{assumed})")
        else:
            (limit,), unit = amount(name, [one.rms])
            there = f"in {join(failing[name])}" if len(failing[name]) <= 3 else f"in {len(failing[name])} check runs"
            parts.append(f"the error of {split_unit(name)[0]} is above {limit} {unit} {there} (tolerance{assumed})")
    return join(parts)


def _of_another_form(diagnosis: Diagnosis) -> str:
    left = (diagnosis.unexplained or "").rstrip(".")
    return f", in a form that differs slightly from the catalogue's: {left}" if left else ""


def _with_probability(effect: NamedEffect) -> str:
    return f"{effect_name(effect.label)} (probability {effect.probability:.2f})"


def effect_name(label: str) -> str:
    """Return a label in words: 'current_offset:current_A' is 'current_offset of current_A', 'r@x' is 'r in x'.

    A difference of a specimen is 'resistance_difference of left'.
    """
    if is_law(label):
        return f"a law of {label}"
    owned = " of " if label.partition("@")[0].partition(":")[0] in WHAT else " in "
    return label.replace(":", " of ").replace("@", owned)


def physics_of(effect: type[Effect]) -> str:
    """Return in one sentence, without its formula, what an effect is."""
    first = (effect.__doc__ or "").strip().splitlines()[:1]
    sentence = first[0] if first else ""
    head, colon, tail = sentence.partition(": ")
    return f"{head}." if colon and re.search(r"[=^|*]|[A-Za-z]_|\(", tail) else sentence


def is_law(label: str) -> bool:
    """Return True for an unknown law, labelled by its port and its variable, 'port(variable)'."""
    return "(" in label


def candidate_name(name: str) -> str:
    """Return a hypothesis in words."""
    known = {"base": "the base model alone", "something_else": "something else"}
    return known.get(name) or " with ".join(effect_name(part) for part in name.split("+"))


def most_probable(diagnosis: Diagnosis) -> str:
    """Return the most probable of the compared models in words."""
    parts = diagnosis.candidates[0][0].split("+")
    # A candidate is named without its run.
    where = {re.split("[:@]", run.label)[0]: run.run for run in diagnosis.runs}
    return candidate_name("+".join(f"{part}@{where[part]}" if part in where else part for part in parts))


def ladder_names(ladder: Sequence[Rung]) -> list[str]:
    """Return the models of a diagnosis in words: as stated, calibrated, then what each adds to the previous one."""
    names = ["base model, as stated", *step_names([one.added for one in ladder[1:]])]
    for place, one in enumerate(ladder[2:], start=2):
        if one.predictions and one.predictions is ladder[0].predictions:
            names[place] = "back to the model as stated"
        elif one.added == ladder[place - 1].added:
            names[place] = "with corrected tables and formulas"
    return names


def step_names(steps: Sequence[tuple[str, ...]]) -> list[str]:
    """Return models in words: what each adds to, and removes from, the previous one."""
    names = []
    for before, now in itertools.pairwise([(), *steps]):
        new = [effect_name(label) for label in now if label not in before]
        gone = [effect_name(label) for label in before if label not in now]
        added = f"{'and' if len(names) > 1 else 'with'} {join(new)}" if new else ""
        said = ", ".join(filter(None, (added, f"without {join(gone)}" if gone else "")))
        names.append(said or ("the same model" if names else "calibrated base model"))
    return names


def final_name(diagnosis: Diagnosis) -> str:
    """Return the final model in words, its additions in the order of the ladder."""
    final = diagnosis.final.added
    added = dict.fromkeys(label for rung in diagnosis.ladder for label in rung.added if label in final)
    return f"with {join([effect_name(label) for label in added])}" if added else "calibrated base model"


def final_in_short(diagnosis: Diagnosis) -> str:
    """Return the name of the final model, or 'final model' if it is too long for one line."""
    name = final_name(diagnosis)
    return name if len(name) <= _ONE_LINE else "final model"


def amount(channel: str, values: Sequence[float]) -> tuple[list[str], str]:
    """Return errors of a channel as numbers in a readable unit, and that unit."""
    scale, unit = readable(values, difference_unit(split_unit(channel)[1]))
    return [number(value * scale) for value in values], unit


def removed(removes: Mapping[str, Removed]) -> str:
    """Say by how much errors change: 'reduces the error of voltage by 12 mV on fit runs and 9 mV on check runs'.

    What rises is said to be raised; '' if nothing changes.
    """
    parts_of_channels = []
    for channel, one in removes.items():
        values = {"fit runs": one.fit, "check runs": one.check}
        values = {split: value for split, value in values.items() if np.isfinite(value)}
        if any(values.values()):
            numbers, unit = amount(channel, list(map(abs, values.values())))
            verbs = ["raises" if value < 0.0 else "reduces" for value in values.values()]
            parts = [" ".join(filter(None, (n, unit, "on", split))) for n, split in zip(numbers, values, strict=True)]
            name = split_unit(channel)[0]
            if len(set(verbs)) == 1:
                parts_of_channels.append(f"{verbs[0]} the error of {name} by {join(parts)}")
            else:
                said = f"{verbs[0]} the error of {name} by {parts[0]} and {verbs[1]} it by {parts[1]}"
                parts_of_channels.append(said)
    return "; it ".join(parts_of_channels)


def named_sentence(effect: NamedEffect) -> str:
    """Say which effect is named, its parameters, and by how much it reduces the errors.

    A parameter whose sd exceeds its value is no number to use.
    """
    told = {name: one for name, one in effect.parameters.items() if not one.sd > abs(one.value)}
    numbers = join([f"{name} = {with_sd(estimate)}" for name, estimate in told.items()])
    untold = join([name for name in effect.parameters if name not in told])
    takes = removed(effect.removes)
    alone = f"; only {effect.rests_on} shows it" if effect.rests_on else ""
    reduces = takes and f"; it {takes}"
    unknown = untold and f"; these data do not tell {untold}"
    return f"{', '.join(filter(None, (effect_name(effect.label), numbers)))}{unknown}{reduces}{alone}."


def curve_sentence(curve: CurveFound) -> str:
    """Say by how much a table or relation is wrong, and by how much its correction reduces the errors."""
    takes = removed(curve.removes)
    return f"{curve.sentence()}{takes and f'; the correction {takes}'}."


def run_sentence(run: RunFound) -> str:
    """Say which parameter of which run differs from that of the other runs, and by how much."""
    takes = removed(run.removes)
    return f"{run_in_short(run)} from the other runs{takes and f'; this shift {takes}'}."


def run_in_short(run: RunFound) -> str:
    """Return 'run-03: series resistance differs by +12.10 ± 0.07 mohm'."""
    what, _, where = run.parameter.partition(":")
    what = split_unit(what.removesuffix("_ohm"))[0]
    scale, unit = readable([run.value], run.unit)
    value = with_sd(Estimate(scale * run.value, scale * run.sd, unit))
    sign = "" if value.startswith("-") or not np.isfinite(run.value) else "+"
    return f"{run.run}: {what}{where and f' of {where}'} differs by {sign}{value}"


def specimen_sentences(diagnosis: Diagnosis, *, with_errors: bool = True) -> list[str]:
    """Say which motor or cell differs, in what and by how much: one sentence for each difference.

    Args:
        diagnosis: its result.
        with_errors: say by how much it reduces the errors, too.
    """

    def shown(one: SpecimenFound) -> dict[str, Removed]:
        return {
            channel: change
            for channel, change in one.removes.items()
            if np.nanmax(np.abs([change.fit, change.check, 0.0])) > _SEEN * diagnosis.noise[channel].sd
        }

    kind = diagnosis.case.kind
    return [_specimen_sentence(one, kind, removed(shown(one)) if with_errors else "") for one in diagnosis.specimens]


def _specimen_sentence(one: SpecimenFound, kind: str, takes: str) -> str:
    who = in_words(kind, one.specimen)
    name, _, column = one.name.partition(":")
    way = "higher" if one.value > 0.0 else "lower"
    others = [in_words(kind, other) for other in one.others]
    theirs = f"that of {join(others) if len(others) < MOST_CHANNELS else 'the others'}" if others else "as stated"
    if one.factor:
        what = f"its {WHAT[name]} is {_by_a_factor(one.value, one.sd, way)} {theirs}"
    else:
        size = with_sd(Estimate(abs(one.value), one.sd, one.unit))
        what = f"its {split_unit(column)[0]} reads {size} {way} than {theirs}"
    doubt = f"; {_rivals(one, kind)} would explain it as well" if one.cannot_tell_apart_from else ""
    return _capital(f"{who} differs: {what}{doubt}{takes and f'; this {takes}'}.")


def _by_a_factor(log: float, sd: float, way: str) -> str:
    """Return '30 ± 1 % higher', or '2.03 ± 0.04 times' where it is more than twice or less than half."""
    factor = float(np.exp(log))
    if abs(log) > np.log(1.9):
        return f"{with_sd(Estimate(factor, factor * sd, ''))} times"
    return f"{with_sd(Estimate(100.0 * abs(factor - 1.0), 100.0 * factor * sd, '%'))} {way} than"


def _rivals(one: SpecimenFound, kind: str) -> str:
    """Return what might stand for a difference: 'another torque constant or resistance', or an effect by its name."""
    parts = [label.partition("@") for label in one.cannot_tell_apart_from]
    own = [WHAT[name.partition(":")[0]] for name, _, owner in parts if owner == one.specimen]
    said = [f"another {join(own, 'or')}"] if own else []
    for name, _, owner in parts:
        what = WHAT.get(name.partition(":")[0])
        if owner != one.specimen:
            said.append(f"another {what} of {in_words(kind, owner)}" if what else effect_name(name))
    return join(said, "or")


def number(value: float, digits: int = 3) -> str:
    """Return a number with some significant digits, '-' if it is not finite."""
    if not np.isfinite(value):
        return "-"
    if 1e3 <= abs(value) < 1e7:
        return f"{float(f'{value:.{digits}g}'):,.0f}"
    return f"{value:.{digits}g}"


def with_sd(estimate: Estimate) -> str:
    """Return 'value ± sd unit', the value rounded to the digits of its sd."""
    value, sd = estimate.value, estimate.sd
    unit = f" {estimate.unit}" if estimate.unit else ""
    if not (np.isfinite(sd) and sd > 0.0):
        return f"{value:.5g}{unit}"
    first = int(np.floor(np.log10(sd)))
    if not -5 <= first <= 4:
        return f"{value:.5g} ± {sd:.2g}{unit}"
    decimals = max(0, 1 - first)
    return f"{value:.{decimals}f} ± {sd:.{decimals}f}{unit}"
