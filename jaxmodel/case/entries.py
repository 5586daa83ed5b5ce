"""Arguments of Python calls in the form of case.toml, so that both share checks and messages."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.case.forms import CaseEntry, check_case


def entry_of(
    where: str, names: Iterable[str], check: Collection[Any], runs: Mapping[Any, Mapping[str, Any]], **stated: Any
) -> CaseEntry:
    """Return the checked form of a case.

    Args:
        where: name of the case in messages.
        names: of the runs.
        check: names of the check runs.
        runs: further entries by run.
        stated: the other tables of case.toml by name.

    Raises:
        MeasurementError: `check` or `runs` names a run that is not there, or an entry has the wrong form.
        ParameterError: the same, inside `parameters`.
    """
    names = [str(name) for name in names]
    check = [check] if isinstance(check, str) else [str(name) for name in check]
    runs = {str(name): entries for name, entries in runs.items()}
    for option, given in (("check", check), ("runs", runs)):
        for name in given:
            if name not in names:
                hint = nearest(name, names) or f" The runs are {', '.join(names)}."
                raise MeasurementError(f"{where}: {option} names the run '{name}', but there is no such run.{hint}")
    blocks = [{**runs.get(name, {}), "file": name, "split": "check" if name in check else "fit"} for name in names]
    return check_case(_plain({**stated, "runs": blocks}), where)


def _plain(value: Any) -> Any:
    """Return values as TOML would hold them: NumPy numbers and arrays as Python's, `(value, sd)` as a table."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        value = {name: entry for name, entry in value.items() if entry is not None}
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, tuple) and len(value) == 2:
        return {"value": _plain(value[0]), "sd": _plain(value[1])}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray | pd.Series):
        return value.tolist()
    return [_plain(entry) for entry in value] if isinstance(value, list | tuple) else value
