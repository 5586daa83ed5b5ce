"""Columns of files that have no line of names: as files beside them have it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.loading import BY_LOOKS, FORM
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.options import Options
from jaxmodel.data.tables import read_table
from jaxmodel.data.tables.reading import TEXT

_ROWS = 50  # that are read for the names


class Header(NamedTuple):
    """Names of columns, and the file that has them."""

    names: tuple[str, ...]
    of: Path


def of_siblings(paths: Sequence[Path], options: Options) -> dict[Path, Header]:
    """Return the names of the columns of each file that has none, of text files of one import.

    A tester writes all files of a test alike: where all that have names and as many columns agree, they are its own.
    """
    heads: dict[Path, tuple[str, ...]] = {}
    form = {name: getattr(options, name) for name in FORM}
    texts = [path for path in paths if path.suffix.lower() in TEXT and path.is_file()]
    for path in texts if len(texts) > 1 else []:
        try:
            heads[path] = tuple(map(str, read_table(path, rows=_ROWS, **form).frame))
        except MeasurementError:  # said where the file itself is read
            continue
    named = {path: names for path, names in heads.items() if not _is_nameless(names)}
    found = {}
    for path in heads.keys() - named.keys():
        alike = {names: other for other, names in named.items() if len(names) == len(heads[path])}
        if len(alike) == 1:
            found[path] = Header(*next(iter(alike.items())))
    return found


def by_most(logs: Sequence[Log]) -> dict[Path, dict[str, str]]:
    """Return, for files without names whose readings told other columns than those of most, the columns of most.

    A strain that goes through zero looks like a current where the current itself is of one sign.
    """
    nameless = [log for log in logs if _is_nameless(list(log.header))]
    told: dict[int, dict[str, Counter[str]]] = {}
    for log in nameless:
        for target, column in _by_looks(log).items():
            told.setdefault(len(log.header), {}).setdefault(target, Counter())[column] += 1
    found = {}
    for log in nameless:
        counts = {target: one.most_common(1)[0] for target, one in told.get(len(log.header), {}).items()}
        alike = sum(len(other.header) == len(log.header) for other in nameless)
        most = {target: column for target, (column, count) in counts.items() if 2 * count > alike}
        if most.items() - _by_looks(log).items():
            found[log.source] = most
    return found


def _by_looks(log: Log) -> dict[str, str]:
    """Return the columns of a log that its readings told, by column of the case."""
    targets = {one.column for one in log.findings if one.what == BY_LOOKS}
    return {target: column for column, target in log.header.items() if target in targets}


def _is_nameless(names: Sequence[str]) -> bool:
    return bool(names) and all(re.fullmatch(r"column \d+", name) for name in names)
