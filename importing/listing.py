"""A list of files among the files: which ambient temperature and which label it states for each."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from jaxmodel.errors import MeasurementError
from jaxmodel.tables.names import matches

_MOST_BYTES = 1 << 20
_LABELS = ("label", "kind", "description", "profile", "test")


@dataclasses.dataclass(frozen=True)
class Listed:
    """What a list states of one file: the ambient temperature [degC], and what it was."""

    ambient_degC: float | None
    label: str


def read_listing(path: Path, names: Sequence[str]) -> dict[str, Listed]:
    """Return what a table says of other files by their names; empty if it is no list of them.

    Args:
        path: a text file.
        names: of the files that are imported.
    """
    if path.stat().st_size > _MOST_BYTES or path.suffix.lower() not in (".csv", ".tsv", ".txt"):
        return {}
    try:
        frame = pd.read_csv(path, sep=None, engine="python", dtype="string", encoding_errors="replace")
    except (ValueError, OSError, pd.errors.ParserError, MeasurementError):
        return {}
    stems = {Path(name).stem: name for name in names}
    for column in frame:
        listed = frame[column].dropna().map(lambda text: stems.get(Path(str(text)).stem))
        if len(listed) and listed.notna().mean() > 0.3:
            return {
                str(listed[row]): Listed(_ambient(frame.loc[row]), _label(frame.loc[row]))
                for row in listed.index
                if pd.notna(listed[row])
            }
    return {}


def _ambient(row: pd.Series) -> float | None:
    for name, text in row.items():
        if pd.notna(text) and any(match.quantity == "ambient_temperature" for match in matches(str(name))):
            try:
                return float(str(text))
            except ValueError:
                return None
    return None


def _label(row: pd.Series) -> str:
    by_name = {str(name).lower(): text for name, text in row.items() if pd.notna(text)}
    return next((str(by_name[name]) for name in _LABELS if name in by_name), "")
