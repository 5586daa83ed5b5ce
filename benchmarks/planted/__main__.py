"""Planted faults: `python -m benchmarks.planted [CASE ...]` puts faults into measured data, and judges what is told."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.planted.judge import Judgement, judge
from benchmarks.planted.one import diagnose_cached
from benchmarks.planted.plantings import PLANTINGS, Planting, plant, seen
from benchmarks.planted.table import Row, print_rows, sentences, summary
from benchmarks.real.cases import CASES, WORK, build, find_data
from benchmarks.report import machine
from jaxmodel.app.terminal import say

HERE = WORK / "planted"
NAMES = tuple(dict.fromkeys(one.case for one in PLANTINGS))
FAULTS = tuple(dict.fromkeys(one.fault for one in PLANTINGS))
app = typer.Typer(add_completion=False)


@app.command()
def main(
    names: Annotated[list[str] | None, typer.Argument(help="Real cases; all of this benchmark without any.")] = None,
    fault: Annotated[list[str] | None, typer.Option(help=f"Faults; all without any: {', '.join(FAULTS)}.")] = None,
    out: Annotated[Path, typer.Option(help="Where planted.json goes.")] = HERE / "results",
    data: Annotated[Path | None, typer.Option(help="Folder of the measurements; else shared/data.")] = None,
    limit_s: Annotated[float, typer.Option("--limit", help="Most seconds for a diagnosis.")] = 1800.0,
) -> None:
    """Judge what the diagnosis says of faults planted in measured data; answers are kept until the sources change."""
    for given, known in ((names, NAMES), (fault, FAULTS)):
        if unknown := set(given or ()) - set(known):
            raise typer.BadParameter(f"no {', '.join(sorted(unknown))}; there are {', '.join(known)}")
    chosen = [one for one in PLANTINGS if one.case in (names or NAMES) and one.fault in (fault or FAULTS)]
    rows, plain = [], {}
    for one in chosen:
        if one.case not in plain:
            case = CASES[one.case]
            folder = build(case, find_data(data) if case.needs else Path(), HERE / "plain")
            say(f"{one.case} as it is ...")
            plain[one.case] = folder, diagnose_cached(folder, (), limit_s, _kept(one.case, "plain"))
        rows.append(_row(one, *plain[one.case], limit_s))
        _write(out, rows)
    print_rows(rows)
    for sentence in sentences(summary(rows)):
        say(sentence)


def _write(out: Path, rows: Sequence[Row]) -> None:
    """Write what is known so far."""
    what = {"machine": machine(), "summary": summary(rows), "plantings": [row.plain() for row in rows]}
    out.mkdir(parents=True, exist_ok=True)
    (out / "planted.json").write_text(json.dumps(what, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def _row(planting: Planting, folder: Path, plain: dict[str, Any], limit_s: float) -> Row:
    """Plant one fault, diagnose and judge it."""
    planted = plant(folder, planting, HERE / planting.case / planting.name)
    say(f"{planting.case} with {planting.fault} ...")
    found = diagnose_cached(planted, planting.labels, limit_s, _kept(planting.case, planting.name))
    amount, moves = planting.amount(folder), seen(folder, planted, planting.column)
    if failed := plain.get("failed") or found.get("failed"):
        judgement = Judgement("failed", failed)
    else:
        judgement = judge(planting, amount, plain["answer"], found["answer"], CASES[planting.case].expects)
    return Row(planting, amount, moves, judgement, found.get("asked", {}), found["seconds"])


def _kept(case: str, name: str) -> Path:
    return HERE / "answers" / case / f"{name}.json"


if __name__ == "__main__":
    app()
