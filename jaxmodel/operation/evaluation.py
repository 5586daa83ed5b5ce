"""Trials of estimators of the state of charge: tuning them on some runs, scoring them on others.

A trial starts with the run, after a rest, with the right state of charge and 30 % too low; or at 80 and 60 %, under
load, 30 % too low and too high, full at most. Its error is the RMS error after 15 minutes to converge. Filters are
tuned by a proper score of estimate and band together: one that claims to know more than it does is not the best.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.stats import qmc

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.records import Run
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.operation.kalman import FilterOutput, Measured, Tuning, ekf
from jaxmodel.operation.polynomial import PolynomialEstimator, run_polynomial

CONVERGED_S = 900.0
START_ERROR = 0.3  # of a wrong start, in state of charge
UNDER_LOAD_SOC = (0.8, 0.6)  # state of charge at which trials under load begin
UNRESTED_V = 0.05  # sd of an RC pair's voltage there
FIXED_DEGC = 25.0  # temperature of a model without a reading of it
REFERENCE_SD = 0.005  # of the reference charge of a full cell; assumed
# Tunings are drawn log-uniformly between these: from a good sensor and table to a poor one. The sd of the capacity and
# of the current sensor are not among them: a reference that is counted with the nominal capacity cannot tell them.
RANGES = {
    "charge_sd": (5e-4, 1e-2),
    "voltage_sd_V": (5e-3, 5e-2),
    "drop_share": (0.05, 0.5),
    "error_s": (5.0, 300.0),
    "scale_sd": (0.05, 0.5),
    "scale_s": (100.0, 1e4),
    "offset_sd_V": (5e-3, 5e-2),
    "offset_s": (100.0, 5e3),
    "bias_sd_V": (5e-3, 5e-2),
    "shift_sd": (3e-3, 5e-2),
    "lasting_share": (0.01, 0.3),
}
LENGTH = 3000  # rows of runs are padded to a multiple of it: a filter compiles once for each length
NEARER = 1.7  # in a second round tunings are drawn within this factor of the best of the first
REACH_K = 10.0  # temperatures nearer than this tell of each other; assumed
BLENDS_S = (60.0, 120.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0)
Progress = Callable[[str], None]


def rms(error: np.ndarray) -> float:
    """Return the root of the mean square of what is finite."""
    return float(np.sqrt(np.nanmean(np.square(error))))


@dataclasses.dataclass(frozen=True)
class Trial:
    """A run from one of its rows on, as an estimator sees it.

    Attributes:
        name: of the run.
        measured: padded with rows of no duration and no reading to one of few lengths.
        soc: the reference state of charge, shape (rows,), without padding.
        time_s: of these rows.
        offsets: of the starts, added to the reference there.
        rested: whether the cell rested before; then the filter starts with relaxed RC pairs.
        hysteresis: assumed state of the loop of hysteresis at the start, where the model has one: that of the run if
            it rested, else the middle.
        capacity_sd: of the capacity by which the reference was counted, as a share of it.
    """

    name: str
    measured: Measured
    soc: np.ndarray
    time_s: np.ndarray
    offsets: tuple[float, ...]
    rested: bool
    hysteresis: float = 0.0
    capacity_sd: float = 0.0

    @property
    def starts(self) -> Array:
        """The assumed states of charge at the start, from empty to full."""
        return jnp.clip(jnp.asarray([self.soc[0] + offset for offset in self.offsets]), 0.0, 1.0)

    @property
    def pairs_sd_V(self) -> Array:
        """The assumed sd of the RC pairs' voltages at the start."""
        return jnp.asarray(0.0 if self.rested else UNRESTED_V)

    @property
    def reference_sd(self) -> np.ndarray:
        """The sd of the reference at each row: that of a full cell, and that of the charge drawn by a capacity."""
        return np.hypot(REFERENCE_SD, self.capacity_sd * (1.0 - self.soc))

    def late(self, values: np.ndarray) -> np.ndarray:
        """Return the part after the time to converge, of an array of shape (..., rows and padding)."""
        return np.asarray(values)[..., : self.time_s.size][..., self.time_s > self.time_s[0] + CONVERGED_S]

    def errors(self, estimates: np.ndarray) -> np.ndarray:
        """Return the RMS error after convergence, shape (...), of estimates of shape (..., rows and padding)."""
        there = np.isfinite(self.late(self.soc))
        return np.asarray(np.sqrt(np.mean((self.late(estimates) - self.late(self.soc))[..., there] ** 2, axis=-1)))

    def log_scores(self, estimates: np.ndarray, sd: np.ndarray) -> np.ndarray:
        """Return the mean of e^2/(2 s^2) + ln s after convergence, shape (...).

        e is the distance of the estimate from the reference, and s its sd: that of the band and of the reference.

        It is the logarithmic score of a normal distribution (Good, 1952), least for the band that is right.
        """
        there = np.isfinite(self.late(self.soc))
        error = (self.late(estimates) - self.late(self.soc))[..., there]
        variance = (self.late(sd) ** 2 + self.late(self.reference_sd) ** 2)[..., there]
        return np.asarray(0.5 * np.mean(error**2 / variance + np.log(variance), axis=-1))

    def convergence_s(self, estimate: np.ndarray, within: float = 0.05) -> float:
        """Return the time after which one estimate stays within a distance of the reference; inf if it never does."""
        off = np.flatnonzero(np.abs(np.asarray(estimate)[: self.soc.size] - self.soc) > within)
        if off.size == 0:
            return 0.0
        return float(self.time_s[off[-1] + 1] - self.time_s[0]) if off[-1] + 1 < self.soc.size else float("inf")


