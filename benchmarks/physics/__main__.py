"""`python -m benchmarks.physics`: cells of PyBaMM are simulated, diagnosed and judged.

What is simulated is kept by seed, and answers by code and case, so that both can be stopped and taken up again.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.apart import plain
from benchmarks.physics.cells import WORK, Cell, cell
from benchmarks.physics.draw import COUNT, SEED, VERSION
from benchmarks.physics.judge import Row, summary
from benchmarks.physics.one import CODE_OF_ANSWERS, CODE_OF_REFERENCES, apart, code, contents, known
from benchmarks.physics.sets import LEFT_OUT, SETS
from benchmarks.physics.table import print_rows, print_summary
from benchmarks.report import machine
from jaxmodel.app.terminal import complain, say
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import UserError

app = typer.Typer(add_completion=False)


@app.command()
def main(
    seed: Annotated[int, typer.Option(help="All cells are drawn from it.")] = SEED,
    count: Annotated[int, typer.Option(help="How many cells.")] = COUNT,
    only: Annotated[str, typer.Option(help="Numbers of cells, such as 0,3,10-19; all without any.")] = "",
    jobs: Annotated[int, typer.Option(help="Processes at a time.")] = 1,
    limit_s: Annotated[float, typer.Option("--limit", help="Most seconds for a diagnosis.")] = 3600.0,
    simulate: Annotated[bool, typer.Option("--simulate", help="Simulate and write cases alone.")] = False,
    judge: Annotated[bool, typer.Option("--judge", help="Judge the answers that are there, of any code.")] = False,
    again: Annotated[bool, typer.Option("--again", help="Diagnose again what this code has diagnosed.")] = False,
    work: Annotated[Path, typer.Option(help="Where cells, answers and physics.json are kept.")] = WORK,
    answers: Annotated[Path | None, typer.Option(help="Where answers are kept, if elsewhere.")] = None,
) -> None:
    """Judge the diagnosis on cells of PyBaMM."""
    try:
        cells = _each(lambda index: cell(seed, index, work, say), numbers(only, count), jobs)
    except UserError as error:
        complain(str(error))
        raise typer.Exit(1) from error
    if simulate:
        _write_truths(work, cells)
        return
    folder = answers or work / "answers"
    rows = _each(lambda one: _row(one, folder, limit_s, judge, again), cells, jobs)
    print_rows(rows)
    found = summary(rows)
    print_summary(found)
    _write_truths(work, cells)
    write_whole(folder / "physics.json", json.dumps(plain(_report(rows, cells, found)), indent=1) + "\n")


def numbers(only: str, count: int) -> list[int]:
    """Return the numbers of cells that a text such as "0,3,10-19" names; all without any.

    Raises:
        typer.BadParameter: it names none, or one that is not there.
    """
    found: list[int] = []
    try:
        for part in filter(None, only.split(",")):
            first, _, last = part.partition("-")
            found += range(int(first), int(last or first) + 1)
    except ValueError:
        raise typer.BadParameter(f"--only is numbers such as 0,3,10-19, not {only}") from None
    if wrong := [number for number in found if number >= count]:
        raise typer.BadParameter(f"there are cells 0 to {count - 1}, and no {wrong[0]}")
    return found or list(range(count))


def _row(one: Cell, folder: Path, limit_s: float, judge: bool, again: bool) -> Row:
    """Return a cell with its answer and the reference's errors, both as kept where they are still true."""
    case = contents(one.folder)
    out, beside = folder / f"{one.name}.json", folder / "reference" / f"{one.name}.json"
    if judge:
        answer, reference = (json.loads(path.read_text()) if path.exists() else {} for path in (out, beside))
        return Row(one.name, one.about, one.truth, answer, reference)
    of = f"{code(CODE_OF_ANSWERS)} {case}"
    answer = {} if again else known(out, of)
    if not answer:
        say(f"{one.name}: {one.about} ...")
        answer = apart(one.folder, out, of, limit_s)
    of = f"{code(CODE_OF_REFERENCES)} {case}"
    reference = known(beside, of) or apart(one.folder, beside, of, limit_s, refer=True)
    return Row(one.name, one.about, one.truth, answer, reference)


def _each(work: Callable[[Any], Any], of: list[Any], jobs: int) -> list[Any]:
    """Return what work gives of each, some at a time; the work itself is done in processes of their own."""
    with ThreadPoolExecutor(max(jobs, 1)) as pool:
        return list(pool.map(work, of))


def _write_truths(work: Path, cells: list[Cell]) -> None:
    """Write what is right of each cell beside its case."""
    for one in cells:
        content = {"about": one.about, "recipe": dataclasses.asdict(one.found.recipe)} | dataclasses.asdict(one.truth)
        write_whole(one.folder.parent / "truth.json", json.dumps(plain(content), indent=1) + "\n")
    say(f"{len(cells)} cells are in {work / 'cells'}.")
    again = {one.name: one.drawn_again for one in cells if one.drawn_again}
    for name, reasons in again.items():
        say(f"{name} was drawn again {len(reasons)} times: {'; '.join(reasons)}.")


def _report(rows: list[Row], cells: list[Cell], found: dict[str, Any]) -> dict[str, Any]:
    """Return all results for JSON."""
    each = [
        {
            "cell": row.name,
            "about": row.about,
            "truth": dataclasses.asdict(row.truth),
            "drawn_again": one.drawn_again,
            "verdict": row.answer.get("verdict"),
            "failed": row.answer.get("failed"),
            "named": row.named,
            "missed": row.missed,
            "wrong": row.wrong,
            "right": row.right,
            "right_verdict": row.right_verdict,
            "ratios": row.ratios(),
            "best": {channel: row.best(channel) for channel in row.ratios()},
            "after": {channel: row.after(channel) for channel in row.ratios()},
            "seconds": row.answer.get("seconds"),
        }
        for row, one in zip(rows, cells, strict=True)
    ]
    sets = {"drawn_from": list(SETS), "left_out": LEFT_OUT}
    return {"machine": machine(), "version": VERSION, "parameter_sets": sets, "summary": found, "cells": each}


if __name__ == "__main__":
    app()
