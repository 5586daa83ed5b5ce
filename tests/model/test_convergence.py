"""The step: second order for smooth loads with every effect, stable at any length, exact enough at 30 s.

One model of a kind holds every effect behind a switch, so that a kind compiles once. To refine, each step of the grid
is cut in equal parts under the same held inputs; the milliseconds after a jump are left as they are, for what happens
there is another question (the energy of a start, in test_laws.py).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.loads import LAWS
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, Track
from jaxmodel.model.simulation import Status, Trajectory, run_track, track
from tests.model.runs import staircase

ROWS, STEPS = 13, 2000
TRANSIENT_S = 0.1
TEMPERATURE_DEPENDENT = (
    "arrhenius_resistance",
    "arrhenius_polarisation",
    "capacity_temperature",
    "charge_transfer",
    "entropic_ocv",
)
# What the rotor's acceleration takes of the current while the slow states move it is right to first order only,
# J/k d2w/dt2 times the step; it hides what else is in these.
CARRY_THE_ACCELERATION = ("current_A", "motor_current_A", "pack_current_A", "pack_voltage_V")
# Its steps are a share of the period of its own resonance, whatever the grid: see test_flexible_shaft.
RINGS = ("flexible_shaft",)
# Dry friction that follows load or current is held over a step, at the value of its middle.
RUBS = ("gear_friction", "torque_friction")
INPUTS = {
    "cell": {"current_A": (2.0, 1.5)},
    "motor": {"voltage_V": (8.0, 3.0), "load_torque_Nm": (0.15, 0.1)},
    "robot": {"duty": (0.35, 0.15), "load_torque_Nm": (0.15, 0.1)},
}
BENDING = (
    "brush_drop",
    "brush_current_drop",
    "saturation",
)  # their steps after a jump are others, and so is the compiled shape


def effects_of(kind: str, bends: bool) -> list[str]:
    """Effects beside a load that is an input; laws of the load have tests of their own (test_loads)."""
    within = {name: cls for name, cls in CATALOGUE.items() if cls not in LAWS.values() and name not in RINGS}
    physical = [name for name, cls in within.items() if kind in cls.kinds and not cls.is_sensor]
    return [name for name in physical if (name in BENDING) == bends]


@functools.cache
def switched(kind: str, bends: bool) -> Model:
    effects = (CATALOGUE[name](switch=jnp.zeros(())) for name in effects_of(kind, bends))
    return Model(kind, Parameters(initial_soc=0.9), effects=tuple(effects))


def with_effects(kind: str, *names: str, **numbers: float) -> Model:
    given = {f"{name}.switch": 1.0 for name in names} | numbers
    arrays = {name: jnp.asarray(value, dtype=float) for name, value in given.items()}
    return with_values(switched(kind, any(name in BENDING for name in names)), arrays)


CASES = [(kind, "") for kind in INPUTS] + [
    (kind, name) for kind in INPUTS for bends in (False, True) for name in effects_of(kind, bends)
]
every_effect = pytest.mark.parametrize(("kind", "effect"), CASES, ids=[f"{k}-{e or 'base'}" for k, e in CASES])


def model_of(kind: str, effect: str, **numbers: float) -> Model:
    warm = ("self_heating",) if effect in TEMPERATURE_DEPENDENT else ()
    return with_effects(kind, *([effect] if effect else []), *warm, **numbers)


def refined(run_steps: Track, parts: int) -> Track:
    """Cut each step that is not part of a transient, and fill up to the one compiled shape."""
    duration = np.asarray(run_steps.duration_s)
    counts = np.where(duration > TRANSIENT_S, parts, 1)
    cut = np.repeat(duration / counts, counts)
    later = np.append(np.repeat(np.arange(1, duration.size + 1), counts), np.full(STEPS - cut.size, duration.size))
    inputs = {name: values[np.append(0, later)] for name, values in run_steps.inputs.items()}
    last_step = jnp.asarray(np.cumsum(counts)[np.asarray(run_steps.last_step)] - 1)
    return Track(jnp.asarray(np.append(cut, np.zeros(STEPS - cut.size))), inputs, last_step)


def ran(model: Model, profile: Profile, parts: int) -> Trajectory:
    return run_track(model, refined(track(model, profile), parts), jnp.asarray(profile.time_s))


def courses(model: Model, profile: Profile, parts: int) -> dict[str, np.ndarray]:
    return {name: np.asarray(values) for name, values in ran(model, profile, parts).readings.items()}


def smooth(kind: str, step_s: float, swing: float) -> Profile:
    """Inputs about a mean, swinging once over the rows."""
    time = np.arange(ROWS) * step_s
    wave = swing * np.sin(2.0 * np.pi * np.arange(ROWS) / (ROWS - 1))
    inputs = {name: mean + amplitude * wave for name, (mean, amplitude) in INPUTS[kind].items()}
    return Profile(time, inputs | {"ambient_degC": np.full(ROWS, 20.0)})


def worst(found: Mapping[str, np.ndarray], exact: Mapping[str, np.ndarray]) -> dict[str, float]:
    return {name: float(np.abs(found[name] - exact[name]).max()) for name in exact}


def orders(model: Model, profile: Profile) -> dict[str, tuple[float, float]]:
    """By reading: the order, and what halving the steps changes; of those that it changes by more than rounding."""
    whole, half, quarter = (courses(model, profile, parts) for parts in (1, 2, 4))
    first, second = worst(whole, half), worst(half, quarter)
    above_rounding = {name for name, change in first.items() if change > 1e-9 * np.abs(whole[name]).max()}
    return {name: (float(np.log2(first[name] / second[name])), first[name]) for name in above_rounding}


@pytest.mark.slow("robot-base")
@every_effect
def test_second_order_for_smooth_loads(kind: str, effect: str):
    for name, (order, change) in orders(model_of(kind, effect), smooth(kind, 8.0, 1.0)).items():
        if name in CARRY_THE_ACCELERATION:
            assert change < 1e-4, name
        else:
            assert order > (1.6 if effect in RUBS else 1.8), (name, order, change)


@pytest.mark.parametrize("effect", ["", "self_heating", "charge_transfer"])
def test_second_order_where_the_curves_are_steep(effect: str):
    """From 6 to 5 per cent of charge every exponential of eqs. 3 to 6 counts."""
    found = orders(model_of("cell", effect, initial_soc=0.06), smooth("cell", 8.0, 1.0))
    assert "voltage_V" in found
    assert all(order > 1.8 for order, _ in found.values()), found


@every_effect
def test_thirty_seconds_are_as_good_as_one_for_a_constant_load(kind: str, effect: str):
    model, profile = model_of(kind, effect), smooth(kind, 30.0, 0.0)
    found = worst(courses(model, profile, 1), courses(model, profile, 30))
    # The speed follows the pack through a line over the step: half a radian per second of 250 while it still bends.
    limits = {"soc": 1e-6, "voltage_V": 1e-3, "pack_voltage_V": 1e-3, "speed_rad_s": 0.6}
    assert {name: error for name, error in found.items() if error > limits.get(name, 5e-3)} == {}


@pytest.mark.parametrize("kind", INPUTS)
@pytest.mark.parametrize("step_s", [1e-3, 0.02, 1.0, 30.0, 300.0])
def test_any_step_is_stable(kind: str, step_s: float):
    """Every effect at once, a load that starts, stops and reverses: nothing rings, nothing leaves its bounds."""
    levels = staircase(11, ROWS, 1.0)
    inputs = {name: levels * mean for name, (mean, _) in INPUTS[kind].items()}
    profile = Profile(np.arange(ROWS) * step_s, inputs | {"ambient_degC": np.linspace(10.0, 30.0, ROWS)})
    found = ran(with_effects(kind, *effects_of(kind, False), initial_soc=0.5), profile, 1)
    assert int(found.status) == Status.COMPLETE
    bounds = {
        "_degC": (0.0, 80.0),
        "_V": (0.0, 26.0),
        "_A": (-120.0, 120.0),
        "_rad_s": (-500.0, 500.0),
        "soc": (0.0, 1.0),
    }
    for name, values in found.readings.items():
        low, high = next(bound for ending, bound in bounds.items() if name.endswith(ending))
        assert low <= float(jnp.min(values)), name
        assert float(jnp.max(values)) <= high, name
