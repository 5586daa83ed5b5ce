"""`python -m benchmarks.parameterise [NAME ...]`: parameters from real data, and their error on runs not used."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from benchmarks.parameterise.cells import ASKED, CELLS, with_simple_tables
from benchmarks.parameterise.motors import MOTORS, linear_errors
from benchmarks.parameterise.peers import peer_errors
from benchmarks.real.cases import WORK, find_data
from benchmarks.real.reference import reference
from benchmarks.report import machine
from jaxmodel.app.terminal import say, table
from jaxmodel.parameterisation import parameterise

app = typer.Typer(add_completion=False)


def judge_cell(name: str, source: Path, peers: Path | None) -> dict[str, Any]:
    """Return errors by run in V: of the parameterised case, the reference, and peers where they are installed."""
    case = CELLS[name](source)
    began = time.perf_counter()
    found = parameterise(case)
    seconds = time.perf_counter() - began
    voltage = found.errors.query("reading == 'voltage_V'").set_index("run")
    capacity = found["capacity_Ah"].value
    simple = with_simple_tables(case, capacity)
    beside = reference(simple)
    others = peer_errors(simple, peers) if peers else {}
    rows = []
    for run in case.runs:
        asked = next((most for key, most in ASKED[name].items() if run.name.endswith(key)), None)
        rows.append(
            {
                "run": run.name,
                "split": run.split,
                "ours": float(voltage.loc[run.name, "rms"]),
                "ours_to_soc_0.1": float(voltage.loc[run.name, "rms_to_soc_0.1"]),
                "reference": beside.runs["voltage_V"][run.name],
                "asked": asked if run.split == "check" else None,
                **{peer: errors.get(run.name) for peer, errors in others.items()},
            }
        )
    return {"case": name, "unit": "V", "seconds": seconds, "reference_seconds": beside.seconds, "runs": rows}


def judge_motor(name: str, source: Path) -> dict[str, Any]:
    """Return speed errors by run: of the parameterised case and a linear model."""
    case = MOTORS[name](source)
    began = time.perf_counter()
    found = parameterise(case)
    seconds = time.perf_counter() - began
    speed = found.errors.query("reading == 'speed_rad_s'").set_index("run")
    linear = linear_errors(case)
    rows = [
        {"run": run.name, "split": run.split, "ours": float(speed.loc[run.name, "rms"]), "linear": linear[run.name]}
        for run in case.runs
    ]
    return {"case": name, "unit": "m/s" if name == "emps" else "rad/s", "seconds": seconds, "runs": rows}


def print_judged(judged: dict[str, Any]) -> None:
    """Print a line for each run."""
    scale = 1e3 if judged["unit"] == "V" else 1.0
    keys = [key for key in judged["runs"][0] if key not in ("run", "split")]
    rows = [
        [str(row["run"]), str(row["split"]), *("" if row[key] is None else f"{scale * row[key]:.3g}" for key in keys)]
        for row in judged["runs"]
    ]
    unit = "mV" if judged["unit"] == "V" else judged["unit"]
    title = f"{judged['case']}: RMS error [{unit}], {judged['seconds']:.0f} s"
    table(title, ["run", "split", *keys], rows, right=range(2, 2 + len(keys)))


@app.command()
def main(
    names: Annotated[list[str] | None, typer.Argument(help="Cases; all without any.")] = None,
    out: Annotated[Path, typer.Option(help="Where parameterise.json goes.")] = WORK / "results",
    data: Annotated[Path | None, typer.Option(help="Folder of the measurements; else shared/data.")] = None,
    peers: Annotated[Path | None, typer.Option(help="Python with thevenin, pybamm and pybop installed.")] = None,
) -> None:
    """Parameterise real cases and judge them on runs that were not used."""
    source, every = find_data(data), [*CELLS, *MOTORS]
    if unknown := set(names or ()) - set(every):
        raise typer.BadParameter(f"no case {', '.join(sorted(unknown))}; there are {', '.join(every)}")
    results = []
    for name in names or every:
        say(f"{name} ...")
        results.append(judge_cell(name, source, peers) if name in CELLS else judge_motor(name, source))
        print_judged(results[-1])
        out.mkdir(parents=True, exist_ok=True)
        content = {"machine": machine(), "cases": results}
        (out / "parameterise.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    app()
