"""One joint refit of all curves of a cell to all its fit runs: variable projection around linear least squares.

The linear part (`parameterisation.design`) is solved with smoothness by restricted likelihood; time constants,
activation energies and the pace of the hysteresis are searched around it (variable projection, Golub and Pereyra 1973).
Readings far from the fit count less (Huber). Initial states of charge move within their stated sd.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from parameterisation.design import RESISTANCES, Grid, Shape, Start, colder, design, penalties_of, soc_of
from parameterisation.rows import Rows
from parameterisation.smoothing import Solution, hats, inflation_of, penalty_matrix, products, solve

SEARCHED_ROWS = 12_000  # of all runs together, while the shape is searched
FITTED_ROWS = 40_000
EDGE_ROWS = 3  # after a step of the current, always kept
HUBER = 2.5  # robust sd of the residual beyond which a reading counts less
LEAST_V = 0.0005  # least sd of a run's residual
LONGEST_S = 10.0  # a reading counts as the root of the time it stands for, up to this
POWER = 0.5
MOST_FADE = 0.3
MOST_INFLATION = 10.0  # for the choice of smoothness
ALTERNATIONS = 3  # of values, and weights with initial states of charge
SOC_STEP = 0.005  # of the slope of the open-circuit voltage
MOST_ITERATIONS = 15
LAWFUL_ROUNDS = 2  # with all tables near their Arrhenius law, while energies are searched
ROUNDS = 2  # of: strengths and weights, then time constants
STEP = 0.02  # of the search, in logarithms and 10 kJ/mol
ENERGY = 1e4  # J/mol; the unit of the search
ENERGY_SD = 1.5  # prior of an activation energy about the first guess, in that unit
LOG_TAU_SD = 0.7  # of a time constant about the first guess, that of the rests


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
        """Return a single value, `R_3` or `M`, and its sd."""
        at = self.layout[name].start
        return float(self.solution.values[at]), float(np.sqrt(self.solution.covariance[at, at]))


@dataclasses.dataclass(eq=False)
class _Problem:
    """The problem on some rows of each run, with the weights of the readings."""

    runs: Sequence[Rows]
    grid: Grid
    capacity_Ah: float
    starts: dict[str, Start]
    ohm: float
    stated: dict[str, Start]
    kept: dict[str, np.ndarray]
    shares: dict[str, np.ndarray]
    weights: dict[str, np.ndarray]
    level: dict[str, np.ndarray] | None = None

    def matrices(self, shape: Shape, slope: Slope | None):
        """Yield name, design and target of each run; `slope` returns dU/dSOC at rows."""
        layout = self.grid.layout(shape)
        for rows in self.runs:
            start, kept = self.starts[rows.name], self.kept[rows.name]
            soc = soc_of(rows, start, self.capacity_Ah)
            matrix = design(rows, soc, start, self.grid, shape, self.capacity_Ah, kept)
            target = rows.voltage_V[kept].copy()
            if slope is not None and rows.name in self.grid.runs:
                number, column = self.grid.runs.index(rows.name), slope(rows, soc)[kept]
                drawn = column * rows.drawn_Ah[kept] / (self.capacity_Ah * (1.0 + start.fade) ** 2)
                matrix[:, layout["soc"].start + number] = column
                matrix[:, layout["fade"].start + number] = drawn
                target += column * (start.soc - self.stated[rows.name].soc) + drawn * start.fade
            yield rows.name, matrix, target

    def penalties(self, shape: Shape):
        """Return the penalties of the values."""
        stated = [self.stated[name] for name in self.grid.runs]
        return penalties_of(self.grid, shape, stated, self.ohm, self.level)

    def sums(self, shape: Shape, slope=None) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Return A'WA, A'Wy, y'Wy and the sum of the weights."""
        square, aim, energy, count = 0.0, 0.0, 0.0, 0.0
        for name, matrix, target in self.matrices(shape, slope):
            weight = self.weights[name]
            heavy = matrix * weight[:, None]
            square, aim = square + heavy.T @ matrix, aim + heavy.T @ target
            energy, count = energy + float(weight @ target**2), count + weight.size
        return np.asarray(square), np.asarray(aim), energy, count

    def positive(self, shape: Shape) -> np.ndarray:
        """Return the mask of the values that are not negative."""
        layout = self.grid.layout(shape)
        mask = np.zeros(layout["fade"].stop, dtype=bool)
        for name in (*RESISTANCES, "R_3", "M"):
            mask[layout[name]] = True
        return mask


