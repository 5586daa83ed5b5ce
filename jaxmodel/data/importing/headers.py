"""Names of columns for files that have no line of them: those of a file beside it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.loading import FORM
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


def _is_nameless(names: Sequence[str]) -> bool:
    return all(re.fullmatch(r"column \d+", name) for name in names)
