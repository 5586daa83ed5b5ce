"""Cases with an `answer.toml`, diagnosed and judged: `python -m benchmarks.discrepancy.hard [FOLDER ...]`."""

from __future__ import annotations

import collections
import dataclasses
import glob
import json
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from benchmarks.discrepancy.grades import (
    Judgement,
    after_over_reachable,
    curve_within,
    judge,
    named,
    parameters_within,
)
from benchmarks.discrepancy.one import MOST_SECONDS, in_a_process

CASES = "../shared/cases/hard-*"


@dataclasses.dataclass(frozen=True)
class Row:
    """One case, what was said of it, and how right that is."""

    name: str
    truth: dict[str, Any]
    stated: dict[str, Any]
    said: dict[str, Any]

    @property
    def judgement(self) -> Judgement:
        """How right the answer is."""
        return judge(self.truth, self.said)

    @property
    def cells(self) -> dict[str, str]:
        """The row of the table."""
        found, said = self.judgement, self.said
        beside = [f"{curve.get('port')}({curve.get('over')})" for curve in said.get("curves") or ()]
        beside += [f"{run.get('file')}: {run.get('parameter')}" for run in said.get("runs") or ()]
        lacks = [*(f"-{name}" for name in found.missed), *(f"+{name}" for name in found.extra), found.why]
        ratio = after_over_reachable(self.truth, said)
        return {
            "case": self.name,
            "class": self.truth["class"],
            "grade": found.grade,
            "verdict": said.get("verdict", "none"),
            "named": ", ".join(named(said)) or "nothing",
            "beside": ", ".join(beside),
            "not right": ", ".join(filter(None, lacks)),
            "check / reachable": f"{ratio:.2f}" if np.isfinite(ratio) else "",
            "numbers in 2 sd": _of(parameters_within(self.truth, said)),
            "knots in band": _of(curve_within(self.truth, self.stated, said)),
            "s": f"{said.get('seconds', float('nan')):.0f}",
        }


def _of(counted: tuple[int, int]) -> str:
    return f"{counted[0]} of {counted[1]}" if counted[1] else ""


def read_row(folder: Path, said: Mapping[str, Any]) -> Row:
    """Return a case with its truth and an answer."""
    truth = tomllib.loads((folder / "answer.toml").read_text())
    case = tomllib.loads((folder / "case.toml").read_text())
    stated = case.get("parameters", {})
    tables = {name: value for name, value in stated.items() if isinstance(value, dict) and "soc" in value}
    return Row(folder.name, truth, tables, dict(said))


def table(rows: Sequence[Row]) -> str:
    """Return all rows as text, columns as wide as they need, and the counts by class and grade."""
    cells = [row.cells for row in rows]
    columns = [name for name in cells[0] if any(cell[name] for cell in cells)]
    width = {name: max(len(name), *(len(cell[name]) for cell in cells)) for name in columns}
    lines = ["  ".join(name.ljust(width[name]) for name in columns).rstrip()]
    lines += ["  ".join(cell[name].ljust(width[name]) for name in columns).rstrip() for cell in cells]
    grades = collections.Counter(cell["grade"] for cell in cells)
    lines += ["", ", ".join(f"{grades[grade]} {grade}" for grade in ("right", "part", "wrong")) + f" of {len(rows)}"]
    by_class = collections.Counter((cell["class"], cell["grade"]) for cell in cells)
    for name in dict.fromkeys(cell["class"] for cell in cells):
        lines.append(f"{name}: " + ", ".join(f"{n} {g}" for (c, g), n in sorted(by_class.items()) if c == name))
    ratios = [ratio for row in rows if np.isfinite(ratio := after_over_reachable(row.truth, row.said))]
    numbers = np.sum([parameters_within(row.truth, row.said) for row in rows], axis=0)
    knots = np.sum([curve_within(row.truth, row.stated, row.said) for row in rows], axis=0)
    seconds = [row.said.get("seconds", float("nan")) for row in rows]
    if ratios:
        lines.append(f"check error over what can be reached: median {np.median(ratios):.2f}, worst {max(ratios):.2f}")
    lines.append(f"numbers in 2 sd: {numbers[0]} of {numbers[1]}; knots in band: {knots[0]} of {knots[1]}")
    lines.append(f"seconds: median {np.nanmedian(seconds):.0f}, worst {np.nanmax(seconds):.0f}")
    return "\n".join(lines)


def main(
    folders: Annotated[list[Path] | None, typer.Argument(help="Case folders with an answer.toml.")] = None,
    cases: Annotated[str, typer.Option(help="A pattern of folders, where none is named.")] = CASES,
    out: Annotated[Path | None, typer.Option(help="Where answers are kept, and read if there.")] = None,
    again: Annotated[bool, typer.Option(help="Diagnose again what was diagnosed.")] = False,
    warm: Annotated[bool, typer.Option(help="Use programs compiled before: quicker, and no measure of time.")] = False,
    limit_s: Annotated[float, typer.Option(help="A case that takes longer is given up.")] = MOST_SECONDS,
) -> None:
    """Diagnose cases one by one, each in a process of its own, and judge the answers by class."""
    chosen = folders or [Path(path) for path in sorted(glob.glob(cases))]
    chosen = [folder for folder in chosen if (folder / "answer.toml").exists()]
    if not chosen:
        raise typer.BadParameter(f"no folder with an answer.toml: {cases}")
    with tempfile.TemporaryDirectory() as scratch:
        kept = out or Path(scratch)
        rows = []
        for folder in chosen:
            file = kept / f"{folder.name}.json"
            known = json.loads(file.read_text()) if file.exists() and not again else {}
            rows.append(
                read_row(
                    folder, known if "verdict" in known else in_a_process(folder, file, cold=not warm, limit_s=limit_s)
                )
            )
            cell = rows[-1].cells
            typer.echo(f"{cell['case']} {cell['grade']} {cell['s']} s {cell['not right']}", err=True)
    typer.echo(table(rows))
    if out is not None:
        (out / "grades.json").write_text(json.dumps([row.cells for row in rows], indent=1) + "\n")


if __name__ == "__main__":
    typer.run(main)
