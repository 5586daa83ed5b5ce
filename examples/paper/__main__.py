"""`python -m examples.paper`: every table and figure of the paper, simulated and as printed."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer

from examples.paper import report, report_no_load
from examples.paper.candidates import carried
from examples.paper.discharges import discharges
from examples.paper.no_load import doubled, experiment, gradients, no_load, pulsed, trajectory
from examples.paper.page import Table, write_page
from jaxmodel import diagnose, keep_compiled_programs, read_case

EXAMPLE = Path(__file__).parents[1] / "paper_table1"
FULL_SPEED = 1.0


app = typer.Typer(add_completion=False)


@app.command()
def paper(
    out: Annotated[Path, typer.Option(help="Folder for the results; made if need be.")] = Path("results"),
    diagnose_again: Annotated[
        bool,
        typer.Option(
            "--diagnose", help="Diagnose Table 1 again instead of showing the recorded answer (takes minutes)."
        ),
    ] = False,
) -> None:
    """Repeat every table and figure of the paper, simulated and as printed, on one page."""
    began = time.perf_counter()

    def progress(what: str) -> None:
        print(f"paper: {what} ({time.perf_counter() - began:.0f} s)", flush=True)

    out.mkdir(parents=True, exist_ok=True)
    keep_compiled_programs()
    progress("Tables 1 and 2, by formula and by look-up table")
    data = discharges()
    progress("Figs. 8 and 9, the experiment")
    still = no_load()
    pulses = pulsed()
    components, together = doubled(FULL_SPEED)
    fits = list(carried(lambda what: progress(f"fitting Table 1 with {what}")))
    answer, origin = _diagnosis(out) if diagnose_again else _recorded()
    held = experiment(still)
    full = gradients(still["time_s"].to_numpy(), trajectory(still, FULL_SPEED))
    sections = [
        *report.fidelity_sections(data),
        report.table_1_section(fits, answer, origin),
        report_no_load.figure_8_section(still, pulses),
        report_no_load.experiment_section(held),
        report_no_load.figure_9_section(components, together),
    ]
    found = report.findings(data, held, full)
    write_page(
        out,
        "The paper, reproduced",
        f"Specht et al., temperature and a rescue robot's battery; made in {time.perf_counter() - began:.0f} s",
        found,
        sections,
        [EXAMPLE / "case.toml", EXAMPLE / "recorded" / "answer.json"],
    )
    for table in (part for section in sections for part in section.parts if isinstance(part, Table)):
        if table.name in ("table-1", "table-2", "headlines", "tables-3-and-5"):
            print(f"\n{table.name}\n{pd.DataFrame(table.rows, columns=list(table.head)).to_string(index=False)}")
    for line in found:
        print(f"- {line}")
    print(f"Everything is on one page: {out / 'report.html'}")


def _recorded() -> tuple[dict[str, Any], str]:
    """Return the recorded answer of an earlier diagnosis, and a sentence on its origin."""
    text = (EXAMPLE / "recorded" / "answer.json").read_text(encoding="utf-8")
    return json.loads(text), "The diagnosis was recorded in examples/paper_table1/recorded; --diagnose repeats it."


def _diagnosis(out: Path) -> tuple[dict[str, Any], str]:
    """Diagnose the example and write the answer and the extended model to `out`."""
    diagnosis = diagnose(read_case(EXAMPLE), progress=lambda what: print(f"Table 1: {what}", flush=True))
    diagnosis.write(out, pictures=False)
    return diagnosis.answer(), "The diagnosis was computed with this report."


if __name__ == "__main__":
    app()
