"""What changed between two diagnoses: verdict, names, numbers, errors by run and channel, data and version."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.units import difference_unit, split_unit
from jaxmodel.diagnosis.answer import rows_of
from jaxmodel.diagnosis.answers import Answer, answer_of, data_in_short, differences_of, label_of
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.wording import amount, effect_name, join

NAMED, POSSIBLE, ABSENT = "named", "possible", "absent"
# The rows of all runs of a split together.
ALL = {"fit": "all fit runs", "check": "all check runs"}
# A number has moved if it differs by more than this share of its sd, or of itself where it has none: answers are
# written with six digits.
_MOVED_SD, _MOVED = 0.01, 1e-5


@dataclasses.dataclass(frozen=True, eq=False)
class AnswerChanges:
    """What changed from one diagnosis to another, of the same case or of two.

    Attributes:
        before, after: the two answers.
        verdict: before and after.
        names: a row for each effect of either: `name`, its band `before` and `after` ("named", "possible" or
            "absent"), and its probability where it is named.
        parameters: a row for each number of the final model of either: `name`, `unit`, `before`, `sd_before`, `after`,
            `sd_after`, and whether it `moved`.
        errors: a row for each channel of each run, and of all fit and check runs together: `channel`, `unit`, `run`,
            `split`, `before`, `after`, `change`, the RMS errors of the final models.
        data: a row for each file of either: `file`, and what it is: "same", "changed", "came", "went".
        origin: a row for case, time, version, model, options and data: `what`, `before`, `after`.
    """

    before: Answer
    after: Answer
    verdict: tuple[str, str]
    names: pd.DataFrame
    parameters: pd.DataFrame
    errors: pd.DataFrame
    data: pd.DataFrame
    origin: pd.DataFrame

    @property
    def is_empty(self) -> bool:
        """Return True if verdict, names, numbers, errors and data are the same."""
        same_names = bool((self.names["before"] == self.names["after"]).all())
        same_errors = bool((self.errors["before"].sub(self.errors["after"]).fillna(0.0) == 0.0).all())
        is_same = bool((self.data["what"] == "same").all())
        moved = bool(self.parameters["moved"].any())
        return self.verdict[0] == self.verdict[1] and same_names and same_errors and is_same and not moved

    def to_dataframe(self) -> pd.DataFrame:
        """Return the errors by run and channel: channel, unit, run, split, before, after, change."""
        return self.errors

    def to_dict(self) -> dict[str, Any]:
        """Return everything that changed and everything it was held against, ready for JSON; NaN is null."""
        tables = {name: getattr(self, name) for name in ("origin", "names", "parameters", "errors", "data")}
        return {"verdict": {"before": self.verdict[0], "after": self.verdict[1]}} | {
            name: rows_of(table) for name, table in tables.items()
        }

    def summary(self) -> str:
        """Return what changed, a sentence in a line."""
        return "\n".join(_sentences(self))

    def __repr__(self) -> str:
        one, other = self.verdict
        verdict = one if one == other else f"{one} -> {other}"
        count = int((self.names["before"] != self.names["after"]).sum())
        return f"<AnswerChanges: {verdict}, {count} of {len(self.names)} names, {self._moved()} numbers>"

    def _moved(self) -> int:
        return int(self.parameters["moved"].sum())

    def _repr_html_(self) -> str:
        lines = "".join(f"<li>{html.escape(line)}</li>" for line in _sentences(self))
        return f"<ul>{lines}</ul>{self.errors.to_html(index=False, border=0, float_format='{:.4g}'.format)}"


def compare_answers(
    before: Diagnosis | Mapping[str, Any] | str | Path, after: Diagnosis | Mapping[str, Any] | str | Path
) -> AnswerChanges:
    """Return what changed from one diagnosis to another.

    Args:
        before: a diagnosis, its answer, the folder that it was written to, or a JSON file: `answer.json`, or one of the
            folder's history.
        after: the other one.

    Raises:
        MeasurementError: there is no answer, or it cannot be read.
    """
    one, other = answer_of(before), answer_of(after)
    return AnswerChanges(
        before=one,
        after=other,
        verdict=(one["verdict"], other["verdict"]),
        names=_table(_names(one, other), ("name", "before", "after", "probability_before", "probability_after")),
        parameters=_table(
            _parameters(one, other), ("name", "unit", "before", "sd_before", "after", "sd_after", "moved")
        ),
        errors=_table(_errors(one, other), ("channel", "unit", "run", "split", "before", "after", "change")),
        data=_table(_data(one, other), ("file", "what")),
        origin=_table(_origin(one, other), ("what", "before", "after")),
    )


def _table(rows: Iterator[tuple[Any, ...]], columns: tuple[str, ...]) -> pd.DataFrame:
    return pd.DataFrame(list(rows), columns=list(columns))


def bands(one: Answer) -> dict[str, tuple[str, float]]:
    """Return the band of each effect of the final model of an answer, and its probability, NaN where it has none."""
    found = {label_of(effect): (NAMED, _float(effect["probability"])) for effect in one["effects"]}
    found |= {label: (NAMED, float("nan")) for label in differences_of(one)}
    return found | {label: (POSSIBLE, float("nan")) for label in one.get("possible", ()) if label not in found}


def _names(one: Answer, other: Answer) -> Iterator[tuple[Any, ...]]:
    of_one, of_other = bands(one), bands(other)
    for label in dict.fromkeys((*of_one, *of_other)):
        (band, probability), (later, probability_later) = (
            found.get(label, (ABSENT, float("nan"))) for found in (of_one, of_other)
        )
        yield label, band, later, probability, probability_later


def _parameters(one: Answer, other: Answer) -> Iterator[tuple[Any, ...]]:
    of_one, of_other = _numbers(one), _numbers(other)
    for name in dict.fromkeys((*of_one, *of_other)):
        was, now = (found.get(name, {}) for found in (of_one, of_other))
        value, later = _float(was.get("value")), _float(now.get("value"))
        sd, sd_later = _float(was.get("sd")), _float(now.get("sd"))
        yield name, was.get("unit") or now.get("unit") or "", value, sd, later, sd_later, _moved(value, later, sd)


def _numbers(one: Answer) -> dict[str, Any]:
    """Return the numbers of an answer by name; of an older one, which lists none, those of its named effects."""
    if "parameters" in one:
        return one["parameters"]
    return {
        f"{label_of(effect)}.{name}": value
        for effect in one["effects"]
        for name, value in effect["parameters"].items()
        if name != "column"
    }


def _moved(value: float, later: float, sd: float) -> bool:
    """Return True if a number came, went or differs."""
    if np.isnan(value) or np.isnan(later):
        return bool(np.isnan(value) != np.isnan(later))
    return abs(later - value) > (_MOVED_SD * sd if sd > 0.0 else _MOVED * abs(value))


def _errors(one: Answer, other: Answer) -> Iterator[tuple[Any, ...]]:
    of_one, of_other = _by_run(one), _by_run(other)
    for channel in dict.fromkeys((*one["error"], *other["error"])):
        unit = difference_unit(split_unit(channel)[1])
        for split, run in ALL.items():
            was, now = (_float(found["error"].get(channel, {}).get("after", {}).get(split)) for found in (one, other))
            if not (np.isnan(was) and np.isnan(now)):
                yield channel, unit, run, split, was, now, now - was
        for key in dict.fromkeys((*of_one, *of_other)):
            if key[0] == channel:
                was, now = (found.get(key, float("nan")) for found in (of_one, of_other))
                yield channel, unit, key[1], key[2], was, now, now - was


def _by_run(one: Answer) -> dict[tuple[str, str, str], float]:
    """Return the error of the final model by channel, run and split."""
    rows = one.get("errors_by_run", ())
    return {(row["channel"], row["run"], row["split"]): _float(row["rms"]) for row in rows if row["model"] == "final"}


def _data(one: Answer, other: Answer) -> Iterator[tuple[str, str]]:
    was, now = (found.get("origin", {}).get("data", {}) for found in (one, other))
    if not was or not now:  # unknown is not the same as gone
        return
    for file in dict.fromkeys((*was, *now)):
        if file not in was:
            yield file, "came"
        elif file not in now:
            yield file, "went"
        else:
            yield file, "same" if was[file] == now[file] else "changed"


def _origin(one: Answer, other: Answer) -> Iterator[tuple[str, str, str]]:
    of_one, of_other = _said(one), _said(other)
    for what in of_one:
        yield what, of_one[what], of_other[what]


def _said(one: Answer) -> dict[str, str]:
    """Return where an answer comes from, in words."""
    made_from = one.get("origin", {})
    named = {"case": "case", "diagnosed at": "made", "version": "version"}
    return {what: made_from.get(name, "not known") for what, name in named.items()} | {
        "model": _model(one),
        "options": " ".join(made_from.get("options", ())) or "none",
        "data": data_in_short(one) or "not known",
    }


def _model(one: Answer) -> str:
    """Return the additions of the final model of an answer."""
    return " + ".join(map(effect_name, one["model"])) or "without additions" if "model" in one else "not known"


def _sentences(changes: AnswerChanges) -> Iterator[str]:
    """Say what changed: the verdict, the names, the errors of all runs, the numbers, the data, the version."""
    if changes.is_empty:
        yield "The same verdict, names, numbers, errors and data."
    one, other = changes.verdict
    yield f"Verdict: {one}, as before." if one == other else f"Verdict: {one} before, {other} now."
    for name, before, after in changes.names[["name", "before", "after"]].to_numpy().tolist():
        yield f"{effect_name(name)}: {_band(before, after)}."
    together = changes.errors[changes.errors["run"].isin(ALL.values())]
    for channel, run, *errors in together[["channel", "run", "before", "after"]].to_numpy().tolist():
        (was, now), unit = amount(channel, errors)
        unit = f" {unit}" if unit else ""
        yield f"RMS error of {split_unit(channel)[0]} on {run}: {was}{unit} before, {now}{unit} now."
    yield from beside_tables(changes)


def beside_tables(changes: AnswerChanges) -> Iterator[str]:
    """Say what tables of names and errors do not: which runs differ much, and what became of numbers and data."""
    yield from _worse_runs(changes)
    moved = int(changes.parameters["moved"].sum())
    yield f"{moved} of {len(changes.parameters)} numbers of the model moved." if moved else "No number moved."
    yield from _of_data(changes)


def _band(before: str, after: str) -> str:
    if before == after:
        return f"{after}, as before"
    if before == ABSENT:
        return f"{after} now, not in the model before"
    return f"{before} before, {'no longer in the model' if after == ABSENT else f'{after} now'}"


def _worse_runs(changes: AnswerChanges) -> Iterator[str]:
    """Say which runs became better and which worse, by more than a tenth."""
    rows = changes.errors[~changes.errors["run"].isin(ALL.values())]
    for channel, of_channel in rows.groupby("channel", sort=False):
        ratio = of_channel["after"] / of_channel["before"]
        for word, chosen in (("smaller", ratio < 0.9), ("larger", ratio > 1.1)):
            runs = of_channel["run"][chosen].tolist()
            if runs:
                listed = join(runs) if len(runs) <= 6 else f"{len(runs)} of {len(of_channel)} runs"
                yield f"The error of {split_unit(str(channel))[0]} is {word} by more than a tenth in {listed}."


def _of_data(changes: AnswerChanges) -> Iterator[str]:
    if changes.data.empty:
        yield "Whether the data are the same is not known: one of the answers does not state them."
        return
    words = {"changed": "changed", "came": "came", "went": "went"}
    said = [
        f"{join(files)} {words[what]}"
        for what in words
        if (files := changes.data["file"][changes.data["what"] == what].tolist())
    ]
    yield f"Data: {'; '.join(said)}." if said else "The data are the same."


def _float(value: float | None) -> float:
    return float("nan") if value is None else float(value)
