"""One run's CSV as arrays: the vocabulary of its columns, and a reader that names the line that is wrong.

Units are in the column names and are never converted here. A row's inputs hold over the interval that ends at
its time, and its readings are taken at that time.
"""

from __future__ import annotations

import dataclasses
import itertools
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.units import LARGEST, ending_of, unit_of
from jaxmodel.case import run_csv


@dataclasses.dataclass(frozen=True)
class Kind:
    """The columns that one kind of case knows.

    Attributes:
        required_inputs: inputs that every run has.
        outputs: what a sensor can see; any of them may be in a CSV.
        alternatives: groups of inputs of which a run has one. Where several are there, the first is the input,
            and the others must be outputs of this kind (a motor driven by its voltage measures its current).
        optional_inputs: inputs that count as zero where they are absent.
        only_with: an input, and the other input without which it means nothing.
    """

    required_inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    alternatives: tuple[tuple[str, ...], ...] = ()
    optional_inputs: tuple[str, ...] = ()
    only_with: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def columns(self) -> tuple[str, ...]:
        """Every column name of this kind but the time, each once."""
        chosen = itertools.chain.from_iterable(self.alternatives)
        return tuple(dict.fromkeys((*self.required_inputs, *chosen, *self.optional_inputs, *self.outputs)))


KINDS: dict[str, Kind] = {
    "cell": Kind(
        required_inputs=("current_A", "ambient_degC"),
        outputs=("voltage_V", "cell_temperature_degC", "soc"),
    ),
    "motor": Kind(
        required_inputs=("ambient_degC",),
        alternatives=(("load_torque_Nm", "speed_rad_s"), ("voltage_V", "current_A")),
        outputs=("current_A", "speed_rad_s", "winding_temperature_degC", "case_temperature_degC"),
    ),
    "robot": Kind(
        required_inputs=("ambient_degC",),
        alternatives=(("duty", "V_set"), ("load_torque_Nm", "incline_deg", "speed_rad_s")),
        optional_inputs=("acceleration_m_s2", "flipper_torque_Nm", "flipper_duty", "arm_torque_Nm", "arm_duty"),
        only_with={
            "acceleration_m_s2": "incline_deg",
            "flipper_torque_Nm": "flipper_duty",
            "flipper_duty": "flipper_torque_Nm",
            "arm_torque_Nm": "arm_duty",
            "arm_duty": "arm_torque_Nm",
        },
        outputs=(
            "pack_voltage_V",
            "pack_current_A",
            "motor_current_A",
            "speed_rad_s",
            "cell_temperature_degC",
            "winding_temperature_degC",
            "case_temperature_degC",
            "soc",
        ),
    ),
}
# The laws that a load may follow, and the columns of a run that each reads and predicts; their torque is that of
# `jaxmodel.effects.loads`, which needs JAX, as reading a table does not.
COLUMNS_OF_LAWS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "free": ((), ()),
    "propeller": ((), ()),
    "gravity": ((), ("position_rad",)),
    "rolling": (("incline_deg",), ()),
}


# What a drive sets, and what the reference of a controller is.
SET_BY = {"voltage": "voltage_V", "current": "current_A"}
REFERENCES = {"position": "reference_position_rad", "speed": "reference_speed_rad_s"}


class Servo(NamedTuple):
    """What a case says of the drive of its motor.

    Attributes:
        drive: a key of `SET_BY`; "" where the columns of a run say it.
        controller: a key of `REFERENCES`; "" for an open loop.
    """

    drive: str = ""
    controller: str = ""


OPEN = Servo()


