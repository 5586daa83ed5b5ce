"""Real benches: `python -m benchmarks.real [NAME ...]` builds, diagnoses and judges them beside the reference."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.apart import plain
from benchmarks.real.cases import CASES, WORK, build, find_data
from benchmarks.real.halves import halves
from benchmarks.real.harmless import counts, judge_harmless
from benchmarks.real.one import diagnose_apart
from benchmarks.real.reference import reference
from benchmarks.real.table import Row, print_halves, print_rows, print_summary, summary
from benchmarks.report import machine
from jaxmodel.app.terminal import say
from jaxmodel.case.reading import read_case

app = typer.Typer(add_completion=False)


def judge_reference(folder: Path) -> dict[str, Any]:
    """Return what the reference says of a case, or `failed`, why it does not."""
    try:
        found = reference(read_case(folder))
    except Exception as error:
        return {"failed": f"{type(error).__name__}: {error}"}
    return {"errors": found.errors, "runs": found.runs, "chosen": found.chosen, "seconds": found.seconds}


@app.command()
def main(
    names: Annotated[list[str] | None, typer.Argument(help="Cases; all without any.")] = None,
    reference_only: Annotated[bool, typer.Option(help="Leave the diagnosis out.")] = False,
    harmless: Annotated[bool, typer.Option(help="Diagnose small cases after changes that should not matter.")] = False,
    by_halves: Annotated[
        bool, typer.Option("--halves", help="Fit the expert's effects to two halves of the fit runs.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Where real.json and the answers go.")] = WORK / "results",
    data: Annotated[Path | None, typer.Option(help="Folder of the measurements; else shared/data.")] = None,
    limit_s: Annotated[float, typer.Option("--limit", help="Most seconds for a diagnosis.")] = 3600.0,
) -> None:
    """Judge the diagnosis on real cases."""
    if unknown := set(names or ()) - CASES.keys():
        raise typer.BadParameter(f"no case {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    chosen = [CASES[name] for name in names or CASES if names or not harmless or CASES[name].harmless]
    out.mkdir(parents=True, exist_ok=True)
    folders, rows = {}, []
    for case in chosen:
        try:
            folders[case.name] = build(case, find_data(data) if case.needs else Path())
        except Exception as error:
            failed = {"failed": f"{type(error).__name__}: {error}"}
            rows.append(Row(case.name, failed, failed))
    if harmless:
        found = judge_harmless(folders.values(), WORK / "harmless", limit_s)
        _write(out / "harmless.json", {"machine": machine(), "summary": counts(found), "cases": found})
        return
    if by_halves:
        of_halves = {name: halves(CASES[name], read_case(folder)) for name, folder in folders.items()}
        print_halves(of_halves)
        _write(out / "halves.json", {"machine": machine(), "cases": of_halves})
        return
    for name, folder in folders.items():
        say(f"{name} ...")
        beside = judge_reference(folder)
        answer = {} if reference_only else diagnose_apart(folder, limit_s)
        rows.append(Row(name, answer, beside))
        _write(out / "answers" / f"{name}.json", {"answer": answer, "reference": beside})
    print_rows(rows)
    found = summary(rows)
    print_summary(found)
    each = [
        {"case": row.name, "answer": row.answer, "reference": row.reference, "ratios": row.ratios()} for row in rows
    ]
    _write(out / "real.json", {"machine": machine(), "summary": found, "cases": each})


def _write(path: Path, what: dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(plain(what), indent=1, allow_nan=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    app()
