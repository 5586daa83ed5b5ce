"""Adaptive stiff integration of the equations, restarted at every row and at every start or stop of the rotor.

Coulomb friction is ideal: the direction of the rotor's motion (or its being stuck) is constant over a stretch, the
right-hand side is smooth there, and the stretch ends at the event where the speed comes to zero or the drive
breaks the rotor away. A steep tanh would need an arbitrary width, creeps at standstill and makes the pair stiffer.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from benchmarks.independent.effects import Columns, Effects, complete, sensed, true_inputs
from benchmarks.independent.equations import GRAVITY, STATES, Tree, algebra, derivative, readings

FIRST_STEP_AFTER_JUMP_S = 1e-5  # well below the 0.7 ms of the armature
ROWS_READ_AT_ONCE = 512  # one compiled shape for readings of any length

HOLDS_ITS_CURRENT_H = 1e30  # the inductance of a motor whose current is imposed: no voltage changes it

# The paper's printed numbers, the motor's data sheet, and the design's own where the paper is silent.
DEFAULTS: dict[str, float] = {
    "capacity_Ah": 5.2,
    "cycles": 25.0,
    "storage_months": 18.0,
    "storage_temperature_degC": 20.0,
    "series_resistance_scale": 1.0,
    "rc_resistance_scale": 1.0,
    "rc_capacitance_scale": 1.0,
    "ocv_offset_V": 0.0,
    "contact_ohm": 0.0,  # of a single cell's leads, which warms no cell: ours, for runs that have one of their own
    "n_series": 6.0,
    "nominal_cell_voltage_V": 3.8,
    "R_0": 0.103,
    "psi_R": 0.0039,
    "psi_L": 0.0,
    "k_tau": 0.0385,
    "L_a": 7.2e-5,
    "J": 5.42e-5,
    "tau_0": 0.010,
    "R_wc": 1.2,
    "R_ca": 3.8,
    "tau_wc": 71.7,
    "tau_ca": 1370.0,
    "T_0": 25.0,
    "n_motors": 2.0,
    "onboard_current_A": 0.3,
    "mass_kg": 40.0,
    "friction_coefficient": 0.7,
    "wheel_radius_m": 0.1,
    "gear_ratio": 156.0,
    "drive_efficiency": 0.94,
}
TABLES = {"ocv": "voltage_V", "R_ints": "ohm", "R_TS": "ohm", "R_TL": "ohm", "C_TS": "farad", "C_TL": "farad"}


def simulate(
    kind: str,
    parameters: Mapping[str, Any],
    profile: Mapping[str, np.ndarray],
    effects: Effects | None = None,
    initial_soc: float = 1.0,
    *,
    tolerance: float = 1e-10,
) -> Columns:
    """Return the readings at every row of a profile, and some inner states.

    Args:
        kind: "cell", "motor" or "robot".
        parameters: numbers and tables under the names of the design; the rest are the paper's.
        profile: time_s and the kind's inputs as the sensors report them, each of shape (rows,). A row's inputs hold
            over the interval that ends at it. A motor is driven by voltage_V or by current_A; a robot by duty or
            V_set, and load_torque_Nm or incline_deg with acceleration_m_s2.
        effects: parameters of each effect that is on; a sensor effect has its column.
        initial_soc: state of charge at row 0.
        tolerance: relative and absolute (in the unit of each state), of every step of the integration.

    Returns:
        Each output (SI, degC, current positive on discharge), shape (rows,).

    Raises:
        ValueError: an unknown kind, parameter, or effect.
        RuntimeError: the integration did not reach the end.
    """
    effects = effects or {}
    p, e = prepare_parameters(parameters), complete(effects)
    columns = true_inputs({name: np.asarray(values, dtype=float) for name, values in profile.items()}, effects)
    imposed = columns["current_A"] if kind == "motor" and "voltage_V" not in columns else None
    if imposed is not None:
        p["L_a"] = HOLDS_ITS_CURRENT_H
    inputs = _inputs_of(kind, columns, p)
    states = _march(kind, columns["time_s"], inputs, imposed, p, e, initial_soc, tolerance)
    outputs = _read(kind, states, inputs, p, e)
    if "temperature_lag" in effects:
        outputs[effects["temperature_lag"]["column"]] = outputs["t_lagged"]
    known = {"lag_target", "t_lagged", *columns}
    return sensed(columns["time_s"], {name: read for name, read in outputs.items() if name not in known}, effects)


def prepare_parameters(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the paper's parameters with those given in their place, tables as arrays."""
    p: dict[str, Any] = dict(DEFAULTS)
    for name, value in parameters.items():
        if name in TABLES:
            p[name] = {key: np.asarray(value[key], float) for key in ("soc", "temperature_degC") if key in value}
            p[name]["values"] = np.asarray(value[TABLES[name]], float)
        elif name in DEFAULTS:
            p[name] = float(value)
        else:
            raise ValueError(f"no parameter is called {name!r}")
    return p


