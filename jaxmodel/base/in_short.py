"""Records in one line at a prompt, and as a small table in a notebook."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from jaxmodel.base.errors import listed

_MOST_LETTERS = 100  # of what is said of a record in one line
_MOST_NAMES = 4  # of what an entry holds


class InShort:
    """A record that says itself in one line, as `<Name: entry=value, ...>`, and as a table with a row for each entry.

    What a dataclass writes for itself has every number of every array; so a dataclass says `repr=False`.
    """

    def _in_short(self) -> str:
        """Return what the line says after the record's name: the entries that are not as by default."""
        said = [f"{name}={text_of(value)}" for name, value, default in _entries(self) if not _same(value, default)]
        return ", ".join(said) or "all by default"

    def __repr__(self) -> str:
        said = self._in_short()
        cut = said if len(said) <= _MOST_LETTERS else f"{said[:_MOST_LETTERS].rsplit(', ', 1)[0]}, ..."
        return f"<{type(self).__name__}: {cut}>"

    def _repr_html_(self) -> str:
        rows = ((name, text_of(value)) for name, value, _ in _entries(self))
        said = repr(self)
        return html_of(said[1:-1] if said.startswith("<") else said, rows)


def html_of(title: str, rows: Iterable[tuple[str, str]]) -> str:
    """Return a title and a table of names and values as HTML; any text is escaped."""
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(text)}</td></tr>" for name, text in rows)
    return f"<p><b>{html.escape(title)}</b></p><table><tbody>{cells}</tbody></table>"


def text_of(value: Any) -> str:
    """Return a value in a few words: of an array its size and range, of a mapping its names."""
    if value is None or isinstance(value, bool | str):
        return str(value)
    if isinstance(value, Mapping):
        return listed(map(str, value), _MOST_NAMES) or "none"
    if hasattr(value, "columns"):  # a DataFrame
        return f"{len(value)} rows of {listed(map(str, value.columns), _MOST_NAMES)}"
    if isinstance(value, list | tuple) and not all(isinstance(one, int | float) for one in value):
        return listed((one if isinstance(one, str) else repr(one) for one in value), _MOST_NAMES)
    if isinstance(value, int | float | list | tuple) or hasattr(value, "shape"):
        return _number_text(value)
    return repr(value)


def _number_text(value: Any) -> str:
    try:
        numbers = np.asarray(value)
    except TypeError:  # inside a JAX transformation there are no numbers yet
        return str(value)
    if numbers.dtype.kind not in "biuf":
        return f"{type(value).__name__} of shape {numbers.shape}"
    if numbers.size == 1:
        one = numbers.reshape(-1)[0]
        return str(one) if numbers.dtype.kind in "bi" else f"{one:.5g}"
    size = " x ".join(map(str, numbers.shape))
    finite = numbers[np.isfinite(numbers)] if numbers.dtype.kind == "f" else numbers
    return f"{size} values{f', {finite.min():.4g} to {finite.max():.4g}' if finite.size else ''}"


def _entries(record: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the entries of a dataclass, or of a form of a file, each with its value and its default."""
    if dataclasses.is_dataclass(record):
        for field in dataclasses.fields(record):
            if not field.name.startswith("_"):
                default = field.default_factory() if callable(field.default_factory) else field.default
                yield field.name, getattr(record, field.name), default
        return
    for name, field in type(record).model_fields.items():
        yield name, getattr(record, name), field.get_default(call_default_factory=True)


def _same(value: Any, default: Any) -> bool:
    if default is dataclasses.MISSING or type(default).__name__ == "PydanticUndefinedType":
        return False
    try:
        return bool(np.all(np.asarray(value) == np.asarray(default))) if np.ndim(value) == np.ndim(default) else False
    except (TypeError, ValueError):
        return False
