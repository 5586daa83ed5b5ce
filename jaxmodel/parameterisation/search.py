"""The search for what is not linear: time constants and energies, by the error at readings left out and their priors.

Left out in turn: each block of a run, and each whole run at a temperature that another run has too. Both are predicted
from the state of charge that is stated at the start of the run and the capacity of the other runs. A run that is alone
at its temperature is not left out whole: what no other run can tell would decide. Readings soon after a step of the
current, others under load, and others at rest are judged apart, by the time or charge that they stand for: an hour
between pulses would outweigh them, and they alone tell of seconds. The score is the mean logarithm of all mean squares,
lest one part that no other can predict decides alone. Each part counts as one reading beside the priors, which keep
what the fit runs hardly tell within what cells have: else an energy may run to 100 kJ/mol, and a run at another current
pays for it. How smooth the curves are is not searched: beside priors of energies of 10 kJ/mol that raised the error of
held-out runs of four real cells of four.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence

import numpy as np

from jaxmodel.parameterisation.design import Columns, Grid, Shape, Start, penalties_of
from jaxmodel.parameterisation.smoothing import data_scale, penalty_matrix, quick

BLOCKS = 16  # of each run
STEPS = (1.0, 0.4, 0.15)  # of the search, in units of `UNIT`
ENERGY = 1e4  # J/mol; the unit of an energy
ENERGIES = ("E_0", "E_S", "E_L")
LOG_TAU = 0.5  # unit of the logarithm of a time constant
BOUNDS = {"tau_S": (0.3, 100.0), "tau_L": (20.0, 5000.0), "g": (3.0, 1000.0)} | dict.fromkeys(ENERGIES, (0.0, 1e5))
# Middle and sd of the priors: energies in J/mol, logarithms of time constants. Assumed: contacts and electrolyte 13 to
# 27 kJ/mol, reactions and diffusion 23 to 37; pairs of seconds and of minutes. Of the sd of an energy 5, 7 and 10
# kJ/mol were tried on held-out runs of three cells of `benchmarks.parameterise`: 7 was best in the mean.
PRIORS = {"E_0": (2e4, 7e3), "E_S": (3e4, 7e3), "E_L": (3e4, 7e3)}
PRIORS |= {"tau_S": (math.log(5.0), 1.5), "tau_L": (math.log(200.0), 1.5)}
APART = 4.0  # least ratio of the time constants
FIRST_TAUS_S = ((2.0, 50.0), (4.0, 120.0), (10.0, 300.0), (10.0, 1000.0), (30.0, 1000.0))
LEAST_V2 = 1e-8  # least mean square that counts
LEAST_GAIN = 1e-3  # of the score, for a step to be taken
ENOUGH = 5e-3  # gain of a pass below which the step is made smaller
PASSES = 6  # over all numbers at each size of step


@dataclasses.dataclass(frozen=True, eq=False)
class _Part:
    """A block of a run: A'WA, A'Wy, sum of W, and the rows with how much they count."""

    run: str
    square: np.ndarray
    aim: np.ndarray
    count: float
    matrix: np.ndarray
    target: np.ndarray
    shares: np.ndarray


@dataclasses.dataclass(eq=False)
class Parts:
    """The blocks of the runs; those of the last shapes are kept.

    Attributes:
        judged: by run, how much each kept reading counts in each kind, shape (kinds, kept).
        searched: names of the fields of the shape to search.
        accompanied: names of the runs at a temperature that another run has too.
    """

    grid: Grid
    columns: dict[str, Columns]
    targets: dict[str, np.ndarray]
    weights: dict[str, np.ndarray]
    judged: dict[str, np.ndarray]
    stated: Sequence[Start]
    ohm: float
    level: dict[str, np.ndarray] | None
    searched: Sequence[str]
    accompanied: Collection[str]
    kept: dict[Shape, list[_Part]] = dataclasses.field(default_factory=dict)

    def of(self, shape: Shape) -> list[_Part]:
        """Return the blocks of the runs for a shape."""
        if shape not in self.kept:
            found = []
            for name, one in self.columns.items():
                matrix, target = one.matrix(shape), self.targets[name]
                for at in (slice(rows[0], rows[-1] + 1) for rows in np.array_split(np.arange(target.size), BLOCKS)):
                    part, weight, share = matrix[at], self.weights[name][at], self.judged[name][:, at]
                    heavy = part.T * weight
                    found.append(_Part(name, heavy @ part, heavy @ target[at], weight.sum(), part, target[at], share))
            self.kept = {shape: found} | dict(list(self.kept.items())[:2])
        return self.kept[shape]

    def alike(self, number: int) -> list[bool]:
        """Return which runs have the capacity as uncertain as one of them has: of their kind it may be."""
        return [start.fade_sd == self.stated[number].fade_sd for start in self.stated]

    def score(self, shape: Shape) -> float:
        """Return the mean logarithm of the mean squares [V^2] of the parts left out, and the prior of the shape.

        Blocks and whole runs count alike; a distance of one sd from a prior counts as one part.
        """
        left_out = float(np.mean([np.mean(one) for one in self.missed(shape) if one]))
        away = 0.0
        for name in self.searched:
            if name in PRIORS:
                middle, sd = PRIORS[name]
                value = getattr(shape, name) if name in ENERGIES else math.log(getattr(shape, name))
                away += ((value - middle) / sd) ** 2
        return left_out + away / len(self.of(shape))

    def missed(self, shape: Shape) -> tuple[list[float], list[float]]:
        """Return the logarithm of the mean square [V^2] of each block left out, and of each run."""
        parts = self.of(shape)
        penalties = penalties_of(self.grid, shape, self.stated, self.ohm, self.level)
        square = np.sum([part.square for part in parts], axis=0)
        aim = np.sum([part.aim for part in parts], axis=0)
        scale = data_scale(sum(part.count for part in parts))
        prior = penalty_matrix(aim.size, penalties)

        layout = self.grid.layout(shape)

        def missed(left_out: Sequence[_Part]) -> float:
            rest = scale * (square - sum(part.square for part in left_out)) + prior
            values = quick(rest, scale * (aim - sum(part.aim for part in left_out)))
            name = left_out[0].run
            if name in self.grid.runs:
                number = self.grid.runs.index(name)
                fades = values[layout["fade"]]
                others = [fades[n] for n, same in enumerate(self.alike(number)) if same and n != number]
                values[layout["soc"].start + number] = 0.0
                values[layout["fade"].start + number] = np.mean(others) if others else 0.0
            squares = [(part.target - part.matrix @ values) ** 2 for part in left_out]
            found = []
            for kind in range(len(left_out[0].shares)):
                weight = sum(float(part.shares[kind].sum()) for part in left_out)
                if weight > 0.0:
                    total = sum(float(part.shares[kind] @ one) for part, one in zip(left_out, squares, strict=True))
                    found.append(math.log(max(total / weight, LEAST_V2)))
            return float(np.mean(found))

        whole = [[part for part in parts if part.run == name] for name in self.accompanied]
        return [missed([part]) for part in parts], [missed(run) for run in whole]


def search(parts: Parts, shape: Shape) -> tuple[Shape, dict[str, float]]:
    """Return the shape of least score, one number after the other, and the sd of the numbers searched.

    Args:
        parts: the problem.
        shape: where the search starts.
    """
    starts = [dataclasses.replace(shape, tau_S=short, tau_L=long) for short, long in FIRST_TAUS_S]
    now = min((shape, *starts), key=parts.score)
    best = parts.score(now)
    for step in STEPS:
        for _ in range(PASSES):
            first, before, moves = now, best, {}
            for name in parts.searched:
                for sign in (step, -step):
                    now, best, count = _line(parts, now, best, {name: sign})
                    if count:
                        moves[name] = sign * count
                        break
            if before - best < ENOUGH:
                break
            if first != now:  # once more the way that all of them went (Hooke and Jeeves)
                now, best, _ = _line(parts, now, best, moves)
    return now, _spread(parts, now, best)


def _line(parts: Parts, now: Shape, best: float, moves: dict[str, float]) -> tuple[Shape, float, int]:
    """Return where steps of some numbers together lead while the score falls, the score, and how many were taken."""
    count = 0
    while True:
        there: Shape | None = now
        for name, step in moves.items():
            there = _moved(there, name, step) if there else None
        score = parts.score(there) if there else math.inf
        if there is None or score > best - LEAST_GAIN:
            return now, best, count
        now, best, count = there, score, count + 1


def _moved(shape: Shape, name: str, step: float) -> Shape | None:
    """Return a shape after a step of one number; None where it would leave its bounds."""
    value = float(getattr(shape, name))
    value = value + step * ENERGY if name in ENERGIES else value * math.exp(step * LOG_TAU)
    low, high = BOUNDS[name]
    moved = dataclasses.replace(shape, **{name: value})
    return moved if low <= value <= high and moved.tau_L >= APART * moved.tau_S else None


def _spread(parts: Parts, shape: Shape, best: float) -> dict[str, float]:
    """Return the sd of the searched numbers: by the curvature of the score, each part being one reading of it."""
    count, spread = len(parts.of(shape)), {}
    for name in parts.searched:
        around = [_moved(shape, name, sign * STEPS[-1]) for sign in (1.0, -1.0)]
        scores = [parts.score(one) for one in around if one is not None]
        bent = max((sum(scores) / max(len(scores), 1) - best) * 2.0 / STEPS[-1] ** 2, 1e-3)
        spread[name] = (ENERGY if name in ENERGIES else LOG_TAU) / math.sqrt(0.5 * count * bent)
    return spread
