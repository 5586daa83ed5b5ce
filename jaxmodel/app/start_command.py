"""What `jaxmodel start` takes; the command itself is in `jaxmodel.app.commands.start_to_finish`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from jaxmodel.app import import_command as of_import
from jaxmodel.app.diagnose_options import Add, Effects, With, Without

_FILES = "Logs of one piece of hardware, in any format; or one folder with a case.toml."


def start(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help=_FILES, show_default=False)],
    kind: Annotated[str, typer.Option(metavar="cell|motor|robot", help="What was measured.")] = "cell",
    out: Annotated[Path, typer.Option("--out", help="Folder for all results.")] = Path("results"),
    title: of_import.Title = None,
    column: of_import.Columns = None,
    unit: of_import.Units = None,
    constant: of_import.Constants = None,
    load: of_import.Load = None,
    drive: of_import.Drive = None,
    controller: of_import.Controller = None,
    brushless: of_import.Brushless = None,
    rows: of_import.Rows = None,
    sign: of_import.Sign = None,
    flip: of_import.Flip = None,
    split_at: of_import.SplitAt = "auto",
    rest_minutes: of_import.RestMinutes = 30.0,
    motor: of_import.Motors = None,
    specimen: of_import.Specimens = None,
    check: of_import.Check = None,
    ambient: of_import.Ambient = None,
    initial_soc: of_import.InitialSoc = None,
    capacity: of_import.Capacity = None,
    preset: of_import.Preset = None,
    seconds_per_row: of_import.SecondsPerRow = None,
    cells_in_series: of_import.CellsInSeries = 1,
    parallel_cells: of_import.ParallelCells = 1,
    each_cell: of_import.EachCell = False,
    sheet: of_import.Sheet = None,
    encoding: of_import.Encoding = None,
    delimiter: of_import.Delimiter = None,
    decimal: of_import.Decimal = None,
    effect: Effects = None,
    add: Add = None,
    with_effects: With = None,
    without: Without = None,
    again: Annotated[bool, typer.Option("--again", help="Repeat stages that are done.")] = False,
) -> None:
    """From raw logs to a diagnosis: import, parameterise, diagnose, report. An interrupted start goes on."""
    from jaxmodel.app.commands.start_to_finish import start_to_finish

    start_to_finish(
        files,
        kind,
        out,
        again=again,
        effects=effect or [],
        search={"add": add or [], "with_effects": with_effects or [], "without": without or []},
        columns=column,
        units=unit,
        constants=constant,
        specimens=specimen,
        title=title,
        load=load,
        drive=drive,
        controller=controller,
        brushless=brushless,
        rows=rows,
        sign=sign,
        flip=flip,
        split_at=split_at,
        rest_minutes=rest_minutes,
        motors=motor,
        check=check,
        ambient=ambient,
        initial_soc=initial_soc,
        capacity_Ah=capacity,
        preset=preset,
        seconds_per_row=seconds_per_row,
        cells_in_series=cells_in_series,
        parallel_cells=parallel_cells,
        each_cell=each_cell,
        sheet=sheet,
        encoding=encoding,
        delimiter=delimiter,
        decimal=decimal,
    )
