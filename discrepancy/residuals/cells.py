"""Mean residuals of each run in each range of a condition, and how much such means scatter from run to run.

A cell is one run in one range of the condition, at one level of what drives the hardware. What a model leaves hangs
together over minutes: the cells of a run in one range share what is the run's own there (variance A), and neighbouring
ranges share part of it (correlation rho); beside that each cell has what its own time averages out, B / seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from discrepancy.residuals.memory import Memory, memory_of
from discrepancy.residuals.regimes import Bins, least_span
from discrepancy.residuals.table import Bools, ChannelResiduals, Floats, Integers

LEAST_READINGS = 3
_HIGHEST_MEMORY = 0.95


@dataclass(frozen=True, eq=False)
class Cells:
    """Time-weighted means of a residual over the readings of each cell.

    Attributes:
        run: (cells,) number of the run.
        bin: (cells,) range of the condition, ascending.
        mean: (cells,) mean residual, in the channel's unit.
        drive: (cells,) mean of what drives the hardware; zeros where nothing does.
        warmth: (cells,) mean temperature less that of all readings, in K; zeros where none is known.
        seconds: (cells,) time spent there.
        noise: (cells,) variance that the instrument's noise leaves in the mean.
        of_rows: (n,) the cell of each reading, -1 where it is in none.
        bins: number of ranges.
        drive_span: a span of the drive that is material.
        warmth_span: a span of the temperature that is material.
    """

    run: Integers
    bin: Integers
    mean: Floats
    drive: Floats
    warmth: Floats
    seconds: Floats
    noise: Floats
    of_rows: Integers
    bins: int
    drive_span: float
    warmth_span: float

    def columns(self) -> Floats:
        """Return what a residual is regressed on: 1, the drive and the warmth, (cells, 3)."""
        return np.stack([np.ones(self.mean.size), self.drive, self.warmth], axis=1)

    def spanned(self, chosen: Bools | Integers) -> list[int]:
        """Return which of these columns some cells span materially.

        The warmth only where it is no mixture of constants and lines in the drive, one for each range: what warms as
        it empties would else be told by its warmth in place of its charge.
        """
        found = [0]
        drive, warmth = self.drive[chosen], self.warmth[chosen]
        if drive.size > 1 and self.drive_span > 0.0 and np.ptp(drive) >= self.drive_span:
            found.append(1)
        if warmth.size > 1 and self.warmth_span > 0.0 and np.ptp(warmth) >= self.warmth_span:
            root, place = np.sqrt(self.seconds[chosen]), self.bin[chosen]
            in_bin = (place[:, None] == np.unique(place)[None]).astype(float)
            known = _orthonormal(root[:, None] * np.hstack([in_bin, in_bin * drive[:, None]]))
            left = root * warmth - known @ (known.T @ (root * warmth))
            # A fifth of the span, as a root mean square, over more cells than constants and lines can follow.
            if known.shape[1] < warmth.size and np.sqrt(np.sum(left**2) / np.sum(root**2)) > 0.2 * self.warmth_span:
                found.append(2)
        return found


def cells_of(
    residuals: ChannelResiduals,
    bins: Bins,
    levels_of_drive: Bins | None,
    drive: str | None,
    warmth: str | None,
) -> Cells:
    """Return the cells of a channel's residuals over a condition.

    Args:
        residuals: of the channel.
        bins: ranges of the condition.
        levels_of_drive: levels of what drives the hardware; None where it is the condition, or nothing does.
        drive: name of the condition that does; None where none does.
        warmth: name of the condition that is the temperature; None where none is.
    """
    levels = levels_of_drive.count if levels_of_drive is not None else 1
    level = levels_of_drive.code if levels_of_drive is not None else np.zeros(residuals.error.size, dtype=int)
    place = (residuals.run * bins.count + bins.code) * levels + level
    weight = residuals.weight_s
    used, index, count = np.unique(place, return_inverse=True, return_counts=True)
    seconds: Floats = np.bincount(index, weight).astype(float)

    def mean(values: Floats) -> Floats:
        return np.bincount(index, weight * values) / seconds

    kept = count >= LEAST_READINGS
    zeros = np.zeros(used.size)
    driven = zeros if drive is None else mean(residuals.conditions[drive])
    warm = zeros
    if warmth is not None:
        values = residuals.conditions[warmth]
        warm = mean(values) - np.average(values, weights=weight)
    variance = residuals.noise_sd**2 * np.bincount(index, weight**2) / seconds**2
    return Cells(
        run=(used // (bins.count * levels))[kept],
        bin=(used // levels % bins.count)[kept],
        mean=mean(residuals.error)[kept],
        drive=driven[kept],
        warmth=warm[kept],
        seconds=seconds[kept],
        noise=np.where(np.isfinite(variance), variance, 0.0)[kept],
        of_rows=np.where(kept, np.cumsum(kept) - 1, -1)[index],
        bins=bins.count,
        drive_span=0.0 if drive is None else least_span(residuals, drive),
        warmth_span=0.0 if warmth is None else least_span(residuals, warmth),
    )


@dataclass(frozen=True, eq=False)
class Scatter:
    """How cells scatter about what they have in common, beside what each run has all through if that was left out.

    Attributes:
        between: A, variance of what is a run's own in one range of the condition.
        within: B, variance of a cell's own mean times the seconds that it averages.
        memory: rho, correlation of what is a run's own in neighbouring ranges.
        freedom: degrees of freedom on which A rests; 0 where no range was seen in runs enough to tell.
        freedom_within: those on which B rests.
        of_run: (cells, p) orthonormal columns of what was left out as a run's own, each cell by the root of its
            seconds; p = 0 where nothing was.
        left: of what the lines leave, how long it hangs together.
    """

    between: float
    within: float
    memory: float
    freedom: float
    freedom_within: float
    of_run: Floats
    left: Memory

    def variance(self, cells: Cells, sums: Floats) -> tuple[Floats, Floats]:
        """Return the variance of weighted sums of the cells' means, and the degrees of freedom that it rests on.

        From A and B (by Satterthwaite), or from the memory of what is left, which knows how often a range was visited:
        the larger.

        Args:
            cells: the cells.
            sums: (sums, cells) weights.
        """
        apart = np.abs(cells.bin[:, None] - cells.bin[None])
        shared = np.where(cells.run[:, None] == cells.run[None], self.between * self.memory**apart, 0.0)
        of_between = np.sum(sums @ shared * sums, axis=1)
        of_within = sums**2 @ np.maximum(self.within / cells.seconds, cells.noise)
        parts = of_between**2 / max(self.freedom, 1e-9) + of_within**2 / max(self.freedom_within, 1.0)
        total = of_between + of_within
        freedom = total**2 / np.maximum(parts, 1e-300)
        by_memory = self.left.variance(sums)
        larger = by_memory > total
        return np.where(larger, by_memory, total), np.where(larger, np.minimum(self.left.freedom, freedom), freedom)


def scatter_of(residuals: ChannelResiduals, cells: Cells, beside_runs: bool) -> Scatter:
    """Estimate the scatter of cells about a line in the drive in each range, and one in each run if asked.

    With every cell y by the root of its seconds, X the columns of all those lines, orthonormal, and E those of units (a
    run in one range), orthonormal too: what lines and units leave has the variance B in each of N - U - p + |E'X|^2
    directions; d = E'(1 - XX')y has the covariance (1 - CC')(A S + B)(1 - CC'), C = E'X and S the seconds of units.
    """
    root = np.sqrt(cells.seconds)
    _, unit = np.unique(cells.run * cells.bins + cells.bin, return_inverse=True)
    of_unit = unit[:, None] == np.arange(unit.max(initial=-1) + 1)[None]
    seconds = np.sum(of_unit * cells.seconds[:, None], axis=0)
    units = of_unit * root[:, None] / np.sqrt(seconds)
    of_run = np.zeros((root.size, 0))
    if beside_runs:
        of_run = _orthonormal(root[:, None] * _lines(cells, cells.run))
    lines = _orthonormal(np.hstack([of_run, root[:, None] * _lines(cells, cells.bin)]))
    fitted = lines @ (lines.T @ (root * cells.mean))
    left = root * cells.mean - fitted
    memory_left = memory_of(residuals, cells.of_rows, fitted / root, lines.shape[1])
    shared = units.T @ lines
    free = np.eye(seconds.size) - shared @ shared.T
    deviation = units.T @ left

    inside = cells.mean.size - seconds.size - lines.shape[1] + np.sum(shared**2)
    within = float(np.sum((left - units @ deviation) ** 2) / inside) if inside > 0.5 else 0.0
    square = free * seconds @ free
    if np.trace(square) <= 1e-6 * seconds.sum():
        return Scatter(0.0, within, 0.0, 0.0, float(inside), of_run, memory_left)
    between = (np.sum(deviation**2) - within * np.trace(free)) / np.trace(square)
    first = np.array([np.flatnonzero(unit == k)[0] for k in range(seconds.size)])
    memory = _memory(cells.run[first], cells.bin[first], deviation)
    freedom = np.trace(square) ** 2 / np.sum(square**2) * (1.0 - memory) / (1.0 + memory)
    return Scatter(float(max(0.0, between)), within, memory, float(freedom), float(inside), of_run, memory_left)


def _lines(cells: Cells, group: Integers) -> Floats:
    """Return the columns of a line in the drive for each group of cells; a constant where it spans no drive."""
    columns = []
    for one in np.unique(group):
        mine = group == one
        columns.append(mine.astype(float))
        if 1 in cells.spanned(mine):
            columns.append(mine * cells.drive)
    return np.stack(columns, axis=1) if columns else np.zeros((cells.mean.size, 0))


def _orthonormal(columns: Floats) -> Floats:
    """Return an orthonormal basis of what columns span."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    if not columns.size:
        return columns
    basis, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return basis[:, size > 1e-9 * size.max(initial=1.0)]


def _memory(run: Integers, place: Integers, deviation: Floats) -> float:
    """Return the correlation of runs' deviations in neighbouring ranges, not less than 0."""
    where = {(int(r), int(p)): k for k, (r, p) in enumerate(zip(run, place, strict=True))}
    pairs = np.array([(k, where[r, p + 1]) for (r, p), k in where.items() if (r, p + 1) in where], dtype=int)
    if pairs.size == 0:
        return 0.0
    first, second = deviation[pairs[:, 0]], deviation[pairs[:, 1]]
    size = np.sqrt(np.sum(first**2) * np.sum(second**2))
    return float(np.clip(first @ second / size, 0.0, _HIGHEST_MEMORY)) if size > 0.0 else 0.0
