"""Derivatives of every reading by every number of the model: forward, reverse and by differences, and finite anywhere.

One model of a kind holds every effect, so that its derivatives compile once; what is told apart are the numbers.
"""

from __future__ import annotations

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import parameter_table, value, with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, Track
from jaxmodel.model.simulation import Cutoff, run_track, track

ROWS = 13
KINDS = ("cell", "motor", "robot")
NEVER = Cutoff()
# Where a number is zero by default, what a change of it is measured by.
SCALES = {"ocv_offset_V": 0.1, "psi_L": 1e-2, "clock_shift.resampled": 0.1, "saturation.i_s": 15.0}
SCALES |= {"initial_temperature_rise_K": 5.0, "initial_hysteresis": 0.3}
SCALES |= {"initial_winding_rise_K": 10.0, "initial_case_rise_K": 10.0}
BRUSHES = ("brush_drop", "brush_current_drop")


@functools.cache
def full_model(kind: str) -> Model:
    """Each effect in one kind at least; a brush drop's derivative is that of its root, in test_root.py."""
    columns = {"current_offset": "current_A", "voltage_gain": "voltage_V", "voltage_offset": "voltage_V"}
    columns |= {name: "winding_temperature_degC" for name in ("temperature_lag", "temperature_gain")}
    columns |= {"temperature_offset": "case_temperature_degC", "current_gain": "current_A", "speed_gain": "speed_rad_s"}
    columns |= {"torque_offset": "load_torque_Nm", "torque_gain": "load_torque_Nm", "chamber_offset": "ambient_degC"}
    of_robot = {name: cls for name, cls in CATALOGUE.items() if cls.kinds == ("robot",)}
    of_kind = {name: cls for name, cls in CATALOGUE.items() if kind in cls.kinds and name not in BRUSHES}
    chosen = of_robot | {"self_heating": CATALOGUE["self_heating"]} if kind == "robot" else of_kind
    effects = [cls(column=columns.get(name, "")) for name, cls in chosen.items()]
    return Model(kind, Parameters(initial_soc=0.85), effects=tuple(effects))


@functools.cache
def names(kind: str) -> tuple[str, ...]:
    return tuple(parameter_table(full_model(kind)))


def values(kind: str, **changes: float) -> np.ndarray:
    # A shift by whole rows reads just where an input jumps, and friction has a kink at standstill: there no reading has
    # a derivative by the one, and by the other; so it has where a load that a transducer invents is just held.
    off = {"clock_shift.d": 0.37, "initial_speed_rad_s": 30.0, "torque_offset.c": 0.003, "charge_transfer.E_i": 2e4}
    changes = off | {"heat_details.s": 0.3, "heat_details.l": -0.2, "heat_details.c": 0.1} | changes
    return np.array([changes.get(name, float(value(full_model(kind), name))) for name in names(kind)])


def profile(kind: str, strength: float = 1.0, ambient: float = 12.0) -> Profile:
    """Two levels and a rest, rows a second apart."""
    levels = strength * np.repeat([1.0, 0.6, 0.0], [5, 4, 4])
    inputs = {
        "cell": {"current_A": 3.0 * levels},
        "motor": {"voltage_V": 9.0 * levels, "load_torque_Nm": 0.15 * levels},
        "robot": {"duty": 0.4 * levels, "load_torque_Nm": 0.15 * levels},
    }[kind]
    return Profile(np.arange(ROWS) * 1.0, inputs | {"ambient_degC": np.full(ROWS, ambient)})


def run_steps(kind: str, given: Profile) -> Track:
    """The steps of a run, the same for every load: one at rest throughout has no jumps of its own."""
    steps = track(full_model(kind), profile(kind))
    rows = track(full_model(kind), given)
    if rows.duration_s.shape == steps.duration_s.shape:
        return rows
    owner = np.searchsorted(np.asarray(steps.last_step), np.arange(steps.duration_s.size)) + 1
    inputs = {name: jnp.asarray(values[np.append(0, owner)]) for name, values in given.inputs.items()}
    return Track(steps.duration_s, inputs, steps.last_step)


def outputs(kind: str, x: jax.Array, steps: Track, cutoff: Cutoff) -> jax.Array:
    """All readings at all rows, shape (readings, rows)."""
    model = with_values(full_model(kind), dict(zip(names(kind), x, strict=True)))
    found = run_track(model, steps, jnp.arange(ROWS) * 1.0, cutoff).readings
    return jnp.stack([found[name] for name in sorted(found)])


@functools.cache
def compiled(kind: str) -> dict[str, Callable]:
    plain = functools.partial(outputs, kind)

    def weighed(x, steps, cutoff, weights):
        return jnp.sum(weights * plain(x, steps, cutoff))

    return {
        "values": eqx.filter_jit(lambda xs, *rest: jax.lax.map(lambda x: plain(x, *rest), xs)),
        "forward": eqx.filter_jit(lambda x, *rest: jax.jacfwd(plain)(x, *rest)),
        "reverse": eqx.filter_jit(lambda x, *rest: jax.grad(weighed)(x, *rest)),
    }


