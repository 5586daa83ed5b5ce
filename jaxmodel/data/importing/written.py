"""Options of an import as a person writes them, in a shell or on a form, as `Options`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, cast

from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.options import Options

# What a pair of each option is, by the name of its field.
PAIRS = {
    "columns": 'NAME="COLUMN"',
    "units": "COLUMN=UNIT",
    "constants": "NAME=VALUE",
    "ambients": "PATTERN=DEGC",
    "specimens": "NAME=PATTERN",
    "load_numbers": "LAW:NAME=VALUE,NAME=VALUE",
    "controller_numbers": "position:NAME=VALUE,NAME=VALUE",
    "brushless_numbers": "rms:NAME=VALUE,NAME=VALUE",
}
LISTS = ("motors", "check", "flip", "sheet")
_WITH_NUMBERS = ("load", "controller", "brushless")
_OF_NUMBERS = ("constants", "ambients", *(f"{name}_numbers" for name in _WITH_NUMBERS))
NUMBERS = ("rest_minutes", "ambient", "initial_soc", "capacity_Ah", "seconds_per_row")
FLAGS = ("each_cell",)
COUNTS = ("cells_in_series", "parallel_cells")
# Options of the command that are not called as their field.
_CALLED = {
    "columns": "column", "units": "unit", "constants": "constant", "specimens": "specimen", "motors": "motor",
    "ambients": "ambient",
    "capacity_Ah": "capacity", "load_numbers": "load", "controller_numbers": "controller",
    "brushless_numbers": "brushless",
}  # fmt: skip


def option_of(name: str) -> str:
    """Return the option of the command that a field of `Options` has: "--specimen" of `specimens`."""
    return f"--{_CALLED.get(name, name).replace('_', '-')}"


def options_of(given: Mapping[str, Any]) -> Options:
    """Return options of which some are texts.

    Args:
        given: by field of `Options`, its value or a text: pairs and lists as lists of texts or one text with commas, a
            load, controller or kind of current with its numbers as "gravity:mass_kg=0.5,arm_m=0.1"; None for what is
            not given.

    Raises:
        MeasurementError: a text is not of its form, or a name is given twice.
    """
    given = {name: value for name, value in given.items() if value is not None}
    for name in _WITH_NUMBERS:
        said, colon, numbers = str(given.get(name, "")).partition(":")
        if colon:
            given |= {name: said.strip(), f"{name}_numbers": numbers}
    given |= _ambients(given.get("ambient"))
    taken: dict[str, Any] = {}
    for name, value in given.items():
        if name in PAIRS and not isinstance(value, Mapping):
            value = pairs(_several(value), option_of(name), PAIRS[name])
        if name in _OF_NUMBERS:
            value = {key: _number(one, f"{option_of(name)} {key}") for key, one in value.items()}
        if name in LISTS:
            value = tuple(_several(cast(Any, value)))
        if name in NUMBERS and value is not None:
            value = _number(value, option_of(name))
        if name in COUNTS:
            value = _count(value, option_of(name))
        if name in FLAGS:
            value = value in (True, "yes")
        taken[name] = value
    return Options(**taken)


def _ambients(value: Any) -> dict[str, Any]:
    """Return the ambient temperature of all runs and those of some files, which one option gives."""
    if not isinstance(value, (str, list, tuple)) or (isinstance(value, str) and "=" not in value):
        return {}
    texts = _several(value)
    of_some = [text for text in texts if "=" in text]
    of_all = [text for text in texts if "=" not in text]
    if len(of_all) > 1:
        raise MeasurementError(
            f"--ambient {' and '.join(of_all)}: all runs have one; name the files of each: PATTERN=DEGC."
        )
    return {"ambient": of_all[0] if of_all else None, **({"ambients": of_some} if of_some else {})}


def _several(value: str | Sequence[str]) -> list[str]:
    parts = value.split(",") if isinstance(value, str) else value
    return [part.strip() for part in parts if part.strip() or not isinstance(value, str)]


def pairs(texts: Sequence[str], option: str, form: str) -> dict[str, str]:
    """Return texts of the form NAME=VALUE as names with values.

    Args:
        texts: as written.
        option: that they are of, in messages.
        form: what to give.

    Raises:
        MeasurementError: a text is not of this form, or a name is given twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not name:
            raise MeasurementError(f"{option} {text}: give {form}.")
        if name in found:
            other = "; a pattern such as 'm[12]_*' is of several files" if option == "--specimen" else ""
            raise MeasurementError(f"{option}: {name} is given twice{other}; keep one of them.")
        found[name] = value.strip("\"'")
    return found


def _number(value: Any, option: str) -> float:
    try:
        return float(value.replace(",", ".") if isinstance(value, str) else value)
    except ValueError:
        raise MeasurementError(f"{option}: '{value}' is not a number; correct it.") from None


def _count(value: Any, option: str) -> int:
    number = _number(value, option)
    if number != round(number):
        raise MeasurementError(f"{option}: {value} is a count; give a whole number.")
    return int(number)
