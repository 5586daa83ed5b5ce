"""One cell simulated, and kept on disk: `python -m benchmarks.physics.simulate SEED INDEX ATTEMPT FOLDER`.

What is kept has no noise and no fault, so that cases can be written and judged again without PyBaMM.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.physics.base import Base, measure
from benchmarks.physics.draw import REFERENCE_DEGC, Recipe, draw
from benchmarks.physics.profiles import Plan, rows_of_steps, steps
from benchmarks.physics.reality import NotSimulated, Reality, Trace
from jaxmodel.base.atomic_files import write_whole

# A run that a limit of the voltage ends before is done again with half its current, as an engineer would; assumed.
LEAST_S, HALVINGS = 900.0, 2
TRACES, WHY_NOT = "simulated.npz", "failed.txt"


@dataclasses.dataclass(frozen=True, eq=False)
class SimulatedRun:
    """A run without noise.

    Attributes:
        plan: as it was driven.
        first_soc: as the base counts it.
        trace: what the cell does.
        twins: what it does without one hidden thing, by name; of fit runs alone.
    """

    plan: Plan
    first_soc: float
    trace: Trace
    twins: dict[str, Trace]


@dataclasses.dataclass(frozen=True, eq=False)
class Simulated:
    """A cell as it is kept."""

    recipe: Recipe
    base: Base
    runs: tuple[SimulatedRun, ...]


def simulate(recipe: Recipe) -> Simulated:
    """Simulate the tests and the runs of a cell.

    Raises:
        NotSimulated: a simulation failed.
    """
    reality = Reality(recipe)
    base = measure(reality, recipe)
    without = {name: Reality(recipe, name, reality.size) for name in recipe.hidden}
    runs = []
    for planned in recipe.plans:
        first = base.soc_of_set(planned.first_soc, recipe.capacity_Ah)
        plan, trace = _lasting(reality, base, planned, first)
        twins = {}
        if plan.split == "fit":
            for name, twin in without.items():
                still = recipe.heat == "isothermal" and plan.ambient_degC == REFERENCE_DEGC
                same = still and name in ("activation", "entropy")  # of the temperature alone
                twins[name] = trace if same else twin.run(trace.time_s, trace.current_A, first, plan.ambient_degC)
        runs.append(SimulatedRun(plan, plan.first_soc, trace, twins))
    return Simulated(recipe, base, tuple(runs))


def _lasting(reality: Reality, base: Base, plan: Plan, first_soc_of_set: float) -> tuple[Plan, Trace]:
    """Return a plan and its run, with half the current where it ended early."""
    lasted = 0.0
    for _ in range(HALVINGS + 1):
        time_s, current = rows_of_steps(steps(plan, base.capacity_Ah), plan.every_s)
        trace = reality.run(time_s, current, first_soc_of_set, plan.ambient_degC)
        lasted = trace.time_s[-1]
        if lasted >= min(LEAST_S, time_s[-1]):
            return plan, trace
        plan = dataclasses.replace(plan, rate=0.5 * plan.rate)
    raise NotSimulated(f"a {plan.kind} at {plan.ambient_degC:g} degC ended after {lasted:.0f} s")


def keep(found: Simulated, folder: Path) -> None:
    """Write a cell into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    arrays: dict[str, Any] = {"capacity_Ah": found.base.capacity_Ah, "pulse_rms_V": found.base.pulse_rms_V}
    arrays |= {"ocv_V": found.base.ocv_V} | found.base.ohm | found.base.farad
    arrays["plans"] = json.dumps([dataclasses.asdict(run.plan) for run in found.runs])
    for number, run in enumerate(found.runs):
        for of, trace in {"": run.trace, **run.twins}.items():
            arrays |= {f"{number}/{of}/{name}": value for name, value in dataclasses.asdict(trace).items()}
    part = folder / f"part-{TRACES}"
    np.savez_compressed(part, **arrays)
    part.rename(folder / TRACES)


def kept(recipe: Recipe, folder: Path) -> Simulated:
    """Return a cell from its folder."""
    with np.load(folder / TRACES) as held:
        arrays = {name: held[name] for name in held.files}
    base = Base(
        float(arrays["capacity_Ah"]),
        arrays["ocv_V"],
        {name: arrays[name] for name in ("R_ints", "R_TS", "R_TL")},
        {name: arrays[name] for name in ("C_TS", "C_TL")},
        float(arrays["pulse_rms_V"]),
    )
    names = [field.name for field in dataclasses.fields(Trace)]
    runs = []
    for number, plan in enumerate(json.loads(str(arrays["plans"]))):
        of_run = {name.split("/")[1] for name in arrays if name.startswith(f"{number}/")}
        traces = {of: Trace(*(arrays[f"{number}/{of}/{name}"] for name in names)) for of in of_run}
        own = traces.pop("")
        runs.append(SimulatedRun(Plan(**plan), plan["first_soc"], own, traces))
    return Simulated(recipe, base, tuple(runs))


def main(seed: int, index: int, attempt: int, folder: Path) -> None:
    """Simulate a cell and keep it, or why it cannot be simulated."""
    try:
        keep(simulate(draw(seed, index, attempt)), folder)
    except NotSimulated as error:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / WHY_NOT, f"{error}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4]))
