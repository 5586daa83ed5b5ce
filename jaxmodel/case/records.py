"""A measurement case: stated hardware and its runs.

All values are plain numbers in the units of their names. `jaxmodel.case.reading` makes a case from files or DataFrames,
`jaxmodel.case.build` a model from a case.
"""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.in_short import html_of, text_of
from jaxmodel.base.late_binding import late_bound
from jaxmodel.case.exported import Exported
from jaxmodel.case.known import Known, MotorTable, Specimen, Table, Tolerance
from jaxmodel.case.measurements import OPEN, Kind, Measured, Servo, file_label, vocabulary
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.controllers import SERVO
from jaxmodel.model.curves import CURVE_NAMES
from jaxmodel.model.parameters import info
from jaxmodel.model.ports import Effect

# A capacity this far from the paper's, as a share of it, is that of another cell. Assumed.
_ANOTHER_CELL = 0.2


@dataclasses.dataclass(frozen=True, eq=False)
class Run:
    """One run of a case.

    Attributes:
        name: the file's name without its ending.
        file: the CSV as case.toml names it.
        split: "fit" for runs that may be fitted, "check" for runs that are never fitted.
        label: free text.
        initial_soc: state of charge at the first row.
        overrides: parameters of the case that are different in this run.
        measured: times, inputs and outputs.
        source: the CSV's path; None for a run from a DataFrame.
        initial_cell_temperature: at the first row, degC; None if not stated.
        tolerance: by column, the acceptable error in this run; that of the case for other columns.
        ambient_degC: the stated constant ambient temperature of this run; None if it is a column.
        specimen: which of several like motors or cells was measured, as "left"; "" where the case has one alone.

    Example:
        >>> from jaxmodel import read_case
        >>> case = read_case("examples/samsung_30q")
        >>> run = case.runs[0]
        >>> run.name, run.split, run.to_dataframe().columns[0]
        ('cc1C', 'fit', 'time_s')
    """

    name: str
    file: str
    split: Literal["fit", "check"]
    label: str
    initial_soc: Known
    overrides: dict[str, Known]
    measured: Measured
    source: Path | None
    initial_cell_temperature: Known | None = None
    tolerance: dict[str, Tolerance] = dataclasses.field(default_factory=dict)
    ambient_degC: float | None = None
    specimen: str = ""

    def driven_by(self, inputs: Mapping[str, np.ndarray]) -> Run:
        """Return the run with other inputs and unchanged readings."""
        return dataclasses.replace(self, measured=dataclasses.replace(self.measured, inputs=dict(inputs)))

    def to_dataframe(self) -> pd.DataFrame:
        """Return the run as a table: `time_s`, inputs and readings by column name, a row for each time."""
        return pd.DataFrame({"time_s": self.measured.time_s, **self.measured.inputs, **self.measured.outputs})

    def __repr__(self) -> str:
        return f"<Run {self.name}: {self.split}, {self.measured.time_s.size} rows>"

    def _repr_html_(self) -> str:
        columns = {"time_s": self.measured.time_s, **self.measured.inputs, **self.measured.outputs}
        return html_of(repr(self)[1:-1], ((name, text_of(values)) for name, values in columns.items()))