def _inputs_of(kind: str, columns: Columns, p: Mapping[str, Any]) -> np.ndarray:
    """Return what drives the equations: current, voltage or duty, load torque and ambient, shape (rows, 3)."""
    load = np.zeros_like(columns["time_s"])
    if kind == "cell":
        drive = columns["current_A"]
    elif kind == "motor":
        drive = columns["voltage_V" if "voltage_V" in columns else "current_A"]
        load = columns["load_torque_Nm"]
    elif kind == "robot":
        drive = columns["duty"] if "duty" in columns else (columns["V_set"] - 2.5) / 2.5  # (22)
        load = columns["load_torque_Nm"] if "load_torque_Nm" in columns else _track_torque(columns, p)
    else:
        raise ValueError(f"no kind is called {kind!r}")
    return np.stack([drive, load, columns["ambient_degC"]], axis=1)


def _track_torque(columns: Columns, p: Mapping[str, Any]) -> np.ndarray:
    """Return the load torque of a track motor on a slope (18), in Nm."""
    slope = np.deg2rad(columns["incline_deg"])
    weight = p["mass_kg"] * GRAVITY
    force = weight * (p["friction_coefficient"] * np.cos(slope) + np.sin(slope))
    force = force + p["mass_kg"] * columns.get("acceleration_m_s2", np.zeros_like(slope))
    return force * p["wheel_radius_m"] / (p["gear_ratio"] * p["drive_efficiency"])


def _march(
    kind: str,
    time_s: np.ndarray,
    inputs: np.ndarray,
    imposed_current: np.ndarray | None,
    p: Tree,
    e: Tree,
    initial_soc: float,
    tolerance: float,
) -> np.ndarray:
    """Return the state at every row, shape (rows, states)."""
    states = np.zeros((len(time_s), len(STATES)))
    for row in range(len(time_s)):
        y = states[row]
        if row == 0:
            y[[STATES.index("soc"), STATES.index("soc_weak")]] = initial_soc
            y[STATES.index("t_cell")] = inputs[0, 2]
            y[STATES.index("t_lagged")] = _read(kind, states[:1], inputs[:1], p, e)["lag_target"][0]
        else:
            y[:] = states[row - 1]
        if imposed_current is not None:
            y[STATES.index("i_a")] = imposed_current[row]
        if row > 0:
            jumped = row == 1 or bool(np.any(inputs[row] != inputs[row - 1]))
            y[:] = _hold(kind, y, inputs[row], time_s[row] - time_s[row - 1], jumped, p, e, tolerance)
    return states


def _hold(
    kind: str, y: np.ndarray, inputs: np.ndarray, interval: float, jumped: bool, p: Tree, e: Tree, tolerance: float
) -> np.ndarray:
    """Return the state after `interval` seconds of constant inputs, stretch by stretch between friction events."""
    speed, elapsed, slide, released = STATES.index("speed"), 0.0, 0.0, False
    for _ in range(200):
        remaining = interval - elapsed
        if remaining <= 1e-14 * interval:
            return y
        if kind != "cell":
            slide = float(np.sign(y[speed])) or float(_breaks_away(kind, y, inputs, released, p, e))
        first_step = min(FIRST_STEP_AFTER_JUMP_S, remaining) if jumped else remaining
        after, reached, hit, failed = _solve(kind, y, inputs, slide, remaining, first_step, True, p, e, tolerance)
        if hit:
            # The event's state comes from a cubic interpolant; going there again by full steps is exact.
            after, reached, _, failed = _solve(kind, y, inputs, slide, reached, first_step, False, p, e, tolerance)
        if failed:
            raise RuntimeError(f"the {kind} could not be integrated beyond {elapsed:g} s of an interval")
        y = np.array(after)
        if hit:
            y[speed] = 0.0
        released = bool(hit) and slide == 0.0
        elapsed, jumped = elapsed + float(reached), True
    raise RuntimeError(f"the {kind} starts and stops more than 200 times within {interval:g} s")