def rows_kept(rows: Rows, most: int) -> np.ndarray:
    """Return the numbers of the rows to fit: every k-th with a voltage, and the first ones after each current step."""
    there = np.flatnonzero(rows.read)
    if there.size <= most:
        return there
    jump = 0.1 * float(np.max(np.abs(rows.current_A)))
    edges = np.flatnonzero(np.abs(np.diff(rows.current_A)) > jump) + 1
    edges = edges[:: max(1, edges.size * EDGE_ROWS * 2 // most)]
    near = np.unique(np.clip(edges[:, None] + np.arange(-1, EDGE_ROWS), 0, rows.time_s.size - 1))
    every = there[:: max(1, there.size // max(most - near.size, most // 2))]
    return np.union1d(every, np.intersect1d(near, there))


def time_shares(rows: Rows, kept: np.ndarray) -> np.ndarray:
    """Return how much each kept reading counts: the time it stands for, up to `LONGEST_S`, with a mean of 1.

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

    def problem(most: int, starts_now: dict[str, Start]) -> _Problem:
        total = sum(int(rows.read.sum()) for rows in runs)
        kept = {rows.name: rows_kept(rows, max(200, most * int(rows.read.sum()) // total)) for rows in runs}
        shares = {rows.name: time_shares(rows, kept[rows.name]) for rows in runs}
        return _Problem(runs, grid, capacity_Ah, dict(starts_now), ohm, starts, kept, shares, dict(shares))

    shape, small, inflation, slope = first, problem(SEARCHED_ROWS, starts), 10.0, None
    spread: dict[str, float] = {}
    values = np.empty(0)
    energies = [name for name in searched if name.startswith("E_")]
    times = [name for name in searched if name not in energies]
    # Energies first, with all tables near their law: a table over temperature would else take the law's work.
    plan = [(True, tuple(searched))] * (LAWFUL_ROUNDS if energies else 0) + [(False, tuple(times))] * ROUNDS
    for number, (lawful, names) in enumerate(plan):
        if not lawful and energies and small.level is None:
            small.level = _levels(small, shape, values)
        if progress:
            progress(f"joint refit, round {number + 1} of {len(plan)}")
        solution, inflation, slope = _linear(small, shape, inflation, slope)
        values = solution.values
        if names:
            shape, found = _search(small, shape, first, names, solution.strengths, solution.variance, inflation, slope)
            spread |= found
    full = problem(FITTED_ROWS, small.starts)
    full.level = small.level
    solution, inflation, slope = _linear(full, shape, inflation, slope)
    residuals = {name: target - matrix @ solution.values for name, matrix, target in full.matrices(shape, slope)}
    return JointFit(grid, shape, solution, capacity_Ah, full.starts, residuals, full.kept, inflation, spread)


def _levels(problem: _Problem, shape: Shape, values: np.ndarray) -> dict[str, np.ndarray]:
    """Return each resistance over SOC at 25 degC, the mean over the temperatures of its table."""
    layout, size = problem.grid.layout(shape), problem.grid.coarse.size
    return {name: values[layout[name]].reshape(-1, size).mean(axis=0) for name in RESISTANCES}


Slope = Callable[[Rows, np.ndarray], np.ndarray]


def _linear(problem: _Problem, shape: Shape, inflation: float, slope: Slope | None) -> tuple[Solution, float, Slope]:
    """Solve for all values: strengths, weights of the readings, and initial states of charge in turn."""
    layout = problem.grid.layout(shape)
    for _ in range(ALTERNATIONS - 1):
        solution, inflation = _solve_once(problem, shape, inflation, slope)
        slope = _slope_of(problem.grid.fine, solution.values[layout["U"]])
    solution, inflation = _solve_once(problem, shape, inflation, slope)
    return solution, inflation, _slope_of(problem.grid.fine, solution.values[layout["U"]])


def _solve_once(problem: _Problem, shape: Shape, inflation: float, slope: Slope | None) -> tuple[Solution, float]:
    """Solve for the values at the weights so far; then set the weights and the initial states of charge anew."""
    layout, sums = problem.grid.layout(shape), problem.sums(shape, slope)
    solution = solve(*sums, problem.penalties(shape), min(inflation, MOST_INFLATION), positive=problem.positive(shape))
    values = solution.values
    left = {name: target - matrix @ values for name, matrix, target in problem.matrices(shape, slope)}
    problem.weights = _weights(left, problem.shares)
    inflation = inflation_of([r * np.sqrt(problem.weights[name]) for name, r in left.items()])
    if slope is not None:
        for number, name in enumerate(problem.grid.runs):
            stated, moved = problem.stated[name], float(values[layout["soc"].start + number])
            fade = float(np.clip(values[layout["fade"].start + number], -MOST_FADE, MOST_FADE))
            problem.starts[name] = dataclasses.replace(stated, soc=stated.soc + moved, fade=fade)
    return solution, inflation


def _slope_of(knots: np.ndarray, values: np.ndarray) -> Slope:
    """Return the function that gives dU/dSOC at states of charge."""

    def slope(rows: Rows, soc: np.ndarray) -> np.ndarray:
        return (hats(soc + SOC_STEP, knots) - hats(soc - SOC_STEP, knots)) @ values / (2.0 * SOC_STEP)

    return slope


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


def _search(problem: _Problem, shape: Shape, expected: Shape, searched, strengths, variance, inflation, slope):
    """Return the shape of least penalised squares at known strengths, and the sd of its numbers."""
    scale = {name: ENERGY if name.startswith("E_") else None for name in searched}

    def to_shape(x: np.ndarray) -> Shape:
        numbers = {
            name: float(at * scale[name]) if scale[name] else float(np.exp(at))
            for name, at in zip(searched, x, strict=True)
        }
        return dataclasses.replace(shape, **numbers)

    def numbers_of(one: Shape) -> np.ndarray:
        values = [getattr(one, name) for name in searched]
        return np.array([v / ENERGY if scale[n] else np.log(v) for n, v in zip(searched, values, strict=True)])

    first, middle = numbers_of(shape), numbers_of(expected)
    width = np.array([ENERGY_SD if scale[name] else LOG_TAU_SD for name in searched])
    prior = penalty_matrix(len(problem.positive(shape)), problem.penalties(shape), strengths)

    def misfit(x: np.ndarray) -> float:
        square, aim, energy, _ = problem.sums(to_shape(x), slope)
        precision = square / (inflation * variance) + prior
        size = 1.0 / np.sqrt(np.diag(precision))
        precision = precision * size[:, None] * size + 1e-9 * np.eye(size.size)
        factor = cho_factor(precision, lower=True, check_finite=False)
        target = size * aim / (inflation * variance)
        squares = energy / (inflation * variance) - target @ cho_solve(factor, target, check_finite=False)
        logdet = 2.0 * np.sum(np.log(np.diag(factor[0]) / size))
        return float(0.5 * squares + 0.5 * logdet + 0.5 * np.sum(((x - middle) / width) ** 2))

    bounds = [(-2.0, 12.0) if scale[name] else (at - 1.2, at + 1.2) for name, at in zip(searched, first, strict=True)]
    found = minimize(misfit, first, method="L-BFGS-B", bounds=bounds, options={"maxiter": MOST_ITERATIONS, "eps": STEP})
    spread = {}
    for number, name in enumerate(searched):
        unit = np.eye(first.size)[number] * 3.0 * STEP
        bent = (misfit(found.x + unit) - 2.0 * found.fun + misfit(found.x - unit)) / (3.0 * STEP) ** 2
        spread[name] = float(1.0 / np.sqrt(max(bent, 1e-6))) * (ENERGY if scale[name] else 1.0)
    return to_shape(found.x), spread