def vocabulary(kind: str, load: str = "", servo: Servo = OPEN) -> Kind:
    """Return the columns of a kind of case, under what it says of its load and drive.

    A measured torque or incline loads the model. Without one, a measured speed drives it, so that nothing of the load
    need be known (`load = "unknown"` if a torque is there too). A law takes the place of both: the speed is a reading,
    and a measured torque is added to that of the law.

    The position of a motor whose drive is stated is a reading. Under a controller its reference is the input, and what
    the drive sets is a reading.

    Args:
        kind: a key of `KINDS`.
        load: "", "measured", "unknown", or a key of `COLUMNS_OF_LAWS`.
        servo: what the case says of its drive.
    """
    known = _of_drive(KINDS[kind], servo) if kind == "motor" else KINDS[kind]
    if not load or kind == "cell":
        return known
    (group,) = (group for group in known.alternatives if "load_torque_Nm" in group)
    others = tuple(one for one in known.alternatives if one != group)
    if load == "measured":
        return dataclasses.replace(known, alternatives=(*others, tuple(n for n in group if n != "speed_rad_s")))
    if load == "unknown":
        return dataclasses.replace(known, alternatives=(*others, ("speed_rad_s",)))
    inputs, outputs = COLUMNS_OF_LAWS[load]
    of_slope = {name for name, other in known.only_with.items() if other == "incline_deg"}
    return dataclasses.replace(
        known,
        alternatives=others,
        optional_inputs=(*(n for n in known.optional_inputs if n not in of_slope), "load_torque_Nm", *inputs),
        only_with={name: other for name, other in known.only_with.items() if name not in of_slope},
        outputs=tuple(dict.fromkeys((*known.outputs, *outputs))),
    )


def _of_drive(known: Kind, servo: Servo) -> Kind:
    if servo == OPEN:
        return known
    (group,) = (group for group in known.alternatives if "voltage_V" in group)
    others = tuple(one for one in known.alternatives if one != group)
    outputs = (*known.outputs, "position_rad")
    if servo.controller:
        required = (*known.required_inputs, REFERENCES[servo.controller])
        read = outputs if servo.drive == "current" else ("voltage_V", *outputs)
        return dataclasses.replace(known, required_inputs=required, alternatives=others, outputs=read)
    set_by = SET_BY[servo.drive]
    return dataclasses.replace(
        known,
        required_inputs=(*known.required_inputs, set_by),
        alternatives=others,
        outputs=tuple(name for name in outputs if name != set_by),
    )


_UNITLESS = {"duty": "numbers from -1 to 1", "V_set": "V, 0 to 5", "soc": "fractions of 1"}

