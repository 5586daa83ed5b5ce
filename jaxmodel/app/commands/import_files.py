"""`jaxmodel import`: raw files of a bench as a case."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import typer

from jaxmodel.app import terminal
from jaxmodel.app.folders import take
from jaxmodel.base.errors import MeasurementError, UserError, nearest
from jaxmodel.case.measurements import KINDS
from jaxmodel.data.importing import Imported, Question, import_case
from jaxmodel.data.importing.imported import shortened
from jaxmodel.data.importing.virtual_bench import PREFIX, logs_of
from jaxmodel.data.importing.written import options_of

_MOST_DECISIONS, _MOST_FINDINGS = 40, 40


def import_files(
    files: Sequence[Path],
    kind: str,
    out: Path,
    *,
    answer_only: bool = False,
    force: bool = False,
    **decisions: Any,
) -> Imported:
    """Import files, print what was found and decided, and write the case, with a picture of each run.

    Args:
        files: as `jaxmodel.data.importing.import_case` takes them; a folder stands for all its files.
        kind: of the case.
        out: folder of the case.
        answer_only: leaves out the pictures.
        force: writes over a case that was edited since it was imported.
        decisions: fields of `jaxmodel.data.importing.Options`, as `jaxmodel.data.importing.written` takes them.

    Raises:
        UserError: a file cannot be used, or something is open and nobody is there to be asked.
    """
    if kind not in KINDS:
        raise MeasurementError(f"--kind: there is no '{kind}'; use {', '.join(KINDS)}.{nearest(kind, KINDS)}")
    options = options_of(decisions)
    paths = files_of(files, out)
    take(out)
    ask = _ask if sys.stdin.isatty() and sys.stderr.isatty() else None
    with terminal.stages("import") as progress:
        imported = import_case(paths, cast(Any, kind), options=options, ask=ask, progress=progress)
        progress("checking the case")
        _check(imported)
        progress(f"writing {len(imported.runs)} runs")
        imported.write(out, pictures=not answer_only, force=force)
    _print(imported)
    pictures = "" if answer_only else ", a picture of each run"
    terminal.say(f"case.toml, {len(imported.runs)} CSV files{pictures} and import.json are in {out}.")
    return imported


def _check(imported: Imported) -> None:
    """Refuse a case that could not be read again."""
    try:
        imported.check()
    except UserError as error:
        raise MeasurementError(
            f"{str(error).rstrip('.')}; for an import: --unit, --sign, --flip or --column state it."
        ) from error


def files_of(files: Sequence[Path], out: Path) -> list[Path]:
    """Return the files, those of a folder by name, and for a parameter set of PyBaMM the logs of its tests.

    Raises:
        MeasurementError: they are in the folder of the case, a folder holds none, or a set cannot be tested.
    """
    found: list[Path] = []
    for path in files:
        if str(path).startswith(PREFIX):
            terminal.say(f"testing {path} at a virtual bench ...")
            found += logs_of(str(path).removeprefix(PREFIX), out.with_name(f"{out.name}_logs"))
        elif path.is_dir():
            inside = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
            logs = [
                file for file in inside if file.suffix.lower() not in (".md", ".png", ".jpg", ".pdf", ".toml", ".json")
            ]
            if not logs:
                raise MeasurementError(f"{path} is a folder without logs; name the files.")
            found += logs
        else:
            found.append(path)
    if any(file.resolve().parent == out.resolve() for file in found):
        raise MeasurementError(f"--out {out}: the files to be imported are in this folder; give another one.")
    return found


def _ask(question: Question) -> str:
    """Ask at the terminal."""
    choices = f" ({' or '.join(question.choices)})" if question.choices else ""
    answer = str(typer.prompt(f"{question.sentence}{choices}", default=question.default or None, err=True)).strip()
    if question.choices and answer not in question.choices:
        raise MeasurementError(
            f"'{answer}' is none of {', '.join(question.choices)}; run again, or give {question.option}."
        )
    return answer


def _print(imported: Imported) -> None:
    table = imported.to_dataframe()
    rows = [
        (
            str(row["run"]),
            str(row["split"]),
            f"{row['rows']:,}",
            terminal.duration(row["duration_s"]),
            f"{row['ambient_degC']:.3g}",
            "" if row["initial_soc"] != row["initial_soc"] else f"{row['initial_soc']:.3g}",
            str(row["warnings"] or ""),
            str(row["label"]),
        )
        for row in cast("list[dict[str, Any]]", table.to_dict("records"))
    ]
    columns = ("run", "split", "rows", "duration", "ambient [degC]", "initial SOC", "look at", "label")
    if imported.kind == "motor":
        columns, *rows = [row[:5] + row[6:] for row in (columns, *rows)]
    terminal.table(imported.title, columns, rows, right=range(2, len(columns) - 1))
    decided = shortened([one for one in imported.decisions if one.about not in ("reading", "clock", "convention")])
    for line in decided[:_MOST_DECISIONS]:
        terminal.say(f"decided: {line}")
    warned = imported.warned()
    for line in warned[:_MOST_FINDINGS]:
        terminal.say(f"look at: {line}")
    if len(decided) > _MOST_DECISIONS or len(warned) > _MOST_FINDINGS:
        terminal.say("import.json has the rest.")
    if missing := imported.missing():
        terminal.say(missing)
