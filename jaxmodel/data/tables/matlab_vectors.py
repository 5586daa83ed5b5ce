"""Every vector of numbers of a MATLAB file and every column of its tables, by path; a program of its own.

SciPy's reader ends the process on some damaged files (a segmentation fault in `read_var_array`, SciPy 1.17, found by
`tests.stress.fuzz`), and so may not run in that of the user. `python -P matlab_vectors.py FILE.mat OUT.npz` leaves 0,
or 2 and a sentence without its subject. Imports nothing of this project: JAX would take seconds.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

_DEEPEST = 6
_MOST_ITEMS = 5000  # of an array of structures: a cell that ages has some hundred cycles
_TABLES = ("table", "timetable")
_WITHOUT = "save it with writetable or table2struct(T, ToScalar=true)"


class _Unreadable(Exception):
    """A file cannot be read; says so after its name."""


class _Vector(NamedTuple):
    """A vector by its path ('meas.Time'), by its name alone, and its unit where a table states one."""

    path: str
    name: str
    values: np.ndarray
    unit: str = ""


def main(path: str, out: str) -> int:
    """Write the vectors of a file with their paths, names and units."""
    try:
        found = {vector.path: vector for vector in _vectors(_content(path), "", "")}
    except _Unreadable as error:
        print(error)
        return 2
    names = json.dumps([(vector.path, vector.name, vector.unit) for vector in found.values()])
    np.savez(out, *(vector.values for vector in found.values()), names=np.frombuffer(names.encode(), np.uint8))
    return 0


def _content(path: str) -> Mapping[str, Any]:
    import scipy.io
    from scipy.io.matlab import MatReadError

    what = "is a MATLAB file of version 7.3; install jaxmodel[matlab], or save it with '-v7'."
    try:
        content = scipy.io.loadmat(path, simplify_cells=True)
        if not _has_table(content):
            return content
        what = f"holds a MATLAB table; install jaxmodel[matlab], or {_WITHOUT}."
    except NotImplementedError:  # v7.3 is HDF5
        pass
    except (MatReadError, ValueError, TypeError, OSError, EOFError, IndexError, KeyError, MemoryError) as error:
        raise _Unreadable(f"cannot be read as a MATLAB file ({error}); save it again.") from error
    try:
        matio = importlib.import_module("matio")  # an extra
    except ImportError:
        raise _Unreadable(what) from None
    try:
        return matio.load_from_mat(path, add_table_attrs=True)
    except Exception as error:  # a damaged file fails in as many ways as that package has lines
        raise _Unreadable(f"cannot be read as a MATLAB file ({error}); save it again, or {_WITHOUT}.") from error


def _has_table(value: Any, depth: int = 0) -> bool:
    """Return whether what SciPy has read holds a table, which it does not open."""
    from scipy.io.matlab import MatlabOpaque

    if depth > _DEEPEST:
        return False
    if isinstance(value, MatlabOpaque):
        return any(bytes(kind).decode(errors="replace") in _TABLES for kind in value["s2"].ravel())
    if isinstance(value, Mapping):
        return any(_has_table(item, depth + 1) for item in value.values())
    if isinstance(value, np.ndarray) and value.dtype.kind == "O":
        return any(_has_table(item, depth + 1) for item in value.ravel())
    return isinstance(value, list) and any(_has_table(item, depth + 1) for item in value)


def _vectors(value: Any, path: str, name: str, depth: int = 0) -> Iterator[_Vector]:
    """Yield every vector of numbers, and the columns of every matrix and table, by its path."""
    if depth > _DEEPEST:
        return
    if isinstance(value, pd.DataFrame):
        yield from _columns(value, path)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            if not str(key).startswith("__"):
                yield from _vectors(inner, f"{path}.{key}" if path else str(key), str(key), depth + 1)
    elif isinstance(value, list):
        if value and all(isinstance(item, int | float) for item in value):
            yield _Vector(path, name, np.asarray(value, dtype=float))
        elif len(value) < _MOST_ITEMS:
            for number, item in enumerate(value, start=1):
                yield from _vectors(item, f"{path} {number}", f"{name} {number}", depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.names is not None and value.size < _MOST_ITEMS:
        for number, item in enumerate(value.ravel(), start=1):
            fields = {key: item[key] for key in value.dtype.names}
            yield from _vectors(fields, path if value.size == 1 else f"{path} {number}", name, depth + 1)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufb":
        if value.ndim == 1 or (value.ndim == 2 and 1 in value.shape):
            yield _Vector(path, name, value.astype(float).ravel())
        elif value.ndim == 2:
            tall = value if value.shape[0] >= value.shape[1] else value.T
            if tall.shape[1] <= 100:
                for number, column in enumerate(tall.T, start=1):
                    yield _Vector(f"{path} {number}", f"{name} {number}", column.astype(float))
    elif isinstance(value, np.ndarray) and value.dtype == object and value.size < _MOST_ITEMS:
        for number, item in enumerate(value.ravel(), start=1):
            yield from _vectors(item, f"{path} {number}", f"{name} {number}", depth + 1)


def _columns(table: pd.DataFrame, path: str) -> Iterator[_Vector]:
    """Yield the columns of a table that are numbers or times, and the times of a timetable's rows."""
    stated = table.attrs.get("VariableUnits") or table.attrs.get("varUnits") or ()
    units = dict(zip(table, stated, strict=True)) if len(stated) == len(table.columns) else {}
    if table.index.dtype.kind in "mM":
        table = table.rename_axis(str(table.index.name or "Time")).reset_index()
    for key, column in table.items():
        name, unit = str(key), str(units.get(key, ""))
        if column.dtype.kind in "iufb":
            values = column.to_numpy(dtype=float)
        elif column.dtype.kind == "m":
            values, unit = column.dt.total_seconds().to_numpy(dtype=float), "s"
        elif column.dtype.kind == "M":  # as seconds since 1970
            values, unit = (column.dt.tz_localize(None) - pd.Timestamp(0)).dt.total_seconds().to_numpy(dtype=float), "s"
        else:
            continue
        yield _Vector(f"{path}.{name}" if path else name, name, values, unit)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
