"""`jaxmodel export`: the model of a case in the format of another tool."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxmodel.app import terminal
from jaxmodel.app.commands.start import read_case_with, start
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError, ParameterError
from jaxmodel.export.formats import export


def export_to(path: Path, to: str, out: Path, effects: Sequence[str], options: Sequence[str]) -> None:
    """Write the file, and print what it does not carry.

    Raises:
        UserError: the case, the format or the file cannot be used.
    """
    given = dict(_of_text(option) for option in options)
    case = read_case_with(path, effects)
    if out.resolve() in [file.resolve() for file in case.files]:
        raise MeasurementError(f"--out {out}: this is a file of the case; give another.")
    if out.is_dir():
        raise MeasurementError(f"--out {out}: this is a folder; give a file.")
    start(None)
    found = export(case, to, **given)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_whole(out, found.content)
    terminal.say(f"{out} has the model of {case.name}.")
    if found.left_out:
        terminal.say("What it does not carry:")
    for sentence in found.left_out:
        terminal.say(f"- {sentence}")


def _of_text(option: str) -> tuple[str, str]:
    name, sign, value = option.partition("=")
    if not (sign and name.isidentifier()):
        raise ParameterError(f"--option {option}: give a name and a value, as in precision=float32.")
    return name, value
