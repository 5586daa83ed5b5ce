"""What `jaxmodel import` takes; the command itself is in `jaxmodel.app.commands.import_files`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

# Each is an option of `jaxmodel start` too: a message of the import may name any of them.
Columns = Annotated[
    list[str] | None,
    typer.Option(
        "--column",
        metavar='NAME="COLUMN"',
        help='As current_A="I/mA", or a formula, as voltage_V="duty * supply_V"; repeatable.',
        show_default=False,
    ),
]
Units = Annotated[
    list[str] | None,
    typer.Option("--unit", metavar='"COLUMN=UNIT"', help="The unit of a column; repeatable.", show_default=False),
]
Constants = Annotated[
    list[str] | None,
    typer.Option(
        "--constant", metavar="NAME=VALUE", help="An input that never changes; repeatable.", show_default=False
    ),
]
Load = Annotated[
    str | None,
    typer.Option(
        metavar="LAW[:NAME=VALUE,...]",
        help="What a load follows that is not measured: unknown, free, propeller, gravity, rolling.",
        show_default=False,
    ),
]
Drive = Annotated[
    str | None,
    typer.Option(metavar="voltage|current", help="What the drive of a motor sets.", show_default=False),
]
Controller = Annotated[
    str | None,
    typer.Option(
        metavar="position|speed:k_p=VALUE,...",
        help="Of a closed loop: the reference is its input.",
        show_default=False,
    ),
]
Brushless = Annotated[
    str | None,
    typer.Option(
        metavar="rms|peak:R_phase_ohm=VALUE,...",
        help="Of a brushless motor: what its phase current is.",
        show_default=False,
    ),
]
Rows = Annotated[
    str | None, typer.Option(metavar="CONDITION", help='Import these only, as "I_A > 0".', show_default=False)
]
Sign = Annotated[
    str | None, typer.Option(metavar="discharge-positive|charge-positive", help="Of the current.", show_default=False)
]
Flip = Annotated[
    list[str] | None, typer.Option(metavar="NAME", help="Reverse this column; repeatable.", show_default=False)
]
SplitAt = Annotated[str, typer.Option(metavar="auto|files|rests|steps", help="Where runs begin, besides each file.")]
RestMinutes = Annotated[float, typer.Option(help="The shortest rest that ends a run.")]
Check = Annotated[
    list[str] | None,
    typer.Option(
        "--check", metavar="RUN", help='Hold out this run, or those of a pattern "*_n20*".', show_default=False
    ),
]
Motors = Annotated[
    list[str] | None,
    typer.Option(
        "--motor",
        metavar="NAME",
        help="Of several motors in one log this one only, as left or motor1; repeatable.",
        show_default=False,
    ),
]
Specimens = Annotated[
    list[str] | None,
    typer.Option(
        "--specimen",
        metavar="NAME=PATTERN",
        help='Of several motors or cells the files of this one, as A="motorA_*"; repeatable.',
        show_default=False,
    ),
]
Ambient = Annotated[
    list[str] | None,
    typer.Option(
        "--ambient",
        metavar="DEGC|PATTERN=DEGC",
        help='Of all runs, or of the files of a pattern, as "*_10c*=10"; repeatable.',
        show_default=False,
    ),
]
InitialSoc = Annotated[float | None, typer.Option(help="At the start of all runs.", show_default=False)]
Capacity = Annotated[float | None, typer.Option(metavar="AH", help="Of the cell.", show_default=False)]
Title = Annotated[str | None, typer.Option(help="Of the case.", show_default=False)]
Preset = Annotated[str | None, typer.Option(help="For what the files do not tell.", show_default=False)]
SecondsPerRow = Annotated[float | None, typer.Option(help="For files without a clock.", show_default=False)]
CellsInSeries = Annotated[int, typer.Option(help="Of a module, to divide its voltage by.")]
ParallelCells = Annotated[int, typer.Option(help="Of a module, to divide its current by.")]
EachCell = Annotated[
    bool, typer.Option("--each-cell", help="Of a module: a run of each cell whose voltage is logged, not their mean.")
]
Sheet = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME|PATTERN",
        help="Of a spreadsheet; a MATLAB variable; a key of JSON; 'run*' for several. Repeatable.",
        show_default=False,
    ),
]
Encoding = Annotated[str | None, typer.Option(help="Of text, as cp1252.", show_default=False)]
Delimiter = Annotated[str | None, typer.Option(help="Of text.", show_default=False)]
Decimal = Annotated[str | None, typer.Option(metavar=".|,", help="Of text.", show_default=False)]


def import_(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Logs of one piece of hardware, in any format.", show_default=False),
    ],
    kind: Annotated[str, typer.Option(metavar="cell|motor|robot", help="What was measured.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", metavar="CASE", help="Folder for the case.", show_default=False)],
    title: Title = None,
    column: Columns = None,
    unit: Units = None,
    constant: Constants = None,
    load: Load = None,
    drive: Drive = None,
    controller: Controller = None,
    brushless: Brushless = None,
    rows: Rows = None,
    sign: Sign = None,
    flip: Flip = None,
    split_at: SplitAt = "auto",
    rest_minutes: RestMinutes = 30.0,
    motor: Motors = None,
    specimen: Specimens = None,
    check: Check = None,
    ambient: Ambient = None,
    initial_soc: InitialSoc = None,
    capacity: Capacity = None,
    preset: Preset = None,
    seconds_per_row: SecondsPerRow = None,
    cells_in_series: CellsInSeries = 1,
    parallel_cells: ParallelCells = 1,
    each_cell: EachCell = False,
    sheet: Sheet = None,
    encoding: Encoding = None,
    delimiter: Delimiter = None,
    decimal: Decimal = None,
    answer_only: Annotated[bool, typer.Option("--answer-only", help="Write the case, no pictures.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Write over a case that was edited since.")] = False,
) -> None:
    """Import raw logs of a cycler or bench as a case: columns, units, signs, clocks and runs are found and checked."""
    from jaxmodel.app.commands.import_files import import_files

    import_files(
        files,
        kind,
        out,
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
        force=force,
        answer_only=answer_only,
    )
