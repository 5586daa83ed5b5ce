"""Errors caused by user input: each states what is wrong, where, and what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class UserError(ValueError):
    """An error in user input; its text is one sentence for the terminal."""


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


class Remark(UserWarning):
    """What a user should know of a result and need not act on; one sentence, as that of an error."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ' Did you mean ...?' for the known name nearest to a misspelt one, or ''."""
    by_lower_case = {entry.lower(): entry for entry in known}
    match = difflib.get_close_matches(name.lower(), by_lower_case, n=1, cutoff=0.5)
    return f" Did you mean '{by_lower_case[match[0]]}'?" if match else ""
