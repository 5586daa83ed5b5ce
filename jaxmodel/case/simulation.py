"""Simulation of all runs of a case."""

from __future__ import annotations

import dataclasses
import html
from collections.abc import Iterator

import numpy as np
import pandas as pd

from jaxmodel.base.in_short import InShort
from jaxmodel.base.progress import Stage, stages
from jaxmodel.base.remark import Remark
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.plotting import SimulationPlots
from jaxmodel.case.records import Case, Run
from jaxmodel.model.pieces import run_in_pieces
from jaxmodel.model.possible import LIMITS, possible
from jaxmodel.model.simulation import Cutoff, Status


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class SimulatedRun(InShort):
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

    def _in_short(self) -> str:
        ended = self.status.name.lower().replace("_", " ")
        return f"{self.run.name}, {len(self.table)} rows, {ended} at {self.end_s:g} s"

    def sentence(self) -> str:
        """Say how the run ended, '' for a normal end."""
        return " ".join(end_of(self))


def end_of(simulated: SimulatedRun) -> tuple[Remark, ...]:
    """Return what there is to say of how a simulated run ended, and of rows outside the valid range."""
    run, table, end_s = simulated.run.name, simulated.table, simulated.end_s
    said = []
    if simulated.status == Status.REACHED_CUTOFF:
        sentence = f"{run} reached its cut-off at {end_s:g} s; the rows after it are empty."
        said.append(Remark(sentence, "reached_cutoff", run, time_s=end_s))
    if simulated.status == Status.NOT_FINITE:
        sentence = f"{run} produced numbers that are not finite; check its parameters and inputs."
        said.append(Remark(sentence, "not_finite", run))
    if simulated.status == Status.IMPOSSIBLE:
        beyond = {
            name: float(table[name].abs().max())
            for name in LIMITS
            if name in table and not np.all(possible({name: table[name].dropna()}))
        }
        far = ", ".join(f"{name} up to {size:.3g}" for name, size in beyond.items())
        sentence = f"{run} reaches an impossible state{far and f' ({far})'}; check its parameters and inputs."
        said.append(Remark(sentence, "impossible", run, **beyond))
    invalid = np.flatnonzero(~table["valid"].to_numpy(dtype=bool))
    if invalid.size:
        first = float(table["time_s"].iloc[invalid[0]])
        sentence = (
            f"{run} is outside the valid range of the cell's equations in {invalid.size} of its {len(table)} rows, "
            f"first at {first:g} s."
        )
        said.append(Remark(sentence, "outside_valid_range", run, rows=float(invalid.size), time_s=first))
    return tuple(said)


@dataclasses.dataclass(frozen=True, eq=False)
class CaseSimulation:
    """The simulated runs of a case, in the order of the case.

    Attributes:
        case: whose model was run.
        runs: one by one.

    Example:
        >>> from jaxmodel import read_case, simulate_case
        >>> simulation = simulate_case(read_case("examples/samsung_30q"), progress=False)
        >>> simulation.to_dataframe().columns[:4].tolist()
        ['run', 'time_s', 'voltage_V', 'cell_temperature_degC']
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
    progress: bool | Stage = True,
) -> CaseSimulation:
    """Run the model of a case over each of its runs.

    Args:
        case: with its effects and cut-off.
        fidelity: "formula" or "lut".
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with the name
            of each run before it starts.

    Returns:
        The simulated runs, in the order of the case; a failure in a run raises no error.

    Raises:
        ParameterError: as `case_model`.
        EffectError: as `case_model`.

    Example:
        >>> from jaxmodel import read_case, simulate_case
        >>> simulate_case(read_case("examples/samsung_30q"))[0]
        <SimulatedRun: cc1C, 933 rows, complete at 3548 s>
    """
    cutoff = Cutoff(**case.cutoff) if case.cutoff else None
    outcomes = []
    with stages(progress, case.name) as tell:
        for run in case.runs:
            tell(run.name)
            course = run_in_pieces(case_model(case, run, fidelity=fidelity), run_profile(run), cutoff)
            usual = [name for name in case.vocabulary.outputs if name in course.readings]
            columns = {name: course.readings[name] for name in dict.fromkeys((*usual, *course.readings))}
            time_s = run.measured.time_s
            table = pd.DataFrame({"time_s": time_s} | columns | {"valid": course.valid}, copy=False)
            outcomes.append(SimulatedRun(run, table, course.status, float(time_s[course.end_row])))
    return CaseSimulation(case, tuple(outcomes))
