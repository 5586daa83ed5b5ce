"""Tuning estimators of the charge on runs set aside for it, and judging them on others.

A run is entered at its start, after a rest, with the right charge and 20 % too low; and at 80 and 60 % charge, in the
midst of driving, 20 % too low and too high. What is judged is the error after the time given to converge.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from jaxmodel.case import Run
from jaxmodel.declaration import Scalar
from jaxmodel.errors import MeasurementError
from jaxmodel.model import Model
from operation.cheap import Cheap
from operation.cheap import run as run_cheap
from operation.estimate import Measured, Track, Tuning, ekf, rms

CONVERGED_S = 900.0
OFF = 0.2  # how wrong a start is
UNDER_WAY_SOC = (0.8, 0.6)  # where a run is entered in the midst of driving
UNRESTED_V = 0.05  # what an RC pair may hold there
UNAWARE_DEGC = 25.0  # what a model takes that knows no temperature
# Where tunings are drawn, log-uniformly: from what a good sensor and table leave to what a bad one does.
RANGES = {
    "charge_sd": (5e-4, 1e-2),
    "voltage_sd_V": (5e-3, 4e-2),
    "drop_share": (0.02, 0.2),
    "scale_sd": (0.03, 0.3),
    "scale_s": (100.0, 2000.0),
    "offset_sd_V": (3e-3, 3e-2),
    "offset_s": (500.0, 6000.0),
}
LENGTH = 3000  # runs are padded to multiples of it: a filter compiles once for each length
NEARER = 1.7  # in a second round tunings are drawn within this factor of the best of the first
BLENDS_S = (60.0, 120.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0)
Progress = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class Entry:
    """A run from one of its rows on, as an estimator sees it.

    Attributes:
        name: of the run.
        measured: padded with rows of no duration and no reading to one of few lengths.
        soc: the reference, shape (rows,), without padding.
        time_s: of these rows.
        offsets: of the starts, added to the reference there.
        rested: whether the cell rested before, and the estimator knows it.
    """

    name: str
    measured: Measured
    soc: np.ndarray
    time_s: np.ndarray
    offsets: tuple[float, ...]
    rested: bool

    @property
    def starts(self) -> Array:
        """Return the charges that estimators are told at the start."""
        return jnp.asarray([self.soc[0] + offset for offset in self.offsets])

    @property
    def pairs_sd_V(self) -> Array:
        """Return what a filter is told of the RC pairs at the start."""
        return jnp.asarray(0.0 if self.rested else UNRESTED_V)

    def late(self, values: np.ndarray) -> np.ndarray:
        """Return the part after the time to converge, of an array of shape (..., rows and padding)."""
        return np.asarray(values)[..., : self.time_s.size][..., self.time_s > self.time_s[0] + CONVERGED_S]

    def errors(self, estimates: np.ndarray) -> np.ndarray:
        """Return the RMS error after convergence, shape (...), of estimates of shape (..., rows and padding)."""
        there = np.isfinite(self.late(self.soc))
        return np.asarray(np.sqrt(np.mean((self.late(estimates) - self.late(self.soc))[..., there] ** 2, axis=-1)))

    def convergence_s(self, estimate: np.ndarray, within: float = 0.05) -> float:
        """Return the time after which one estimate stays within a distance of the reference; inf if it never does."""
        off = np.flatnonzero(np.abs(np.asarray(estimate)[: self.soc.size] - self.soc) > within)
        if off.size == 0:
            return 0.0
        return float(self.time_s[off[-1] + 1] - self.time_s[0]) if off[-1] + 1 < self.soc.size else float("inf")


def entries(runs: Sequence[Run], *, aware: bool) -> list[Entry]:
    """Return each run from its start, and from places under way that leave time to converge and to be judged.

    Args:
        runs: of a cell, with readings of its voltage and a reference of its charge (`soc`).
        aware: whether the model is given the measured temperature of the cell (the ambient where there is none), or 25
            degC whatever it is.

    Raises:
        MeasurementError: a run has no reference at its start, or none after the time to converge.
    """
    made = []
    for run in runs:
        outputs = run.measured.outputs
        if "soc" not in outputs or "voltage_V" not in outputs:
            raise MeasurementError(f"{run.file}: needs the columns voltage_V and soc, to be judged by.")
        soc, time_s = outputs["soc"], run.measured.time_s
        if not np.isfinite(soc[0]) or not np.isfinite(soc[time_s > time_s[0] + CONVERGED_S]).any():
            raise MeasurementError(
                f"{run.file}: needs soc in its first row, and after the {CONVERGED_S:g} s that estimators are "
                "given to converge."
            )
        made.append(_entry(run, 0, (0.0, -OFF), aware))
        for charge in UNDER_WAY_SOC:
            row = int(np.argmax(soc < charge))
            if row > 0 and run.measured.time_s[-1] - run.measured.time_s[row] > 2.0 * CONVERGED_S:
                made.append(_entry(run, row, (-OFF, OFF), aware))
    return made


def _entry(run: Run, row: int, offsets: tuple[float, ...], aware: bool) -> Entry:
    inputs, outputs = run.measured.inputs, run.measured.outputs
    degC = outputs.get("cell_temperature_degC", inputs["ambient_degC"]) if aware else UNAWARE_DEGC
    if aware:
        degC = _without_gaps(run.measured.time_s, np.asarray(degC))
    time_s = run.measured.time_s[row:]
    length = LENGTH * -(-time_s.size // LENGTH)
    columns = (time_s, inputs["current_A"][row:], np.broadcast_to(degC, run.measured.time_s.shape)[row:])

    def padded(values: np.ndarray, by: float) -> Array:
        return jnp.asarray(np.concatenate([values, np.full(length - values.size, by)]))

    measured = Measured(
        padded(columns[0], time_s[-1]),
        padded(columns[1], 0.0),
        padded(columns[2], columns[2][-1]),
        padded(outputs["voltage_V"][row:], np.nan),
    )
    return Entry(run.name, measured, outputs["soc"][row:], time_s, offsets, rested=row == 0)


def _without_gaps(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return readings with those that are missing drawn straight between their neighbours."""
    there = np.isfinite(values)
    return np.interp(time_s, time_s[there], values[there]) if there.any() else np.full(time_s.size, UNAWARE_DEGC)


