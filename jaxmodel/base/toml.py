"""TOML: reading it within limits, and writing the subset that case files need, in compact form."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.schema import without_schema

_LINE = 100
# No file of ours has more than six tables in one another; deeper ones end in Python's own limit on recursion.
_DEEPEST = 20
# A key of more parts than that, as in a.b.c; the time of Python's parser grows with the square of their number.
_DOTTED = re.compile(rf"""(?<![\w-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{_DEEPEST}}}""")
_CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]")
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def parsed(text: str, where: str) -> dict[str, Any]:
    """Return the content of a TOML document, without its schema.

    Args:
        text: of it.
        where: name of the file in messages.

    Raises:
        MeasurementError: it is not TOML, is nested deeper than a person writes, or holds a number or a character that
            no file needs, or its schema is newer than this version.
    """
    if _DOTTED.search(text):
        raise _too_deep(where)
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise _too_deep(where) from None
    except tomllib.TOMLDecodeError as error:
        what, _, place = str(error).removesuffix(")").partition(" (at ")
        raise MeasurementError(f"{where}, {place}: this is not valid TOML ({what}); correct it there.") from error
    except ValueError:  # Python's limit on the digits of a whole number
        raise MeasurementError(f"{where}: a whole number in it has thousands of digits; correct it.") from None
    _check(content, where)
    return without_schema(content, where)


def _check(content: Mapping[str, Any], where: str) -> None:
    """Raise MeasurementError for what TOML allows and nobody means, table by table and without recursion."""
    left: list[tuple[Any, str, int]] = [(content, "", 0)]
    while left:
        entry, key_, depth = left.pop()
        if depth > _DEEPEST:
            raise _too_deep(where)
        if isinstance(entry, Mapping):
            left += [(item, name, depth + 1) for name, item in entry.items()]
            left += [(name, "a key", depth) for name in entry]
        elif isinstance(entry, list):
            left += [(item, key_, depth + 1) for item in entry]
        elif isinstance(entry, str) and _CONTROL.search(entry):
            raise MeasurementError(f"{where}: {key_} has a control character in its text; remove it.")
        elif isinstance(entry, int) and not -(2**63) <= entry < 2**63:
            raise MeasurementError(f"{where}: {key_} is a whole number of more than 64 bits; correct it.")


def _too_deep(where: str) -> MeasurementError:
    return MeasurementError(f"{where}: its tables or lists are nested more than {_DEEPEST} deep; flatten them.")


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
