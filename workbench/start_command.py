"""What `jaxmodel start` takes; the command itself is in `workbench.commands.start_to_finish`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

_FILES = "Logs of one piece of hardware, in any format; or one folder with a case.toml."


def start(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=_FILES, show_default=False)],
    kind: Annotated[str, typer.Option(metavar="cell|motor|robot", help="What was measured.")] = "cell",
    out: Annotated[Path, typer.Option("--out", help="Folder for all results.")] = Path("results"),
    column: Annotated[
        list[str] | None,
        typer.Option(metavar='NAME="COLUMN"', help='As current_A="I/mA"; repeatable.', show_default=False),
    ] = None,
    unit: Annotated[
        list[str] | None,
        typer.Option(metavar='"COLUMN=UNIT"', help="The unit of a column; repeatable.", show_default=False),
    ] = None,
    constant: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="An input that never changes; repeatable.", show_default=False),
    ] = None,
    sign: Annotated[
        str | None,
        typer.Option(metavar="discharge-positive|charge-positive", help="Of the current.", show_default=False),
    ] = None,
    check: Annotated[
        list[str] | None,
        typer.Option(metavar="RUN", help='Hold out this run, or those of a pattern "*_n20*".', show_default=False),
    ] = None,
    ambient: Annotated[float | None, typer.Option(metavar="DEGC", help="Of all runs.", show_default=False)] = None,
    initial_soc: Annotated[float | None, typer.Option(help="At the start of all runs.", show_default=False)] = None,
    capacity: Annotated[float | None, typer.Option(metavar="AH", help="Of the cell.", show_default=False)] = None,
    again: Annotated[bool, typer.Option("--again", help="Repeat stages that are done.")] = False,
) -> None:
    """From raw logs to a diagnosis: import, parameterise, diagnose, report. An interrupted start goes on."""
    from workbench.commands.start_to_finish import start_to_finish

    start_to_finish(
        files,
        kind,
        out,
        again=again,
        pairs={"column": column or [], "unit": unit or [], "constant": constant or []},
        sign=sign,
        check=None if check is None else tuple(check),
        ambient=ambient,
        initial_soc=initial_soc,
        capacity_Ah=capacity,
    )
