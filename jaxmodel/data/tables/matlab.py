"""Tables of MATLAB files: vectors of the commonest length, of the whole file or of each of several structures."""

from __future__ import annotations

import fnmatch
import json
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, listed
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.keyed_tables import Sheets, matching, patterns_of, put_together, short_labels
from jaxmodel.data.tables.names import matches
from jaxmodel.data.tables.raw_table import RawTable, unique_names, units_in

# Of a cell array, as `matlab_vectors` names it.
_ELEMENT = re.compile(r"(?P<name>[^.]+) (?P<number>\d+)")
_CLOCKS = ("time", "step_time", "stamp")


class _Vector(NamedTuple):
    """A vector by its path ('meas.Time'), its name alone, and its unit, '' where the file states none."""

    path: str
    name: str
    unit: str
    values: np.ndarray


def read_matlab(path: Path, variables: Sheets = None) -> RawTable:
    """Read a MATLAB file; one of v7.3, or with a table, needs the extra `matlab` (mat-io).

    Structures and tables with the same fields, such as `run1` and `run2` or the elements of an array of structures, are
    runs of their own, under their names; so are the elements of cell arrays of the same lengths.

    Args:
        path: the file.
        variables: structures, tables or matrices of it, as 'meas', 'data.cycle' or 'run*'; by default the whole file.

    Raises:
        MeasurementError: the file is damaged, or holds no vectors of equal length.
    """
    label = file_label(path)
    vectors = _vectors_of(path, label)
    if variables:
        parts = dict.fromkeys(part for vector in vectors for part in _paths(vector.path))
        paths = sorted(parts, key=lambda path: path.count("."))
        named = matching(paths, _spelled(variables, paths), label, "variable")
        vectors = [vector for vector in vectors if any(part in named for part in _paths(vector.path))]
    runs = _runs(vectors)
    if len(runs) > 1:
        tables = {name: _table(own)[0] for name, own in runs.items()}
        keyed = put_together(tables, variables is not None)
        units = {vector.name: vector.unit for own in runs.values() for vector in own if vector.unit}
        frame = keyed.frame
        stated = units_in(map(str, frame)) | {name: unit for name, unit in units.items() if name in frame}
        in_runs = {vector.path for own in runs.values() for vector in own}
        others = [one.path for one in vectors if one.values.size > 1 and one.path not in in_runs]
        remarks = (*keyed.remarks, *([f"Not read, being of no run: {listed(others, 8)}."] if others else []))
        return RawTable(frame, stated, path, "MATLAB", remarks, losses=keyed.losses, key=keyed.key)
    if not any(vector.values.size > 1 for vector in vectors):
        what = f"'{listed(patterns_of(variables), 3)}' of " if variables else ""
        raise MeasurementError(f"{what}{label} holds no vectors of equal length; name the variable that does.")
    frame, units, chosen = _table(vectors)
    length = len(frame)
    remarks = [f"Vectors of {length:,} values: {', '.join(vector.path for vector in chosen)}."]
    left = [f"{one.path} ({one.values.size})" for one in vectors if one.values.size != length and one.values.size > 1]
    if left:
        remarks.append(f"Not read, being of other lengths: {listed(left, 8)}.")
    return RawTable(frame, units_in(map(str, frame)) | units, path, "MATLAB", tuple(remarks))


def _paths(path: str) -> list[str]:
    """Return a path and those of the structures that it is in: 'data.run 1.V', 'data.run 1', 'data'."""
    parts = path.split(".")
    return [".".join(parts[:count]) for count in range(len(parts), 0, -1)]


def _spelled(variables: Sheets, paths: Iterable[str]) -> list[str]:
    """Return patterns as paths begin: 'run*' is of a name at any depth, and 'data.cycle' of the whole array too."""
    spelled: list[str] = []
    for pattern in patterns_of(variables):
        forms = (pattern, f"{pattern} [0-9]*", f"*.{pattern}", f"*.{pattern} [0-9]*")
        own = [form for form in forms if any(fnmatch.fnmatchcase(one, form) for one in paths)]
        spelled += own or [pattern]
    return spelled


