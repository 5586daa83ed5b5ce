"""The report of one diagnosis: a single HTML page that opens offline and prints well.

It begins with three lines: what is missing, how sure that is, what to measure next. Then come a picture of the run in
which the base model is furthest off, the ladder of models, and the details.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmodel.app.page import write_page
from jaxmodel.app.report_rows import channel_rows, ladder_tables, noise_rows, parameter_rows
from jaxmodel.base.provenance import provenance
from jaxmodel.base.units import difference_unit, split_unit
from jaxmodel.case.records import Run
from jaxmodel.case.simulation import end_of
from jaxmodel.diagnosis.advice.next_experiment import in_words
from jaxmodel.diagnosis.headline import consistent, possible, undetectable
from jaxmodel.diagnosis.opening import opening
from jaxmodel.diagnosis.residuals.blocks import block_sentence, worst_block
from jaxmodel.diagnosis.result import Diagnosis, NamedEffect
from jaxmodel.diagnosis.rungs import evaluated_rows
from jaxmodel.diagnosis.summary import extrapolated_sentence, purpose_sentences
from jaxmodel.diagnosis.wording import (
    candidate_name,
    curve_sentence,
    effect_name,
    join,
    physics_of,
    removed,
    run_sentence,
    specimen_sentences,
    verdict_title,
    with_sd,
)
from jaxmodel.fit.settings import SEED, SETTINGS
from jaxmodel.model.declaration import describe
from jaxmodel.plots.diagnosis import pulses_drawn, pulses_name


def write_report(diagnosis: Diagnosis, folder: str | Path) -> dict[str, bytes]:
    """Write all pictures of a diagnosis or comparison and `report.html`, one page that opens offline, to a folder.

    Args:
        diagnosis: what to report.
        folder: made if need be.

    Returns:
        The pictures as PNG by name.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    ends = [remark for one in diagnosis.simulation for remark in end_of(one)]
    pictures = {file.stem: file.read_bytes() for file in diagnosis.plot.save(folder)}
    with_ends = dataclasses.replace(diagnosis, remarks=(*diagnosis.remarks, *ends))
    write_page(folder / "report.html", "diagnosis.html", **report_content(with_ends, pictures))
    return pictures


