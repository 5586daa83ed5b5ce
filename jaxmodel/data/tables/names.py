"""Names of columns as benches write them: the unit in them, and the quantity that they name."""

from __future__ import annotations

import functools
import re
from collections.abc import Sequence
from typing import NamedTuple

from jaxmodel.data.tables.quantities import ELSEWHERE, HEAT, MEASURED, NOT_MEASURED, QUANTITIES, WANTED, Quantity
from jaxmodel.data.tables.units import conversion, is_unit, spelled


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
        unit_unknown: it has a unit that nobody knows, so that the name alone speaks for it.
    """

    quantity: str
    rank: int
    unit_unknown: bool = False


_BRACKETS = re.compile(r"[(\[{]\s*([^()\[\]{}]*?)\s*[)\]}]")
_TIME_FORM = re.compile(r"(d+[. ])?h+:m+(in)?:s+(\.m?s+|\.f+)?", re.IGNORECASE)
_NUMBER = re.compile(r"[+-]?\d*[.,]?\d+([eE][+-]?\d+)?")
_DIGITS = re.compile(r"\d+$")
_SLASH = re.compile(r"^(?P<name>.+?)\s*/\s*(?P<unit>[^/\s()\[\]{}]+(/s2?|/min)?)$")
_ENDING = re.compile(r"^(?P<name>.+?)[_\s](?P<unit>m_s2|rad_s|deg_s|m_s|[^\s_]+)$")
# A word at the end of a name that is a unit: of one letter only after an underscore, so that 'Ch A' is no current.
_IN = re.compile(r"^(?P<name>.+?)\s+in\s+(?P<unit>\S+)$", re.IGNORECASE)
_LETTERS = frozenset("sAVCKFWhd%")
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_SEPARATORS = re.compile(r"[\W_]+")


@functools.lru_cache(maxsize=4096)
def parse_name(column: str) -> Name:
    """Return the words and the unit of a column's name: 'Voltage(V)', 'I/mA', 'Test Time / s', 'Angle in deg'."""
    text = " ".join(column.split()).strip("# \"'")
    # A column may be called by its unit alone: 'Nm'. 'V' is a name of a voltage first.
    if spelled(text) and not text.isdigit() and _words(text) not in _whole_names():
        return Name(_words(text), text)
    brackets = list(_BRACKETS.finditer(text))
    for states_unit in (_is_unit, _looks_like_unit):
        for found in brackets:
            at_end = not text[found.end() :].strip()
            if states_unit(found[1]) and (at_end or states_unit is _is_unit):
                return Name(_words(f"{text[: found.start()]} {text[found.end() :]}"), found[1])
    if (found := _SLASH.match(text)) and is_unit(found["unit"]):
        return Name(_words(found["name"]), found["unit"])
    if (found := _IN.match(text)) and is_unit(found["unit"]) and not found["unit"].isdigit():
        return Name(_words(found["name"]), found["unit"])
    if (found := _ENDING.match(text)) and spelled(unit := found["unit"]) and not unit.isdigit():
        if (len(unit) > 1 or (unit in _LETTERS and "_" in text)) and unit not in ("Volt", "Amp", "C1"):
            return Name(_words(found["name"]), unit)
    return Name(_words(text), "")


def _is_unit(text: str) -> bool:
    """Return whether a text is a unit, or the form of a time ('h:min:s.ms')."""
    return is_unit(text) or _TIME_FORM.fullmatch(text) is not None


def _looks_like_unit(text: str) -> bool:
    """Return whether a text in brackets can be a unit that nobody knows, and not a remark: 'Current (motor)'."""
    short = bool(text) and len(text) <= 14 and " " not in text and not text.isdigit()
    words = _words(text)
    return short and words not in _vocabulary() and not {one for one in _tokens(words) if len(one) > 2} & _vocabulary()


@functools.cache
def _whole_names() -> frozenset[str]:
    return frozenset(name for quantity in QUANTITIES.values() for name in quantity.names)


@functools.cache
def _vocabulary() -> frozenset[str]:
    """Return every word that a name of a quantity may hold."""
    known = [*NOT_MEASURED, *WANTED, *ELSEWHERE, "measured", "filtered", "average", "avg", "mean", "smoothed", "actual"]
    for quantity in QUANTITIES.values():
        known += [*quantity.words, *quantity.also, *quantity.without]
        known += [word for name in quantity.names for word in name.split()]
    return frozenset(known)


def _words(text: str) -> str:
    return _SEPARATORS.sub(" ", _CAMEL.sub(" ", text)).strip().lower()


def _tokens(words: str) -> frozenset[str]:
    """Return the single words of a name, without numbers behind them: 'force x1' is a force."""
    return frozenset(_DIGITS.sub("", token) for token in words.split())


