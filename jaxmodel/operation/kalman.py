"""State of charge from current, voltage and temperature: an extended Kalman filter on the model's own step.

The state is that of the model (charge, RC voltages, states of effects) and two numbers that no table holds: the
scale of all resistances and a slowly varying offset of the open-circuit voltage, in which age, hysteresis and the
current's own effect on resistance show. Process and reading are `jaxmodel.model.electrothermal.step` and `read`, their
Jacobians `jax.jacfwd` of these. One filter is a scan; batches are `vmap` outside.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.base.in_short import InShort
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.electrothermal import Model, initial_state, read, step
from jaxmodel.model.names import with_values

# Beside the model's states: the logarithm of the scale of all resistances, and the offset of V_oc in V.
VARYING = ("log_scale", "offset_V")
SOC_RANGE = (0.0, 1.0)  # outside it the curves are held constant, and readings say nothing of the charge
FIRST_ROUNDS = 6

# Current, temperature and voltage of a row.
Row = tuple[Array, Array, Array]


def _as_array(value: Any) -> Array:
    return jnp.asarray(value, dtype=float)


class Tuning(InShort, eqx.Module):
    """The standard deviations and time constants that the filter assumes; any leaf may carry lanes.

    Attributes:
        start_sd: of the state of charge at the start.
        charge_sd: of the state of charge counted over an hour, by errors of current sensor and capacity.
        voltage_sd_V: of a reading, model error that changes from reading to reading included.
        drop_share: further error of a reading, as a share of what the load takes from the open-circuit voltage.
        scale_sd: of the logarithm of the scale of all resistances, a first-order Gauss-Markov process.
        scale_s: correlation time of that process.
        offset_sd_V: of the offset of the open-circuit voltage, a process of the same kind.
        offset_s: correlation time of that process.

    Example:
        >>> from jaxmodel import operation
        >>> operation.Tuning(scale_sd=0.1)
        <Tuning: scale_sd=0.1>
    """

    start_sd: Scalar = eqx.field(default=0.2, converter=_as_array)
    charge_sd: Scalar = eqx.field(default=0.01, converter=_as_array)
    voltage_sd_V: Scalar = eqx.field(default=0.01, converter=_as_array)
    drop_share: Scalar = eqx.field(default=0.1, converter=_as_array)
    scale_sd: Scalar = eqx.field(default=0.3, converter=_as_array)
    scale_s: Scalar = eqx.field(default=1000.0, converter=_as_array)
    offset_sd_V: Scalar = eqx.field(default=0.02, converter=_as_array)
    offset_s: Scalar = eqx.field(default=1000.0, converter=_as_array)


class Measured(InShort, eqx.Module):
    """A run as the robot's computer sees it, each of shape (rows,).

    Attributes:
        time_s: increasing.
        current_A: held since the row before, positive on discharge.
        degC: temperature for the model: the cell's, or a fixed one where it is not measured.
        voltage_V: of the cell; NaN where there is no reading.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import operation, preset_model
        >>> time_s = jnp.arange(0.0, 600.0, 10.0)
        >>> current_A, degC, voltage_V = jnp.full(60, 2.0), jnp.full(60, 20.0), jnp.linspace(4.0, 3.9, 60)
        >>> measured = operation.Measured(time_s, current_A, degC, voltage_V)
        >>> measured.voltage_V.shape
        (60,)
    """

    time_s: Float[Array, " rows"]
    current_A: Float[Array, " rows"]
    degC: Float[Array, " rows"]
    voltage_V: Float[Array, " rows"]


class FilterOutput(InShort, eqx.Module):
    """The estimates of a filter at each row, shape (..., rows).

    Attributes:
        soc: state of charge.
        sd: its standard deviation by the filter's covariance.
        nis: normalised innovation squared; 1 on average where the filter is consistent. NaN without a reading.
        scale: of all resistances.
        offset_V: of the open-circuit voltage.
    """

    soc: Array
    sd: Array
    nis: Array
    scale: Array
    offset_V: Array


def state_names(model: Model) -> tuple[str, ...]:
    """Return the names of the filter's states, in the order of its vector."""
    zero = jnp.zeros(())
    inputs = {"current_A": zero, "ambient_degC": zero}
    return (*sorted(initial_state(model, inputs)), *VARYING)


def ekf(model: Model, tuning: Tuning, measured: Measured, start_soc: Scalar, pairs_sd_V: Scalar) -> FilterOutput:
    """Run one filter over a run; pure, so that it may be vmapped over tunings, starts and runs.

    Args:
        model: of kind "cell".
        tuning: its assumed errors.
        measured: the run, NaN where a voltage is missing.
        start_soc: assumed state of charge at the start, 0 to 1.
        pairs_sd_V: sd of the voltages of the RC pairs there: 0 after a rest.

    Returns:
        Estimates of shape (rows,).
    """
    duration = jnp.diff(measured.time_s)
    readings = (measured.current_A, measured.degC, measured.voltage_V)
    first, later = (jax.tree.map(lambda x, part=part: x[part], readings) for part in (0, slice(1, None)))
    before = _before_first_reading(model, tuning, first, jnp.asarray(start_soc, dtype=float), pairs_sd_V)
    # A wrong start is far from where the curves were linearised: its first reading is linearised again and again.
    begin, first_output = _correct(model, tuning, *before, first, rounds=FIRST_ROUNDS)

    def advance(carry: tuple[Array, Array], row: tuple[Array, Row]) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
        return _correct(model, tuning, *_predict(model, tuning, *carry, *row), row[1])

    outputs = jax.lax.scan(advance, begin, (duration, later))[1]
    return FilterOutput(*(jnp.concatenate([one[None], rest]) for one, rest in zip(first_output, outputs, strict=True)))


