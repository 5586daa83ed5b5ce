"""Tables of MATLAB files: every vector of the commonest length, from variables and from fields of structures."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, listed
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.raw_table import RawTable, unique_names, units_in


def read_matlab(path: Path, variable: str | None = None) -> RawTable:
    """Read a MATLAB file; one of v7.3, or with a table, needs the extra `matlab` (mat-io).

    Args:
        path: the file.
        variable: a structure or matrix of it, as 'meas' or 'data.cycle'; by default the whole file.

    Raises:
        MeasurementError: the file is damaged, or holds no vectors of equal length.
    """
    label = file_label(path)
    found, ends, stated = _found(path, label)
    if variable:
        found = {name: values for name, values in found.items() if name == variable or name.startswith(f"{variable}.")}
    lengths = Counter(values.size for values in found.values() if values.size > 1)
    if not lengths:
        what = f"'{variable}' of " if variable else ""
        raise MeasurementError(f"{what}{label} holds no vectors of equal length; name the variable that does.")
    # As many columns as possible; among equal counts, the longest.
    length = max(lengths, key=lambda size: (lengths[size] > 1, lengths[size] * min(size, 1000), size))
    chosen = {name: values for name, values in found.items() if values.size == length}
    short = [ends[name] for name in chosen]
    names = unique_names(short if len(set(short)) == len(short) else list(chosen))
    frame = pd.DataFrame(dict(zip(names, chosen.values(), strict=True)))
    left = [f"{name} ({values.size})" for name, values in found.items() if values.size != length and values.size > 1]
    remarks = [f"Vectors of {length:,} values: {', '.join(chosen)}."]
    if left:
        remarks.append(f"Not read, being of other lengths: {listed(left, 8)}.")
    units = {name: stated[key] for name, key in zip(names, chosen, strict=True) if stated[key]}
    return RawTable(frame, units_in(names) | units, path, "MATLAB", tuple(remarks))


def _found(path: Path, label: str) -> tuple[dict[str, np.ndarray], dict[str, str], dict[str, str]]:
    """Return the vectors of a file by their paths, the names alone, and the units that tables state.

    They are read in a process of its own; `matlab_vectors` says why.
    """
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
            vectors = {key: arrays[f"arr_{number}"] for number, (key, _, _) in enumerate(known)}
        return vectors, {key: name for key, name, _ in known}, {key: unit for key, _, unit in known}
