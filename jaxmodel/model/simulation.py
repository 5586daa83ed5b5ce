"""Simulation of a model over a profile: the scan, the readings, and a status."""

from __future__ import annotations

import enum
import math
from collections.abc import Collection
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.base.errors import listed
from jaxmodel.base.in_short import InShort
from jaxmodel.lanes.xla_kernel import holds_constants
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.electrothermal import Model, Readings, initial_state, read, step, valid
from jaxmodel.model.flow import State
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import touches
from jaxmodel.model.possible import possible
from jaxmodel.model.profile import (
    BENDING_STEP_SHARE,
    GROWTH,
    GROWTH_SATURATING,
    LOOP_SHARE,
    SLOW_ROTOR_S,
    WARMING_S,
    WARMING_STEP_SHARE,
    Grid,
    Profile,
    Track,
    make_grid,
)
from jaxmodel.model.scan import observed_after, states_after
from jaxmodel.model.sensors import distort, has_dynamic_sensors


class Status(enum.IntEnum):
    """How a run, or one lane of a batch, ended.

    A run is `IMPOSSIBLE` that went where nothing can be (`jaxmodel.model.possible`): a winding above the melting point
    of copper, say. Its numbers are kept, because they show how far it went.

    Example:
        >>> from jaxmodel import Model, Status, constant, simulate
        >>> run = simulate(Model("cell"), constant(600.0, 60.0, current_A=2.0, ambient_degC=20.0))
        >>> Status(int(run.status)).name
        'COMPLETE'
    """

    COMPLETE = 0
    REACHED_CUTOFF = 1
    NOT_FINITE = 2
    IMPOSSIBLE = 3


def _as_array(value) -> Array:
    """Convert a limit to an array, so that another limit needs no compilation."""
    return jnp.asarray(value, dtype=float)


class Cutoff(InShort, eqx.Module):
    """Where a run ends: at the first row below a state of charge or a cell's voltage in V; -inf never ends it.

    Example:
        >>> from jaxmodel import Cutoff
        >>> Cutoff(voltage_V=2.7)
        <Cutoff: voltage_V=2.7>
    """

    soc: Scalar = eqx.field(default=-np.inf, converter=_as_array)
    voltage_V: Scalar = eqx.field(default=-np.inf, converter=_as_array)


class Needed(eqx.Module):
    """What the lanes of a batch need at most; everything else is skipped.

    Attributes:
        steps: number of steps; later ones are not computed. Such a run has forward-mode derivatives only. None for all.
        dynamic_sensors: of each sensor effect with internal state or delay, in order, whether any lane has it.
    """

    steps: Array | None
    dynamic_sensors: Array


class Trajectory(InShort, eqx.Module):
    """The result of a run, over the rows of its profile (axis 0; lanes, if any, before it).

    Attributes:
        time_s: time of each row.
        readings: sensor readings by column name.
        states: all states of the model.
        valid: False where the equations are outside their valid range.
        status: a `Status`.
        end_row: the row at which the cut-off was reached, after which the state is held; else the last.

    Example:
        >>> from jaxmodel import Model, constant, simulate
        >>> run = simulate(Model("cell"), constant(600.0, 60.0, current_A=2.0, ambient_degC=20.0))
        >>> run.readings["soc"].shape, round(float(run.readings["soc"][-1]), 4)
        ((11,), 0.9229)
    """

    time_s: Array
    readings: dict[str, Array]
    states: State
    valid: Array
    status: Array
    end_row: Array

    def _in_short(self) -> str:
        shape = " x ".join(map(str, np.shape(self.time_s)))
        return f"{shape} rows of {listed(self.readings, 6)}"


def track(model: Model, profile: Profile, steps: int | None = None) -> Track:
    """Return the steps of a profile for a model, padded to a number of steps if one is given.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import Model, constant, run_track, track
        >>> profile = constant(600.0, 60.0, current_A=2.0, ambient_degC=20.0)
        >>> laid = track(Model("cell"), profile)
        >>> round(float(run_track(Model("cell"), laid, jnp.asarray(profile.time_s)).readings["soc"][-1]), 4)
        0.9229
    """
    grid = grid_of(model, profile)
    if steps is not None:
        grid = grid.padded(steps)
    rows = np.concatenate([[0], grid.row])
    inputs = {name: values[rows] for name, values in profile.inputs.items()}
    # In one transfer: separately, each shape would compile its own program.
    return Track(*jax.device_put((grid.duration_s, inputs, grid.last_step)))


def grid_of(model: Model, profile: Profile, jumped_s: float | None = None) -> Grid:
    """Return the steps of a profile for a model; `jumped_s` as of `jaxmodel.model.profile.make_grid`."""
    pace = pace_of(model, profile.inputs)
    longest_s = float(np.min(pace.longest_s))
    if pace.electrical_s is None:
        grid = make_grid(profile, None)
    else:
        shortest, longest = float(np.min(pace.rotor_s)), float(np.max(pace.rotor_s))
        settling, share = ((shortest, longest) if pace.bends else None), BENDING_STEP_SHARE
        if longest > SLOW_ROTOR_S:
            shortest = min(shortest if pace.bends else max(shortest, SLOW_ROTOR_S), WARMING_S)
            settling, share = (shortest, longest), WARMING_STEP_SHARE
        grid = make_grid(profile, float(np.min(pace.electrical_s)), settling, share, pace.growth, jumped_s)
    return grid.cut(longest_s) if math.isfinite(longest_s) else grid