def says_another(column: str, quantities: Sequence[str] = (), unit: str = "") -> bool:
    """Return whether a column's name says what it holds, and that it is none of some quantities.

    Args:
        column: its name.
        quantities: keys of `QUANTITIES` that it may be, the one that is sought first.
        unit: as the file states it; that in the name, if the file states none.
    """
    tokens = _tokens(parse_name(column).words)
    without = QUANTITIES[quantities[0]].without if quantities else frozenset()
    return bool(tokens & (ELSEWHERE | WANTED | without)) or any(
        match.quantity not in quantities for match in matches(column, unit)
    )


def is_set(column: str) -> bool:
    """Return whether a column's name says that it is set or supplied, and not measured."""
    tokens = _tokens(parse_name(column).words)
    return bool(tokens & NOT_MEASURED) and not tokens & MEASURED


def are_units(fields: Sequence[str], above: Sequence[str]) -> bool:
    """Return whether a line states the units of the names in the line above it, and names nothing itself.

    A word is a unit alone or in brackets; 'Time(s)' is a name, a number is neither. Where some are units that nobody
    knows, the words of the line above must name more than those of this one; where all are, most of them must. Below
    channels that name nothing ('X,CH1,CH2' above 'Sequence,Volt,Volt'), most words must be units.

    Args:
        fields: of the line.
        above: of the line above it; empty where there is none.
    """
    filled = [field for field in fields if field.strip() and not _NUMBER.fullmatch(field.strip())]
    units = sum(_is_field_of_unit(field) for field in filled)
    if 2 * sum(bool(field.strip()) for field in above) <= len(filled):  # a title is no line of names
        return False
    here, there = _named(filled), _named(above)
    if here == 0 and 2 * units > len(filled) and len({*above}) == len(above) > 0:
        return True
    return units == len(filled) or (units > 0 and here < there) or (here == 0 and 2 * there > len(filled))


def _named(fields: Sequence[str]) -> int:
    """Return how many fields name a quantity, and are no units."""
    return sum(bool(matches(field)) and not _is_field_of_unit(field) for field in fields)


def _is_field_of_unit(field: str) -> bool:
    whole = _BRACKETS.fullmatch(field.strip()) or re.fullmatch(r"<([^<>]*)>", field.strip())
    if whole:
        return len(whole[1]) < 12
    return _is_unit(field.strip())


def of_two_lines(names: Sequence[str], above: Sequence[str]) -> list[str]:
    """Return names that stand in two lines, as in a sheet with merged cells.

    A column without a name in the lower line has that of the upper one. A name that occurs more than once gets the
    word above it, which holds for the columns to its right too. A single field above is a title.

    Args:
        names: of the lower line, as many as there are columns.
        above: the fields of the line above it.
    """
    above = [*above, *[""] * len(names)][: len(names)]
    filled = sum(bool(field) for field in above)
    gaps = any(not name and field for name, field in zip(names, above, strict=True))
    if filled < 2 or not any(names) or not (gaps or len({*filter(None, names)}) < sum(bool(n) for n in names)):
        return list(names)
    found, group = [], ""
    for name, field in zip(names, above, strict=True):
        group = field or group
        found.append((f"{group} {name}" if list(names).count(name) > 1 else name) if name else field)
    return found


def matches(column: str, unit: str = "") -> list[Match]:
    """Return the quantities that a column may be, the surest first.

    Args:
        column: its name.
        unit: as the file states it; that in the name, if the file states none.
    """
    words, in_name = parse_name(column)
    unit = unit or in_name
    found = []
    for name, quantity in QUANTITIES.items():
        if (rank := _rank(words, unit, quantity)) >= 0:
            found.append(Match(name, rank, bool(unit) and _fits(unit, quantity) is None))
    return sorted(found, key=lambda match: (match.unit_unknown, match.rank))


def _rank(words: str, unit: str, quantity: Quantity) -> int:
    """Return how well words fit a quantity, -1 if they do not."""
    if unit and _fits(unit, quantity) is False:
        return -1
    if words in quantity.with_unit and not unit:
        return -1
    if words in quantity.names:
        return quantity.names.index(words)
    tokens = words.split()
    without = {*tokens, *_tokens(words)}  # 'imu2' is one of those that 'imu' names
    # A logger numbers its thermometers, 'LogTemp001', and not its one voltage.
    said = {*tokens, *(_tokens(words) & HEAT)}
    if without & quantity.without or not said & quantity.words:
        return -1
    if quantity.also and not any(token in quantity.also for token in tokens):
        return -1
    set_ = any(token in NOT_MEASURED for token in tokens) and not any(token in MEASURED for token in tokens)
    return (200 if set_ else 100) + len(tokens)


def _fits(unit: str, quantity: Quantity) -> bool | None:
    """Return whether a unit is one of a quantity; None if it is none that benches write."""
    if quantity.unit is None:
        return not quantity.counts or spelled(unit) == "dimensionless"
    if quantity.unit == "s" and _TIME_FORM.fullmatch(unit):
        return True
    if conversion(unit, quantity.unit) is not None:
        return True
    return False if spelled(unit) else None
