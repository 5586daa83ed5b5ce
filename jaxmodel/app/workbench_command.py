"""What `jaxmodel workbench` takes; the command itself is in `jaxmodel.app.commands.workbench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def workbench(
    data: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[CASE|FILE...]", help="A case, or raw files of a bench.", show_default=False),
    ] = None,
    kind: Annotated[str, typer.Option(metavar="cell|motor|robot", help="What raw files measured.")] = "cell",
    ambient: Annotated[
        float | None, typer.Option(metavar="DEGC", help="Of all runs in raw files.", show_default=False)
    ] = None,
    host: Annotated[str, typer.Option(help="Address to listen on; another than loopback needs --token.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="To listen on.")] = 8765,
    token: Annotated[
        str | None,
        typer.Option(metavar="WORD", help="Lets a browser in; by default a random one.", show_default=False),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="For the sessions; by default .jaxmodel/workbench at home.", show_default=False
        ),
    ] = None,
    forget: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar="DAYS", help="Remove sessions that were not used for so long.", show_default=False
        ),
    ] = None,
    open_page: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in a browser.")] = True,
) -> None:
    """Open the workbench in a browser: compare, see where the model fails, learn what is missing, add it."""
    from jaxmodel.app.commands.workbench import open_workbench

    open_workbench(
        data or [], kind, ambient,
        host=host, port=port, token=token, folder=folder, show=open_page, forget_days=forget,
    )  # fmt: skip
