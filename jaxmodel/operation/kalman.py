"""State of charge from current, voltage and temperature: an extended Kalman filter on the model's own step.

The state is that of the model (charge, RC voltages, states of effects) and six numbers that no table holds: the scale
of all that the load takes from the voltage; errors of the voltage that last a run, a part of the charge, and seconds to
minutes; the scale of the capacity; and an offset of the current sensor. Process and reading are
`jaxmodel.model.electrothermal.step` and `read`, their Jacobians `jax.jacfwd` of these. One filter is a scan; batches
are `vmap` outside.
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

# Beside the model's states: logarithm of the scale of all resistances, offset of V_oc that varies and one that does
# not, in V, logarithm of the scale of the capacity, offset of the current sensor as a share of the capacity in an hour
# (1/h), and passing error in V.
VARYING = ("log_scale", "offset_V", "bias_V", "log_capacity", "drift_per_h", "error_V")
HYSTERESIS = "ocv_hysteresis.h"
# Of a loop of which nobody knows where the cell stands: even between its branches, -1 and 1.
HYSTERESIS_SD = 3.0**-0.5
SOC_RANGE = (0.0, 1.0)  # outside it the curves are held constant, and readings say nothing of the charge
FIRST_ROUNDS, FIRST_CHARGES = 6, 101  # of the iteration of the first reading, and where it may begin
PAIRS = ("v_ts_V", "v_tl_V")
SECANT = 0.1  # of the state of charge; assumed, a few knots of a table
SHORTEST_S = 1e-9  # of a correlation: none, and no division by zero

# Charge below the least that is known of the model over which what the load takes becomes wholly unknown; assumed.
BEYOND = 0.05

# Current, temperature, voltage and least known charge of a row.
Row = tuple[Array, Array, Array, Array]


def _as_array(value: Any) -> Array:
    return jnp.asarray(value, dtype=float)


class Tuning(InShort, eqx.Module):
    """The standard deviations and time constants that the filter assumes; any leaf may carry lanes.

    Attributes:
        start_sd: of the state of charge at the start.
        charge_sd: of the state of charge counted over an hour, by errors of current sensor and capacity.
        voltage_sd_V: of a reading, model error that changes from reading to reading included.
        drop_share: of a passing error of the model, as a share of what the load takes from the open-circuit voltage.
        scale_sd: of the logarithm of the scale of all resistances, a first-order Gauss-Markov process.
        scale_s: correlation time of that process.
        offset_sd_V: of the offset of the open-circuit voltage, a process of the same kind.
        offset_s: correlation time of that process.
        shift_sd: of a shift of the open-circuit voltage along the charge, in state of charge; its slope makes it a
            part of the sd of that process, large where the voltage is steep: near empty.
        lasting_share: of an error of the model that lasts as long as that process, as diffusion that no RC pair holds:
            a share of what the load takes, so that it is large in the cold.
        capacity_sd: of the logarithm of the scale of the capacity, constant in a run. By default 0.1: a cell at the
            usual end of its life, 80 % of its capacity, is two of these away (assumed).
        current_sd: of a constant offset of the current sensor, as a share of the capacity in an hour (1/h). By default
            0.003, some mA of a cell of 3 A h (assumed).
        bias_sd_V: of a further offset of the open-circuit voltage, constant in a run.
        error_s: correlation time of the passing error, a first-order Gauss-Markov process; 0, the default, makes it
            white.

    Example:
        >>> from jaxmodel import operation
        >>> operation.Tuning(scale_sd=0.1)
        <Tuning: scale_sd=0.1>
    """

    start_sd: Scalar = eqx.field(default=0.3, converter=_as_array)
    charge_sd: Scalar = eqx.field(default=0.01, converter=_as_array)
    voltage_sd_V: Scalar = eqx.field(default=0.01, converter=_as_array)
    drop_share: Scalar = eqx.field(default=0.1, converter=_as_array)
    scale_sd: Scalar = eqx.field(default=0.3, converter=_as_array)
    scale_s: Scalar = eqx.field(default=1000.0, converter=_as_array)
    offset_sd_V: Scalar = eqx.field(default=0.02, converter=_as_array)
    offset_s: Scalar = eqx.field(default=1000.0, converter=_as_array)
    capacity_sd: Scalar = eqx.field(default=0.1, converter=_as_array)
    current_sd: Scalar = eqx.field(default=0.003, converter=_as_array)
    bias_sd_V: Scalar = eqx.field(default=0.0, converter=_as_array)
    error_s: Scalar = eqx.field(default=0.0, converter=_as_array)
    shift_sd: Scalar = eqx.field(default=0.0, converter=_as_array)
    lasting_share: Scalar = eqx.field(default=0.0, converter=_as_array)


class Measured(InShort, eqx.Module):
    """A run as the robot's computer sees it, each of shape (rows,).

    Attributes:
        time_s: increasing.
        current_A: held since the row before, positive on discharge.
        degC: temperature for the model: the cell's, or a fixed one where it is not measured.
        voltage_V: of the cell; NaN where there is no reading.
        least_soc: the least state of charge at which the model is known at this temperature; None if it is known
            everywhere. Below it, what the load takes is known to no more than its size.

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
    least_soc: Float[Array, " rows"] | None = None