def _before_first_reading(
    model: Model, tuning: Tuning, first: Row, start_soc: Scalar, pairs_sd_V: Scalar
) -> tuple[Array, Array]:
    """Return mean and covariance before the first reading."""
    names = state_names(model)
    state = initial_state(model, _inputs(first)) | {"soc": start_soc} | dict.fromkeys(VARYING, jnp.zeros(()))
    known = dict.fromkeys(("v_ts_V", "v_tl_V"), pairs_sd_V)
    known |= {"soc": tuning.start_sd, "log_scale": tuning.scale_sd, "offset_V": tuning.offset_sd_V}
    variances = jnp.stack([jnp.asarray(known.get(name, 0.0), dtype=float) ** 2 for name in names])
    mean = jnp.stack([jnp.asarray(state[name], dtype=float) for name in names])
    return mean, variances[:, None] * jnp.eye(len(names))


def _inputs(row: Row) -> dict[str, Array]:
    return {"current_A": row[0], "ambient_degC": row[1]}


def _named(model: Model, x: Array) -> tuple[Model, dict[str, Array]]:
    """Return the model with the varying numbers of a state vector in it, and its own states by name."""
    values = dict(zip(state_names(model), x, strict=True))
    factor = jnp.exp(values.pop("log_scale"))
    p = model.parameters
    own = {
        "series_resistance_scale": p.series_resistance_scale * factor,
        "rc_resistance_scale": p.rc_resistance_scale * factor,
        # The pairs keep their time constants.
        "rc_capacitance_scale": p.rc_capacitance_scale / factor,
        "ocv_offset_V": p.ocv_offset_V + values.pop("offset_V"),
    }
    return with_values(model, own), values


def _predict(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, duration: Array, row: Row
) -> tuple[Array, Array]:
    """Move mean and covariance over a step by the model's own, linearised at the mean."""
    names = state_names(model)
    keep = {"log_scale": jnp.exp(-duration / tuning.scale_s), "offset_V": jnp.exp(-duration / tuning.offset_s)}

    def move(x: Array) -> Array:
        own, state = _named(model, x)
        moved = step(own, state, _inputs(row), duration)
        unchanged = dict(zip(names, x, strict=True))
        return jnp.stack([moved[n] if n in moved else unchanged[n] * keep[n] for n in names])

    noise = {
        "soc": tuning.charge_sd**2 * duration / 3600.0,
        "log_scale": tuning.scale_sd**2 * (1.0 - keep["log_scale"] ** 2),
        "offset_V": tuning.offset_sd_V**2 * (1.0 - keep["offset_V"] ** 2),
    }
    added = jnp.stack([jnp.asarray(noise.get(name, 0.0), dtype=float) for name in names])
    slope = jax.jacfwd(move)(mean)
    covariance = _product(_product(slope, covariance), slope.T) + added[:, None] * jnp.eye(len(names))
    return move(mean), covariance


def _correct(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, row: Row, rounds: int = 1
) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
    """Correct by a voltage (Joseph's form, which keeps the covariance positive); return both, and the output.

    In further rounds the reading is linearised where the round before ended (iterated extended Kalman filter).
    """
    names, voltage = state_names(model), row[2]
    soc = names.index("soc")

    def reading(x: Array) -> Array:
        own, state = _named(model, x)
        return read(own, state, _inputs(row))["voltage_V"]

    own, state = _named(model, mean)
    unloaded = state | {name: jnp.zeros(()) for name in ("v_ts_V", "v_tl_V")}
    at_rest = {"current_A": jnp.zeros(()), "ambient_degC": row[1]}
    drop = read(own, unloaded, at_rest)["voltage_V"] - reading(mean)
    variance = tuning.voltage_sd_V**2 + (tuning.drop_share * drop) ** 2
    seen = jnp.isfinite(voltage)

    def linearised(x: Array) -> tuple[Array, Array, Array, Array, Array]:
        along = jax.jacfwd(reading)(x)
        innovation = jnp.where(seen, voltage - reading(x) - jnp.sum(along * (mean - x)), 0.0)
        across = jnp.sum(covariance * along, axis=1)
        spread = jnp.sum(across * along) + variance
        gain = jnp.where(seen, across / spread, 0.0)
        return along, innovation, spread, gain, _clipped(mean + gain * innovation, soc)

    along, innovation, spread, gain, corrected = linearised(mean)
    nis = jnp.where(seen, innovation**2 / spread, jnp.nan)
    if rounds > 1:
        nearer = jax.lax.fori_loop(0, rounds - 2, lambda _, x: linearised(x)[-1], corrected)
        along, _, _, gain, corrected = linearised(nearer)
    left = jnp.eye(len(names)) - gain[:, None] * along
    covariance = _product(_product(left, covariance), left.T) + variance * gain[:, None] * gain
    output = (
        corrected[soc],
        jnp.sqrt(covariance[soc, soc]),
        nis,
        jnp.exp(corrected[names.index("log_scale")]),
        corrected[names.index("offset_V")],
    )
    return (corrected, covariance), output


def _clipped(mean: Array, soc: int) -> Array:
    """Keep the charge within its range; a wrong start must not leave it."""
    here = jnp.arange(mean.shape[0]) == soc
    return jnp.where(here, jnp.clip(mean, *SOC_RANGE), mean)


def _product(a: Array, b: Array) -> Array:
    """Return the matrix product as sums: a library call for matrices of five rows would cost more than the numbers."""
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)
