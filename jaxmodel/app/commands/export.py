"""`jaxmodel export`: the model of a case in the format of another tool."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxmodel.app import terminal
from jaxmodel.app.commands.start import read_case_with, start
from jaxmodel.data.importing.written import pairs
from jaxmodel.export.formats import export_case


def export_to(path: Path, to: str, out: Path, effects: Sequence[str], options: Sequence[str]) -> None:
    """Write the file or files, and print what it does not carry.

    Raises:
        UserError: the case, the format or the file cannot be used.
    """
    given = pairs(options, "--option", "a name and a value, as in precision=float32")
    case = read_case_with(path, effects)
    start(None)
    found = export_case(case, to, out, **given)
    for name in found.files:
        terminal.say(f"{out / name}")
    terminal.say(f"{out} has {'the runs' if found.files else 'the model'} of {case.name}.")
    if found.left_out:
        terminal.say("What it does not carry:")
    for sentence in found.left_out:
        terminal.say(f"- {sentence}")
