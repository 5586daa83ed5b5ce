"""Options that `jaxmodel diagnose` and `jaxmodel start` take both."""

from __future__ import annotations

from typing import Annotated

import typer

Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="FILE.py:CLASS",
        help="An effect of your own, added to the catalogue; may be given several times.",
        show_default=False,
    ),
]
Add = Annotated[
    list[str] | None,
    typer.Option(
        "--add", metavar="NAME", help="Add this effect, whatever the data say; seek no other.", show_default=False
    ),
]
With = Annotated[
    list[str] | None,
    typer.Option(
        "--with", metavar="NAME", help="Add this effect, whatever the data say, and go on looking.", show_default=False
    ),
]
Without = Annotated[
    list[str] | None, typer.Option("--without", metavar="NAME", help="Rule this effect out.", show_default=False)
]
