"""`jaxmodel simulate`: the model of a case over its runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from jaxmodel.app import terminal
from jaxmodel.app.commands.start import read_case_with, start
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError, ParameterError, nearest
from jaxmodel.case.build import FIDELITIES
from jaxmodel.case.simulation import SimulatedRun, simulate_case


def simulate(path: Path, out: Path, fidelity: str, effects: Sequence[str], *, answer_only: bool = False) -> None:
    """Simulate every run of a case; write `out/RUN.csv` and, but for `answer_only`, `out/RUN.png`.

    Raises:
        UserError: the case, an effect or the fidelity cannot be used.
    """
    if fidelity not in FIDELITIES:
        known = " or ".join(FIDELITIES)
        raise ParameterError(f"--fidelity: there is no '{fidelity}'; use {known}.{nearest(fidelity, FIDELITIES)}")
    case = read_case_with(path, effects)
    for run in case.runs:
        if (out / f"{run.name}.csv").resolve() == run.source:
            raise MeasurementError(f"--out {out}: {run.name}.csv in this folder is a measurement; give another folder.")
    start(out)
    with terminal.stages(case.name) as progress:
        outcomes = simulate_case(case, fidelity=fidelity, progress=progress)
    for outcome in outcomes:
        write_csv(outcome, out / f"{outcome.run.name}.csv")
        if not answer_only:
            _draw(outcome, out / f"{outcome.run.name}.png")
    rows = [
        (o.run.name, o.run.label, str(len(o.table)), f"{o.end_s:g}", o.status.name.lower().replace("_", " "))
        for o in outcomes
    ]
    terminal.table(case.title, ("run", "label", "rows", "end [s]", "status"), rows, right=(2, 3))
    for sentence in filter(None, (outcome.sentence() for outcome in outcomes)):
        terminal.say(sentence)
    terminal.say(f"{len(outcomes)} CSV files{'' if answer_only else ' and pictures'} are in {out}.")


def _draw(outcome: SimulatedRun, path: Path) -> None:
    from jaxmodel.plots.runs import simulation
    from jaxmodel.plots.style import png

    write_whole(path, png(simulation(outcome.run.name, outcome.table, outcome.run)))


def write_csv(outcome: SimulatedRun, path: Path) -> None:
    """Write a run's table with twelve significant digits; rows after the end are empty."""
    write_whole(path, outcome.table.to_csv(index=False, float_format="%.12g"))
