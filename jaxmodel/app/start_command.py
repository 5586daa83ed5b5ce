"""What `jaxmodel start` takes; the command itself is in `jaxmodel.app.commands.start_to_finish`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jaxmodel.app.import_command import Ambient, Capacity, Check, Columns, Constants, InitialSoc, Sign, Units

_FILES = "Logs of one piece of hardware, in any format; or one folder with a case.toml."


def start(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=_FILES, show_default=False)],
    kind: Annotated[str, typer.Option(metavar="cell|motor|robot", help="What was measured.")] = "cell",
    out: Annotated[Path, typer.Option("--out", help="Folder for all results.")] = Path("results"),
    column: Columns = None,
    unit: Units = None,
    constant: Constants = None,
    sign: Sign = None,
    check: Check = None,
    ambient: Ambient = None,
    initial_soc: InitialSoc = None,
    capacity: Capacity = None,
    again: Annotated[bool, typer.Option("--again", help="Repeat stages that are done.")] = False,
) -> None:
    """From raw logs to a diagnosis: import, parameterise, diagnose, report. An interrupted start goes on."""
    from jaxmodel.app.commands.start_to_finish import start_to_finish

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
