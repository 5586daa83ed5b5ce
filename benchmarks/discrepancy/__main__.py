"""Blind cases by seed: `python -m benchmarks.discrepancy make|diagnose|judge|report FOLDER`.

Cases with an `answer.toml` of their own (`../shared/cases`): `python -m benchmarks.discrepancy.hard`.
Cases below 1000 are for development, those from 1000 on are sealed: to be made and judged, never to be looked at.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.progress import track

from benchmarks.discrepancy.generate import draw
from benchmarks.discrepancy.generate import make as make_case
from benchmarks.discrepancy.judge import read, report
from benchmarks.discrepancy.one import in_a_process
from benchmarks.discrepancy.publish import publish
from jaxmodel.base.jax_settings import keep_compiled_programs

app = typer.Typer(add_completion=False, no_args_is_help=True)
Folder = Annotated[Path, typer.Argument(help="Where the cases are, one folder each.")]
Name = Literal[
    "null",
    "single",
    "double",
    "sensor",
    "outside",
    "several",
    "table",
    "run",
    "noise",
    "prior",
    "extrapolation",
    "immaterial",
]
Group = Annotated[Name | None, typer.Option(help="Cases of this group alone; from `several` on those from seed 5000.")]


@app.command()
def make(folder: Folder, first: int = 0, count: int = 240, group: Group = None) -> None:
    """Make the cases that are not there yet, but for seeds that cannot be made; why is told."""
    keep_compiled_programs()
    seeds = [number for number in range(first, first + count) if group is None or draw(number).blind.group == group]
    for number in track(seeds, "making"):
        hidden = folder / f"{number:04d}" / "blind.json"
        if not hidden.exists():
            try:
                blind = make_case(hidden.parent, number)
            except RuntimeError as error:
                typer.echo(f"Seed {number} is left out: {error}.", err=True)
                continue
            hidden.write_text(json.dumps(dataclasses.asdict(blind)))


@app.command()
def diagnose(folder: Folder, again: bool = False) -> None:
    """Diagnose the cases that were not yet, or all again; may be stopped at any time."""
    paths = [path.parent for path in sorted(folder.glob("[0-9]*/blind.json"))]
    for path in track([p for p in paths if again or not (p / "said.json").exists()], "diagnosing"):
        said = in_a_process(path, path / "said.json", cold=False)
        if "verdict" not in said:
            (path / "said.json").unlink()
            typer.echo(f"Case {path.name} failed: {said['error']}", err=True)


@app.command()
def judge(folder: Folder) -> None:
    """Print the figures of merit of the cases diagnosed."""
    print(report(read(folder)))


@app.command(name="report")
def write_report(folder: Folder, page: Path = Path("docs/proving_ground.md"), group: Group = None) -> None:
    """Write the figures of sealed cases into a page, its JSON and pictures; what each case hid is not told."""
    publish(folder, page, group)


if __name__ == "__main__":
    app()
