"""Simulation of all runs of a case, with one compiled program."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Callable, Iterator

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxmodel.build import case_model, run_profile
from jaxmodel.case import Case, Run
from jaxmodel.measurements import KINDS
from jaxmodel.plotting import SimulationPlots
from jaxmodel.simulation import Cutoff, Status, Trajectory, run_track, track


@dataclasses.dataclass(frozen=True, eq=False)
class SimulatedRun:
    """The simulation of one run.

    Attributes:
        run: the run, as measured.
        table: time_s, every reading, and `valid`: False where the equations are outside their valid range.
            Rows after the end are empty.
        status: how it ended.
        end_s: time of the last row that was reached.
    """

    run: Run
    table: pd.DataFrame
    status: Status
    end_s: float

    def sentence(self) -> str:
        """Say how the run ended, '' for a normal end."""
        said = []
        if self.status == Status.REACHED_CUTOFF:
            said.append(f"{self.run.name} reached its cut-off at {self.end_s:g} s; the rows after it are empty.")
        if self.status == Status.NOT_FINITE:
            said.append(f"{self.run.name} produced numbers that are not finite; check its parameters and inputs.")
        invalid = np.flatnonzero(~self.table["valid"].to_numpy(dtype=bool))
        if invalid.size:
            first = float(self.table["time_s"].iloc[invalid[0]])
            said.append(
                f"{self.run.name} is outside the valid range of the cell's equations in {invalid.size} of its "
                f"{len(self.table)} rows, first at {first:g} s."
            )
        return " ".join(said)


@dataclasses.dataclass(frozen=True, eq=False)
class CaseSimulation:
    """The simulated runs of a case, in the order of the case.

    Attributes:
        case: whose model was run.
        runs: one by one.
    """

    case: Case
    runs: tuple[SimulatedRun, ...]

    def __getitem__(self, place: int) -> SimulatedRun:
        """Return a run by its index."""
        return self.runs[place]

    def __iter__(self) -> Iterator[SimulatedRun]:
        """Go through the runs."""
        return iter(self.runs)

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.runs)

    def to_dataframe(self) -> pd.DataFrame:
        """Return all runs in one table: `run`, `time_s`, every reading, and `valid`."""
        table = pd.concat([one.table for one in self.runs], ignore_index=True)
        table.insert(0, "run", np.repeat([one.run.name for one in self.runs], [len(one.table) for one in self.runs]))
        return table

    def summary(self) -> str:
        """Return a line for each run: how it ended."""
        lines = [
            f"{one.run.name}: {len(one.table)} rows, {one.status.name.lower().replace('_', ' ')} at {one.end_s:g} s"
            for one in self.runs
        ]
        return "\n".join([*lines, *filter(None, (one.sentence() for one in self.runs))])

    @property
    def plot(self) -> SimulationPlots:
        """Return the pictures: `plot()` draws the first run, `plot("run name")` another."""
        return SimulationPlots(self)

    def __repr__(self) -> str:
        return f"<CaseSimulation of {self.case.name}: {len(self)} runs>"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self.summary())}</pre>"


def simulate_case(
    case: Case,
    *,
    fidelity: str = "formula",
    progress: Callable[[str], None] | None = None,
) -> CaseSimulation:
    """Run the model of a case over each of its runs.

    All runs are padded to the same number of steps and rows, so that JAX compiles once for the whole case.

    Args:
        case: with its effects and cut-off.
        fidelity: "formula" or "lut".
        progress: called with the name of each run before it starts.

    Returns:
        The simulated runs, in the order of the case; a failure in a run raises no error.

    Raises:
        ParameterError: as `case_model`.
        EffectError: as `case_model`.
    """
    models = [case_model(case, run, fidelity=fidelity) for run in case.runs]
    profiles = [run_profile(run) for run in case.runs]
    steps = max(track(m, p).duration_s.shape[0] for m, p in zip(models, profiles, strict=True))
    if case.kind != "cell":
        steps = _rounded_up(steps)  # a motor's steps depend on its parameters: else each change of them would compile
    rows = max(profile.time_s.size for profile in profiles)
    cutoff = Cutoff(**case.cutoff) if case.cutoff else None
    outcomes = []
    for run, model, profile in zip(case.runs, models, profiles, strict=True):
        if progress:
            progress(run.name)
        padded = track(model, profile, steps)
        missing = rows - profile.time_s.size
        last_step = jnp.asarray(np.pad(padded.last_step, (0, missing), mode="edge"))
        padded = eqx.tree_at(lambda c: c.last_step, padded, last_step)
        ran = run_track(model, padded, jnp.asarray(np.pad(profile.time_s, (0, missing), mode="edge")), cutoff)
        outcomes.append(_outcome(case.kind, run, ran, profile.time_s.size))
    return CaseSimulation(case, tuple(outcomes))


def _rounded_up(count: int) -> int:
    """Return a number to four binary digits, rounded up."""
    size = 1 << max(count.bit_length() - 4, 0)
    return -(-count // size) * size


def _outcome(kind: str, run: Run, ran: Trajectory, rows: int) -> SimulatedRun:
    ran = jax.tree.map(np.asarray, ran)  # slicing by JAX would compile a program for each column
    time_s = np.asarray(ran.time_s)[:rows]
    status = Status(int(ran.status))
    end = min(int(ran.end_row), rows - 1)
    columns: dict[str, np.ndarray] = {"time_s": time_s}
    usual = [name for name in KINDS[kind].outputs if name in ran.readings]
    for name in dict.fromkeys((*usual, *ran.readings)):
        column = np.array(ran.readings[name][:rows], dtype=float)
        column[end + 1 :] = np.nan
        columns[name] = column
    valid = np.array(ran.valid[:rows], dtype=bool)
    valid[end + 1 :] = True
    return SimulatedRun(run, pd.DataFrame(columns | {"valid": valid}), status, float(time_s[end]))