def trials(runs: Sequence[Run], *, with_temperature: bool, capacity_sd: float = 0.0) -> list[Trial]:
    """Return for each run a trial from its start, and trials under load that leave time to converge and to be scored.

    Args:
        runs: of a cell, with readings of its voltage and a reference of its charge (`soc`).
        with_temperature: whether the model has the measured temperature of the cell (the ambient where there is
            none), or always 25 degC.
        capacity_sd: of the capacity by which the reference was counted, as a share of it.

    Raises:
        MeasurementError: a run has no reference at its start, or none after the time to converge.
    """
    made = []
    for run in runs:
        outputs = run.measured.outputs
        if "soc" not in outputs or "voltage_V" not in outputs:
            raise MeasurementError(f"{run.file}: needs the columns voltage_V and soc, to be evaluated.")
        soc, time_s = outputs["soc"], run.measured.time_s
        if not np.isfinite(soc[0]) or not np.isfinite(soc[time_s > time_s[0] + CONVERGED_S]).any():
            raise MeasurementError(
                f"{run.file}: needs soc in its first row, and after the {CONVERGED_S:g} s that estimators "
                "have to converge."
            )
        made.append(_trial(run, 0, (0.0, -START_ERROR), with_temperature, capacity_sd))
        for charge in UNDER_LOAD_SOC:
            row = int(np.argmax(soc < charge))
            if row > 0 and run.measured.time_s[-1] - run.measured.time_s[row] > 2.0 * CONVERGED_S:
                made.append(_trial(run, row, (-START_ERROR, START_ERROR), with_temperature, capacity_sd))
    return made


def _trial(run: Run, row: int, offsets: tuple[float, ...], with_temperature: bool, capacity_sd: float) -> Trial:
    measured = seen(run, row, with_temperature=with_temperature)
    known = run.overrides.get("initial_hysteresis") if row == 0 else None
    hysteresis = 0.0 if known is None else known.value
    soc, time_s, rested = run.measured.outputs["soc"][row:], run.measured.time_s[row:], row == 0
    return Trial(run.name, measured, soc, time_s, offsets, rested, hysteresis, capacity_sd)


