"""Rows of impedance spectra in a log: they are of a frequency and not of a time, and are left out."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.tables import RawTable
from jaxmodel.data.tables.raw_table import to_numbers

_FREQUENCY = re.compile(r"(?<![a-z])(freq|frequency|frequenz|频率)(?![a-z])")
_IMPEDANCE = re.compile(
    r"(?<![a-z])(re|im|real|imag)[ ._(|]*z(?![a-z])|(?<![a-z])z[ ._'(]*(re|im|real|imag|mod)(?![a-z])|\|z\||"
    r"(?<![a-z])z['\"]{1,2}|(?<![a-z])(impedance|impedanz|阻抗)(?![a-z])"
)
# A bridge that measures at one frequency throughout makes no spectrum.
_FEWEST_FREQUENCIES = 3


class OnlySpectra(MeasurementError):
    """A file that holds impedance spectra alone."""


def of_spectra(names: Iterable[str]) -> list[str]:
    """Return the columns that tell rows of a spectrum: a frequency and impedances; empty without both."""
    names = list(names)
    frequency = [name for name in names if _FREQUENCY.search(name.lower())][:1]
    impedance = [name for name in names if _IMPEDANCE.search(name.lower()) and name not in frequency]
    return [*frequency, *impedance] if frequency and impedance else []


def without_spectra(table: RawTable) -> tuple[RawTable, list[Finding]]:
    """Return a table without its rows of impedance spectra, and what was left out.

    Raises:
        OnlySpectra: no other rows are left.
    """
    columns = of_spectra(str(name) for name in table.frame)
    rows = _rows(table.frame, columns) if columns else np.zeros(len(table.frame), dtype=bool)
    if not rows.any():
        return table, []
    frequencies = _numbers(table.frame, columns[0])[rows]
    span = f"{frequencies.min():.3g} Hz to {frequencies.max():.3g} Hz"
    if rows.all():
        raise OnlySpectra(
            f"{table.label} holds impedance spectra ({span}) and no readings over time; give a log of pulses or of a "
            "discharge."
        )
    sentence = (
        f"{table.label}: {int(rows.sum()):,} of {rows.size:,} rows are of impedance spectra (column '{columns[0]}', "
        f"{span}) and are left out: the model has no answer to a frequency."
    )
    frame = pd.DataFrame(table.frame[~rows]).reset_index(drop=True)
    numbers = {"rows": float(rows.sum())}
    return dataclasses.replace(table, frame=frame), [
        Finding("spectra", table.label, sentence, "warning", numbers=numbers)
    ]


def _rows(frame: pd.DataFrame, columns: Sequence[str]) -> np.ndarray:
    """Return which rows have a frequency and an impedance, of several frequencies."""
    frequency = _numbers(frame, columns[0])
    impedances = np.stack([_numbers(frame, name) for name in columns[1:]])
    rows = (np.nan_to_num(frequency) > 0.0) & np.any(np.nan_to_num(impedances) != 0.0, axis=0)
    return rows if np.unique(frequency[rows]).size >= _FEWEST_FREQUENCIES else np.zeros(rows.size, dtype=bool)


def _numbers(frame: pd.DataFrame, name: str) -> np.ndarray:
    column = pd.Series(frame[name])
    return column.to_numpy(dtype=float) if column.dtype.kind in "iufb" else to_numbers(column.astype("string"))
