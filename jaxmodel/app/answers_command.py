"""What `jaxmodel compare-answers` and `history` take; the commands are in `jaxmodel.app.commands.compare_answers`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

_FOLDER = "The folder that a diagnosis was written to, a folder of such folders, or an answer.json."
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def compare_answers(
    before: Annotated[Path, typer.Argument(metavar="A", help=_FOLDER, show_default=False)],
    after: Annotated[
        Path | None,
        typer.Argument(metavar="[B]", help="The other; without it, A against the one before it.", show_default=False),
    ] = None,
    json: Json = False,
) -> None:
    """Show what changed between two diagnoses: verdict, names, numbers, errors by run, data and version."""
    from jaxmodel.app.commands.compare_answers import compare

    compare(before, after, as_json=json)


def history(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="The folder that a case's diagnoses were written to.")
    ] = Path("results"),
    json: Json = False,
) -> None:
    """List the diagnoses of a case: what was diagnosed when, with verdict and errors."""
    from jaxmodel.app.commands.compare_answers import history

    history(folder, as_json=json)
