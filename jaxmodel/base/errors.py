"""Errors caused by user input: each states what is wrong, where, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_MOST_LETTERS = 800  # of a sentence: what a damaged file puts into it may have no end
_MOST_NAMES = 12


class UserError(ValueError):
    """An error in user input; its text is one sentence for the terminal, on one line and without control characters.

    Example:
        >>> from jaxmodel import UserError, read_case
        >>> try:
        ...     read_case("nowhere")
        ... except UserError as error:
        ...     print("case.toml" in str(error))
        True
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(_on_one_line(sentence))


class ParameterError(UserError):
    """A parameter is unknown, out of its bounds or of the wrong form."""


class MeasurementError(UserError):
    """A case folder, its TOML file or one of its CSV files cannot be used."""


class SweepError(UserError):
    """A study cannot be run."""


class FitError(UserError):
    """A case cannot be calibrated."""


class EffectError(UserError):
    """An effect is unknown, does not apply to this kind of model, or is not valid."""


class RemarkWarning(UserWarning):
    """A remark as a warning of Python, where there is no result yet to carry it; one sentence, as that of an error."""


def _on_one_line(sentence: str) -> str:
    """Return a sentence without line ends and control characters, its middle left out if it is very long."""
    text = " ".join(sentence.split())
    text = "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)
    half = _MOST_LETTERS // 2
    return text if len(text) <= _MOST_LETTERS else f"{text[:half].rstrip()} ... {text[-half:].lstrip()}"


def reason(error: Exception, unsaid: str = "") -> str:
    """Return why something failed, for brackets in a sentence: an error's first line, or what to say if it has none."""
    lines = str(error).strip().splitlines()
    return lines[0].rstrip(".") if lines else unsaid or type(error).__name__


def instead(name: str, known: Iterable[str]) -> str:
    """Return what to write instead of an unknown name: the nearest known one, or which there are."""
    known = list(dict.fromkeys(known))
    if hint := nearest(name, known):
        return hint
    return f" Use one of {listed(known, _MOST_NAMES)}." if known else " Remove it."


def listed(names: Iterable[str], most: int) -> str:
    """Return names for a sentence, at most so many: 'a, b and 3 more'."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ' Did you mean ...?' for the known name nearest to a misspelt one, or ''."""
    by_lower_case = {entry.lower(): entry for entry in known}
    match = difflib.get_close_matches(name.lower(), by_lower_case, n=1, cutoff=0.5)
    return f" Did you mean '{by_lower_case[match[0]]}'?" if match else ""
