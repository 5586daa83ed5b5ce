"""The open-circuit voltage that the fit runs show: a correction of the table by their own readings, before tuning."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.model.curves import Table
from jaxmodel.model.electrothermal import Model, initial_state, read, step
from jaxmodel.model.names import with_values
from jaxmodel.operation.evaluation import Trial
from jaxmodel.operation.kalman import PAIRS, Measured
from jaxmodel.operation.preparation import rising

KNOTS = np.array([0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0])
KNOT_SD_V = 0.03  # of the correction at a knot before the runs are seen; assumed
LOSS_SD = 0.3  # of the scale of what the load takes in a run; assumed
CAPACITY_SD = 0.1  # of the scale of the capacity by which the reference was counted in a run; assumed, as in Tuning
READING_SD_V, DROP_SHARE = 0.005, 0.1  # of the residual that is neither; assumed
INDEPENDENT_S = 100.0  # readings nearer than this in time tell the same of the model's error; assumed


def calibrated(model: Model, fit: Sequence[Trial]) -> Model:
    """Return a cell's model with its table of the open-circuit voltage corrected by runs whose charge is known.

    At the reference charge s of each run, reading less model is fitted by least squares with
    f(s) + a_r D - q_r (1 - s) dV_oc/ds: f the correction, piecewise linear between `KNOTS`; D what the load takes, with
    a factor for each run; and the error of a reference that was counted by a capacity that is wrong by q_r. All have
    priors of mean zero, so that f is not what age or cold explain.

    Args:
        model: as `for_estimation` gives it.
        fit: trials from the starts of runs.
    """
    table = model.curves.ocv
    if not isinstance(table, Table) or not fit:
        return model
    columns, targets = [], []
    for number, trial in enumerate(fit):
        residual, drop, slope = _open_loop(model, trial)
        soc = np.asarray(trial.soc)
        there = np.isfinite(residual) & np.isfinite(soc)
        seconds = np.gradient(trial.time_s) if trial.time_s.size > 1 else np.ones(1)
        weight = np.sqrt(np.clip(seconds / INDEPENDENT_S, 0.0, 1.0)) / np.hypot(READING_SD_V, DROP_SHARE * drop)
        hats = np.stack([np.interp(soc, KNOTS, row) for row in np.eye(KNOTS.size)], axis=1) * KNOT_SD_V
        own = np.zeros((soc.size, 2 * len(fit)))
        own[:, 2 * number] = -LOSS_SD * drop
        own[:, 2 * number + 1] = CAPACITY_SD * (1.0 - soc) * slope
        columns.append((np.concatenate([hats, own], axis=1) * weight[:, None])[there])
        targets.append((residual * weight)[there])
    design, target = np.concatenate(columns), np.concatenate(targets)
    found = np.linalg.solve(design.T @ design + np.eye(design.shape[1]), design.T @ target)
    soc = np.unique(np.concatenate([np.asarray(table.soc), KNOTS]))
    rows = np.stack([np.interp(soc, np.asarray(table.soc), row) for row in np.asarray(table.values)])
    corrected = rows + np.interp(soc, KNOTS, KNOT_SD_V * found[: KNOTS.size])
    made = Table(soc, rising(soc, corrected), table.temperature_degC)
    return eqx.tree_at(lambda m: m.curves.ocv, model, made, is_leaf=lambda leaf: isinstance(leaf, Table))


def _open_loop(model: Model, trial: Trial) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return reading less model at the reference charge, what the load takes, and the slope of V_oc by the charge."""
    rows = trial.soc.size
    measured = jax.tree.map(lambda x: x[:rows], trial.measured)
    soc = np.interp(trial.time_s, trial.time_s[np.isfinite(trial.soc)], trial.soc[np.isfinite(trial.soc)])
    own = with_values(model, {"initial_hysteresis": jnp.asarray(trial.hysteresis)})
    volts, drop, slope = (np.asarray(x) for x in _followed(own, measured, jnp.asarray(soc)))
    return np.asarray(measured.voltage_V) - volts, drop, slope


@eqx.filter_jit
def _followed(model: Model, measured: Measured, soc: Array) -> tuple[Array, ...]:
    """Return voltages, drops and slopes of a model whose charge is given at each row."""
    first = {"current_A": measured.current_A[0], "ambient_degC": measured.degC[0]}
    begin = {name: jnp.asarray(value, dtype=float) for name, value in initial_state(model, first).items()}
    duration = jnp.diff(measured.time_s, prepend=measured.time_s[:1])

    def advance(state: dict[str, Array], row: tuple[Array, ...]) -> tuple[dict[str, Array], tuple[Array, ...]]:
        seconds, current, degC, charge = row
        inputs = {"current_A": current, "ambient_degC": degC}
        state = step(model, state, inputs, seconds) | {"soc": charge}
        relaxed = state | dict.fromkeys(PAIRS, jnp.zeros(()))

        def resting(at: Array) -> Array:
            return read(model, relaxed | {"soc": at}, inputs | {"current_A": jnp.zeros(())})["voltage_V"]

        volts = read(model, state, inputs)["voltage_V"]
        slope = (resting(charge + 0.05) - resting(charge - 0.05)) / 0.1
        return state, (volts, resting(charge) - volts, slope)

    return jax.lax.scan(advance, begin, (duration, measured.current_A, measured.degC, soc))[1]
