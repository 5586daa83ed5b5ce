"""`jaxmodel diagnose` and `jaxmodel compare`: model against measurement, case by case."""

from __future__ import annotations

import sys
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import typer

from jaxmodel.app import terminal
from jaxmodel.app.commands.start import read_case_with, start
from jaxmodel.app.folders import take
from jaxmodel.app.meanwhile import import_meanwhile
from jaxmodel.app.one_sentence import sentence_of
from jaxmodel.base.errors import MeasurementError, UserError
from jaxmodel.diagnosis import Diagnosis, compare, diagnose
from jaxmodel.diagnosis.diagnosis import DONE_BY as OF_DIAGNOSIS
from jaxmodel.diagnosis.extended.files import LAW_FILE
from jaxmodel.diagnosis.headline import possible, undetectable
from jaxmodel.diagnosis.summary import purpose_sentences, sure_and_next
from jaxmodel.diagnosis.wording import (
    curve_sentence,
    effect_name,
    final_in_short,
    final_name,
    join,
    named_sentence,
    run_sentence,
    specimen_sentences,
    verdict_sentence,
)

# Usual share of the work that is done when each part starts. Assumed.
DONE_BY = OF_DIAGNOSIS | {"pictures": 0.9}

# What draws them.
_PICTURES = ("jaxmodel.plots.diagnosis", "jaxmodel.plots.evidence", "jaxmodel.plots.runs", "jaxmodel.plots.errors")


def diagnose_all(
    paths: Sequence[Path],
    out: Path,
    effects: Sequence[str],
    *,
    try_effects: bool = True,
    answer_only: bool = False,
    add: Sequence[str] = (),
    with_effects: Sequence[str] = (),
    without: Sequence[str] = (),
) -> list[Diagnosis]:
    """Diagnose cases one after the other, each into `out/CASE/`; continue if one cannot be used.

    Args:
        paths: folders or TOML files.
        out: folder for the results.
        effects: the user's own, as `file.py:Class`.
        try_effects: False calibrates the base model only.
        answer_only: leave out pictures and report.
        add: names of effects that are added whatever the data show; no other is tested.
        with_effects: the same, but others are tested too.
        without: names of effects that are ruled out.

    Raises:
        UserError: the only case, or an effect, cannot be used, or two cases have one name.
        typer.Exit: with code 2, after all others, where one of several cases could not be diagnosed.
    """
    method = partial(diagnose, add=add, with_effects=with_effects, without=without) if try_effects else compare
    _check_names(paths)
    start(None)
    done: list[Diagnosis] = []
    failed: list[str] = []
    began = time.perf_counter()
    for number, path in enumerate(paths):
        place = _place(number, len(paths), time.perf_counter() - began)
        try:
            done.append(_diagnose_one(path, place, out, effects, method, answer_only))
        except Exception as error:
            if len(paths) == 1:
                raise
            sentence = sentence_of(error)
            if not sentence:  # a defect of the program: show it, and continue with the other cases
                traceback.print_exc(file=sys.stderr)
            terminal.complain(sentence or str(error))
            failed.append(path.name)
    if len(paths) > 1:
        _print_all(done, failed)
    if failed:
        raise typer.Exit(2)
    return done


def _check_names(paths: Sequence[Path]) -> None:
    """Raise where two cases would be written to one folder."""
    names = [(path if path.is_dir() else path.parent).resolve().name for path in paths]
    for name in names:
        if names.count(name) > 1:
            raise MeasurementError(
                f"Two of the cases are called '{name}'; diagnose them one by one, each with its own --out."
            )


def _place(number: int, of: int, elapsed_s: float) -> str:
    """Say which of several cases this is, and estimate the remaining time."""
    if of == 1:
        return ""
    left = f", about {elapsed_s / number * (of - number) / 60.0:.0f} min left" if number else ""
    return f" ({number + 1} of {of}{left})"


def _diagnose_one(
    path: Path,
    place: str,
    out: Path,
    effects: Sequence[str],
    method: Callable[..., Diagnosis],
    answer_only: bool,
) -> Diagnosis:
    try_effects = method is not compare
    case = read_case_with(path, effects)
    take(out / case.name)
    import_meanwhile("jaxmodel.app.report", *([] if answer_only else _PICTURES))
    with terminal.stages(f"{case.name}{place}", DONE_BY if try_effects else None) as progress:
        diagnosis = method(case, progress=progress)
        folder, refused = out / case.name, None
        try:
            try:
                diagnosis.write(folder, pictures=False)
            except UserError as error:  # a file that nobody could read again; the rest took minutes and is written
                refused = error
            if not answer_only:
                progress("pictures and report")
                from jaxmodel.app.report import write_report

                write_report(diagnosis, folder)
        except OSError:  # what took minutes is shown, though it cannot be kept
            print_diagnosis(diagnosis)
            raise
    print_diagnosis(diagnosis)
    if diagnosis.law_source:
        terminal.say(
            f"The law is an effect in {folder / LAW_FILE}: test it with --effect {folder / LAW_FILE}:FoundLaw "
            "--with found_law, then replace its table by a physical formula."
        )
    terminal.say(
        f"Everything is in {folder}." if answer_only else f"Everything is in {folder}; open report.html there."
    )
    if refused is not None:
        raise refused
    return diagnosis


def print_diagnosis(diagnosis: Diagnosis) -> None:
    """Print the errors as a table, the verdict, what is missing, what is wrong, and all remarks."""
    from jaxmodel.app.report_rows import channel_rows

    rows = [
        [
            row["label"],
            row["noise"],
            ", ".join(row["tolerance"]),
            *(" / ".join(row[model]) for model in ("stated", "before")),
        ]
        + ([" / ".join(row["after"])] if diagnosis.final.added else [])
        for row in channel_rows(diagnosis)
    ]
    columns = ["RMS error: fit / check runs", "noise", "tolerance", "base model, as stated", "calibrated base model"]
    columns += [final_in_short(diagnosis)] if diagnosis.final.added else []
    terminal.table(diagnosis.case.title, columns, rows, right=range(1, len(columns)))
    if diagnosis.final.added and final_name(diagnosis) not in columns:
        terminal.say(f"Final model: {final_name(diagnosis)}.")
    terminal.say(verdict_sentence(diagnosis))
    for line in sure_and_next(diagnosis):
        terminal.say(line)
    for effect in diagnosis.effects:
        terminal.say(f"Found: {named_sentence(effect)}")
    for sentence in specimen_sentences(diagnosis):
        terminal.say(f"Found: {sentence}")
    for sentence in (*map(curve_sentence, diagnosis.curves), *map(run_sentence, diagnosis.runs)):
        terminal.say(f"Correction: {sentence}")
    for channel, one in diagnosis.remaining.items():
        for sentence in one.where:
            terminal.say(f"Remaining error of {channel}: {sentence}")
    for sentence in purpose_sentences(diagnosis):
        terminal.say(sentence)
    for one in possible(diagnosis):
        terminal.say(f"Possible, but not named: {one.sentence.rstrip('.')}.")
    if hidden := undetectable(diagnosis):
        terminal.say(f"Not detectable with these data: {join([effect_name(label) for label in hidden])}.")
    for remark in diagnosis.remarks:
        terminal.say(f"Note: {remark}")


def _print_all(done: Sequence[Diagnosis], failed: Sequence[str]) -> None:
    rows = [[d.case.name, d.verdict, ", ".join(f"{e.label} {e.probability:.2f}" for e in d.effects)] for d in done]
    rows += [[name, "failed", ""] for name in failed]
    terminal.table(f"{len(rows)} cases", ("case", "verdict", "effects"), rows)
