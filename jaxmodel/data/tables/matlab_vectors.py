"""Every vector of numbers of a MATLAB file, by its path; a program of its own.

SciPy's reader ends the process on some damaged files (a segmentation fault in `read_var_array`, SciPy 1.17, found by
`tests.stress.fuzz`), and so may not run in that of the user. `python -P matlab_vectors.py FILE.mat OUT.npz` leaves 0,
or 2 and a sentence without its subject. Imports nothing of this project: JAX would take seconds.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

_DEEPEST = 6


class _Unreadable(Exception):
    """A file cannot be read; says so after its name."""


def main(path: str, out: str) -> int:
    """Write the vectors of a file and their names."""
    try:
        found = dict(_vectors(_content(path), ""))
    except _Unreadable as error:
        print(error)
        return 2
    names = np.frombuffer(json.dumps(list(found)).encode(), np.uint8)
    np.savez(out, *found.values(), names=names)
    return 0


def _content(path: str) -> Mapping[str, Any]:
    import scipy.io
    from scipy.io.matlab import MatReadError

    try:
        return scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:  # v7.3 is HDF5
        pass
    except (MatReadError, ValueError, TypeError, OSError, EOFError, IndexError, KeyError, MemoryError) as error:
        raise _Unreadable(f"cannot be read as a MATLAB file ({error}); save it again.") from error
    try:
        pymatreader = importlib.import_module("pymatreader")  # an extra
    except ImportError:
        raise _Unreadable("is a MATLAB file of version 7.3; install jaxmodel[matlab], or save it with '-v7'.") from None
    try:
        return pymatreader.read_mat(path)
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise _Unreadable(f"cannot be read as a MATLAB file ({error}); save it again.") from error


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


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