@partial(jax.jit, static_argnames="kind")
def _breaks_away(kind: str, y: jax.Array, inputs: jax.Array, released: bool, p: Tree, e: Tree) -> jax.Array:
    """Return the direction in which a rotor at standstill is driven beyond its breakaway torque, or 0.

    A rotor just `released` by an event is at the breakaway torque up to rounding: it goes.
    """
    motor = algebra(kind, jnp.asarray(y), jnp.asarray(inputs), jnp.zeros(()), p, e)["motor"]
    return jnp.where(released | (jnp.abs(motor["drive"]) > motor["breakaway"]), jnp.sign(motor["drive"]), 0.0)


@partial(jax.jit, static_argnames="kind")
def _solve(
    kind: str,
    y: jax.Array,
    inputs: jax.Array,
    slide: float,
    duration: float,
    first_step: float,
    watch: bool,
    p: Tree,
    e: Tree,
    tolerance: float,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Return the state, the time reached, whether a friction event ended the stretch, and whether it failed."""

    def slope(t: Any, y: jax.Array, args: tuple) -> jax.Array:
        return derivative(kind, y, *args)

    def margin(t: Any, y: jax.Array, args: tuple, **_: object) -> jax.Array:
        """Positive while the rotor keeps sliding the same way, or stays stuck.

        The offsets let a reversal or a release within the very first step, which starts at zero margin, be seen.
        """
        motor = algebra(kind, y, *args)["motor"]
        stuck = motor["breakaway"] - jnp.abs(motor["drive"]) + 1e-14
        return jnp.where(watch, jnp.where(args[1] == 0.0, stuck, args[1] * y[STATES.index("speed")] + 1e-12), 1.0)

    # The stages are solved to a hundredth of the chord method's tolerance. Tighter than this, rounding alone makes it
    # give up, and half of the steps fail.
    chord = diffrax.VeryChord(rtol=10.0 * tolerance, atol=10.0 * tolerance, norm=optx.max_norm)
    event = None
    if kind != "cell":
        event = diffrax.Event(margin, optx.Bisection(rtol=1e-13, atol=1e-13), direction=False)
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(slope),
        diffrax.Kvaerno5(root_finder=chord),
        t0=0.0,
        t1=duration,
        dt0=first_step,
        y0=jnp.asarray(y),
        args=(jnp.asarray(inputs), jnp.asarray(slide), p, e),
        saveat=diffrax.SaveAt(t1=True),
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance, pcoeff=0.4, icoeff=0.3),
        event=event,
        adjoint=diffrax.ForwardMode(),
        max_steps=20_000,
        throw=False,
    )
    assert solution.ys is not None
    assert solution.ts is not None
    hit = solution.result == diffrax.RESULTS.event_occurred
    failed = (solution.result != diffrax.RESULTS.successful) & ~hit
    return solution.ys[-1], solution.ts[-1], hit, failed


def _read(kind: str, states: np.ndarray, inputs: np.ndarray, p: Tree, e: Tree) -> Columns:
    """Return the readings of many rows, in blocks of one compiled shape."""
    rows = len(states)
    fill = (-rows) % ROWS_READ_AT_ONCE
    states, inputs = (np.concatenate([x, np.repeat(x[-1:], fill, axis=0)]) for x in (states, inputs))
    blocks = [
        _read_block(kind, states[at : at + ROWS_READ_AT_ONCE], inputs[at : at + ROWS_READ_AT_ONCE], p, e)
        for at in range(0, rows, ROWS_READ_AT_ONCE)
    ]
    return {name: np.concatenate([np.asarray(block[name]) for block in blocks])[:rows] for name in blocks[0]}


@partial(jax.jit, static_argnames="kind")
def _read_block(kind: str, states: jax.Array, inputs: jax.Array, p: Tree, e: Tree) -> dict[str, jax.Array]:
    return jax.vmap(lambda y, u: readings(kind, y, u, p, e))(jnp.asarray(states), jnp.asarray(inputs))
