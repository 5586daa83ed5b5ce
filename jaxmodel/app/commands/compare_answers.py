"""`jaxmodel compare-answers` and `jaxmodel history`: what changed between diagnoses, and which there were."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.app import terminal
from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.units import split_unit
from jaxmodel.diagnosis.answers import answers_below, history_files
from jaxmodel.diagnosis.answers import history as history_table
from jaxmodel.diagnosis.changes import AnswerChanges, beside_tables, compare_answers
from jaxmodel.diagnosis.result import Estimate
from jaxmodel.diagnosis.wording import amount, effect_name, number, with_sd

_MOST_NUMBERS = 12  # that a table of what moved shows


def compare(before: Path, after: Path | None, *, as_json: bool = False) -> None:
    """Print what changed between two answers, or between those of two folders that hold the same cases.

    Args:
        before: a folder of a diagnosis, a folder of such folders, or a JSON file.
        after: the other; None for the last answer of `before`, against the one before it.
        as_json: print JSON.

    Raises:
        MeasurementError: there is no answer, none earlier, or the two folders have no case in common.
    """
    changes = {name: compare_answers(*pair) for name, pair in _pairs(before, after).items()}
    if as_json:
        found: Any = {name: one.to_dict() for name, one in changes.items()}
        print(json.dumps(found.get("", found), indent=2))
        return
    for name, one in changes.items():
        _print(name, one)


def _pairs(before: Path, after: Path | None) -> dict[str, tuple[Path, Path]]:
    """Return the answers to compare by the name of the case, "" where only two are given."""
    if after is None:
        return {name: _last_two(folder) for name, folder in answers_below(before).items()}
    ones, others = answers_below(before), answers_below(after)
    if len(ones) == len(others) == 1:  # of whatever names: the same case may be called otherwise
        return {"": (next(iter(ones.values())), next(iter(others.values())))}
    common = [name for name in ones if name in others]
    if not common:
        raise MeasurementError(f"{before} and {after} have no case in common; give the folders of one case each.")
    for where, alone in ((before, ones.keys() - others), (after, others.keys() - ones)):
        if alone:
            terminal.complain(f"Only in {where}: {', '.join(sorted(alone))}.")
    return {name: (ones[name], others[name]) for name in common}


def _last_two(folder: Path) -> tuple[Path, Path]:
    files = history_files(folder) if folder.is_dir() else []
    if len(files) < 2:
        raise MeasurementError(f"{folder} has no earlier answer to compare with; give two folders or files.")
    return files[-2], files[-1]


def _print(name: str, changes: AnswerChanges) -> None:
    rows = [["verdict", *changes.verdict], *changes.origin.to_numpy().tolist()]
    terminal.table(name or "Two answers", ("", "before", "after"), rows)
    if len(changes.names):
        shown = [
            [effect_name(one["name"]), one["before"], one["after"]]
            + [number(one[f"probability_{when}"], 2) for when in ("before", "after")]
            for one in changes.names.to_dict("records")
        ]
        columns = ("effect", "before", "after", "probability before", "after")
        terminal.table("Names", columns, shown, right=(3, 4))
    for channel, rows_of in changes.errors.groupby("channel", sort=False):
        _print_errors(str(channel), rows_of)
    _print_numbers(changes.parameters[changes.parameters["moved"]])
    for sentence in beside_tables(changes):
        terminal.say(sentence)


def _print_errors(channel: str, rows: pd.DataFrame) -> None:
    texts, unit = amount(channel, rows[["before", "after", "change"]].to_numpy().ravel().tolist())
    quantity = split_unit(channel)[0]
    title = f"RMS error of {quantity} [{unit}]" if unit else f"RMS error of {quantity}"
    cells = [texts[first : first + 3] for first in range(0, len(texts), 3)]
    shown = [
        [row["run"], row["split"], was, now, _percent(row["before"], row["after"])]
        for row, (was, now, _) in zip(rows.to_dict("records"), cells, strict=True)
    ]
    terminal.table(title, ("run", "split", "before", "after", "change"), shown, right=(2, 3, 4))


def _percent(before: float, after: float) -> str:
    return f"{100.0 * (after / before - 1.0):+.1f} %" if before > 0.0 and np.isfinite(after) else "-"


def _print_numbers(moved: pd.DataFrame) -> None:
    """Print the numbers that moved, those that moved most of their sd first."""
    if moved.empty:
        return
    sd = moved["sd_before"].fillna(0.0).clip(lower=1e-300)
    order = ((moved["after"] - moved["before"]).abs() / sd).fillna(np.inf).sort_values(ascending=False).index
    rows = [
        [one["name"], *(_with_sd(one[when], one[f"sd_{when}"], one["unit"]) for when in ("before", "after"))]
        for one in moved.loc[order[:_MOST_NUMBERS]].to_dict("records")
    ]
    more = len(moved) - len(rows)
    terminal.table(
        f"Numbers that moved{f', and {more} more' if more else ''}", ("number", "before", "after"), rows, right=(1, 2)
    )


def _with_sd(value: float, sd: float, unit: str) -> str:
    return with_sd(Estimate(value, sd, unit)) if np.isfinite(value) else "-"


def history(folder: Path, *, as_json: bool = False) -> None:
    """Print the diagnoses that were written to a folder, or to each folder in it.

    Raises:
        MeasurementError: there is none.
    """
    found = {name: history_table(place) for name, place in answers_below(folder).items()}
    if as_json:
        tables: Any = {name: json.loads(table.to_json(orient="records")) for name, table in found.items()}
        print(json.dumps(tables.get("", tables), indent=2))
        return
    for name, table in found.items():
        channels = [column for column in table.columns if column not in _PLAIN]
        shown = {column: amount(column, table[column].astype(float).tolist()) for column in channels}
        heads = [_PLAIN.get(column) or _head(column, shown[column][1]) for column in table.columns]
        rows = [
            [str(row[column]) if column in _PLAIN else shown[column][0][place] for column in table.columns]
            for place, (_, row) in enumerate(table.iterrows())
        ]
        right = [place for place, column in enumerate(table.columns) if column in channels]
        terminal.table(name or folder.resolve().name, heads, rows, right=right)


_PLAIN = {"made": "diagnosed at", "version": "version", "verdict": "verdict", "named": "named"}
_PLAIN |= {"possible": "possible", "data": "data"}


def _head(channel: str, unit: str) -> str:
    return f"{split_unit(channel)[0]} [{unit}]" if unit else split_unit(channel)[0]
