"""`jaxmodel diagnose` and `jaxmodel compare`: model against measurement, case by case."""

from __future__ import annotations

import dataclasses
import json
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import typer

from discrepancy import Diagnosis, answer, compare, diagnose
from discrepancy.advice.next_experiment import in_words
from discrepancy.extended.case import extended_case
from discrepancy.result import write_answer
from discrepancy.wording import (
    candidate_name,
    curve_sentence,
    effect_name,
    final_in_short,
    final_name,
    join,
    named_sentence,
    run_sentence,
    verdict_sentence,
)
from jaxmodel.case import Case
from jaxmodel.case_simulation import Outcome, simulate_case
from jaxmodel.case_writing import write_case
from jaxmodel.cases import read_case
from jaxmodel.errors import MeasurementError, UserError
from jaxmodel.ports import Effect
from plots import evidence
from plots.errors import errors_by_run
from plots.runs import channels_read, fit_and_residuals, residuals_by_condition
from plots.style import png
from workbench import terminal
from workbench.commands.start import catalogue_with, own_effects, start
from workbench.report import purpose_sentences, write_report
from workbench.report_rows import channel_rows

LAW_FILE = "found_law.py"
_CONDITIONS = {
    "cell": ("soc", "current_A", "cell_temperature_degC"),
    "motor": ("current_A", "speed_rad_s", "winding_temperature_degC"),
    "robot": ("soc", "pack_current_A", "speed_rad_s", "winding_temperature_degC"),
}

# The share of a diagnosis that is usually done when each of its parts first begins. Assumed: rounds differ in number.
DONE_BY = {"calibrating": 0.0, "refitting": 0.35, "adding": 0.5, "weighing": 0.85, "pictures": 0.9}


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
    """Diagnose cases one after the other, each into `out/CASE/`; go on where one cannot be used.

    Args:
        paths: folders or TOML files.
        out: folder for the results.
        effects: the user's own, as `file.py:Class`.
        try_effects: False calibrates the base model only.
        answer_only: leave out pictures and report.
        add: names of effects to be in the model, whatever the data say; no other is sought.
        with_effects: the same, and others are sought beside them.
        without: names of effects that are ruled out.

    Raises:
        UserError: the only case, or an effect, cannot be used, or two cases have one name.
        typer.Exit: with code 2, after all others, where one of several cases could not be diagnosed.
    """
    own = own_effects(effects)
    look = partial(diagnose, add=add, with_effects=with_effects, without=without) if try_effects else compare
    _check_names(paths)
    start(out)
    done: list[Diagnosis] = []
    failed: list[str] = []
    began = time.perf_counter()
    for number, path in enumerate(paths):
        place = _place(number, len(paths), time.perf_counter() - began)
        try:
            done.append(_diagnose_one(path, place, out, own, look, answer_only))
        except Exception as error:
            if len(paths) == 1:
                raise
            if not isinstance(
                error, UserError
            ):  # ours, not the user's: the others must not suffer, and we must hear of it
                traceback.print_exc(file=sys.stderr)
            terminal.complain(str(error))
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
                f"Two of the cases are called '{name}'; diagnose them one by one, each with an --out of its own."
            )


def _place(number: int, of: int, elapsed_s: float) -> str:
    """Say which of several cases this is, and how long all of them may still take."""
    if of == 1:
        return ""
    left = f", about {elapsed_s / number * (of - number) / 60.0:.0f} min left" if number else ""
    return f" ({number + 1} of {of}{left})"


def _diagnose_one(
    path: Path,
    place: str,
    out: Path,
    own: Mapping[str, type[Effect]],
    look: Callable[..., Diagnosis],
    answer_only: bool,
) -> Diagnosis:
    try_effects = look is not compare
    case = read_case(path)
    with terminal.told(f"{case.name}{place}", DONE_BY if try_effects else None) as progress:
        diagnosis = look(case, extra_effects=own, progress=progress)
        folder = out / case.name
        folder.mkdir(parents=True, exist_ok=True)
        extended, notes = extended_case(diagnosis, catalogue_with(own))
        if try_effects:
            write_answer(diagnosis, folder / "answer.json")
        else:
            (folder / "errors.json").write_text(
                json.dumps(answer(diagnosis)["error"], indent=2) + "\n", encoding="utf-8"
            )
        write_case(
            extended, folder / ("extended.toml" if try_effects else "calibrated.toml"), _comments(diagnosis, own, notes)
        )
        if diagnosis.law_source:
            (folder / LAW_FILE).write_text(diagnosis.law_source, encoding="utf-8")
        if not answer_only:
            progress("pictures and report")
            write_pictures_and_report(diagnosis, extended, folder, catalogue_with(own))
    print_diagnosis(diagnosis)
    if diagnosis.law_source:
        terminal.say(
            f"The law is an effect in {folder / LAW_FILE}: try it with --effect {folder / LAW_FILE}:FoundLaw "
            "--with found_law, then give it the form that physics has for it."
        )
    terminal.say(
        f"Everything is in {folder}." if answer_only else f"Everything is in {folder}; open report.html there."
    )
    return diagnosis


def write_pictures_and_report(
    diagnosis: Diagnosis, extended: Case, folder: Path, catalogue: Mapping[str, type[Effect]]
) -> dict[str, bytes]:
    """Write all pictures of a diagnosis and its report; return the pictures as PNG by name."""
    outcomes = simulate_case(extended, catalogue=catalogue)
    out_of_range = tuple(filter(None, (outcome.sentence() for outcome in outcomes)))
    diagnosis = dataclasses.replace(diagnosis, remarks=(*diagnosis.remarks, *out_of_range))
    pictures = pictures_of(diagnosis, outcomes)
    for name, picture in pictures.items():
        (folder / f"{name}.png").write_bytes(picture)
    write_report(diagnosis, folder / "report.html", pictures, catalogue)
    return pictures