def differences(
    kind: str,
    x: np.ndarray,
    steps: Track,
) -> tuple[np.ndarray, np.ndarray]:
    """Central differences of fourth order by every number, shape (readings, rows, numbers), and their steps."""
    h = 1e-3 * np.array([SCALES.get(name, abs(v)) for name, v in zip(names(kind), x, strict=True)])
    moves = np.array([-2.0, -1.0, 1.0, 2.0])
    points = x + moves[:, None, None] * np.diag(h)
    found = np.asarray(compiled(kind)["values"](jnp.asarray(points.reshape(-1, x.size)), steps, NEVER))
    found = found.reshape(4, x.size, *found.shape[1:])
    slope = np.tensordot([1.0, -8.0, 8.0, -1.0], found, 1) / (12.0 * h[:, None, None])
    return np.moveaxis(slope, 0, -1), h


def forward(kind: str, x: np.ndarray, steps: Track, cutoff: Cutoff = NEVER) -> np.ndarray:
    return np.asarray(compiled(kind)["forward"](jnp.asarray(x), steps, cutoff))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_forward_derivatives_are_differences(kind: str):
    """To 1e-6 of the largest over the run, and what rounding leaves of a difference, most from short secants."""
    x, steps = values(kind), run_steps(kind, profile(kind))
    expected, h = differences(kind, x, steps)
    largest = np.abs(np.asarray(compiled(kind)["values"](jnp.asarray(x[None]), steps, NEVER))[0]).max(axis=1)
    rounding = 500.0 * np.finfo(float).eps * largest[:, None] / h
    off = np.abs(forward(kind, x, steps) - expected).max(axis=1)
    beyond = off > 1e-6 * np.abs(expected).max(axis=1) + rounding
    assert not beyond.any(), [names(kind)[column] for column in np.flatnonzero(beyond.any(axis=0))]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["cell", "motor"])
def test_reverse_derivatives_are_forward_ones(kind: str):
    x, steps = values(kind), run_steps(kind, profile(kind))
    matrix = forward(kind, x, steps)
    weights = np.random.default_rng(1).normal(size=matrix.shape[:2])
    found = np.asarray(compiled(kind)["reverse"](jnp.asarray(x), steps, NEVER, jnp.asarray(weights)))
    size = np.einsum("rt,rtn->n", np.abs(weights), np.abs(matrix))
    assert np.all(np.abs(found - np.einsum("rt,rtn->n", weights, matrix)) <= 1e-9 * size)


def nulls(kind: str) -> dict[str, float]:
    return {name: entry.null for name, entry in parameter_table(full_model(kind)).items() if entry.null is not None}


EDGES = {
    "null values": lambda kind: (nulls(kind), profile(kind), NEVER),
    "at rest": lambda kind: ({"initial_speed_rad_s": 0.0}, profile(kind, 0.0), NEVER),
    "at rest and null": lambda kind: (nulls(kind) | {"initial_speed_rad_s": 0.0}, profile(kind, 0.0), NEVER),
    # Its current falls to 1e-250 A.
    "coasting": lambda kind: (nulls(kind), profile(kind, 0.0), NEVER),
    "empty": lambda kind: ({"initial_soc": 0.0}, profile(kind), NEVER),
    "full": lambda kind: ({"initial_soc": 1.0, "cycles": 0.0}, profile(kind), NEVER),
    "-40 degC": lambda kind: ({}, profile(kind, ambient=-40.0), NEVER),
    "100 degC": lambda kind: ({}, profile(kind, ambient=100.0), NEVER),
    "cut off": lambda kind: ({}, profile(kind), Cutoff(soc=0.8495)),
    "backwards": lambda kind: ({"initial_soc": 0.5}, profile(kind, -1.0), NEVER),
}


@pytest.mark.slow(
    "cell-null values",
    "motor--40 degC",
    "motor-100 degC",
    "motor-at rest and null",
    "motor-at rest",
    "motor-backwards",
    "motor-coasting",
    "motor-cut off",
    "motor-empty",
    "motor-full",
    "motor-null values",
    "robot--40 degC",
    "robot-100 degC",
    "robot-at rest and null",
    "robot-at rest",
    "robot-backwards",
    "robot-coasting",
    "robot-cut off",
    "robot-empty",
    "robot-full",
    "robot-null values",
)
@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_finite_at_the_edges(kind: str, edge: str):
    changes, given, cutoff = EDGES[edge](kind)
    found = forward(kind, values(kind, **changes), run_steps(kind, given), cutoff)
    bad = ~np.isfinite(found).all(axis=(0, 1))
    assert not bad.any(), [names(kind)[column] for column in np.flatnonzero(bad)]


@pytest.mark.slow("robot")
@pytest.mark.parametrize("kind", ["cell", "robot"])
def test_the_derivative_by_the_initial_charge_is_whole_where_the_cell_is_full(kind: str):
    """A full cell is where most runs start: one-sided as the model is beyond, the slope is that of just below."""
    steps = run_steps(kind, profile(kind))
    place = names(kind).index("initial_soc")
    full, below = (forward(kind, values(kind, initial_soc=soc), steps)[..., place] for soc in (1.0, 1.0 - 1e-7))
    np.testing.assert_allclose(full, below, rtol=1e-5, atol=1e-7)
