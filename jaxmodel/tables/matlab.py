"""Tables of MATLAB files: every vector of the commonest length, from variables and from fields of structures."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.errors import MeasurementError
from jaxmodel.measurements import file_label
from jaxmodel.tables.raw_table import RawTable, unique_names, units_in

_DEEPEST = 6


def read_matlab(path: Path, variable: str | None = None) -> RawTable:
    """Read a MATLAB file; one of v7.3 needs the extra `matlab` (pymatreader).

    Args:
        path: the file.
        variable: a structure or matrix of it, as 'meas' or 'data.cycle'; by default the whole file.

    Raises:
        MeasurementError: the file is damaged, or holds no vectors of equal length.
    """
    label = file_label(path)
    content = _content(path, label)
    found = dict(_vectors(content, ""))
    if variable:
        found = {name: values for name, values in found.items() if name == variable or name.startswith(f"{variable}.")}
    lengths = Counter(values.size for values in found.values() if values.size > 1)
    if not lengths:
        what = f"'{variable}' of " if variable else ""
        raise MeasurementError(f"{what}{label} holds no vectors of equal length; name the variable that does.")
    # As many columns as possible; among equal counts, the longest.
    length = max(lengths, key=lambda size: (lengths[size] > 1, lengths[size] * min(size, 1000), size))
    chosen = {name: values for name, values in found.items() if values.size == length}
    ends = [name.rsplit(".", 1)[-1] for name in chosen]
    names = unique_names(ends if len(set(ends)) == len(ends) else list(chosen))
    frame = pd.DataFrame(dict(zip(names, chosen.values(), strict=True)))
    left = [f"{name} ({values.size})" for name, values in found.items() if values.size != length and values.size > 1]
    remarks = [f"Vectors of {length:,} values: {', '.join(chosen)}."]
    if left:
        more = f" and {len(left) - 8} more" if len(left) > 8 else ""
        remarks.append(f"Not read, being of other lengths: {', '.join(left[:8])}{more}.")
    return RawTable(frame, units_in(names), path, "MATLAB", tuple(remarks))


def _content(path: Path, label: str) -> Mapping[str, Any]:
    import scipy.io
    from scipy.io.matlab import MatReadError

    try:
        return scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:  # v7.3 is HDF5
        pass
    except (MatReadError, ValueError, TypeError, OSError, EOFError, IndexError, KeyError, MemoryError) as error:
        raise MeasurementError(f"{label} cannot be read as a MATLAB file ({error}); save it again.") from error
    try:
        pymatreader = importlib.import_module("pymatreader")  # an extra
    except ImportError:
        raise MeasurementError(
            f"{label} is a MATLAB file of version 7.3; install jaxmodel[matlab], or save it with '-v7'."
        ) from None
    try:
        return pymatreader.read_mat(path)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise MeasurementError(f"{label} cannot be read as a MATLAB file ({error}); save it again.") from error


def _vectors(value: Any, name: str, depth: int = 0) -> Iterator[tuple[str, np.ndarray]]:
    """Yield every vector of numbers, and the columns of every matrix, by its path."""
    if depth > _DEEPEST:
        return
    if isinstance(value, Mapping):
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _vectors(inner, f"{name}.{key}" if name else str(key), depth + 1)
    elif isinstance(value, list):
        if value and all(isinstance(item, int | float) for item in value):
            yield name, np.asarray(value, dtype=float)
        elif len(value) < 200:
            for number, item in enumerate(value, start=1):
                yield from _vectors(item, f"{name} {number}", depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb":
        if value.ndim == 1:
            yield name, value.astype(float)
        elif value.ndim == 2 and 1 in value.shape:
            yield name, value.astype(float).ravel()
        elif value.ndim == 2:
            tall = value if value.shape[0] >= value.shape[1] else value.T
            if tall.shape[1] <= 100:
                for number, column in enumerate(tall.T, start=1):
                    yield f"{name} {number}", column.astype(float)
    elif isinstance(value, np.ndarray) and value.dtype == object and value.size < 200:
        for number, item in enumerate(value.ravel(), start=1):
            yield from _vectors(item, f"{name} {number}", depth + 1)
