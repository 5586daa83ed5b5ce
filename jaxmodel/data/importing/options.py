"""What a user may decide about an import; everything else is found in the files."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal

from jaxmodel.case.measurements import Servo

Kind = Literal["cell", "motor", "robot"]
Sign = Literal["discharge-positive", "charge-positive"]
SplitAt = Literal["auto", "files", "rests", "steps"]


@dataclasses.dataclass(frozen=True)
class Options:
    """Decisions of the user; the default of each lets the files decide.

    Attributes:
        title: of the case; by default the names of the folders of the files.
        columns: by column of the case (`current_A`, `time_s`), the column of the files that holds it, or a formula of
            columns (`duty * supply_V`); '' for none.
        units: by column of the files, its unit.
        sign: what the sign of the current means in the files; for a motor, "discharge-positive" is positive when
            it drives.
        rows: a condition on columns of the files; only rows for which it holds are imported.
        flip: columns of the case whose sign is reversed.
        split_at: where runs begin: "files" for each file, "rests" after each long rest too, "steps" at each new cycle
            or step too; "auto" for each file and each restart of its clock.
        rest_minutes: the shortest rest that ends a run, in minutes.
        motors: which of several motors of one log are imported, as "left" or "motor1"; by default all.
        specimens: by name of one of several motors or cells, which files are of it, as a pattern: `{"A": "motorA_*"}`.
        check: names of the check runs; None for a proposal.
        ambient: ambient temperature [degC] of all runs.
        ambients: the same of the files of a pattern: `{"*_10c*": 10.0}`.
        load: of a motor or robot: "measured", "unknown", or the law that it follows: "free", "propeller", "gravity",
            "rolling"; None for a torque if one is measured, else unknown.
        load_numbers: of that law, by name: `{"mass_kg": 0.5, "arm_m": 0.1}`.
        drive: of a motor: "current" or "voltage", what its drive sets; None for what the columns say.
        controller: of a motor: "position" or "speed", of a closed loop.
        controller_numbers: its gains, by name: `{"k_p": 40.0, "k_d": 0.2, "limit": 10.0}`.
        brushless: of a brushless motor, what its current is: "rms" or "peak" (i_q) of a phase.
        brushless_numbers: its constants, by name: `{"R_line_to_line_ohm": 0.1, "KV_rpm_per_V": 170.0}`.
        constants: by input of the case, a value that holds throughout (`load_torque_Nm`: 0.0).
        initial_soc: state of charge at the start of all runs.
        capacity_Ah: capacity of the cell.
        preset: source of every parameter that is not stated.
        seconds_per_row: time from row to row [s], for files without a clock.
        cells_in_series: by which a voltage is divided, for a module that is modelled as one cell.
        parallel_cells: by which a current is divided, for the same.
        each_cell: each column of a single cell is a run of a cell of its own, in place of their mean.
        accept_unsettled_sign: keep the sign of the file where physics cannot settle it.
        sheet: of spreadsheets; of MATLAB files the variable, of JSON the key; names, or patterns such as 'run*'.
        encoding: of text.
        delimiter: of text.
        decimal: of text.

    Example:
        >>> from jaxmodel import Options, import_case
        >>> options = Options(ambient=23.0, capacity_Ah=3.0)
        >>> log = "examples/samsung_30q/cc1C.csv"
        >>> import_case(log, "cell", options=options, progress=False).capacity
        Stated(value=3.0, sd=0.06, why='stated')
    """

    title: str | None = None
    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)
    units: Mapping[str, str] = dataclasses.field(default_factory=dict)
    sign: str | None = None
    rows: str | None = None
    flip: tuple[str, ...] = ()
    split_at: str = "auto"
    rest_minutes: float = 30.0
    motors: tuple[str, ...] = ()
    specimens: Mapping[str, str] = dataclasses.field(default_factory=dict)
    check: tuple[str, ...] | None = None
    ambient: float | None = None
    ambients: Mapping[str, float] = dataclasses.field(default_factory=dict)
    load: str | None = None
    load_numbers: Mapping[str, float] = dataclasses.field(default_factory=dict)
    drive: str | None = None
    controller: str | None = None
    controller_numbers: Mapping[str, float] = dataclasses.field(default_factory=dict)
    brushless: str | None = None
    brushless_numbers: Mapping[str, float] = dataclasses.field(default_factory=dict)
    constants: Mapping[str, float] = dataclasses.field(default_factory=dict)
    initial_soc: float | None = None
    capacity_Ah: float | None = None
    preset: str | None = None
    seconds_per_row: float | None = None
    cells_in_series: int = 1
    parallel_cells: int = 1
    each_cell: bool = False
    accept_unsettled_sign: bool = False
    sheet: str | tuple[str, ...] | None = None
    encoding: str | None = None
    delimiter: str | None = None
    decimal: str | None = None

    @property
    def servo(self) -> Servo:
        """What is said of the drive of a motor."""
        return Servo(self.drive or "", self.controller or "")
