"""All cells of a seed: simulated where they are not kept, drawn again where a simulation fails, written as cases."""

from __future__ import annotations

import dataclasses
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.physics.draw import Recipe, draw
from benchmarks.physics.one import ROOT
from benchmarks.physics.simulate import TRACES, WHY_NOT, Simulated, kept
from benchmarks.physics.truth import Truth, truth_of
from benchmarks.physics.writing import write_case
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import UserError

WORK = ROOT / ".physics-cases"
SIMULATION_S = 1800.0  # a simulation that takes longer failed; assumed, a cell takes 5 to 50 s
ATTEMPTS = 10
ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}


@dataclasses.dataclass(frozen=True, eq=False)
class Cell:
    """A cell with its case.

    Attributes:
        found: what was simulated.
        folder: of the case.
        truth: what is right.
        drawn_again: why each draw before failed.
    """

    found: Simulated
    folder: Path
    truth: Truth
    drawn_again: tuple[str, ...]

    @property
    def name(self) -> str:
        """The name of the cell."""
        return self.found.recipe.name

    @property
    def about(self) -> str:
        """What it is and what is hidden in it, in a few words."""
        recipe = self.found.recipe
        energies = "/".join(f"{energy / 1e3:.0f}" for energy in recipe.energies_J_mol.values())
        words = {"activation": f"activation {energies}", "entropy": f"entropy {recipe.entropy}"}
        words["hysteresis"] = f"hysteresis {recipe.hysteresis}"
        hidden = [words.get(thing, thing) for thing in recipe.hidden]
        hidden += [f"{recipe.fault} {recipe.fault_size:g}"] if recipe.fault else []
        return f"{recipe.parameter_set} {recipe.model}: {', '.join(hidden) or 'nothing'}"


def cell(seed: int, index: int, work: Path, tell: Callable[[str], None]) -> Cell:
    """Return a cell; it is simulated in a process of its own if it is not kept in the folder.

    Raises:
        UserError: PyBaMM is needed and not installed, or no draw could be simulated.
    """
    again: list[str] = []
    for attempt in range(ATTEMPTS):
        recipe = draw(seed, index, attempt)
        folder = work / "cells" / recipe.name
        why = _simulated(recipe, folder, tell)
        if not why:
            found = kept(recipe, folder)
            write_case(found, folder / "case")
            return Cell(found, folder / "case", truth_of(found), tuple(again))
        tell(f"{recipe.name} ({recipe.parameter_set}) is drawn again: {why}.")
        again.append(f"{recipe.parameter_set}: {why}")
    raise UserError(f"Cell {index} of seed {seed} could not be simulated in {ATTEMPTS} draws: {again[-1]}.")


def _simulated(recipe: Recipe, folder: Path, tell: Callable[[str], None]) -> str:
    """Simulate a cell if it was not; return why it cannot be, "" if it is there."""
    if (folder / TRACES).exists():
        return ""
    if (folder / WHY_NOT).exists():
        return (folder / WHY_NOT).read_text(encoding="utf-8").strip()
    if importlib.util.find_spec("pybamm") is None:
        raise UserError(
            f"Cell {recipe.name} is not simulated yet, and PyBaMM, which simulates it, is not installed: "
            "pip install -e '.[test,peers]' -c constraints.txt."
        )
    tell(f"{recipe.name}: {recipe.parameter_set} is simulated ...")
    command = [sys.executable, "-m", "benchmarks.physics.simulate"]
    command += [str(recipe.seed), str(recipe.index), str(recipe.attempt), str(folder.resolve())]
    environment = os.environ | ONE_THREAD | {"PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=SIMULATION_S)
    except subprocess.TimeoutExpired:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / WHY_NOT, f"not done after {SIMULATION_S:.0f} s\n")
    else:
        if done.returncode:  # a fault of ours, and no reason to draw another cell
            last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            raise UserError(f"The simulation of {recipe.name} broke off: {last}")
    return (folder / WHY_NOT).read_text(encoding="utf-8").strip() if (folder / WHY_NOT).exists() else ""