class FilterOutput(InShort, eqx.Module):
    """The estimates of a filter at each row, shape (..., rows).

    Attributes:
        soc: state of charge.
        sd: its standard deviation by the filter's covariance.
        nis: normalised innovation squared; 1 on average where the filter is consistent. NaN without a reading.
        scale: of all resistances.
        offset_V: of the open-circuit voltage, what is constant in it included.
        innovation: reading less prediction, by the sd that the filter expects of it; its square is `nis`.
        capacity_scale: of the capacity.
        capacity_sd: sd of the logarithm of that scale.
        current_offset_A: what the current sensor reads too much.
    """

    soc: Array
    sd: Array
    nis: Array
    scale: Array
    offset_V: Array
    innovation: Array
    capacity_scale: Array
    capacity_sd: Array
    current_offset_A: Array


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
    begin, first_output, rows = first_corrected(model, tuning, measured, start_soc, pairs_sd_V)

    def advance(carry: tuple[Array, Array], row: tuple[Array, Row]) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
        return corrected_step(model, tuning, *carry, *row)

    outputs = jax.lax.scan(advance, begin, rows)[1]
    return FilterOutput(*(jnp.concatenate([one[None], rest]) for one, rest in zip(first_output, outputs, strict=True)))


def corrected_step(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, duration: Array, row: Row
) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
    """Return mean and covariance after a step and its reading, and the output there."""
    mean, covariance = predicted(model, tuning, mean, covariance, duration, row)
    return corrected_at(model, tuning, mean, covariance, row, mean)


def first_corrected(
    model: Model, tuning: Tuning, measured: Measured, start_soc: Scalar, pairs_sd_V: Scalar
) -> tuple[tuple[Array, Array], tuple[Array, ...], tuple[Array, Row]]:
    """Return mean and covariance after the first reading, the output there, and durations and columns of later rows."""
    duration = jnp.diff(measured.time_s)
    least = jnp.zeros_like(measured.degC) if measured.least_soc is None else measured.least_soc
    readings = (measured.current_A, measured.degC, measured.voltage_V, least)
    first, later = (jax.tree.map(lambda x, part=part: x[part], readings) for part in (0, slice(1, None)))
    before = before_first_reading(model, tuning, first, jnp.asarray(start_soc, dtype=float), pairs_sd_V)

    # A wrong start is far from where the curves should be linearised: the first reading is, where it is most probable,
    # and then where each round before ended (iterated extended Kalman filter).
    def closer(_: Any, at: Array) -> Array:
        return _linearised(model, tuning, *before, first, at)[-1]

    at = jax.lax.fori_loop(0, FIRST_ROUNDS - 1, closer, _most_probable(model, tuning, *before, first))
    begin, output = corrected_at(model, tuning, *before, first, at)
    return begin, output, (duration, later)


