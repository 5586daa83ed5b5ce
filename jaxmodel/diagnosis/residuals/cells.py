"""Mean residuals of each run in each range of a condition, and how much such means scatter from run to run.

A cell is one run in one range of the condition, at one level of the drive (current, torque or duty). Residuals are
correlated over minutes. The cells of a run in one range share a deviation of variance A, which is correlated between
neighbouring ranges (correlation rho). Each cell has a further variance B / seconds, which falls with its duration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jaxmodel.diagnosis.residuals.correlation import StretchCovariance, stretch_covariance
from jaxmodel.diagnosis.residuals.regimes import Bins, least_span
from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats, Integers

LEAST_READINGS = 3
_HIGHEST_CORRELATION = 0.95


@dataclass(frozen=True, eq=False)
class Cells:
    """Time-weighted means of a residual over the readings of each cell.

    Attributes:
        run: (cells,) number of the run.
        bin: (cells,) range of the condition, ascending.
        mean: (cells,) mean residual, in the channel's unit.
        drive: (cells,) mean of the drive; zeros without one.
        temperature: (cells,) mean temperature minus that of all readings, in K; zeros where it is unknown.
        seconds: (cells,) duration.
        noise: (cells,) variance of the mean that is due to sensor noise.
        of_rows: (n,) the cell of each reading, -1 for none.
        bins: number of ranges.
        drive_span: a span of the drive that is material.
        temperature_span: a span of the temperature that is material.
    """

    run: Integers
    bin: Integers
    mean: Floats
    drive: Floats
    temperature: Floats
    seconds: Floats
    noise: Floats
    of_rows: Integers
    bins: int
    drive_span: float
    temperature_span: float

    def columns(self) -> Floats:
        """Return the regressors of a residual: 1, the drive and the temperature, (cells, 3)."""
        return np.stack([np.ones(self.mean.size), self.drive, self.temperature], axis=1)

    def spanned(self, chosen: Bools | Integers) -> list[int]:
        """Return which of these columns span a material range in some cells.

        The temperature counts only if a constant and a line in the drive per range do not already explain it. Otherwise
        a cell that warms while it discharges would be described by its temperature instead of its state of charge.
        """
        found = [0]
        drive, temperature = self.drive[chosen], self.temperature[chosen]
        if drive.size > 1 and self.drive_span > 0.0 and np.ptp(drive) >= self.drive_span:
            found.append(1)
        if temperature.size > 1 and self.temperature_span > 0.0 and np.ptp(temperature) >= self.temperature_span:
            root, place = np.sqrt(self.seconds[chosen]), self.bin[chosen]
            in_bin = (place[:, None] == np.unique(place)[None]).astype(float)
            known = _orthonormal(root[:, None] * np.hstack([in_bin, in_bin * drive[:, None]]))
            left = root * temperature - known @ (known.T @ (root * temperature))
            # More than a fifth of the span, over more cells than the constants and lines have parameters.
            if (
                known.shape[1] < temperature.size
                and np.sqrt(np.sum(left**2) / np.sum(root**2)) > 0.2 * self.temperature_span
            ):
                found.append(2)
        return found


def cells_of(
    residuals: ChannelResiduals,
    bins: Bins,
    levels_of_drive: Bins | None,
    drive: str | None,
    temperature: str | None,
) -> Cells:
    """Return the cells of a channel's residuals over a condition.

    Args:
        residuals: of the channel.
        bins: ranges of the condition.
        levels_of_drive: levels of the drive; None without a drive, or if the drive is the condition.
        drive: name of the condition that is the drive; None without one.
        temperature: name of the condition that is the temperature; None without one.
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
    if temperature is not None:
        values = residuals.conditions[temperature]
        warm = mean(values) - np.average(values, weights=weight)
    variance = residuals.noise_sd**2 * np.bincount(index, weight**2) / seconds**2
    return Cells(
        run=(used // (bins.count * levels))[kept],
        bin=(used // levels % bins.count)[kept],
        mean=mean(residuals.error)[kept],
        drive=driven[kept],
        temperature=warm[kept],
        seconds=seconds[kept],
        noise=np.where(np.isfinite(variance), variance, 0.0)[kept],
        of_rows=np.where(kept, np.cumsum(kept) - 1, -1)[index],
        bins=bins.count,
        drive_span=0.0 if drive is None else least_span(residuals, drive),
        temperature_span=0.0 if temperature is None else least_span(residuals, temperature),
    )


@dataclass(frozen=True, eq=False)
class Scatter:
    """Scatter of cells about their common lines, optionally without the line of each run.

    Attributes:
        between: A, variance between runs in one range of the condition.
        within: B, variance of a cell's mean times its duration in seconds.
        correlation: rho, correlation of a run's deviations in neighbouring ranges.
        freedom: degrees of freedom of A; 0 if too few runs cover any range.
        freedom_within: degrees of freedom of B.
        of_run: (cells, p) orthonormal columns of the lines of runs, each cell scaled by the root of its duration; p = 0
            if these were not removed.
        left: covariance of the residuals of the lines, by stretches of time.
    """

    between: float
    within: float
    correlation: float
    freedom: float
    freedom_within: float
    of_run: Floats
    left: StretchCovariance

    def variance(self, cells: Cells, sums: Floats) -> tuple[Floats, Floats]:
        """Return the variance of weighted sums of the cells' means, and its degrees of freedom.

        The larger of two estimates: from A and B (Satterthwaite), and from the autocorrelation of the residuals, which
        accounts for how often a range was visited.

        Args:
            cells: the cells.
            sums: (sums, cells) weights.
        """
        apart = np.abs(cells.bin[:, None] - cells.bin[None])
        shared = np.where(cells.run[:, None] == cells.run[None], self.between * self.correlation**apart, 0.0)
        of_between = np.sum(sums @ shared * sums, axis=1)
        of_within = sums**2 @ np.maximum(self.within / cells.seconds, cells.noise)
        parts = of_between**2 / max(self.freedom, 1e-9) + of_within**2 / max(self.freedom_within, 1.0)
        total = of_between + of_within
        freedom = total**2 / np.maximum(parts, 1e-300)
        by_stretches = self.left.variance(sums)
        larger = by_stretches > total
        return np.where(larger, by_stretches, total), np.where(larger, np.minimum(self.left.freedom, freedom), freedom)


def scatter_of(residuals: ChannelResiduals, cells: Cells, beside_runs: bool) -> Scatter:
    """Estimate the scatter of cells about a line in the drive in each range and, if asked, one in each run.

    Every cell y is scaled by the root of its duration. X are the orthonormal columns of all lines, E those of units (a
    run in one range). The residual of lines and units has the variance B in each of N - U - p + |E'X|^2 directions.
    d = E'(1 - XX')y has the covariance (1 - CC')(A S + B)(1 - CC'), with C = E'X and S the durations of the units.
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
    of_left = stretch_covariance(residuals, cells.of_rows, fitted / root, lines.shape[1])
    shared = units.T @ lines
    free = np.eye(seconds.size) - shared @ shared.T
    deviation = units.T @ left

    inside = cells.mean.size - seconds.size - lines.shape[1] + np.sum(shared**2)
    within = float(np.sum((left - units @ deviation) ** 2) / inside) if inside > 0.5 else 0.0
    square = free * seconds @ free
    if np.trace(square) <= 1e-6 * seconds.sum():
        return Scatter(0.0, within, 0.0, 0.0, float(inside), of_run, of_left)
    between = (np.sum(deviation**2) - within * np.trace(free)) / np.trace(square)
    first = np.array([np.flatnonzero(unit == k)[0] for k in range(seconds.size)])
    correlation = _neighbour_correlation(cells.run[first], cells.bin[first], deviation)
    freedom = np.trace(square) ** 2 / np.sum(square**2) * (1.0 - correlation) / (1.0 + correlation)
    return Scatter(float(max(0.0, between)), within, correlation, float(freedom), float(inside), of_run, of_left)


def _lines(cells: Cells, group: Integers) -> Floats:
    """Return the columns of a line in the drive for each group of cells; a constant if the drive hardly varies."""
    columns = []
    for one in np.unique(group):
        mine = group == one
        columns.append(mine.astype(float))
        if 1 in cells.spanned(mine):
            columns.append(mine * cells.drive)
    return np.stack(columns, axis=1) if columns else np.zeros((cells.mean.size, 0))


def _orthonormal(columns: Floats) -> Floats:
    """Return an orthonormal basis of the span of some columns."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    if not columns.size:
        return columns
    basis, size, _ = np.linalg.svd(scaled, full_matrices=False)
    return basis[:, size > 1e-9 * size.max(initial=1.0)]


def _neighbour_correlation(run: Integers, place: Integers, deviation: Floats) -> float:
    """Return the correlation of runs' deviations in neighbouring ranges, at least 0."""
    where = {(int(r), int(p)): k for k, (r, p) in enumerate(zip(run, place, strict=True))}
    pairs = np.array([(k, where[r, p + 1]) for (r, p), k in where.items() if (r, p + 1) in where], dtype=int)
    if pairs.size == 0:
        return 0.0
    first, second = deviation[pairs[:, 0]], deviation[pairs[:, 1]]
    size = np.sqrt(np.sum(first**2) * np.sum(second**2))
    return float(np.clip(first @ second / size, 0.0, _HIGHEST_CORRELATION)) if size > 0.0 else 0.0
