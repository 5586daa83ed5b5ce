"""A log in the columns of a case: the arrays of one file, or of one run of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.errors import listed
from jaxmodel.data.importing.findings import Decision, Finding

_MOST_COLUMNS = 40  # that a sentence lists


@dataclasses.dataclass(frozen=True, eq=False)
class Log:
    """Readings of one file or run.

    Attributes:
        name: of the run that it becomes.
        source: the file.
        time_s: of each row [s], NaN where the file has none, shape (rows,); empty where the file has no clock.
        columns: by column of the case, in its unit; NaN where there is no reading.
        marks: `step`, `cycle` and `state` by row where the file has them, as numbers; `counted` is a state by the
            tester's own counts of charge.
        stamp_s: time stamps as seconds since 1970, NaN where there is none; None where the file has none.
        discharged_Ah: the tester's own count of the charge taken out; None where the file has none.
        time_is_of_step: whether `time_s` begins anew with each step.
        restarts: rows at which a new run begins because the clock does.
        findings: what was found so far.
        decisions: what was settled so far.
        header: by column of the file, the column of the case that it became, '' for none.
        specimen: which of several motors of one file it is of; "" for a file of one.
    """

    name: str
    source: Path
    time_s: np.ndarray
    columns: dict[str, np.ndarray]
    marks: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    stamp_s: np.ndarray | None = None
    discharged_Ah: np.ndarray | None = None
    time_is_of_step: bool = False
    restarts: tuple[int, ...] = ()
    findings: tuple[Finding, ...] = ()
    decisions: tuple[Decision, ...] = ()
    header: Mapping[str, str] = dataclasses.field(default_factory=dict)
    specimen: str = ""

    @property
    def rows(self) -> int:
        """Return the number of rows."""
        return next((values.size for values in self.columns.values()), self.time_s.size)

    def take(self, rows: np.ndarray | slice, name: str = "") -> Log:
        """Return some rows, under another name if one is given; the restarts are forgotten."""
        return dataclasses.replace(
            self,
            name=name or self.name,
            time_s=self.time_s[rows] if self.time_s.size else self.time_s,
            columns={key: values[rows] for key, values in self.columns.items()},
            marks={key: values[rows] for key, values in self.marks.items()},
            stamp_s=None if self.stamp_s is None else self.stamp_s[rows],
            discharged_Ah=None if self.discharged_Ah is None else self.discharged_Ah[rows],
            restarts=(),
        )

    def also(self, *found: Finding | Decision) -> Log:
        """Return the log with more findings and decisions."""
        findings = tuple(one for one in found if isinstance(one, Finding))
        decisions = tuple(one for one in found if isinstance(one, Decision))
        return dataclasses.replace(
            self, findings=self.findings + findings, decisions=self.decisions + decisions
        )  # fmt: skip

    def to_dataframe(self) -> pd.DataFrame:
        """Return time and columns, without a copy of the arrays."""
        return pd.DataFrame({"time_s": self.time_s, **self.columns}, copy=False)


def columns_of(header: Mapping[str, str]) -> str:
    """Return the columns of a file with what was recognised in each, as part of a sentence."""
    named = [f"{column} ({target})" if target else column for column, target in header.items()]
    return f"the columns are {listed(named, _MOST_COLUMNS)}"


def spans(flags: np.ndarray, time_s: np.ndarray, most: int = 50) -> tuple[tuple[float, float], ...]:
    """Return the first stretches of rows that are flagged, as times [s]."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0))
    return tuple(
        (float(time_s[begin]), float(time_s[end - 1])) for begin, end in edges.reshape(-1, 2)[:most].tolist()
    )  # fmt: skip