@dataclasses.dataclass(frozen=True, eq=False)
class Case:
    """Hardware as far as it is known, its sensors, and its runs.

    `read_case` makes a case from files, `Case.from_dataframes` from tables in memory.

    Attributes:
        name: the folder's name.
        path: the TOML file; None for a case from DataFrames.
        title: free text, by default the name.
        kind: a key of `KINDS`.
        preset: source of every parameter that is not stated here.
        parameters: scalar parameters by name, without `initial_soc`, which belongs to each run.
        tables: curves by name (`ocv`, `R_ints`, `R_TS`, `R_TL`, `C_TS`, `C_TL`).
        effects: effects turned on: their parameters by name, and the `column` of a sensor effect.
        sensors: by column, the sd of its white noise before rounding, in the column's unit.
        runs: in the order of the file; at least one.
        cutoff: end of a discharge: `soc`, `voltage_V`, both or neither.
        tolerance: by column of a reading, the acceptable error, in the column's unit.
        effect_sd: by effect and parameter, the sd of the value in `effects`; others are exact.
        own_effects: the user's own effect classes by name; they are used like those of the catalogue.
        motor_tables: curves of a motor by name (`friction`, `torque_factor`).
        load: of a motor or robot: "measured", "unknown" or a law (docs/cases.md); "" where its columns say it.
        servo: what it says of the drive of its motor.
        specimens: by the specimens that its runs name, what each has of its own.
        brushless: what a current of its brushless motor is, "rms" or "peak"; "" for a motor with brushes.

    Example:
        >>> import pandas as pd
        >>> from jaxmodel import Case
        >>> rows = {"time_s": [0.0, 10.0, 20.0], "current_A": 1.0, "ambient_degC": 20.0, "voltage_V": 4.1}
        >>> frame = pd.DataFrame(rows)
        >>> Case.from_dataframes({"rest": frame}, kind="cell")
        <Case case: cell, 1 fit and 0 check runs>
    """

    name: str
    path: Path | None
    title: str
    kind: Literal["cell", "motor", "robot"]
    preset: str
    parameters: dict[str, Known]
    tables: dict[str, Table]
    effects: dict[str, dict[str, float | str]]
    sensors: dict[str, float]
    runs: tuple[Run, ...]
    cutoff: dict[str, float]
    tolerance: dict[str, Tolerance] = dataclasses.field(default_factory=dict)
    effect_sd: dict[str, dict[str, float]] = dataclasses.field(default_factory=dict)
    own_effects: Mapping[str, type[Effect]] = dataclasses.field(default_factory=dict)
    motor_tables: dict[str, MotorTable] = dataclasses.field(default_factory=dict)
    load: str = ""
    servo: Servo = OPEN
    specimens: dict[str, Specimen] = dataclasses.field(default_factory=dict)
    brushless: str = ""

    @classmethod
    def from_dataframes(
        cls,
        frames: Mapping[Any, pd.DataFrame],
        *,
        kind: Literal["cell", "motor", "robot"],
        load: str | None = None,
        drive: str | None = None,
        controller: str | None = None,
        brushless: Mapping[str, Any] | None = None,
        name: str = "case",
        title: str = "",
        preset: str = "paper",
        parameters: Mapping[str, Any] | None = None,
        tables: Mapping[str, Mapping[str, Any]] | None = None,
        effects: Mapping[str, Mapping[str, Any]] | None = None,
        sensors: Mapping[str, float] | None = None,
        tolerance: Mapping[str, Any] | None = None,
        cutoff: Mapping[str, float] | None = None,
        specimens: Mapping[str, Mapping[str, Any]] | None = None,
        check: Collection[Any] = (),
        runs: Mapping[Any, Mapping[str, Any]] | None = None,
        own_effects: Iterable[type[Effect]] = (),
    ) -> Case:
        """Make a case from one DataFrame per run; all other arguments correspond to case.toml (docs/cases.md).

        Args:
            frames: by name of the run, a table with the columns of a run's CSV: `time_s` [s] (or as the index), inputs
                and readings with their units in their names. Currents are positive on discharge.
            kind: "cell", "motor" or "robot".
            load: of a motor or robot: "measured", "unknown", "free", "propeller", "gravity" or "rolling".
            drive: of a motor: "current" or "voltage", what its drive sets; by default the columns say it.
            controller: "position" or "speed", of a closed loop; its gains are those of an effect.
            brushless: of a brushless motor, its [brushless] block: `{"current": "rms", "R_phase_ohm": 0.02}`.
            name: of the case and its results.
            title: free text.
            preset: source of every parameter that is not stated here: a key of `jaxmodel.case.presets.PRESETS`, or the
                path of a file of that form, which ends in `.toml`.
            parameters: scalar parameters by name: a number is exact, `(value, sd)` has a standard deviation.
            tables: curves by name: `{"ocv": {"soc": [...], "voltage_V": [...]}}`.
            effects: effects turned on, with their parameters: `{"self_heating": {}}`.
            sensors: by column, the sd of its noise.
            tolerance: by column, the acceptable error: an rms, or `{"rms": , "max": }`.
            cutoff: end of a discharge: `soc`, `voltage_V`.
            specimens: by name of a motor or cell, the entries of its [specimens.NAME] block.
            check: names of the check runs; all others are fit runs.
            runs: by name of a run, the entries of its [[runs]] block in case.toml: `initial_soc`, `label`,
                `ambient_degC`, `initial_cell_temperature_degC`, `specimen`, and parameters that are different in it.
            own_effects: your own effect classes, used like those of the catalogue.

        Raises:
            MeasurementError: a table or entry cannot be used; the message says where and what to do.
            ParameterError: a parameter is unknown, out of its bounds or of the wrong form.
            EffectError: one of your own effects is incomplete, or has the name of another.
        """
        entries = {"parameters": {**(parameters or {}), **(tables or {})}, "effects": effects or {}}
        entries |= {"sensors": sensors or {}, "tolerance": tolerance or {}, "cutoff": cutoff or {}}
        entries |= {"title": title, "kind": kind, "preset": preset, "specimens": specimens or {}}
        if load is not None:
            entries["load"] = load
        of_drive = (("drive", drive), ("controller", controller), ("brushless", brushless))
        entries |= {name: said for name, said in of_drive if said is not None}
        case_of_frames = late_bound("jaxmodel.case.reading:case_of_frames")
        return case_of_frames(frames, name, check, runs or {}, entries, own_effects)

    @property
    def label(self) -> str:
        """Return the name of the case in messages: its file, or its name if it has none."""
        return f"case '{self.name}'" if self.path is None else file_label(self.path)

    @property
    def vocabulary(self) -> Kind:
        """Return the columns that its runs may have."""
        return vocabulary(self.kind, self.load, self.servo)

    @property
    def catalogue(self) -> dict[str, type[Effect]]:
        """Return every effect that may act in the case by name: the catalogue, a servo's and the user's own."""
        return {**CATALOGUE, **SERVO, **self.own_effects}

    @property
    def files(self) -> list[Path]:
        """Return the files that the case was read from."""
        return [path for path in (self.path, *(run.source for run in self.runs)) if path is not None]

    def of_specimens(self) -> dict[str, Case]:
        """Return a case for each motor or cell that its runs name, by that name; one of a single one is itself.

        Example:
            >>> import pandas as pd
            >>> from jaxmodel import Case
            >>> rows = {"time_s": [0.0, 1.0], "voltage_V": 6.0, "speed_rad_s": 100.0, "current_A": 1.0}
            >>> frame = pd.DataFrame(rows | {"ambient_degC": 20.0})
            >>> sides = {side: {"specimen": side} for side in ("left", "right")}
            >>> case = Case.from_dataframes({"left": frame, "right": frame}, kind="motor", load="unknown", runs=sides)
            >>> list(case.of_specimens())
            ['left', 'right']
        """
        if not self.specimens:
            return {self.name: self}
        return {
            name: dataclasses.replace(
                self, name=name, specimens={name: own}, runs=tuple(run for run in self.runs if run.specimen == name)
            )
            for name, own in self.specimens.items()
        }

    def to_dataframes(self) -> dict[str, pd.DataFrame]:
        """Return the runs as tables by name: `time_s`, inputs and readings."""
        return {run.name: run.to_dataframe() for run in self.runs}

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each run: split, rows, duration, initial SOC, and its readings."""
        return pd.DataFrame(
            {
                "run": run.name,
                "split": run.split,
                "rows": run.measured.time_s.size,
                "duration_s": run.measured.time_s[-1] - run.measured.time_s[0],
                "initial_soc": run.initial_soc.value,
                "inputs": ", ".join(run.measured.inputs),
                "readings": ", ".join(run.measured.outputs),
                "label": run.label,
            }
            for run in self.runs
        )

    def summary(self) -> str:
        """Return the case in a few lines: hardware, uncertain parameters, runs."""
        uncertain = [f"{name} = {k.value:g} ± {k.sd:g}" for name, k in self.parameters.items() if k.sd is not None]
        lines = [
            f"{self.title} ({self.kind}, preset {Path(self.preset).name})",
            f"uncertain: {', '.join(uncertain) or 'nothing'}",
            f"tables: {', '.join([*self.tables, *self.motor_tables]) or 'none'}",
            *([f"formulas of the paper's cell: {', '.join(self.formulas)}"] if self.formulas else []),
            f"effects: {', '.join(self.effects) or 'none'}",
            *([f"specimens: {', '.join(self.specimens)}"] if self.specimens else []),
            self.to_dataframe().to_string(index=False, max_colwidth=60),
        ]
        return "\n".join(lines)

    @property
    def formulas(self) -> tuple[str, ...]:
        """Return the curves of a cell other than the paper's for which the case states no table."""
        paper_Ah = info("capacity_Ah").default
        capacity = self.parameters.get("capacity_Ah", Known(paper_Ah)).value
        if self.kind == "motor" or not (self.tables or abs(capacity / paper_Ah - 1.0) > _ANOTHER_CELL):
            return ()
        return tuple(name for name in CURVE_NAMES if name not in self.tables)

    def predict(self, frame: pd.DataFrame, **stated: Any) -> pd.DataFrame:
        """Return the readings that the model of the case predicts for new inputs.

        They are what `simulate_case` gives for a run of these rows, cut-off included. A run with the name of one of the
        case starts as that one is stated. Any other one starts charged (`initial_soc` 1), at rest and at ambient
        temperature, unless it is stated otherwise.

        Args:
            frame: a row for each time, with the columns of a run's CSV, units in their names (docs/cases.md): `time_s`
                (or as the index) and inputs. `run` names the run of each row, if there are several. Readings are not
                needed; only those of the first row are used, of a motor that runs already. What a run states of its own
                may be a column, with one number in all its rows: `initial_soc`, `specimen`, or a parameter.
            stated: the same for all runs: `initial_soc=0.8`, `ambient_degC=25.0`, `cycles=300`.

        Returns:
            For each row of the table, under its index, every reading by column name, and `valid`: False where the
            equations are outside their valid range. Rows after a cut-off are empty.

        Raises:
            MeasurementError: a column is missing, unknown or unusable; the message says which, where and what to do.
            ParameterError: a parameter is unknown, out of its bounds or of the wrong form.

        Example:
            >>> import pandas as pd
            >>> from jaxmodel import read_case
            >>> case = read_case("examples/samsung_30q")
            >>> frame = pd.DataFrame({"time_s": [0.0, 60.0, 120.0], "current_A": 6.0, "ambient_degC": 25.0})
            >>> case.predict(frame, initial_soc=0.5)["voltage_V"].round(2).tolist()
            [3.53, 3.38, 3.33]
        """
        return late_bound("jaxmodel.case.prediction:predict")(self, frame, stated)

    def write(self, folder: str | Path) -> Path:
        """Write the case as a folder with `case.toml` and a CSV for each run, which `read_case` takes.

        Returns:
            The TOML file.

        Raises:
            MeasurementError: a file of the case itself would be overwritten.
        """
        return late_bound("jaxmodel.case.writing:write_folder")(self, Path(folder))

    def export(self, to: str, out: str | Path | None = None, **options: Any) -> Exported:
        """Return the model of the case in the format of another tool, and write it to a file if one is given.

        Args:
            to: the format: "actuator", "bdf", "c", "c-filter", "fmu", "mujoco", "pybamm" or "simscape", or the name
                of one that another package adds (docs/how_to/export.md).
            out: the file; the folder of a format that writes several.
            options: of the format, such as `precision="float32"` of "c".

        Returns:
            Its `content`, and in `left_out` what the file does not carry, a sentence each.

        Raises:
            ParameterError: there is no such format, it has no such option, or it cannot hold such a case.

        Example:
            >>> from jaxmodel import read_case
            >>> read_case("examples/samsung_30q").export("c").content.splitlines()[12]
            'typedef struct {'
        """
        return late_bound("jaxmodel.export.formats:export_case")(self, to, out, **options)

    def __repr__(self) -> str:
        fitted = sum(run.split == "fit" for run in self.runs)
        return f"<Case {self.name}: {self.kind}, {fitted} fit and {len(self.runs) - fitted} check runs>"

    def _repr_html_(self) -> str:
        return f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>{self.to_dataframe().to_html(index=False, border=0)}"


def chosen_run(name: str | None, names: Iterable[str]) -> str:
    """Return the name of a run, the first by default; raise MeasurementError if there is no such run."""
    names = list(names)
    chosen = names[0] if name is None else name
    if chosen not in names:
        hint = nearest(chosen, names) or f" The runs are {', '.join(names)}."
        raise MeasurementError(f"plot: no run is called '{chosen}'.{hint}")
    return chosen
