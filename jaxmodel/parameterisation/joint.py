"""One joint refit of all curves of a cell to all its fit runs: variable projection around linear least squares.

The linear part (`jaxmodel.parameterisation.design`) is solved for given time constants and activation energies.
These are searched for the least error at readings that were left out (`jaxmodel.parameterisation.search`);
no run that is not fitted takes part. Readings far from the fit count less (Huber). Initial states of charge and
capacities of runs move as far as that search finds useful.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from jaxmodel.parameterisation.design import (
    RESISTANCES,
    Columns,
    Grid,
    Shape,
    Start,
    colder,
    penalties_of,
    soc_of,
)
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.search import Parts, search
from jaxmodel.parameterisation.smoothing import Solution, hats, inflation_of, penalty_matrix, products, solve

SEARCHED_ROWS = 12_000  # of all runs together, while numbers are searched
FITTED_ROWS = 40_000
EDGE_ROWS = 3  # after a step of the current, always kept
HUBER = 2.5  # robust sd of the residual beyond which a reading counts less
LEAST_V = 0.0005  # least sd of a run's residual
LONGEST_S = 10.0  # a reading counts as the root of the time it stands for, up to this
POWER = 0.5
MOST_FADE = 0.3
LONGEST_JUDGED_S = 120.0  # a reading stands for, where readings left out are judged
STEP_SHARE = 0.1  # of the largest current: a change between two readings that is a step
SOON_S, LONGEST_SOON_S = 15.0, 1.0  # after a step is judged apart; the longest time that a reading stands for there
SOON_CHARGE = 0.02  # least share of the charge that flows so soon, for a run to tell of seconds
ALTERNATIONS = 3  # of values, and weights with initial states of charge
SOC_STEP = 0.005  # of the slope of the open-circuit voltage


@dataclasses.dataclass(frozen=True, eq=False)
class JointFit:
    """All curves of a cell.

    Attributes:
        grid: the points of the curves.
        shape: time constants and energies.
        solution: the values and their covariance.
        capacity_Ah: that the state of charge is counted with.
        starts: by run, with the fitted state of charge.
        residuals: by run, reading minus fit at its kept rows [V].
        kept: by run, the numbers of those rows.
        inflation: rows that count as one.
        shape_sd: sd of the searched numbers by name: of the logarithm of a time constant, of an energy [J/mol].
    """

    grid: Grid
    shape: Shape
    solution: Solution
    capacity_Ah: float
    starts: dict[str, Start]
    residuals: dict[str, np.ndarray]
    kept: dict[str, np.ndarray]
    inflation: float
    shape_sd: dict[str, float]

    @property
    def layout(self) -> dict[str, slice]:
        """Return where the values of each curve stand."""
        return self.grid.layout(self.shape)

    def weights(self, name: str, soc: np.ndarray, degC: float) -> np.ndarray:
        """Return the derivatives of a curve at one temperature by all values, shape (soc, values)."""
        matrix = np.zeros((soc.size, self.solution.values.size))
        table = products(hats(np.full(soc.size, degC), self.grid.degC), hats(soc, self.grid.coarse))
        if name == "U":
            matrix[:, self.layout["U"]] = hats(soc, self.grid.fine)
            if self.grid.degC.size > 1:
                matrix[:, self.layout["dU"]] = table
        else:
            energy = {"R_0": self.shape.E_0, "R_S": self.shape.E_S, "R_L": self.shape.E_L}[name]
            matrix[:, self.layout[name]] = table * np.exp(energy * colder(degC))
        return matrix

    def curve(self, name: str, soc: np.ndarray, degC: float) -> np.ndarray:
        """Return U [V] or R_0, R_S, R_L [ohm] over SOC at one temperature."""
        return self.weights(name, soc, degC) @ self.solution.values

    def curve_sd(self, name: str, soc: np.ndarray, degC: float) -> np.ndarray:
        """Return the sd of a curve, model misfit included by the inflation."""
        weights = self.weights(name, soc, degC)
        return np.sqrt(np.maximum(np.sum((weights @ self.solution.covariance) * weights, axis=1), 0.0))

    def value(self, name: str) -> tuple[float, float]:
        """Return a single value, such as `M`, and its sd."""
        at = self.layout[name].start
        return float(self.solution.values[at]), float(np.sqrt(self.solution.covariance[at, at]))


@dataclasses.dataclass(eq=False)
class _Problem:
    """The problem on some rows of each run, with the weights of the readings and what is known by now."""

    runs: Sequence[Rows]
    grid: Grid
    capacity_Ah: float
    stated: dict[str, Start]
    ohm: float
    most: int
    searched: Sequence[str] = ()
    starts: dict[str, Start] = dataclasses.field(init=False)
    kept: dict[str, np.ndarray] = dataclasses.field(init=False)
    shares: dict[str, np.ndarray] = dataclasses.field(init=False)
    weights: dict[str, np.ndarray] = dataclasses.field(init=False)
    slope: np.ndarray | None = None
    level: dict[str, np.ndarray] | None = None

    def __post_init__(self) -> None:
        total = sum(int(rows.read.sum()) for rows in self.runs)
        self.kept = {r.name: rows_kept(r, max(200, self.most * int(r.read.sum()) // total)) for r in self.runs}
        self.shares = {rows.name: time_shares(rows, self.kept[rows.name]) for rows in self.runs}
        self.weights, self.starts = dict(self.shares), dict(self.stated)

    def columns(self) -> dict[str, Columns]:
        """Return by run what its columns are made of, at the present states of charge."""
        return {
            rows.name: Columns(
                rows, self.starts[rows.name], self.grid, self.capacity_Ah, self.kept[rows.name], self._moves(rows)
            )
            for rows in self.runs
        }

    def _moves(self, rows: Rows) -> np.ndarray | None:
        """Return the derivatives of the voltage by the initial state of charge and the fade, shape (kept, 2)."""
        if self.slope is None or rows.name not in self.grid.runs:
            return None
        start, kept = self.starts[rows.name], self.kept[rows.name]
        soc = soc_of(rows, start, self.capacity_Ah)[kept]
        rise = hats(soc + SOC_STEP, self.grid.fine) - hats(soc - SOC_STEP, self.grid.fine)
        column = rise @ self.slope / (2.0 * SOC_STEP)
        drawn = rows.drawn_Ah[kept] / (self.capacity_Ah * (1.0 + start.fade) ** 2)
        return np.column_stack([column, column * drawn])

    def target(self, rows: Rows, moves: np.ndarray | None) -> np.ndarray:
        """Return what the columns are to give: the voltage, where moves count from what is stated."""
        start = self.starts[rows.name]
        voltage = rows.voltage_V[self.kept[rows.name]]
        if moves is None:
            return voltage
        return voltage + moves @ np.array([start.soc - self.stated[rows.name].soc, start.fade])

    def parts(self, columns: dict[str, Columns]) -> Parts:
        """Return the problem in the parts that the search leaves out."""
        targets = {rows.name: self.target(rows, columns[rows.name].moves) for rows in self.runs}
        stated = [self.stated[name] for name in self.grid.runs]
        judged = {rows.name: counts(rows, self.kept[rows.name]) for rows in self.runs}
        levels = [int(np.argmin(np.abs(self.grid.degC - np.median(rows.ambient_degC)))) for rows in self.runs]
        accompanied = [rows.name for rows, at in zip(self.runs, levels, strict=True) if levels.count(at) > 1]
        return Parts(
            self.grid, columns, targets, self.weights, judged, stated, self.ohm, self.level, self.searched, accompanied
        )

    def solved(self, shape: Shape) -> tuple[Solution, float, dict[str, np.ndarray]]:
        """Return the solution, the inflation, and the residuals; set weights, starts and levels for the next time."""
        columns, layout = self.columns(), self.grid.layout(shape)
        designs = {name: one.matrix(shape) for name, one in columns.items()}
        targets = {rows.name: self.target(rows, columns[rows.name].moves) for rows in self.runs}
        stated, weights = [self.stated[name] for name in self.grid.runs], self.weights
        penalties = penalties_of(self.grid, shape, stated, self.ohm, self.level)
        positive = np.zeros(layout["fade"].stop, dtype=bool)
        for name in (*RESISTANCES, "M"):
            positive[layout[name]] = True

        def residuals(values: np.ndarray) -> dict[str, np.ndarray]:
            return {name: targets[name] - matrix @ values for name, matrix in designs.items()}

        solution, inflation = solve(
            np.asarray(sum((matrix.T * weights[name]) @ matrix for name, matrix in designs.items())),
            np.asarray(sum((matrix.T * weights[name]) @ targets[name] for name, matrix in designs.items())),
            float(sum(weights[name] @ target**2 for name, target in targets.items())),
            float(sum(weight.sum() for weight in weights.values())),
            penalty_matrix(positive.size, penalties),
            positive,
            lambda values: inflation_of([r * np.sqrt(weights[name]) for name, r in residuals(values).items()]),
        )
        left = residuals(solution.values)
        self._learn(solution.values, layout, left)
        return solution, inflation, left

    def _learn(self, values: np.ndarray, layout: dict[str, slice], left: dict[str, np.ndarray]) -> None:
        self.weights = _weights(left, self.shares)
        size = self.grid.coarse.size
        self.level = {name: values[layout[name]].reshape(-1, size).mean(axis=0) for name in RESISTANCES}
        if self.slope is not None:
            for number, name in enumerate(self.grid.runs):
                stated, moved = self.stated[name], float(values[layout["soc"].start + number])
                fade = float(np.clip(values[layout["fade"].start + number], -MOST_FADE, MOST_FADE))
                self.starts[name] = dataclasses.replace(stated, soc=stated.soc + moved, fade=fade)
        self.slope = values[layout["U"]]


def rows_kept(rows: Rows, most: int) -> np.ndarray:
    """Return the numbers of the rows to fit: every k-th with a voltage, and the first ones after each current step."""
    there = np.flatnonzero(rows.read)
    if there.size <= most:
        return there
    edges = steps_of(rows)
    edges = edges[:: max(1, edges.size * EDGE_ROWS * 2 // most)]
    near = np.unique(np.clip(edges[:, None] + np.arange(-1, EDGE_ROWS), 0, rows.time_s.size - 1))
    every = there[:: max(1, there.size // max(most - near.size, most // 2))]
    return np.union1d(every, np.intersect1d(near, there))


def steps_of(rows: Rows) -> np.ndarray:
    """Return the numbers of the first rows after each step of the current."""
    return np.flatnonzero(np.abs(np.diff(rows.current_A)) > STEP_SHARE * float(np.max(np.abs(rows.current_A)))) + 1


def counts(rows: Rows, kept: np.ndarray) -> np.ndarray:
    """Return how much each kept reading counts in each kind, shape (3, kept).

    Soon after a step of the current by the time it stands for, else under load by the charge, else at rest by the time.
    A constant discharge, with one step, has nothing of the first kind.
    """
    time_s, current = rows.time_s[kept], np.abs(rows.current_A[kept])
    steps = steps_of(rows)
    last = np.searchsorted(steps, kept, side="right")
    soon = time_s - np.append(-np.inf, rows.time_s[steps])[last] < SOON_S
    resting = current <= rows.resting_A
    held_s = np.gradient(time_s)
    long_s = np.minimum(held_s, LONGEST_JUDGED_S)
    charge = long_s * current
    soon &= charge[soon].sum() > SOON_CHARGE * charge.sum()
    return np.stack(
        [
            np.where(soon, np.minimum(held_s, LONGEST_SOON_S), 0.0),
            np.where(soon | resting, 0.0, charge),
            np.where(resting & ~soon, long_s, 0.0),
        ]
    )


def time_shares(rows: Rows, kept: np.ndarray) -> np.ndarray:
    """Return how much each kept reading counts: the root of the time it stands for, up to `LONGEST_S`; mean 1.

    What the model misses lasts for seconds to minutes. A log that is dense in pulses would otherwise be fitted there
    alone, and one that is thinned at rest not at all.
    """
    step = np.diff(rows.time_s[kept])
    share = 0.5 * (np.minimum(np.append(step, step[-1:]), LONGEST_S) + np.minimum(np.append(step[:1], step), LONGEST_S))
    share = share**POWER
    return share / np.mean(share)


def fit_joint(
    runs: Sequence[Rows],
    grid: Grid,
    capacity_Ah: float,
    starts: dict[str, Start],
    first: Shape,
    searched: Sequence[str],
    ohm: float,
    progress: Callable[[str], None] | None = None,
) -> JointFit:
    """Fit all curves to all runs.

    Args:
        runs: fit runs.
        grid: the points of the curves.
        capacity_Ah: that the state of charge is counted with.
        starts: by run, as stated.
        first: the first guess of the shape.
        searched: names of the fields of the shape to search.
        ohm: typical resistance of the cell.
        progress: called with what is done next.
    """
    small = _Problem(runs, grid, capacity_Ah, starts, ohm, SEARCHED_ROWS, searched)
    if progress:
        progress("joint refit")
    for _ in range(ALTERNATIONS):
        small.solved(first)
    shape, spread = search(small.parts(small.columns()), first)
    full = _Problem(runs, grid, capacity_Ah, starts, ohm, FITTED_ROWS)
    full.starts, full.level, full.slope = dict(small.starts), small.level, small.slope
    for _ in range(ALTERNATIONS - 1):
        full.solved(shape)
    solution, inflation, left = full.solved(shape)
    return JointFit(grid, shape, solution, capacity_Ah, full.starts, left, full.kept, inflation, spread)


def _weights(left: dict[str, np.ndarray], shares: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the weights of the readings: by the robust sd of their run's residual, and Huber's within it.

    A run that the model cannot follow (deep cold) must not spoil those it can. By its variance it would hardly count,
    although it alone may tell of its temperature: the root of that weight is taken. The mean is about one.
    """
    typical = {name: max(1.4826 * float(np.median(np.abs(r))), LEAST_V) for name, r in left.items()}
    mean = np.exp(np.average(np.log(list(typical.values())), weights=[r.size for r in left.values()]))
    return {
        name: shares[name]
        * (mean / typical[name])
        * np.minimum(1.0, HUBER * typical[name] / np.maximum(np.abs(r), 1e-12))
        for name, r in left.items()
    }