class Pace(NamedTuple):
    """What the steps of a model follow, in s; each number of one lane, or of many.

    Attributes:
        longest_s: the longest step that a closed loop and effects allow; inf without either.
        electrical_s: L_a / R_0 of a motor whose rotor settles after a jump of the inputs, else None.
        rotor_s: R_0 J / k_tau^2 of such a motor, else None.
        growth: ratio of each step after a jump to the one before.
        bends: whether the armature has a kink at zero current.
    """

    longest_s: Any
    electrical_s: Any = None
    rotor_s: Any = None
    growth: float = GROWTH
    bends: bool = False


def pace_of(model: Model, inputs: Collection[str]) -> Pace:
    """Return what the steps of a model follow that is driven by inputs of these names; pure in the model's numbers."""
    p, longest_s = model.parameters, math.inf
    for effect in model.effects:
        if hasattr(effect, "longest_step_s"):
            own = effect.longest_step_s(p)
            longest_s = jnp.minimum(longest_s, own if effect.switch is None else jnp.where(effect.switch, own, np.inf))
    if model.kind == "cell" or "speed_rad_s" in inputs:  # no rotor settles
        return Pace(longest_s)
    for effect in model.effects:
        if hasattr(effect, "command"):
            return Pace(jnp.minimum(longest_s, _of_loop(p, effect)))
    bends = touches(model.effects, "armature_voltage_drop")
    growth = GROWTH_SATURATING if touches(model.effects, "motor_torque") else GROWTH
    return Pace(longest_s, p.L_a / p.R_0, p.R_0 * p.J / p.k_tau**2, growth, bends)


def _of_loop(p: Parameters, controller: Any) -> Array:
    """Return the longest step of a motor under a controller, in s: a share of the time constant of its loop.

    The loop settles with k_tau k_d / J and oscillates with sqrt(k_tau k_p / J), where the controller sets the current;
    where it sets the voltage, k_tau / R_0 stands in the place of k_tau.
    """
    per_unit = p.k_tau / p.J / (p.R_0 if controller.column == "voltage_V" else 1.0)
    fastest = per_unit * controller.k_p
    if hasattr(controller, "k_d"):
        fastest = jnp.maximum(jnp.sqrt(fastest), per_unit * controller.k_d)
    return LOOP_SHARE / jnp.maximum(fastest, 1e-9)


def simulate(model: Model, profile: Profile, cutoff: Cutoff | None = None) -> Trajectory:
    """Run a model over a profile.

    Args:
        model: any kind; its leaves are scalars. To run lanes, `jax.vmap` a function that calls `run_track`.
        profile: inputs over time, names as in case files.
        cutoff: where the run ends, if before the end of the profile.

    Returns:
        The trajectory at the rows of the profile, with a status; a failure in the run raises no error.

    Example:
        >>> from jaxmodel import Model, constant, simulate
        >>> run = simulate(Model("cell"), constant(60.0, 1.0, current_A=2.0, ambient_degC=20.0))
        >>> f"{float(run.readings['soc'][-1]):.3f}"
        '0.992'
    """
    return run_track(model, track(model, profile), jnp.asarray(profile.time_s), cutoff)


def read_track(model: Model, track: Track, time_s: Array, needed: Needed) -> dict[str, Array]:
    """Return only the readings at the rows of a run; pure, and faster than `run_track`.

    Readings are computed in the scan, not from stored states. Arguments as `run_track`.
    """
    one_kernel = not holds_constants((model, track, needed))
    readings, states = _read_true(model, track, needed.steps, one_kernel, has_dynamic_sensors(model))
    return distort(model, readings, states, track, needed.dynamic_sensors)


@eqx.filter_jit
def _read_true(
    model: Model, track: Track, steps: Array | None, one_kernel: bool, with_states: bool
) -> tuple[dict[str, Array], State]:
    """Return ideal readings at the rows, and the states at the start and after every step if requested."""
    start = _start(model, track)
    later_inputs = {name: values[1:] for name, values in track.inputs.items()}

    def advance_one(state, given):
        return step(model, state, *given)

    def observe(state, given):
        return read(model, state, given[0]), (state if with_states else {})

    given = (later_inputs, track.duration_s)
    readings, states = observed_after(advance_one, observe, start, given, steps, one_kernel)
    at_start = read(model, start, {name: values[0] for name, values in track.inputs.items()})

    def with_start(first, later):
        return jnp.concatenate([first[None], later])

    at_rows = {name: with_start(at_start[name], values)[track.at_rows] for name, values in readings.items()}
    return at_rows, (jax.tree.map(with_start, start, states) if with_states else {})