def before_first_reading(
    model: Model, tuning: Tuning, first: Row, start_soc: Scalar, pairs_sd_V: Scalar
) -> tuple[Array, Array]:
    """Return mean and covariance before the first reading."""
    names = state_names(model)
    state = initial_state(model, _inputs(first)) | {"soc": start_soc} | dict.fromkeys(VARYING, jnp.zeros(()))
    known = dict.fromkeys(PAIRS, pairs_sd_V)
    known |= {"soc": tuning.start_sd, "log_scale": tuning.scale_sd}
    known |= {"log_capacity": tuning.capacity_sd, "drift_per_h": tuning.current_sd, HYSTERESIS: HYSTERESIS_SD}
    known["bias_V"] = tuning.bias_sd_V
    mean = jnp.stack([jnp.asarray(state[name], dtype=float) for name in names])
    known["error_V"], known["offset_V"] = _voltage_sds(model, tuning, mean, first)
    variances = jnp.stack([jnp.asarray(known.get(name, 0.0), dtype=float) ** 2 for name in names])
    return mean, variances[:, None] * jnp.eye(len(names))


def _inputs(row: Row) -> dict[str, Array]:
    return {"current_A": row[0], "ambient_degC": row[1]}


def _named(model: Model, x: Array) -> tuple[Model, dict[str, Array], dict[str, Array]]:
    """Return the model with the varying numbers of a state vector in it, its own states, and the varying numbers.

    RC pairs keep their time constants. The scale of what the current takes at once, and what concerns the count of
    charge alone, are not in the model.
    """
    values = dict(zip(state_names(model), x, strict=True))
    varying = {name: values.pop(name) for name in VARYING}
    factor, p = jnp.exp(varying["log_scale"]), model.parameters
    own = {
        "rc_resistance_scale": p.rc_resistance_scale * factor,
        "rc_capacitance_scale": p.rc_capacitance_scale / factor,
        "ocv_offset_V": p.ocv_offset_V + varying["offset_V"] + varying["bias_V"] + varying["error_V"],
    }
    return with_values(model, own), values, varying


def _kept(tuning: Tuning, duration: Array) -> dict[str, Array]:
    """Return the share of each Gauss-Markov process that is left after a step."""
    seconds = {"log_scale": tuning.scale_s, "offset_V": tuning.offset_s, "error_V": tuning.error_s}
    return {name: jnp.exp(-duration / jnp.maximum(of, SHORTEST_S)) for name, of in seconds.items()}


def moved(model: Model, tuning: Tuning, x: Array, duration: Array, row: Row) -> Array:
    """Return a state vector after a step: that of the model, and what varies nearer to its mean.

    The charge moves by (dSOC + c dt)/q: dSOC is the model's, c the offset of the current, q the scale of the capacity.
    """
    keep = _kept(tuning, duration)
    own, state, varying = _named(model, x)
    here = _losing(state)
    end = step(own, here, _inputs(row), duration)
    counted = end["soc"] - here["soc"] + varying["drift_per_h"] * duration / 3600.0
    end["soc"] = state["soc"] + counted * jnp.exp(-varying["log_capacity"])
    before = state | varying
    return jnp.stack([end[n] if n in end else before[n] * keep.get(n, 1.0) for n in state_names(model)])


def added_variance(model: Model, tuning: Tuning, x: Array, duration: Array, row: Row) -> Array:
    """Return the variance that a step to a state vector adds to each state: that of counting, and of what varies."""
    keep = _kept(tuning, duration)
    sd = {"log_scale": tuning.scale_sd}
    sd["error_V"], sd["offset_V"] = _voltage_sds(model, tuning, x, row)
    noise = {name: sd[name] ** 2 * (1.0 - keep[name] ** 2) for name in sd}
    noise["soc"] = tuning.charge_sd**2 * duration / 3600.0
    return jnp.stack([jnp.asarray(noise.get(name, 0.0), dtype=float) for name in state_names(model)])