@eqx.filter_jit
def filters(
    model: Model, tunings: Tuning, measured: Measured, starts: Float[Array, " starts"], pairs_sd_V: Array
) -> Track:
    """Run filters over one run: leaves of shape (tunings, starts, rows)."""

    def one(tuning: Tuning, start: Scalar) -> Track:
        return ekf(model, tuning, measured, start, pairs_sd_V)

    return jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None))(tunings, starts)


@eqx.filter_jit
def cheap_ones(cheap: Cheap, measured: Measured, starts: Float[Array, " starts"]) -> Array:
    """Run cheap estimators over one run: shape (starts, rows)."""
    return jax.vmap(lambda start: run_cheap(cheap, measured, start))(starts)


def draw(count: int, near: Tuning | None = None) -> Tuning:
    """Return tunings drawn evenly in their logarithms, from `RANGES` or near one; leaves of shape (count,)."""
    ranges = RANGES if near is None else {n: (getattr(near, n) / NEARER, getattr(near, n) * NEARER) for n in RANGES}
    unit = qmc.Sobol(len(RANGES), rng=0 if near is None else 1).random(count)
    drawn = {
        name: jnp.asarray(low * (high / low) ** unit[:, column])
        for column, (name, (low, high)) in enumerate(ranges.items())
    }
    base = Tuning()
    return Tuning(**{name: drawn.get(name, jnp.full(count, getattr(base, name))) for name in vars(base)})


def tuned(model: Model, fit: Sequence[Entry], count: int, told: Progress) -> tuple[Tuning, float]:
    """Return the tuning with the least RMS error over all entries of the runs set aside, and that error.

    Args:
        model: of the cell.
        fit: entries of the runs to tune on.
        count: tunings to try, a power of two; half as many again are tried near the best of them.
        told: told which run is under way.
    """
    first = _best(model, fit, draw(count), told)
    second = _best(model, fit, draw(max(1, count // 2), first[0]), told)
    return min(first, second, key=lambda pair: pair[1])


def _best(model: Model, fit: Sequence[Entry], drawn: Tuning, told: Progress) -> tuple[Tuning, float]:
    squares = []
    for entry in fit:
        told(entry.name)
        track = filters(model, drawn, entry.measured, entry.starts, entry.pairs_sd_V)
        squares.append(entry.errors(np.asarray(track.soc)) ** 2)
    mean = np.sqrt(np.mean(np.concatenate(squares, axis=1), axis=1))
    best = int(np.nanargmin(mean))
    return jax.tree.map(lambda leaf: leaf[best], drawn), float(mean[best])


def tuned_cheap(make: Callable[[float], Cheap], fit: Sequence[Entry]) -> Cheap:
    """Return the cheap estimator with the blend that has the least RMS error over the runs set aside."""
    found = []
    for blend in BLENDS_S:
        cheap = make(blend)
        errors = [entry.errors(np.asarray(cheap_ones(cheap, entry.measured, entry.starts))) for entry in fit]
        found.append((rms(np.concatenate(errors)), cheap))
    return min(found, key=lambda pair: pair[0])[1]
