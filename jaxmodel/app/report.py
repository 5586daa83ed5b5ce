"""The report of one diagnosis: a single HTML page that opens offline and prints well.

Its sections: what is missing, which stated values and tables are wrong, which error remains and whether it is material.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxmodel.app.page import write_page
from jaxmodel.app.report_rows import channel_rows, ladder_rows, noise_rows, parameter_rows
from jaxmodel.base.provenance import provenance
from jaxmodel.base.units import split_unit
from jaxmodel.diagnosis.advice.next_experiment import in_words
from jaxmodel.diagnosis.advice.remarks import extrapolated_sentence as remark_on_extrapolation
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.summary import extrapolated_sentence, purpose_sentences, summary
from jaxmodel.diagnosis.wording import (
    VERDICT_TITLES,
    candidate_name,
    curve_sentence,
    effect_name,
    join,
    removed,
    run_sentence,
    verdict_sentence,
    with_sd,
)
from jaxmodel.fit.settings import SEED


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
    out_of_range = tuple(filter(None, (one.sentence() for one in diagnosis.simulation)))
    pictures = {file.stem: file.read_bytes() for file in diagnosis.plot.save(folder)}
    with_range = dataclasses.replace(diagnosis, remarks=(*diagnosis.remarks, *out_of_range))
    write_page(folder / "report.html", "diagnosis.html", **report_content(with_range, pictures))
    return pictures


def report_content(diagnosis: Diagnosis, pictures: Mapping[str, bytes]) -> dict[str, Any]:
    """Return the content for the templates of a diagnosis; arguments as `write_report`."""
    case, parameters = diagnosis.case, parameter_rows(diagnosis)
    on_extrapolation = set(map(remark_on_extrapolation, diagnosis.extrapolated))
    return {
        "diagnosis": diagnosis,
        "case": case,
        "pictures": pictures,
        "verdict_title": VERDICT_TITLES[diagnosis.verdict],
        "verdict": verdict_sentence(diagnosis),
        "summary": summary(diagnosis),
        "ladder": ladder_rows(diagnosis),
        "named": [
            {
                "label": effect.label,
                "probability": effect.probability,
                "parameters": [f"{name} = {with_sd(estimate)}" for name, estimate in effect.parameters.items()],
                "equation": case.catalogue[effect.name].equation if effect.name in case.catalogue else "",
                "removes": removed(effect.removes),
                "rests_on": effect.rests_on,
                "rivals": ", ".join(effect_name(label) for label in effect.cannot_tell_apart_from),
            }
            for effect in diagnosis.effects
        ],
        "where_base": _by_channel(diagnosis.where_base),
        "curves": [curve_sentence(curve) for curve in diagnosis.curves],
        "off_runs": [run_sentence(run) for run in diagnosis.runs],
        "strained": [row for row in parameters if row["strained"]],
        "channels": channel_rows(diagnosis),
        "fit_for_purpose": purpose_sentences(diagnosis),
        "where": _by_channel({channel: one.where for channel, one in diagnosis.remaining.items()}),
        "immaterial": [_immaterial(one.sentence, removed(one.removes)) for one in diagnosis.immaterial],
        "extrapolated": [extrapolated_sentence(one) for one in diagnosis.extrapolated],
        # Extrapolation has its own heading in the report.
        "remarks": [remark for remark in diagnosis.remarks if remark not in on_extrapolation],
        "blind": join([effect_name(label) for label in diagnosis.blind_to]),
        "indistinguishable": [
            f"{effect_name(effect.label)}: {join([effect_name(label) for label in effect.cannot_tell_apart_from])}"
            for effect in diagnosis.effects
            if effect.cannot_tell_apart_from
        ],
        "next": in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]),
        "runs": case.runs,
        "parameters": parameters,
        "noise": noise_rows(diagnosis),
        "origin": provenance(_files(diagnosis), _settings(diagnosis)),
    }


def _by_channel(sentences: Mapping[str, tuple[str, ...]]) -> list[tuple[str, list[str]]]:
    """Return the channels that have statements, with these."""
    return [(split_unit(channel)[0], [_sentence(one) for one in some]) for channel, some in sentences.items() if some]


def _sentence(text: str) -> str:
    """Return a text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def _immaterial(sentence: str, takes: str) -> str:
    return _sentence(f"{sentence.rstrip('.')}{takes and f'; it {takes}'}")


def _files(diagnosis: Diagnosis) -> list[Path]:
    """Return the files of the case and of the user's own effects."""
    case = diagnosis.case
    own = dict.fromkeys(inspect.getfile(effect) for effect in case.own_effects.values())
    return [*case.files, *(Path(file) for file in own)]


def _settings(diagnosis: Diagnosis) -> list[str]:
    ordered = [f"options: {' '.join(diagnosis.ordered)}"] if diagnosis.ordered else []
    return [f"random seed {SEED}", *ordered]