def expected_voltage(model: Model, x: Array, row: Row) -> Array:
    """Return the voltage of a state vector: V = V(0) - s (V(0) - V(i)), s the scale of what the current takes at once.

    So s scales the overpotentials of effects as it does resistances. The derivative by the charge is the secant of the
    open-circuit voltage over a width of twice `SECANT`: between knots a table is rough, and a filter that trusts each
    slope tells an offset of the voltage from an error of the charge by the roughness.
    """
    own, state, varying = _named(model, x)
    inputs = _inputs(row)
    resting = inputs | {"current_A": jnp.zeros(())}
    here = _losing(state)
    unloaded = read(own, here, resting)["voltage_V"]
    lost = unloaded - read(own, here, inputs)["voltage_V"]
    slope = jax.lax.stop_gradient(_secant(own, here, resting))
    return unloaded + slope * (state["soc"] - here["soc"]) - jnp.exp(varying["log_scale"]) * lost


def _secant(own: Model, state: dict[str, Array], resting: dict[str, Array]) -> Array:
    """Return the slope of the open-circuit voltage, in V: of a secant, 0 beyond the range."""
    low, high = (jnp.clip(state["soc"] + by, *SOC_RANGE) for by in (-SECANT, SECANT))
    across = [read(own, state | {"soc": at}, resting)["voltage_V"] for at in (low, high)]
    return (across[1] - across[0]) / jnp.maximum(high - low, SECANT)


def _losing(state: dict[str, Array]) -> dict[str, Array]:
    """Return the states for what the load takes, which is linearised as if it did not depend on the charge.

    Resistances change with the charge by a few percent, as much as their tables err: a filter that reads the charge
    off them is wrong, and sure of it. Only the open-circuit voltage tells the charge.
    """
    return state | {"soc": jax.lax.stop_gradient(state["soc"])}


def _voltage_sds(model: Model, tuning: Tuning, x: Array, row: Row) -> tuple[Array, Array]:
    """Return the sd of the passing error and of the offset of the open-circuit voltage, in V.

    s_e = d D and s_o^2 = o^2 + (b dV_oc/dSOC)^2 + (l^2 + u^2) D^2, D what the load takes from the open-circuit voltage,
    u from 0 to 1 below the least charge at which the model is known.
    """
    own, state, _ = _named(model, x)
    resting = _inputs(row) | {"current_A": jnp.zeros(())}
    relaxed = state | {name: jnp.zeros(()) for name in PAIRS}
    drop = read(own, relaxed, resting)["voltage_V"] - expected_voltage(model, x, row)
    unknown = jnp.clip((row[3] - state["soc"]) / BEYOND, 0.0, 1.0)
    parts = (tuning.offset_sd_V, tuning.shift_sd * _secant(own, state, resting), tuning.lasting_share * drop)
    parts = (*parts, unknown * drop)
    return tuning.drop_share * drop, jnp.sqrt(sum(part**2 for part in parts))


def predicted(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, duration: Array, row: Row
) -> tuple[Array, Array]:
    """Move mean and covariance over a step by the model's own, linearised at the mean."""

    def move(x: Array) -> Array:
        return moved(model, tuning, x, duration, row)

    slope, end = jax.jacfwd(move)(mean), move(mean)
    added = added_variance(model, tuning, end, duration, row)
    covariance = _product(_product(slope, covariance), slope.T) + added[:, None] * jnp.eye(mean.shape[0])
    return end, covariance


def corrected_at(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, row: Row, at: Array
) -> tuple[tuple[Array, Array], tuple[Array, ...]]:
    """Correct by a voltage that is linearised at given states, and return mean and covariance, and the output.

    The covariance is in Joseph's form, which keeps it positive. Without a voltage nothing is corrected.
    """
    along, innovation, spread, gain, corrected = _linearised(model, tuning, mean, covariance, row, at)
    normalised = jnp.where(jnp.isfinite(row[2]), innovation / jnp.sqrt(spread), jnp.nan)
    left = jnp.eye(mean.shape[0]) - gain[:, None] * along
    covariance = _product(_product(left, covariance), left.T) + tuning.voltage_sd_V**2 * gain[:, None] * gain
    return (corrected, covariance), output_of(model, corrected, covariance, normalised)


