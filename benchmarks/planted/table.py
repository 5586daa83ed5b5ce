"""What is printed: a line for each planting, what the search held against those not told, and the shares."""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from benchmarks.planted.judge import Judgement
from benchmarks.planted.plantings import Planting
from jaxmodel.app.terminal import say, table

# Told in nine of ten, and nothing true lost: the task of this benchmark.
ASKED_TOLD, ASKED_LOST = 0.9, 0
VERDICTS = ("told", "possible", "missed", "failed")
LONGEST = 50  # letters of a cell of the table: a remark is a sentence


@dataclasses.dataclass(frozen=True)
class Row:
    """What came out of one planting.

    Attributes:
        planting: the fault.
        amount: its size, in its unit.
        seen: RMS by which it moves its column, in sd of the stated noise.
        judgement: of the answer.
        asked: of each candidate that would tell it, why the search refuses it.
        seconds: of the diagnosis.
    """

    planting: Planting
    amount: float
    seen: float
    judgement: Judgement
    asked: dict[str, Any]
    seconds: float

    def plain(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        one = self.planting
        return {
            "case": one.case,
            "fault": one.fault,
            "runs": list(one.runs),
            "size": self.amount,
            "unit": one.unit,
            "seen_sd": self.seen,
            **dataclasses.asdict(self.judgement),
            "asked": self.asked,
            "seconds": self.seconds,
        }


def print_rows(rows: Sequence[Row]) -> None:
    """Print the table, and below it why what is not told was refused."""
    columns = ["case", "fault", "planted", "moves, sd", "judged", "how", "size", "lost", "new", "s"]
    lines = []
    for row in rows:
        one, found = row.planting, row.judgement
        planted = f"{row.amount:.3g} {one.unit}{' in ' if one.runs else ''}{', '.join(one.runs)}"
        size = "" if found.size is None else f"{found.size:.3g}"
        lost, new = ", ".join(found.lost), ", ".join(found.new)
        how, seconds = textwrap.shorten(found.how, LONGEST, placeholder=" ..."), f"{row.seconds:.0f}"
        moves = f"{row.seen:.3g}"
        lines.append([one.case, one.fault, planted, moves, found.verdict, how, size, lost, new, seconds])
    table("Faults planted in measured data", columns, lines, right=(3, 6, 9))
    for row in rows:
        if row.judgement.verdict != "told":
            for sentence in refusals(row):
                say(sentence)


def refusals(row: Row) -> Iterator[str]:
    """Yield, for each candidate that would have told a fault, why it is not named."""
    where = f"{row.planting.case}, {row.planting.fault}"
    for label, one in row.asked.items():
        if one.get("no_candidate"):
            yield f"{where}: {label} is no candidate."
            continue
        test = one["test"]
        place = one["place_by_own"]
        rank = "no score" if place is None else f"place {place + 1} of the scores"
        numbers = ", ".join(f"{name.rpartition('.')[2]} = {value:.3g}" for name, value in one["numbers"].items())
        gain = test["gain"] or 0.0
        why = test["why_not"] if gain > test["odds"] else "too little evidence"
        yield (
            f"{where}: {label} ({numbers}), {rank}, gain {gain:.1f} of {test['odds']:.1f}, bags {test['share']:.2f},"
            f" {'named beside the final model' if test['named'] else f'refused: {why}'}."
        )


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """Return what the rows come to, altogether and by fault."""
    faults = dict.fromkeys(row.planting.fault for row in rows)
    return {
        "all": _counts(rows),
        "by_fault": {fault: _counts([row for row in rows if row.planting.fault == fault]) for fault in faults},
    }


def _counts(rows: Sequence[Row]) -> dict[str, int]:
    counts = {verdict: sum(row.judgement.verdict == verdict for row in rows) for verdict in VERDICTS}
    lost, new = (sum(bool(getattr(row.judgement, what)) for row in rows) for what in ("lost", "new"))
    return {"plantings": len(rows), **counts, "with_something_lost": lost, "with_something_new": new}


def sentences(found: dict[str, Any]) -> Iterator[str]:
    """Yield the summary as lines for a person."""
    for fault, one in (("Planted faults", found["all"]), *found["by_fault"].items()):
        asked = f" (asked: {ASKED_TOLD:.0%})" if one is found["all"] else ""
        yield (
            f"{fault}: told in {one['told']} of {one['plantings']}{asked}, possible in {one['possible']}, missed in"
            f" {one['missed']}{', failed in {}'.format(one['failed']) if one['failed'] else ''}."
        )
    one = found["all"]
    yield (
        f"Something that the plain case names is lost in {one['with_something_lost']} plantings (asked: {ASKED_LOST}),"
        f" something else is named besides in {one['with_something_new']}."
    )