def pictures_of(diagnosis: Diagnosis, outcomes: Sequence[Outcome]) -> dict[str, bytes]:
    """Return all pictures of a diagnosis as PNG by name.

    Args:
        diagnosis: what to draw.
        outcomes: of the final model, for the conditions under which the readings were taken.
    """
    noise_sd = {channel: noise.sd for channel, noise in diagnosis.noise.items()}
    models = {"calibrated base model": diagnosis.base.predictions}
    if diagnosis.final is not diagnosis.base:
        models[final_in_short(diagnosis)] = diagnosis.final.predictions
    pictures = {"ladder": png(evidence.ladder(diagnosis))}
    residuals = {name: _residuals(diagnosis, predictions) for name, predictions in models.items()}
    pictures["residuals-by-condition"] = png(
        residuals_by_condition(residuals, _conditions(diagnosis.case, outcomes), noise_sd)
    )
    if diagnosis.curves:
        pictures["curves"] = png(evidence.curves(diagnosis.curves))
    if diagnosis.errors is not None and len(diagnosis.errors):
        assumed = tuple(channel for channel, one in diagnosis.tolerance.items() if one.assumed)
        pictures["errors-by-run"] = png(errors_by_run(diagnosis.errors, assumed))
    if diagnosis.candidates:
        pictures["candidates"] = png(evidence.candidates(diagnosis))
    if diagnosis.scores:
        pictures["scores"] = png(evidence.scores(diagnosis))
    for run, outcome in zip(diagnosis.case.runs, outcomes, strict=True):
        if not channels_read(run, noise_sd):
            continue
        of_run = {name: predictions[run.name] for name, predictions in models.items()}
        valid = outcome.table["valid"].to_numpy(dtype=bool)
        pictures[f"run-{run.name}"] = png(fit_and_residuals(run, of_run, noise_sd, valid))
    return pictures


def _residuals(diagnosis: Diagnosis, predictions: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Return measured less predicted of every channel, run after run; NaN where a run has no such reading."""
    runs = diagnosis.case.runs
    return {
        channel: np.concatenate(
            [
                run.measured.outputs.get(channel, np.full(run.measured.time_s.size, np.nan))
                - predictions[run.name][channel]
                for run in runs
            ]
        )
        for channel in diagnosis.noise
    }


def _conditions(case: Case, outcomes: Sequence[Outcome]) -> dict[str, np.ndarray]:
    """Return the conditions that matter for a kind, run after run: inputs as measured, the rest as modelled."""
    return {
        name: np.concatenate(
            [
                o.run.measured.inputs[name] if name in o.run.measured.inputs else o.table[name].to_numpy()
                for o in outcomes
            ]
        )
        for name in _CONDITIONS[case.kind]
    }


def _comments(diagnosis: Diagnosis, own: Mapping[str, type[Effect]], notes: Sequence[str]) -> list[str]:
    """Return what stands on top of the extended case."""
    model = final_name(diagnosis) if diagnosis.final.added else "without any effect"
    lines = [f"The case '{diagnosis.case.name}', calibrated {model}.", *notes]
    if diagnosis.final.estimates:
        lines.append(
            "An sd is what its runs left of it: give it other runs before it is diagnosed, or they count twice."
        )
    if needed := [label for label in diagnosis.final.added if label in own]:
        lines.append(f"Give --effect FILE.py:CLASS again for {', '.join(needed)}.")
    return lines


def print_diagnosis(diagnosis: Diagnosis) -> None:
    """Print the errors as a table, the verdict, what is missing and what is off, and what should be known beside it."""
    rows = [
        [row["label"], row["noise"], row["tolerance"], *(" / ".join(row[model]) for model in ("stated", "before"))]
        + ([" / ".join(row["after"])] if diagnosis.final.added else [])
        for row in channel_rows(diagnosis)
    ]
    columns = ["error, RMS: fitted / held out", "noise", "tolerance", "base model, as stated", "calibrated base model"]
    columns += [final_in_short(diagnosis)] if diagnosis.final.added else []
    terminal.table(diagnosis.case.title, columns, rows, right=range(1, len(columns)))
    if diagnosis.final.added and final_name(diagnosis) not in columns:
        terminal.say(f"The final model: {final_name(diagnosis)}.")
    terminal.say(verdict_sentence(diagnosis))
    for effect in diagnosis.effects:
        terminal.say(f"Missing: {named_sentence(effect)}")
    for sentence in (*map(curve_sentence, diagnosis.curves), *map(run_sentence, diagnosis.runs)):
        terminal.say(f"Off: {sentence}")
    for channel, one in diagnosis.remaining.items():
        for sentence in one.where:
            terminal.say(f"Left of {channel}: {sentence}")
    for sentence in purpose_sentences(diagnosis):
        terminal.say(sentence)
    for one in diagnosis.immaterial:
        terminal.say(f"Detectable, not added: {one.sentence.rstrip('.')}.")
    if diagnosis.blind_to:
        terminal.say(f"Blind to: {join([effect_name(label) for label in diagnosis.blind_to])}.")
    for remark in diagnosis.remarks:
        terminal.say(f"Note: {remark}")
    if diagnosis.proposals:
        terminal.say(in_words(diagnosis.proposals, [candidate_name(name) for name in diagnosis.rivals]))


def _print_all(done: Sequence[Diagnosis], failed: Sequence[str]) -> None:
    rows = [[d.case.name, d.verdict, ", ".join(f"{e.label} {e.probability:.2f}" for e in d.effects)] for d in done]
    rows += [[name, "failed", ""] for name in failed]
    terminal.table(f"{len(rows)} cases", ("case", "verdict", "effects"), rows)