def seen(run: Run, row: int, *, with_temperature: bool) -> Measured:
    """Return a cell's run from a row on as an estimator sees it, padded to one of few lengths."""
    inputs, outputs = run.measured.inputs, run.measured.outputs
    degC = outputs.get("cell_temperature_degC", inputs["ambient_degC"]) if with_temperature else FIXED_DEGC
    if with_temperature:
        degC = _without_gaps(run.measured.time_s, np.asarray(degC))
    time_s = run.measured.time_s[row:]
    length = LENGTH * -(-time_s.size // LENGTH)
    columns = (time_s, inputs["current_A"][row:], np.broadcast_to(degC, run.measured.time_s.shape)[row:])

    def padded(values: np.ndarray, by: float) -> Array:
        return jnp.asarray(np.concatenate([values, np.full(length - values.size, by)]))

    return Measured(
        padded(columns[0], time_s[-1]),
        padded(columns[1], 0.0),
        padded(columns[2], columns[2][-1]),
        padded(outputs["voltage_V"][row:], np.nan),
    )


def known_of(trials: Sequence[Trial], fit: Sequence[Trial]) -> list[Trial]:
    """Return trials with the least charge that some runs reached near the temperature of each row, 1 where none was.

    A model is known where it was compared with readings. Below, as of a cold cell nearly empty, it is extrapolated.

    Args:
        trials: to be filtered.
        fit: of the runs that made and corrected the model.
    """
    degC, soc = (np.concatenate([of(one) for one in fit]) for of in (_degC, lambda one: one.soc))
    order = np.argsort(degC[np.isfinite(soc)])
    degC, soc = degC[np.isfinite(soc)][order], soc[np.isfinite(soc)][order]
    grid = np.arange(np.floor(degC[0] - REACH_K), degC[-1] + REACH_K + 1.0)
    near = [(np.searchsorted(degC, at - REACH_K), np.searchsorted(degC, at + REACH_K)) for at in grid]
    least = np.array([np.min(soc[low:high], initial=1.0) for low, high in near])

    def of(trial: Trial) -> Trial:
        rows = jnp.interp(trial.measured.degC, grid, least, left=1.0, right=1.0)
        return dataclasses.replace(trial, measured=dataclasses.replace(trial.measured, least_soc=rows))

    return [of(trial) for trial in trials]


def _degC(trial: Trial) -> np.ndarray:
    return np.asarray(trial.measured.degC)[: trial.soc.size]


def _without_gaps(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return readings with those that are missing interpolated linearly between their neighbours."""
    there = np.isfinite(values)
    return np.interp(time_s, time_s[there], values[there]) if there.any() else np.full(time_s.size, FIXED_DEGC)


Filter = Callable[[Model, Tuning, Measured, Scalar, Scalar], FilterOutput]


@eqx.filter_jit
def filters(
    model: Model,
    tunings: Tuning,
    measured: Measured,
    starts: Float[Array, " starts"],
    pairs_sd_V: Array,
    hysteresis: Array | None = None,
    run: Filter = ekf,
) -> FilterOutput:
    """Run a filter for each tuning and start over one run: leaves of shape (tunings, starts, rows)."""
    if hysteresis is not None:
        model = with_values(model, {"initial_hysteresis": hysteresis})

    def one(tuning: Tuning, start: Scalar) -> FilterOutput:
        return run(model, tuning, measured, start, pairs_sd_V)

    return jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None))(tunings, starts)


@eqx.filter_jit
def _bands(
    models: Model, tunings: Tuning, measured: Measured, starts: Array, pairs_sd_V: Array, hysteresis: Array
) -> tuple[Array, Array]:
    """Return charge and band of a filter for each trial, tuning and start: shape (trials, tunings, starts, rows)."""

    def one(model: Model, *trial: Any) -> tuple[Array, Array]:
        track = filters(model, tunings, *trial)
        return track.soc, track.sd

    return eqx.filter_vmap(one)(models, measured, starts, pairs_sd_V, hysteresis)


def _stacked(trials: Sequence[Trial]) -> tuple[Any, ...]:
    """Return the arguments of filters for all trials at once, padded to the longest: one scan costs less than many."""
    rows = max(trial.measured.time_s.size for trial in trials)

    def longer(trial: Trial) -> Measured:
        def to(values: Array, last: Array | float) -> Array:
            return jnp.concatenate([values, jnp.full(rows - values.size, last)])

        m = trial.measured
        least = None if m.least_soc is None else to(m.least_soc, m.least_soc[-1])
        return Measured(
            to(m.time_s, m.time_s[-1]), to(m.current_A, 0.0), to(m.degC, m.degC[-1]), to(m.voltage_V, jnp.nan), least
        )

    each = [(longer(t), t.starts, t.pairs_sd_V, jnp.asarray(t.hysteresis)) for t in trials]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)


@eqx.filter_jit
def polynomials(estimator: PolynomialEstimator, measured: Measured, starts: Float[Array, " starts"]) -> Array:
    """Run a polynomial estimator over one run from some starts: shape (starts, rows)."""
    return jax.vmap(lambda start: run_polynomial(estimator, measured, start))(starts)


def draw_tunings(count: int, near: Tuning | None = None) -> Tuning:
    """Return tunings drawn evenly in their logarithms, from `RANGES` or near one; leaves of shape (count,)."""
    ranges = RANGES if near is None else {n: (getattr(near, n) / NEARER, getattr(near, n) * NEARER) for n in RANGES}
    unit = qmc.Sobol(len(RANGES), rng=0 if near is None else 1).random(count)
    drawn = {
        name: jnp.asarray(low * (high / low) ** unit[:, column])
        for column, (name, (low, high)) in enumerate(ranges.items())
    }
    base = Tuning()
    return Tuning(**{name: drawn.get(name, jnp.full(count, getattr(base, name))) for name in vars(base)})


def tune_filter(models: Sequence[Model], fit: Sequence[Trial], count: int, progress: Progress) -> tuple[Tuning, float]:
    """Return the tuning with the least score over some trials, and that score: see `Trial.log_scores`.

    Args:
        models: of the cell, one for each trial, of one structure.
        fit: trials of the runs to tune on.
        count: tunings to try, a power of two; half as many again are tried near the best of them.
        progress: called with the name of each round before it.
    """
    progress("first round")
    first = _best(models, fit, draw_tunings(count))
    progress("second round")
    second = _best(models, fit, draw_tunings(max(1, count // 2), first[0]))
    return min(first, second, key=lambda pair: pair[1])


def _best(models: Sequence[Model], fit: Sequence[Trial], drawn: Tuning) -> tuple[Tuning, float]:
    stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *models)
    soc, sd = map(np.asarray, _bands(stacked, drawn, *_stacked(fit)))
    scores = [trial.log_scores(*track) for trial, *track in zip(fit, soc, sd, strict=True)]
    mean = np.mean(np.concatenate(scores, axis=1), axis=1)
    best = int(np.nanargmin(mean))
    return jax.tree.map(lambda leaf: leaf[best], drawn), float(mean[best])


def tune_polynomial(make: Callable[[float], PolynomialEstimator], fit: Sequence[Trial]) -> PolynomialEstimator:
    """Return the estimator with the blending time that has the least RMS error over some trials; `make` builds each."""
    found = []
    for blend in BLENDS_S:
        estimator = make(blend)
        errors = [trial.errors(np.asarray(polynomials(estimator, trial.measured, trial.starts))) for trial in fit]
        found.append((rms(np.concatenate(errors)), estimator))
    return min(found, key=lambda pair: pair[0])[1]