def _runs(vectors: Sequence[_Vector]) -> dict[str, list[_Vector]]:
    """Return the vectors of each structure that is a run, by what tells the structures apart; empty for less than two.

    A run has two or more columns beside its time: structures of a time and one signal each are columns of one table.
    """
    groups: dict[str, list[_Vector]] = {}
    for vector in (*vectors, *_of_cell_arrays(vectors)):
        if vector.values.size > 1:
            groups.setdefault(vector.path.rpartition(".")[0], []).append(vector)
    inside = {name: own for name, own in groups.items() if name and _has_columns(own)}
    names = Counter(vector.name for own in inside.values() for vector in own)
    shared = {name: own for name, own in inside.items() if sum(names[vector.name] > 1 for vector in own) > 1}
    if len(shared) < 2:
        return {}
    labels = short_labels([tuple(name.split(".")) for name in shared])
    return dict(zip(labels, shared.values(), strict=True))


def _of_cell_arrays(vectors: Sequence[_Vector]) -> list[_Vector]:
    """Return the elements of cell arrays with as many vectors, of the same lengths, as fields of runs 'run 1', ...

    The columns of a matrix have one length; the elements of cell arrays, an experiment each, seldom do.
    """
    arrays: dict[str, dict[int, _Vector]] = {}
    for vector in vectors:
        if found := _ELEMENT.fullmatch(vector.path):
            arrays.setdefault(found["name"], {})[int(found["number"])] = vector
    alike: dict[tuple[tuple[int, int], ...], list[str]] = {}
    for name, elements in arrays.items():
        lengths = tuple(sorted((number, one.values.size) for number, one in elements.items()))
        if len({size for _, size in lengths}) > 1:
            alike.setdefault(lengths, []).append(name)
    names = max(alike.values(), key=len, default=[])
    return [
        one._replace(path=f"run {number}.{name}", name=name)
        for name in (names if len(names) > 1 else ())
        for number, one in arrays[name].items()
    ]


def _has_columns(vectors: Sequence[_Vector]) -> bool:
    """Return whether two or more vectors of one length are no times."""
    signals = [one for one in vectors if not any(match.quantity in _CLOCKS for match in matches(one.name, one.unit))]
    return max(Counter(one.values.size for one in signals).values(), default=0) > 1


def _table(vectors: Sequence[_Vector]) -> tuple[pd.DataFrame, dict[str, str], list[_Vector]]:
    """Return vectors of one length as columns, their units, and which they are.

    As many columns as possible; among equal counts, the longest.
    """
    lengths = Counter(vector.values.size for vector in vectors if vector.values.size > 1)
    length = max(lengths, key=lambda size: (lengths[size] > 1, lengths[size] * min(size, 1000), size))
    chosen = [vector for vector in vectors if vector.values.size == length]
    short = [vector.name for vector in chosen]
    names = unique_names(short if len(set(short)) == len(short) else [vector.path for vector in chosen])
    frame = pd.DataFrame({name: vector.values for name, vector in zip(names, chosen, strict=True)})
    return frame, {name: one.unit for name, one in zip(names, chosen, strict=True) if one.unit}, chosen


def _vectors_of(path: Path, label: str) -> list[_Vector]:
    """Return the vectors of a file; they are read in a process of its own, and `matlab_vectors` says why."""
    program = Path(__file__).with_name("matlab_vectors.py")
    with tempfile.TemporaryDirectory() as room:
        out = Path(room) / "vectors.npz"
        done = subprocess.run([sys.executable, "-P", program, path, out], capture_output=True, text=True)
        if done.returncode == 2 and done.stdout:
            raise MeasurementError(f"{label} {' '.join(done.stdout.split())}")
        if done.returncode:
            raise MeasurementError(f"{label} cannot be read as a MATLAB file (it is damaged); save it again.")
        with np.load(out) as arrays:
            known = json.loads(arrays["names"].tobytes())
            return [
                _Vector(where, name, unit, arrays[f"arr_{number}"]) for number, (where, name, unit) in enumerate(known)
            ]
