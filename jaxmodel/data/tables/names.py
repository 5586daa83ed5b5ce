"""Names of columns as benches write them: the unit in them, and the quantity that they name."""

from __future__ import annotations

import functools
import re
from typing import NamedTuple

from jaxmodel.data.tables.quantities import NOT_MEASURED, QUANTITIES, Quantity
from jaxmodel.data.tables.units import conversion, spelled


class Name(NamedTuple):
    """A column's name in parts: its words, lower case and without unit, and its unit as written ('' if it has none)."""

    words: str
    unit: str


class Match(NamedTuple):
    """A quantity that a name may mean; the lower the rank, the surer.

    Attributes:
        quantity: a key of `QUANTITIES`.
        rank: the place of the synonym among those of the quantity; 100 and more for a name that only contains a word
            of it, 200 and more where the word says that it is set and not measured.
    """

    quantity: str
    rank: int


_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[(\[{]\s*(?P<unit>[^()\[\]{}]*)\s*[)\]}]\s*_?(?P<more>.*)$")
_SLASH = re.compile(r"^(?P<name>.+?)\s*/\s*(?P<unit>[^/\s]+(/s2?|/min)?)$")
_ENDING = re.compile(r"^(?P<name>.+?)[_\s](?P<unit>m_s2|rad_s|deg_s|m_s|[^\s_]+)$")
# A word at the end of a name that is a unit: of one letter only after an underscore, so that 'Ch A' is no current.
_LETTERS = frozenset("sAVCKFWhd%")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_SEPARATORS = re.compile(r"[\W_]+")


@functools.lru_cache(maxsize=4096)
def parse_name(column: str) -> Name:
    """Return the words and the unit of a column's name: 'Voltage(V)', 'I/mA', 'Test Time / s', 'current_mA'."""
    text = " ".join(column.split()).strip("# \"'")
    if (found := _BRACKETS.match(text)) and (spelled(found["unit"]) or _looks_like_unit(found["unit"])):
        return Name(_words(f"{found['name']} {found['more']}"), found["unit"].strip())
    if (found := _SLASH.match(text)) and spelled(found["unit"]):
        return Name(_words(found["name"]), found["unit"])
    for pattern in (_ENDING,):
        found = pattern.match(text)
        if not found or not spelled(found["unit"]) or found["unit"].isdigit():
            continue
        unit = found["unit"]
        if (len(unit) > 1 or (unit in _LETTERS and "_" in text)) and unit not in ("Volt", "Amp", "C1"):
            return Name(_words(found["name"]), unit)
    return Name(_words(text), "")


def _looks_like_unit(text: str) -> bool:
    """Return whether the text in brackets can be a unit, or the form of a time ('h:min:s.ms')."""
    return bool(text) and len(text) <= 14 and " " not in text.strip() and not text.strip().isdigit()


def _words(text: str) -> str:
    return _SEPARATORS.sub(" ", _CAMEL.sub(" ", text)).strip().lower()


def matches(column: str, unit: str = "") -> list[Match]:
    """Return the quantities that a column may be, the surest first.

    Args:
        column: its name.
        unit: as the file states it; that in the name, if the file states none.
    """
    words, in_name = parse_name(column)
    unit = unit or in_name
    found = [Match(name, rank) for name, quantity in QUANTITIES.items() if (rank := _rank(words, unit, quantity)) >= 0]
    return sorted(found, key=lambda match: match.rank)


def _rank(words: str, unit: str, quantity: Quantity) -> int:
    """Return how well words fit a quantity, -1 if they do not."""
    if unit and not _fits(unit, quantity):
        return -1
    if words in quantity.with_unit and not unit:
        return -1
    if words in quantity.names:
        return quantity.names.index(words)
    tokens = words.split()
    if any(token in quantity.without for token in tokens) or not any(token in quantity.words for token in tokens):
        return -1
    if quantity.also and not any(token in quantity.also for token in tokens):
        return -1
    return (200 if any(token in NOT_MEASURED for token in tokens) else 100) + len(tokens)


def _fits(unit: str, quantity: Quantity) -> bool:
    if quantity.unit is None:
        return not quantity.counts or spelled(unit) == "dimensionless"
    if quantity.unit == "s" and re.fullmatch(r"(d+[. ])?h+:m+(in)?:s+(\.m?s+|\.f+)?", unit, re.IGNORECASE):
        return True
    return conversion(unit, quantity.unit) is not None