def run_track(
    model: Model, track: Track, time_s: Array, cutoff: Cutoff | None = None, needed: Needed | None = None
) -> Trajectory:
    """Run a model over given steps; pure, so that it may be vmapped and differentiated.

    The run and its sensors are two programs, so that a sensor without fault does not change the run at all.

    Args:
        model: of any kind; its leaves are scalars.
        track: its steps; their number is a multiple of `jaxmodel.model.scan.ROUND` if not all are needed.
        time_s: (rows,) times of the readings.
        cutoff: where the run ends, if before its last row.
        needed: by all lanes of a batch, itself without lanes; None for everything.

    Example:
        >>> import jax
        >>> import jax.numpy as jnp
        >>> from jaxmodel import Model, constant, run_track, track, with_values
        >>> profile = constant(600.0, 60.0, current_A=2.0, ambient_degC=20.0)
        >>> laid, time_s = track(Model("cell"), profile), jnp.asarray(profile.time_s)
        >>> def final_soc(capacity_Ah):
        ...     model = with_values(Model("cell"), {"capacity_Ah": capacity_Ah})
        ...     return run_track(model, laid, time_s).readings["soc"][-1]
        >>> round(float(jax.grad(final_soc)(5.0)), 4)
        0.016
    """
    one_kernel = not holds_constants((model, track, cutoff, needed))
    truth, states = _run_true(model, track, time_s, cutoff, None if needed is None else needed.steps, one_kernel)
    dynamic = None if needed is None else needed.dynamic_sensors
    return eqx.tree_at(lambda t: t.readings, truth, distort(model, truth.readings, states, track, dynamic))


def _start(model: Model, track: Track) -> State:
    """Return the state at the start of a run.

    Every state gets the axis of lanes at once; otherwise JAX would trace the step again for each state in which lanes
    begin to differ.
    """
    first_inputs = {name: values[0] for name, values in track.inputs.items()}
    always = jnp.isfinite(track.duration_s[0])
    return jax.tree.map(lambda x: jnp.where(always, x, x), initial_state(model, first_inputs))


@eqx.filter_jit
def _run_true(
    model: Model, track: Track, time_s: Array, cutoff: Cutoff | None, steps: Array | None, one_kernel: bool
) -> tuple[Trajectory, State]:
    """Return ideal readings, and the states at the start and after every step."""
    later_inputs = {name: values[1:] for name, values in track.inputs.items()}
    start = _start(model, track)

    def advance_one(state, given):
        return step(model, state, *given)

    if cutoff is None:
        states = states_after(advance_one, start, (later_inputs, track.duration_s), steps, one_kernel)
        running = jnp.asarray(True)
    else:

        def advance_until_cutoff(carry, given):
            state, running = carry
            inputs, duration, ends_row = given
            state = step(model, state, inputs, jnp.where(running, duration, 0.0))
            running &= ~(ends_row & below(model, read(model, state, inputs), cutoff))
            return state, running

        # Only at the end of a row: the inrush current pulls the voltage below any cut-off for some milliseconds.
        ends_row = jnp.zeros(track.duration_s.shape, dtype=bool).at[track.last_step].set(True)
        given = (later_inputs, track.duration_s, ends_row)
        begin = (start, jnp.asarray(True))
        states, running = states_after(advance_until_cutoff, begin, given, steps, one_kernel)
    running = jnp.broadcast_to(running, track.duration_s.shape)

    def with_start(first, later):
        return jnp.concatenate([first[None], later])

    fine_states = jax.tree.map(with_start, start, states)
    row_states, row_inputs = jax.tree.map(lambda x: x[track.at_rows], (fine_states, track.inputs))
    readings = jax.vmap(lambda s, u: read(model, s, u))(row_states, row_inputs)
    finite = jnp.all(jnp.stack([jnp.all(jnp.isfinite(v)) for v in (*row_states.values(), *readings.values())]))
    completed = jnp.sum(running[track.last_step])
    ended = completed < time_s.shape[0] - 1
    status = jnp.where(ended, Status.REACHED_CUTOFF, Status.COMPLETE)
    status = jnp.where(jnp.all(possible(readings)), status, Status.IMPOSSIBLE)
    status = jnp.where(finite, status, Status.NOT_FINITE)
    truth = Trajectory(
        time_s=time_s,
        readings=readings,
        states=row_states,
        valid=jax.vmap(lambda s, u: valid(model, s, u))(row_states, row_inputs),
        status=status,
        end_row=jnp.minimum(completed + ended, time_s.shape[0] - 1),
    )
    return truth, fine_states


def below(model: Model, readings: Readings, cutoff: Cutoff) -> Array:
    """Return True where ideal readings are below a cut-off; a motor has none."""
    if "soc" not in readings:
        return jnp.asarray(False)
    voltage = readings["voltage_V"] if "voltage_V" in readings else readings["pack_voltage_V"]
    series = 1.0 if "voltage_V" in readings else model.parameters.n_series
    return (readings["soc"] < cutoff.soc) | (voltage / series < cutoff.voltage_V)


def to_frame(trajectory: Trajectory):
    """Return a single trajectory as a pandas table: time_s, then every reading."""
    import pandas as pd

    return pd.DataFrame({"time_s": trajectory.time_s} | dict(trajectory.readings))