def _linearised(
    model: Model, tuning: Tuning, mean: Array, covariance: Array, row: Row, at: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return slope, innovation, its variance, gain and corrected mean with the reading linearised at given states."""
    voltage, soc = row[2], state_names(model).index("soc")
    seen = jnp.isfinite(voltage)

    def reading(x: Array) -> Array:
        return expected_voltage(model, x, row)

    along = jax.jacfwd(reading)(at)
    innovation = jnp.where(seen, voltage - reading(at) - jnp.sum(along * (mean - at)), 0.0)
    across = jnp.sum(covariance * along, axis=1)
    spread = jnp.sum(across * along) + tuning.voltage_sd_V**2
    gain = jnp.where(seen, across / spread, 0.0)
    along_soc = covariance[:, soc] - gain * across[soc]
    return along, innovation, spread, gain, within_range(mean + gain * innovation, along_soc, soc)


def _most_probable(model: Model, tuning: Tuning, mean: Array, covariance: Array, row: Row) -> Array:
    """Return the mean before the first reading with the most probable state of charge after it, of all of its range.

    Along the charge the reading may bend and turn, where a local search would end at the wrong place.
    """
    soc = state_names(model).index("soc")
    charges = jnp.append(jnp.linspace(*SOC_RANGE, FIRST_CHARGES), mean[soc])
    found = jax.vmap(lambda charge: improbability(model, tuning, mean, covariance, row, charge))(charges)
    best = charges[jnp.argmin(found)]
    return jnp.where((jnp.arange(mean.shape[0]) == soc) & jnp.isfinite(row[2]), best, mean)


def improbability(model: Model, tuning: Tuning, mean: Array, covariance: Array, row: Row, charge: Array) -> Array:
    """Return -2 log of the posterior density of a state of charge at the first reading, without a constant.

    The other states are linearised at their means at that charge.
    """
    soc = state_names(model).index("soc")
    here = jnp.arange(mean.shape[0]) == soc
    rest = jnp.where(here[:, None] | here[None, :], 0.0, covariance)
    x = jnp.where(here, charge, mean)
    along = jax.jacfwd(lambda at: expected_voltage(model, at, row))(x)
    spread = jnp.sum(jnp.sum(rest * along, axis=1) * along) + tuning.voltage_sd_V**2
    off = (row[2] - expected_voltage(model, x, row)) ** 2 / spread + jnp.log(spread)
    return off + (charge - mean[soc]) ** 2 / covariance[soc, soc]


def output_of(model: Model, mean: Array, covariance: Array, normalised: Array) -> tuple[Array, ...]:
    """Return the fields of `FilterOutput` at a row."""
    at = {name: place for place, name in enumerate(state_names(model))}
    return (
        mean[at["soc"]],
        jnp.sqrt(covariance[at["soc"], at["soc"]]),
        normalised**2,
        jnp.exp(mean[at["log_scale"]]),
        mean[at["offset_V"]] + mean[at["bias_V"]],
        normalised,
        jnp.exp(mean[at["log_capacity"]]),
        jnp.sqrt(covariance[at["log_capacity"], at["log_capacity"]]),
        mean[at["drift_per_h"]] * model.parameters.capacity_Ah,
    )


def within_range(mean: Array, covariance: Array, soc: int) -> Array:
    """Return the mean with its charge within the range, and the other states where they then are most probable.

    x - P_s (s - s_b)/P_ss, s_b the nearest charge of the range: the projection by the covariance of Simon and Chia
    (IEEE Trans. Aerospace and Electronic Systems 38 (2002) 128). To move the charge alone would leave the others
    corrected for a charge that cannot be.

    Args:
        mean: the states, shape (n,).
        covariance: that of each state with the charge, shape (n,).
        soc: place of the charge.
    """
    off = mean[soc] - jnp.clip(mean[soc], *SOC_RANGE)
    share = covariance / jnp.where(covariance[soc] > 0.0, covariance[soc], 1.0)
    share = jnp.where(jnp.arange(mean.shape[0]) == soc, 1.0, share)
    return mean - share * off


def _product(a: Array, b: Array) -> Array:
    """Return the matrix product as sums: a library call for matrices of five rows would cost more than the numbers."""
    return jnp.sum(a[:, :, None] * b[None, :, :], axis=1)
