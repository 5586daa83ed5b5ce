"""Writing TOML: the subset that case files need, in compact form."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

_LINE = 100
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def document(content: Mapping[str, Any]) -> str:
    """Return a document: plain values, a [table] for each mapping, a [[block]] for each entry of a list of mappings.

    Nested mappings are written inline, `{ a = 1 }`, or as a table of their own if the line would be long.
    """
    lines: list[str] = []
    tables: list[tuple[str, Mapping[str, Any]]] = []
    for name, entry in content.items():
        if isinstance(entry, Mapping):
            short = {k: v for k, v in entry.items() if not _is_long(v)}
            tables += [(f"[{key(name)}]", short)] if short or not entry else []
            tables += [(f"[{key(name)}.{key(k)}]", v) for k, v in entry.items() if _is_long(v)]
        elif _is_blocks(entry):
            tables += [(f"[[{key(name)}]]", block) for block in entry]
        else:
            lines.append(f"{key(name)} = {value(entry)}")
    for heading, table in tables:
        lines += ["", heading, *(f"{key(k)} = {value(v)}" for k, v in table.items())]
    return "\n".join(lines) + "\n"


def _is_long(entry: Any) -> bool:
    return isinstance(entry, Mapping) and len(value(entry)) > _LINE


def _is_blocks(entry: Any) -> bool:
    return isinstance(entry, Sequence) and bool(entry) and all(isinstance(item, Mapping) for item in entry)


def key(name: str) -> str:
    """Return a key, in quotes if necessary."""
    return name if _BARE.fullmatch(name) else value(name)


def value(entry: Any) -> str:
    """Return a value as TOML.

    Raises:
        TypeError: TOML has no such type.
    """
    match entry:
        case bool():
            return "true" if entry else "false"
        case int():
            return str(entry)
        case float():
            return repr(float(entry))  # of a NumPy number as of Python's own
        case str():
            # JSON's strings are TOML's but for this one character.
            return json.dumps(entry, ensure_ascii=False).replace("\x7f", "\\u007f")
        case Mapping():
            return "{ " + ", ".join(f"{key(k)} = {value(v)}" for k, v in entry.items()) + " }"
        case Sequence():
            return "[" + ", ".join(value(item) for item in entry) + "]"
    raise TypeError(f"TOML has no value for {entry!r}.")
