"""A list of files among the files: which ambient temperature and which label it states for each."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from pathlib import Path

import pandas as pd

from jaxmodel.data.tables.names import matches

_MOST_BYTES = 1 << 20
_LABELS = ("label", "kind", "description", "profile", "test")


@dataclasses.dataclass(frozen=True)
class Listed:
    """What a list states of one file: the ambient temperature [degC], what it was, and inputs of the case by name."""

    ambient_degC: float | None
    label: str
    inputs: dict[str, float]


def read_listing(path: Path, names: Sequence[str], inputs: Collection[str]) -> dict[str, Listed]:
    """Return what a table says of other files by their names; empty if it is no list of them.

    Args:
        path: a text file.
        names: of the files that are imported.
        inputs: columns of the case that a list may state as one number for a file.
    """
    if path.stat().st_size > _MOST_BYTES or path.suffix.lower() not in (".csv", ".tsv", ".txt"):
        return {}
    frame = _table(path)
    stems = {Path(name).stem: name for name in names}
    for column in frame:
        texts = [str(text) for text in frame[column]]
        listed = {row: stems[Path(text).stem] for row, text in enumerate(texts) if Path(text).stem in stems}
        # It may list more files than the user took, if it lists all of those.
        of_all = {*listed.values()} == {*names} and len({*texts}) == len(texts)
        if of_all or len(listed) > 0.3 * len(texts):
            return {name: _of_row(frame.iloc[row], inputs) for row, name in listed.items()}
    return {}


def _of_row(row: pd.Series, inputs: Collection[str]) -> Listed:
    return Listed(_ambient(row), _label(row), _inputs(row, inputs))


def _table(path: Path) -> pd.DataFrame:
    """Return a table of text, by the delimiter that gives most columns; empty if it is none."""
    best = pd.DataFrame()
    for delimiter in (",", ";", "\t"):
        try:
            frame = pd.read_csv(path, sep=delimiter, dtype="string", encoding_errors="replace")
        except (ValueError, OSError):
            continue
        best = frame if len(frame.columns) > len(best.columns) else best
    return best


def _ambient(row: pd.Series) -> float | None:
    for name, text in row.items():
        if pd.notna(text) and any(match.quantity == "ambient_temperature" for match in matches(str(name))):
            try:
                return float(str(text))
            except ValueError:
                return None
    return None


def _inputs(row: pd.Series, inputs: Collection[str]) -> dict[str, float]:
    found = {}
    for name, text in row.items():
        if str(name) in inputs and pd.notna(text):
            try:
                found[str(name)] = float(str(text))
            except ValueError:
                continue
    return found


def _label(row: pd.Series) -> str:
    by_name = {str(name).lower(): text for name, text in row.items() if pd.notna(text)}
    return next((str(by_name[name]) for name in _LABELS if name in by_name), "")