# Of a TOML or JSON file: the largest of ours have some hundred numbers, and a parser takes a second for a megabyte.
_MOST_BYTES = 8 * 2**20
# What the temperature of surroundings can be.
AMBIENT_RANGE_DEGC = (-90.0, 200.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Measured:
    """One run as measured; every array has shape (rows,).

    Attributes:
        time_s: strictly increasing times [s], at least two.
        inputs: by column name, finite everywhere. An optional input that is not in the CSV is not here.
        outputs: by column name, NaN where the field was empty.
    """

    time_s: np.ndarray
    inputs: dict[str, np.ndarray]
    outputs: dict[str, np.ndarray]


def read_measurements(
    path: Path, kind: str, ambient_degC: float | None = None, load: str = "", servo: Servo = OPEN
) -> Measured:
    """Read and check the CSV of one run.

    Args:
        path: the CSV file: UTF-8, comma separated, `time_s` first; lines that start with '#' may precede the header.
        kind: a key of `KINDS`.
        ambient_degC: the ambient temperature of the whole run [degC], for a CSV without that column.
        load: what the case says of its load, as of `vocabulary`.
        servo: what it says of its drive.

    Returns:
        Times, inputs and outputs, in the units of the column names.

    Raises:
        MeasurementError: the file cannot be used; the message names file, line and column.
    """
    label = file_label(path)
    header = run_csv.read_header(path, label)
    where = f"{label}, line {header.line}"
    known = vocabulary(kind, load, servo)
    _check_header(header.names, kind, known, where)
    inputs, outputs = _roles(header.names, kind, known, ambient_degC, where)
    columns = run_csv.read_numbers(path, header, label)
    if (count := columns["time_s"].size) < 2:
        raise MeasurementError(
            f"{label} has {count} row{'' if count == 1 else 's'} of readings below its header; "
            "a run needs at least two."
        )

    def place(row: int) -> str:
        return f"{label}, line {run_csv.line_of_row(path, label, row)}"

    return _measured(columns, inputs, outputs, ambient_degC, label, place)


def measurements_of(
    frame: pd.DataFrame, kind: str, ambient_degC: float | None, label: str, load: str = "", servo: Servo = OPEN
) -> Measured:
    """Check the table of one run.

    Args:
        frame: the columns of a run's CSV, in any order; `time_s` may be the index. A missing reading is NaN.
        kind: a key of `KINDS`.
        ambient_degC: the ambient temperature of the whole run [degC], for a table without that column.
        label: how messages name the table.
        load: what the case says of its load, as of `vocabulary`.
        servo: what it says of its drive.

    Raises:
        MeasurementError: the table cannot be used; the message names row and column.
    """
    if "time_s" not in frame.columns and frame.index.name == "time_s":
        frame = frame.reset_index()
    header = [str(name) for name in frame.columns]
    if "time_s" not in header:
        raise MeasurementError(f"{label} has no column 'time_s', the time in seconds of each row; add it.")
    header = ["time_s", *(name for name in header if name != "time_s")]
    known = vocabulary(kind, load, servo)
    _check_header(header, kind, known, label)
    inputs, outputs = _roles(header, kind, known, ambient_degC, label)
    if len(frame) < 2:
        raise MeasurementError(f"{label} has {len(frame)} rows; a run needs at least two.")
    columns = {name: _floats(pd.Series(frame[name]), f"{label}, column '{name}'") for name in header}
    return _measured(columns, inputs, outputs, ambient_degC, label, lambda row: f"{label}, row {row}")


def _floats(column: pd.Series, where: str) -> np.ndarray:
    """Return a column as numbers, finite or NaN."""
    if column.dtype.kind in "mM":
        raise MeasurementError(f"{where} holds dates or durations; give seconds, as in (t - t[0]).dt.total_seconds().")
    try:
        values = column.to_numpy(dtype=float, na_value=np.nan, copy=True)
    except (TypeError, ValueError):
        raise MeasurementError(f"{where} holds {column.dtype}, not numbers; convert it first.") from None
    if np.isinf(values).any():
        raise MeasurementError(f"{where}, row {int(np.isinf(values).argmax())} is not finite; correct it or set NaN.")
    return values


def _measured(
    columns: dict[str, np.ndarray],
    inputs: Sequence[str],
    outputs: Sequence[str],
    ambient_degC: float | None,
    label: str,
    place: Callable[[int], str],
) -> Measured:
    """Return the columns of a run; raise MeasurementError for a gap in an input, an order, or a unit that is wrong."""
    for name in ("time_s", *inputs):
        if name in columns and np.isnan(columns[name]).any():
            row = int(np.isnan(columns[name]).argmax())
            raise MeasurementError(
                f"{place(row)}: '{name}' is empty, and an input has no missing readings; fill it in or drop the row."
            )
    for name, values in columns.items():
        if (large := np.abs(values) > LARGEST).any():
            row = int(large.argmax())
            raise MeasurementError(
                f"{place(row)}: '{name}' = {values[row]:.15g}, and nothing that is measured exceeds {LARGEST:g}; "
                "correct it or its unit."
            )
    time_s = columns["time_s"]
    if (late := np.diff(time_s) <= 0).any():
        row = int(late.argmax()) + 1
        raise MeasurementError(
            f"{place(row)}: time_s = {time_s[row]:.12g} comes after {time_s[row - 1]:.12g}; "
            "times must increase from row to row, so sort the rows and drop repeated ones."
        )
    if ambient_degC is not None:
        columns["ambient_degC"] = np.full(time_s.shape, float(ambient_degC))
    return Measured(time_s, {name: columns[name] for name in inputs}, {name: columns[name] for name in outputs})


def file_label(path: Path) -> str:
    """Return folder and file name: what a message needs to name a file without its whole path."""
    path = Path(os.path.abspath(path))
    return f"{path.parent.name}/{path.name}"


def read_utf8(path: Path) -> str:
    """Return the text of a UTF-8 file, with or without a byte-order mark.

    Raises:
        MeasurementError: there is no such file, it is no text, or it is larger than a person's settings can be.
    """
    try:
        run_csv.refuse_no_file(path, file_label(path))
        if path.stat().st_size > _MOST_BYTES:
            raise MeasurementError(
                f"{file_label(path)} is larger than {_MOST_BYTES // 2**20} MB, too large for a file of settings; "
                "check its name."
            )
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise MeasurementError(f"{file_label(path)} cannot be read ({error.strerror}); check its name.") from error
    except UnicodeDecodeError as error:
        raise MeasurementError(f"{file_label(path)} is not UTF-8 text; save it again as UTF-8.") from error


def _check_header(header: Sequence[str], kind: str, known: Kind, where: str) -> None:
    """Raise MeasurementError unless the header is time_s and then columns of this kind, each once."""
    if len(header) == 1 and any(separator in header[0] for separator in ";\t"):
        raise MeasurementError(f"{where}: the fields are not separated by commas; save with ',' and decimal points.")
    if header[0] != "time_s":
        raise MeasurementError(
            f"{where}: the first column is '{header[0]}'; it must be 'time_s', the time in seconds of each row."
        )
    columns = known.columns
    for position, name in enumerate(header[1:], start=2):
        if not name:
            raise MeasurementError(f"{where}: column {position} has no name; name it or remove it.")
        if name in header[: position - 1]:
            raise MeasurementError(f"{where}: there are two columns '{name}'; remove or rename one.")
        if name not in columns:
            raise MeasurementError(f"{where}: a {kind} has no column '{name}'.{_remedy(name, columns)}")


def _remedy(name: str, known: Sequence[str]) -> str:
    """Return which column was probably meant and in which unit, or the list of those there are."""
    quantity = {column: _without_unit(column).lower() for column in known}
    same = [column for column in known if name.lower().startswith(quantity[column])]
    hint = f" Did you mean '{max(same, key=len)}'?" if same else nearest(name, known)
    for column in known:
        if hint == f" Did you mean '{column}'?":
            unit = _UNITLESS.get(column) or unit_of(column)
            return f"{hint} Convert the readings to {unit} and rename the column, or remove it."
    return f" Rename it to one of {', '.join(known)}, or remove it."


def _without_unit(column: str) -> str:
    return column if column in _UNITLESS else column.removesuffix(f"_{ending_of(column)}")


def _roles(
    header: Sequence[str], kind: str, known: Kind, ambient_degC: float | None, where: str
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return which columns are inputs and which are outputs; raise MeasurementError where an input is lacking."""
    if ambient_degC is not None and "ambient_degC" in header:
        raise MeasurementError(f"{where}: 'ambient_degC' is a column and a constant of this run; remove one of them.")
    given = {*header, "ambient_degC"} if ambient_degC is not None else set(header)
    for name in known.required_inputs:
        if name not in given:
            constant = ", or write ambient_degC = ... under this run's [[runs]]" if name == "ambient_degC" else ""
            raise MeasurementError(f"{where}: a {kind} needs the column '{name}'; add it{constant}.")
    inputs = [name for name in (*known.required_inputs, *known.optional_inputs) if name in given]
    for group in known.alternatives:
        present = [name for name in group if name in given]
        choice = " or ".join(f"'{name}'" for name in group)
        if not present:
            raise MeasurementError(f"{where}: a {kind} needs one of the columns {choice}; add one.")
        if any(name not in known.outputs for name in present[1:]):
            raise MeasurementError(f"{where}: a {kind} is driven by {choice}, not by both; remove one.")
        inputs.append(present[0])
    for name, other in known.only_with.items():
        if name in given and other not in given:
            raise MeasurementError(f"{where}: '{name}' is used only together with '{other}'; add that or remove this.")
    return tuple(inputs), tuple(name for name in known.outputs if name in given and name not in inputs)
