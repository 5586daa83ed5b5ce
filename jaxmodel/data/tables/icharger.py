"""Logs of Junsi's iCharger: lines without names, '$1;2;1000;...', whose places its firmware fixes."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.raw_table import RawTable, units_in

_LINE = re.compile(r"^\$\d{1,2};\d{1,3};\d*(;-?\d+){11,}\s*$")
_SAMPLE_LINES = 50
_SURE = 0.8  # of the first lines
# Modes of readings. A line of another one, as 128 of the cells' resistances, has other places.
_MODES = {1: "Charging", 2: "Discharging", 3: "Monitor", 4: "Rest", 6: "Finished", 8: "Trickle charging"}
# The line of a memory card: channel, mode, ms, two codes, then these, the cells and a check sum.
_OF_CARD = {
    "Time [ms]": 2,
    "Battery current [A]": 5,
    "Supply [mV]": 6,
    "Battery voltage [mV]": 7,
    "Counted charge [mAh]": 8,
    "Charger temperature [degC]": 9,
    "Battery temperature [degC]": 10,
}
_CELLS_OF_CARD = (11, -1)
# The line of the serial port has no clock, unless the program that wrote it down has put one there.
_OF_PORT = {
    "Supply [mV]": 3,
    "Battery voltage [mV]": 4,
    "Battery current [A]": 5,
    "Charger temperature [degC]": -4,
    "Battery temperature [degC]": -3,
    "Counted charge [mAh]": -2,
}
_CELLS_OF_PORT = (6, -4)
_SCALES = {
    "Battery current [A]": 0.01,
    "Charger temperature [degC]": 0.1,
    "Battery temperature [degC]": 0.1,
}
_SUPPLY_MV = (4000, 65_000)  # of any iCharger, with a margin
_KEY = "Channel"
# Of the head, which names the charger, and ends in zeros; all below is digits.
_ENCODING = "latin-1"


def is_icharger(path: Path) -> bool:
    """Return whether the lines of a text are those of an iCharger, by their form and the voltage of its supply.

    Args:
        path: the file.
    """
    try:
        with path.open(encoding=_ENCODING, errors="replace") as stream:
            lines = [line for line in itertools.islice(stream, _SAMPLE_LINES) if _is_line(line)]
    except OSError:  # said by the reader of tables
        return False
    rows = [_fields(line) for line in lines if _LINE.match(line)]
    return len(rows) > 1 and len(rows) >= _SURE * len(lines) and any(_places(row) is not None for row in rows)


def _is_line(line: str) -> bool:
    return bool(line.strip("\0 \r\n")) and not line.startswith("@")


def _fields(line: str) -> list[int | None]:
    return [int(field) if field.strip() else None for field in line.strip()[1:].split(";")]


def _places(fields: list[int | None]) -> dict[str, int] | None:
    """Return the places of the readings in a line, by where the voltage of the supply stands; None for no readings."""
    for places in (_OF_PORT, _OF_CARD):  # a card has a small code where the port has the supply
        supply = fields[places["Supply [mV]"]]
        if fields[1] in _MODES and supply is not None and _SUPPLY_MV[0] <= supply <= _SUPPLY_MV[1]:
            return places
    return None


def read_icharger(path: Path) -> RawTable:
    """Read the lines of an iCharger: a table for each of its channels.

    Args:
        path: the file.

    Raises:
        MeasurementError: no line holds readings.
    """
    with path.open(encoding=_ENCODING, errors="replace") as stream:
        lines = [line for line in stream if _is_line(line)]
    rows = [_fields(line) for line in lines if _LINE.match(line)]
    read = [(row, places) for row in rows if (places := _places(row)) is not None]
    forms = Counter((len(row), id(places)) for row, places in read)
    if not forms:
        raise MeasurementError(f"{file_label(path)} has no line of readings of an iCharger; export the log again.")
    form = forms.most_common(1)[0][0]
    places = next(places for row, places in read if (len(row), id(places)) == form)
    values = np.array(
        [[np.nan if one is None else one for one in row] for row, there in read if (len(row), id(there)) == form]
    )
    begin, end = _CELLS_OF_CARD if places is _OF_CARD else _CELLS_OF_PORT
    columns = {name: _SCALES.get(name, 1.0) * values[:, place] for name, place in places.items()}
    columns |= {f"Cell {n} [mV]": column for n, column in enumerate(values[:, begin:end].T, start=1)}
    if places is _OF_PORT and np.isfinite(values[:, 2]).any():
        columns = {"Time": values[:, 2], **columns}
    frame = pd.DataFrame(columns)
    frame.insert(0, "Mode", pd.Series([_MODES[int(mode)] for mode in values[:, 1]], dtype="string"))
    channels = values[:, 0]
    key = _KEY if np.unique(channels).size > 1 else ""
    if key:
        frame[key] = [f"channel{int(channel)}" for channel in channels]
    lost = len(lines) - len(frame)
    losses = (f"{lost:,} of {len(lines):,} lines hold no readings and were left out.",) if lost else ()
    remark = "Lines of an iCharger without names; their places are fixed."
    return RawTable(frame, units_in(map(str, frame)), path, "iCharger", (remark,), losses=losses, key=key)