def report_content(diagnosis: Diagnosis, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the content for the templates of a diagnosis; arguments as `write_report`."""
    case, parameters = diagnosis.case, parameter_rows(diagnosis)
    return {
        "diagnosis": diagnosis,
        "case": case,
        "pictures": pictures,
        "verdict_title": verdict_title(diagnosis),
        "opening": opening(diagnosis).lines(),
        "lead": lead_run(diagnosis, pictures),
        "ladder": ladder_tables(diagnosis),
        "named": [_named(diagnosis, effect) for effect in diagnosis.effects],
        "where_base": _by_channel(diagnosis.where_base, case.runs),
        "specimens": specimen_sentences(diagnosis),
        "curves": [_sentence(curve_sentence(curve)) for curve in diagnosis.curves],
        "off_runs": [run_sentence(run) for run in diagnosis.runs],
        "strained": [row for row in parameters if row["strained"]],
        "channels": channel_rows(diagnosis),
        "fit_for_purpose": purpose_sentences(diagnosis),
        "where": _by_channel({channel: one.where for channel, one in diagnosis.remaining.items()}, case.runs),
        "furthest": furthest_off(diagnosis),
        "possible": [_immaterial(one.sentence, removed(one.removes)) for one in possible(diagnosis)],
        "extrapolated": [extrapolated_sentence(one) for one in diagnosis.extrapolated],
        # Extrapolation has its own heading in the report.
        "remarks": [remark for remark in diagnosis.remarks if remark.code != "run_outside_fitted"],
        "blind": join([effect_name(label) for label in undetectable(diagnosis)]),
        "indistinguishable": [
            f"{effect_name(effect.label)}: {join([effect_name(label) for label in effect.cannot_tell_apart_from])}"
            for effect in diagnosis.effects
            if effect.cannot_tell_apart_from
        ],
        "next": in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]),
        "runs": case.runs,
        "pulses": pulses_shown(diagnosis, pictures),
        "parameters": parameters,
        "noise": noise_rows(diagnosis),
        "origin": provenance(_files(diagnosis), _settings(diagnosis)),
    }


def lead_run(diagnosis: Diagnosis, pictures: Mapping[str, bytes]) -> str:
    """Return the run whose picture opens the report: the check run in which the base model is furthest off.

    A fit run where no check run has a picture; "" where no run has one.
    """

    def size(run: Run) -> float:
        errors = {name: by_run[run.name] for name, by_run in diagnosis.base.by_run.items() if run.name in by_run}
        return max((one.rms / max(diagnosis.noise[name].sd, 1e-300) for name, one in errors.items()), default=0.0)

    drawn = [run for run in diagnosis.case.runs if f"run-{run.name}" in pictures]
    checks = [run for run in drawn if run.split == "check"]
    chosen = max(checks or drawn, key=size, default=None)
    return "" if chosen is None else chosen.name


def furthest_off(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Return, by channel, where the final model is furthest off on average, in a stretch of any run."""
    found = []
    for channel in diagnosis.noise:
        errors: dict[str, np.ndarray] = {}
        conditions: dict[str, dict[str, np.ndarray]] = {}
        for run in diagnosis.case.runs:
            predicted = diagnosis.final.predictions.get(run.name, {})
            if channel in predicted and channel in run.measured.outputs:
                error = run.measured.outputs[channel] - predicted[channel]
                first = evaluated_rows(run, SETTINGS).start
                errors[run.name] = np.where(np.arange(error.size) >= first, error, np.nan)
                conditions[run.name] = {name: predicted[name] for name in ("soc",) if name in predicted}
        worst = worst_block(diagnosis.case.runs, errors, conditions)
        if worst is not None:
            quantity, unit = split_unit(channel)
            found.append((quantity, block_sentence(worst, difference_unit(unit))))
    return found


def pulses_shown(diagnosis: Diagnosis, pictures: Mapping[str, bytes]) -> list[dict[str, str]]:
    """Return the pictures of pulses and steps: name, run and quantity."""
    drawn = [(pulses_name(run, channel), run, channel) for run, channel in pulses_drawn(diagnosis)]
    return [
        {"picture": name, "run": run, "quantity": split_unit(channel)[0]}
        for name, run, channel in drawn
        if name in pictures
    ]


def _named(diagnosis: Diagnosis, effect: NamedEffect) -> dict[str, Any]:
    """Return what the report says of a named effect."""
    cls = diagnosis.case.catalogue.get(effect.name)
    return {
        "label": effect.label,
        "probability": effect.probability,
        "physics": physics_of(cls) if cls else "",
        "parameters": [
            (f"{name} = {with_sd(estimate)}", describe(cls)[name].meaning if cls and name in describe(cls) else "")
            for name, estimate in effect.parameters.items()
        ],
        "equation": cls.equation if cls else "",
        "removes": removed(consistent(effect.removes, diagnosis)),
        "rests_on": effect.rests_on,
        "rivals": ", ".join(effect_name(label) for label in effect.cannot_tell_apart_from),
    }


def _by_channel(sentences: Mapping[str, tuple[str, ...]], runs: Sequence[Run]) -> list[tuple[str, list[str]]]:
    """Return the channels that have statements, with these; a run keeps its name as it is written."""
    names = tuple(run.name for run in runs)
    return [
        (split_unit(channel)[0], [one if one.startswith(names) else _sentence(one) for one in some])
        for channel, some in sentences.items()
        if some
    ]


def _sentence(text: str) -> str:
    """Return a text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def _immaterial(sentence: str, takes: str) -> str:
    """Return a sentence that begins with the name of an effect, as it is written."""
    return f"{sentence.rstrip('.')}{takes and f'; it {takes}'}."


def _files(diagnosis: Diagnosis) -> list[Path]:
    """Return the files of the case and of the user's own effects."""
    case = diagnosis.case
    own = dict.fromkeys(inspect.getfile(effect) for effect in case.own_effects.values())
    return [*case.files, *(Path(file) for file in own)]


def _settings(diagnosis: Diagnosis) -> list[str]:
    ordered = [f"options: {' '.join(diagnosis.ordered)}"] if diagnosis.ordered else []
    return [f"random seed {SEED}", *ordered]
