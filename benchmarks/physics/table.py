"""What is printed: a line for each channel of each cell, and what was asked."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from benchmarks.physics.judge import ASKED_RATIO, ASKED_RIGHT, ASKED_WRONG, Row
from benchmarks.real.table import UNITS, shown
from jaxmodel.app.terminal import say, table

COLUMNS = [
    "cell",
    "hidden",
    "expected",
    "verdict: named",
    "judged",
    "check",
    "noise",
    "before",
    "after",
    "best",
    "ratio",
    "s",
]


def print_rows(rows: Sequence[Row]) -> None:
    """Print the table."""
    lines = [line for row in rows for line in _lines(row)]
    table("Cells of PyBaMM: root mean square error on runs that were never fitted", COLUMNS, lines, right=range(6, 12))


def _lines(row: Row) -> Iterator[list[str]]:
    starts = [row.name, row.about, ", ".join(_short(either) for either in row.truth.expected) or "nothing"]
    starts += [_told(row), _judged(row)]
    seconds = f"{row.answer['seconds']:.0f}" if "seconds" in row.answer else ""
    errors = row.answer.get("error", {}) if row.answered else {}
    for number, channel in enumerate(errors or ("",)):
        start, end = (starts, seconds) if number == 0 else ([""] * len(starts), "")
        if not errors:
            yield [*start, *[""] * 6, end]
            continue
        before = errors[channel].get("before", {}).get("check")
        best, least = row.best(channel)
        of = [errors[channel].get("noise_floor"), before, row.after(channel)]
        values = [shown(float("nan") if value is None else value, channel) for value in of]
        ratio = row.ratios().get(channel)
        said = f"{ratio:.2f}" if ratio is not None else ""
        short = UNITS.get(channel, (channel,))[0]
        yield [*start, short, *values, f"{shown(least, channel)} {best}".strip(), said, end]


def _short(either: str) -> str:
    return either.partition("|")[0]


def _told(row: Row) -> str:
    if "failed" in row.answer:
        return f"FAILED: {row.answer['failed'][:120]}"
    if not row.answer:
        return "not diagnosed"
    names = list(row.named)
    names += [f"curve: {curve.get('port')} over {curve.get('over')}" for curve in row.answer.get("curves", ())]
    names += [f"{run.get('file')}: {run.get('parameter')}" for run in row.answer.get("runs", ())]
    return f"{row.answer['verdict']}: {', '.join(names) or 'nothing'}"


def _judged(row: Row) -> str:
    if not row.answered:
        return ""
    parts = [*(f"-{_short(either)}" for either in row.missed), *(f"+{name}" for name in row.wrong)]
    parts += [] if row.right_verdict else ["verdict"]
    return ", ".join(parts) or "right"


def sentences(found: dict[str, Any]) -> Iterator[str]:
    """Yield the summary as lines for a person."""
    yield f"{found['asked']} of {found['cells']} cells are diagnosed, {len(found['failed'])} of these failed."
    if found["asked"]:
        yield f"All that is expected is named and nothing wrong: {_rate(found['right'])} (asked: {ASKED_RIGHT:.0%})."
        wrong = found["with_a_wrong_name"]
        yield f"Answers with a wrong name: {_rate(wrong)} (asked: at most {ASKED_WRONG:.0%})."
        named, of = found["expected_named"]
        yield f"Of what is expected, {named} of {of} are named; missed: {_counts(found['missed'])}."
        yield f"Wrong names: {_counts(found['wrong'])}."
        yield f"Verdicts that are not wrong: {_rate(found['right_verdict'])}."
        yield f"Answers that blame a single run, which is true of none: {_rate(found['single_runs_blamed'])}."
    if found["ratios"]:
        mean, median, worst = (found[f"{name}_ratio"] for name in ("geometric_mean", "median", "worst"))
        yield (
            f"Held-out error of the final model over that of the best model tried: geometric mean {mean:.2f}, median"
            f" {median:.2f} (asked: at most {ASKED_RATIO:g}), worst {worst:.2f}, {found['worst']}, of {found['ratios']}"
            " cells and channels."
        )


def print_summary(found: dict[str, Any]) -> None:
    """Print the summary."""
    for sentence in sentences(found):
        say(sentence)


def _rate(found: dict[str, Any]) -> str:
    if not found["of"]:
        return "none"
    return f"{found['hits']} of {found['of']} ({found['hits'] / found['of']:.0%})"


def _counts(found: dict[str, int]) -> str:
    return ", ".join(f"{_short(name)} {count}" for name, count in found.items()) or "none"
