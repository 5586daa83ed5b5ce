"""A table of a file of any format: columns as they are named there, units as they are written there."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Literal, cast

import numpy as np
import pandas as pd

from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.names import parse_name


@dataclasses.dataclass(frozen=True, eq=False)
class RawTable:
    """One table of one file, nothing renamed or converted.

    Attributes:
        frame: the columns under the names of the file; numbers are float64 with NaN where the file has none, and text
            (time stamps, states) is text.
        units: by column, the unit as the file writes it, of columns that were left out too; a column absent here has
            none.
        source: the file.
        format: in words, such as "text" or "Excel".
        remarks: sentences on how the file was read, and on sheets and variables that were not.
        losses: sentences on lines and fields of the table that could not be read.
        first_line: line (or row) of the file on which the first row of the table stands, counted from 1.
        current_positive_on: what the format fixes for the sign of the current; None where it fixes nothing.
        left_out: columns of the file that were not read.
        repeated: names that several columns have; the second is called 'name 2'.
        key: the column whose texts tell several tables of one file apart; '' for one table.
        plain: by column, the plain name of what a known format holds there; '' for nothing of a case.

    Example:
        >>> from jaxmodel import read_table
        >>> table = read_table("examples/samsung_30q/cc1C.csv")
        >>> table.format, table.frame.columns[0]
        ('text', 'time_s')
    """

    frame: pd.DataFrame
    units: Mapping[str, str]
    source: Path
    format: str
    remarks: tuple[str, ...] = ()
    first_line: int = 1
    current_positive_on: Literal["charge", "discharge"] | None = None
    left_out: tuple[str, ...] = ()
    losses: tuple[str, ...] = ()
    repeated: tuple[str, ...] = ()
    key: str = ""
    plain: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def label(self) -> str:
        """Return how messages name the file."""
        return file_label(self.source)

    def tables(self) -> Iterator[tuple[str, RawTable]]:
        """Yield the tables of the file by the names of the runs that they become: of the file, and of its key."""
        if not self.key:
            yield self.source.stem, self
            return
        for key, frame in self.frame.groupby(self.key, sort=False):
            yield f"{self.source.stem}-{key}", dataclasses.replace(self, frame=frame.reset_index(drop=True))

    def to_dataframe(self) -> pd.DataFrame:
        """Return the columns as they are named in the file."""
        return self.frame

    def summary(self) -> str:
        """Return format, columns with units, and remarks, one line each."""
        lines = [f"{self.label}: {self.format}, {len(self.frame):,} rows"]
        lines += [f"  {name} [{self.units[name]}]" if name in self.units else f"  {name}" for name in self.frame]
        return "\n".join([*lines, *self.remarks, *self.losses])

    def __repr__(self) -> str:
        return f"<RawTable {self.label}: {self.format}, {len(self.frame)} rows, {len(self.frame.columns)} columns>"


def units_in(names: Iterable[str]) -> dict[str, str]:
    """Return the units that names of columns state, by name."""
    return {name: unit for name in names if (unit := parse_name(name).unit)}


def to_numbers(text: pd.Series) -> np.ndarray:
    """Return text as numbers, NaN where it is none."""
    numbers = cast("pd.Series", pd.to_numeric(text, errors="coerce"))
    return np.asarray(numbers.astype("Float64").to_numpy(dtype=float, na_value=np.nan))


def unique_names(names: Iterable[str]) -> list[str]:
    """Return names of columns, each once: a nameless one is 'column 3', and a repeated one has a number after it."""
    result: list[str] = []
    for position, name in enumerate(names, start=1):
        name = " ".join(str(name).split()) or f"column {position}"
        count, candidate = 1, name
        while candidate in result:
            count += 1
            candidate = f"{name} {count}"
        result.append(candidate)
    return result


def repeated_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names that stand more than once among those of columns."""
    seen = [" ".join(str(name).split()) for name in names]
    return tuple(dict.fromkeys(name for name in seen if name and seen.count(name) > 1))
