"""Laws: what leaves the chemistry is work or heat, mirrored drives mirror, an absent effect is absent.

Heat is read off the model's own stages, made so heavy that their rise is its integral. One model of a kind holds every
effect behind a switch, so that a kind compiles once.
"""

from __future__ import annotations

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from jaxmodel.effects import CATALOGUE
from jaxmodel.model.declaration import describe
from jaxmodel.model.electrothermal import Model, read
from jaxmodel.model.motor import BENDING
from jaxmodel.model.names import with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import touches
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Trajectory, run_track
from tests.model.runs import STEPS, padded, run, staircase

STAGE = 1e7  # s, or J/K: a thermal stage so slow that it only adds up
KINDS = ("cell", "motor", "robot")
BRUSHES = ("brush_drop", "brush_current_drop")


def effects_of(kind: str) -> list[str]:
    """All but brushes, whose grid is another, sensors, which carry no energy, and what a case states."""
    physical = {name: cls for name, cls in CATALOGUE.items() if cls.is_candidate and not cls.is_sensor}
    return [name for name, cls in physical.items() if kind in cls.kinds and name not in BRUSHES]


@functools.cache
def switched(kind: str, *, brushes: bool = False) -> Model:
    names = [*BRUSHES, *(["self_heating"] if kind == "robot" else [])] if brushes else effects_of(kind)
    effects = (CATALOGUE[name](switch=jnp.zeros(())) for name in names)
    return Model(kind, Parameters(), effects=tuple(effects))


def changed(model: Model, **numbers: float) -> Model:
    return with_values(model, {n.replace("__", "."): jnp.asarray(x, dtype=float) for n, x in numbers.items()})


def chemistry(soc: np.ndarray) -> np.ndarray:
    """The integral of the open-circuit voltage over the charge from empty, in V."""
    return 1.031 / 35.0 * np.exp(-35.0 * soc) + soc * (
        3.685 + soc * (0.2156 / 2 + soc * (-0.1178 / 3 + soc * 0.3201 / 4))
    )


def on(effect: str) -> dict[str, float]:
    return {f"{effect}__switch": 1.0} if effect else {}


def levels(currents: list[float], rows: int, step_s: float) -> Profile:
    values = np.repeat(currents, rows)
    values = np.append(values[:1], values)
    return Profile(np.arange(values.size) * step_s, {"current_A": values, "ambient_degC": np.full(values.size, 20.0)})


def over_levels(model: Model, profile: Profile, ran: Trajectory, rows: int, column: str) -> list[float]:
    """The integral of a reading over each level, with the jump at its start."""
    found = []
    for first in range(0, profile.time_s.size - 1, rows):
        states = {name: values[first : first + rows + 1] for name, values in ran.states.items()}
        inputs = {name: jnp.asarray(values[first + 1]) for name, values in profile.inputs.items()}
        rates = jax.vmap(lambda state, u=inputs: read(model, state, u)[column])(states)
        found.append(
            float(
                CubicSpline(profile.time_s[first : first + rows + 1], rates).integrate(
                    profile.time_s[first], profile.time_s[first + rows]
                )
            )
        )
    return found


@pytest.mark.slow(
    "",
    "arrhenius_resistance",
    "capacity_temperature",
    "charge_transfer",
    "contact_heating",
    "ocv_hysteresis",
    "rate_capacity",
    "resistance_ageing",
    "self_discharge",
    "self_heating",
)
@settings(max_examples=8)
@given(st.lists(st.floats(0.3, 5.0), min_size=4, max_size=4), st.floats(0.3, 1.0))
@pytest.mark.parametrize("effect", ["", *effects_of("cell")])
def test_what_leaves_the_chemistry_of_a_cell_is_work_or_heat_or_leaks(effect: str, currents: list[float], soc: float):
    rows, step_s = 30, 0.5
    currents[2] *= -0.5
    heavy = {"self_heating__switch": 1.0, "self_heating__C_th": STAGE, "self_heating__hA": 1e-3}
    model = changed(switched("cell"), initial_soc=soc, **(heavy | on(effect)))
    profile = levels(currents, rows, step_s)
    ran = run(model, profile)
    temperature = np.asarray(ran.readings["cell_temperature_degC"])
    charge = 3600.0 * 5.2 * left_after_cycles(effect) * (1.0 - 1.544e5 * np.exp(-40498.0 / (8.3143 * 293.15)) * 18.0)
    released = charge * (chemistry(np.asarray(ran.states["soc"][0])) - chemistry(np.asarray(ran.states["soc"][-1])))
    passed = float(np.sum(np.array(currents)) * rows * step_s)
    lost_inside = 0.0
    if effect == "entropic_ocv":  # reversible heat is drawn from the surroundings, not from the chemistry
        released -= 2e-4 * (273.15 + 20.0) * passed
    if effect == "rate_capacity":
        shares = (np.abs(currents) / 5.2) ** 0.1
        sums = over_levels_of_ocv(ran, profile, rows)
        lost_inside = float(np.sum((shares - 1.0) * np.array(currents) * sums))
    if effect == "self_discharge":
        lost_inside = leaked(model, ran, profile, rows)
    work = float(np.dot(currents, over_levels(model, profile, ran, rows, "voltage_V")))
    heat = STAGE * (temperature[-1] - 20.0)
    turned_over = float(np.sum(np.abs(currents))) * rows * step_s * 4.0
    assert abs(released - lost_inside - work - heat) < 1e-6 * turned_over


def left_after_cycles(effect: str) -> float:
    """The share of the capacity that 25 cycles leave."""
    return 1.0 - 0.03 * 25.0 / 100.0 if effect == "capacity_fade" else 1.0


def over_levels_of_ocv(ran: Trajectory, profile: Profile, rows: int) -> np.ndarray:
    ocv = open_circuit(np.asarray(ran.states["soc"]))
    edges = range(0, profile.time_s.size - 1, rows)
    return np.array([simpson(ocv[a : a + rows + 1], x=profile.time_s[a : a + rows + 1]) for a in edges])


def leaked(model: Model, ran: Trajectory, profile: Profile, rows: int) -> float:
    """The energy of V/R through the leakage resistance of 200 ohm, at the open-circuit voltage."""
    mean_ocv = np.mean(open_circuit(np.asarray(ran.states["soc"])))
    return float(mean_ocv * sum(over_levels(model, profile, ran, rows, "voltage_V")) / 200.0)


def imbalance_of_a_start(effect: str, load: float, parts: int = 1) -> float:
    """What a start from standstill takes less where it went, as a share of the first.

    From 10 microseconds on rows grow by an eighth, so that all of the inrush is there to be integrated.
    """
    voltage, resistance, inertia, inductance = 10.0, 0.103, 5.42e-5, 7.2e-5
    time = np.append(0.0, np.geomspace(1e-5, 10.0, 125))
    inputs = {"voltage_V": 0.0 * time + voltage, "load_torque_Nm": 0.0 * time + load, "ambient_degC": 0.0 * time + 25.0}
    adding_up = {"tau_wc": STAGE, "tau_ca": STAGE, "R_wc": 1.0, "R_ca": 1.0, "psi_R": 0.0, "R_0": resistance}
    all_off = switched("motor", brushes=effect in BRUSHES)
    model, profile = changed(all_off, **adding_up, **on(effect)), Profile(time, inputs)
    run_steps, time_s = padded(model, profile)
    used = (STEPS // parts) * parts
    finer = jnp.repeat(run_steps.duration_s[: used // parts] / parts, parts)
    run_steps = eqx.tree_at(lambda c: c.duration_s, run_steps, jnp.append(finer, jnp.zeros(STEPS - used)))
    run_steps = eqx.tree_at(lambda c: c.last_step, run_steps, (run_steps.last_step + 1) * parts - 1)
    ran = jax.tree.map(lambda x: x[:126] if x.ndim else x, run_track(model, run_steps, time_s))
    current, speed = (np.asarray(ran.readings[name]) for name in ("current_A", "speed_rad_s"))

    def integral(values: np.ndarray) -> float:
        return float(CubicSpline(time, values).integrate(0.0, 10.0))

    beside = 0.0  # what eq. 16 leaves out of the winding's heat
    if effect == "saturation":
        beside = integral(0.0385 * current * speed * (current / 50.0) ** 2 / (1.0 + (current / 50.0) ** 2))
    if effect == "gear_loss":
        beside = integral(0.05 * load * speed)
    if effect == "brush_drop":
        beside = integral(0.5 * np.tanh(current / 0.1) * current)
    if effect == "brush_current_drop":
        beside = integral(0.1 * np.arcsinh(current / 1.0) * current)
    given_in = voltage * integral(current)
    stored = 0.5 * inertia * speed[-1] ** 2 + 0.5 * inductance * current[-1] ** 2
    heat = warmed(effect, ran)
    return abs(given_in - load * integral(speed) - stored - heat - beside) / given_in


def warmed(effect: str, ran: Trajectory) -> float:
    """All heat of a motor: eq. 15 puts it into each of the two stages, a chain of them into both together."""
    winding, case = (STAGE * float(ran.states[name][-1]) for name in ("x_winding_K", "x_case_K"))
    return winding + 2.0 * case if effect == "heat_path" else case


@pytest.mark.parametrize("effect", ["", *BRUSHES, *(name for name in effects_of("motor") if name != "saturation")])
@pytest.mark.parametrize("load", [0.02, 0.15])
def test_what_a_start_takes_is_motion_load_or_heat(effect: str, load: float):
    # A drop that bends all the way up, and friction that follows the inrush, leave a little more of the step's error.
    bends = ("brush_current_drop", "torque_friction")
    assert imbalance_of_a_start(effect, load) < (5e-6 if effect in bends else 2e-6)


@pytest.mark.parametrize("load", [0.02, 0.15])
def test_what_a_saturated_start_takes_closes_with_the_square_of_the_step(load: float):
    """An inrush of twice i_s bends the torque within a step; what is missing is the step's error, and goes with it."""
    whole, quarter = (imbalance_of_a_start("saturation", load, parts) for parts in (1, 4))
    assert whole < 1e-4
    assert quarter < whole / 8.0


@pytest.mark.slow("", "arrhenius_resistance")
@pytest.mark.parametrize("effect", ["", *BRUSHES, *effects_of("robot")])
def test_what_leaves_the_chemistry_of_a_robot_is_load_motion_draw_or_heat(effect: str):
    """From the six cells to the wheels of two motors, through a start."""
    duty, load = 0.4, 0.1
    time = np.append(0.0, np.geomspace(1e-5, 10.0, 125))
    inputs = {"duty": 0.0 * time + duty, "load_torque_Nm": 0.0 * time + load, "ambient_degC": 0.0 * time + 20.0}
    heavy = {"tau_wc": STAGE, "tau_ca": STAGE, "R_wc": 1.0, "R_ca": 1.0}
    heavy |= {"self_heating__switch": 1.0, "self_heating__C_th": STAGE, "self_heating__hA": 1e-3}
    all_off = switched("robot", brushes=effect in BRUSHES)
    model = changed(all_off, initial_soc=0.8, storage_months=0.0, **(heavy | on(effect)))
    ran = run(model, Profile(time, inputs))
    read_off = {name: np.asarray(values) for name, values in ran.readings.items()}
    current, speed, soc = read_off["motor_current_A"], read_off["speed_rad_s"], read_off["soc"]
    pack_voltage, pack_current = read_off["pack_voltage_V"], read_off["pack_current_A"]

    def integral(values: np.ndarray) -> float:
        return float(CubicSpline(time, values).integrate(0.0, 10.0))

    released = 3600.0 * 5.2 * left_after_cycles(effect) * (chemistry(soc[0]) - chemistry(soc[-1]))
    heat = STAGE * (read_off["cell_temperature_degC"][-1] - 20.0)
    inside = 0.0  # of one cell: neither its work nor irreversible heat
    if effect == "entropic_ocv":
        inside = 2e-4 * (273.15 + 20.0) * integral(pack_current)
    if effect == "rate_capacity":
        inside = integral(((np.abs(pack_current) / 5.2) ** 0.1 - 1.0) * pack_current * open_circuit(soc))
    if effect == "self_discharge":
        inside = integral(open_circuit(soc) * pack_voltage / 6.0 / 200.0)
    pack = integral(pack_voltage * pack_current)
    # The model gives a weak cell the heat of the others, not the little more of its own; friction follows the inrush.
    close = {"cell_imbalance": 5e-6, "torque_friction": 1e-5}.get(effect, 2e-6)
    assert 6.0 * (released - heat - inside) == pytest.approx(pack, rel=close)

    onboard = integral(pack_voltage * (pack_current - 2.0 * duty * current))
    stored = 0.5 * 5.42e-5 * speed[-1] ** 2 + 0.5 * 7.2e-5 * current[-1] ** 2
    beside = {  # of one motor: what is lost outside the winding, and the ripple's heat, which the form draws nowhere
        "bridge_resistance": lambda: integral(0.02 * current**2),
        "gear_loss": lambda: integral(0.05 * load * speed),
        "brush_drop": lambda: integral(0.5 * np.tanh(current / 0.1) * current),
        "brush_current_drop": lambda: integral(0.1 * np.arcsinh(current / 1.0) * current),
        "bridge_dead_time": lambda: integral(0.02 * np.tanh(duty / 0.04) * pack_voltage * current),
        "pwm_ripple": lambda: -integral(0.02 * (duty * (1.0 - duty) * pack_voltage) ** 2),
        "saturation": lambda: integral(
            0.0385 * current * speed * (current / 50.0) ** 2 / (1.0 + (current / 50.0) ** 2)
        ),
    }.get(effect, float)()
    one_motor = load * integral(speed) + stored + beside + warmed(effect, ran)
    # As in a start of the motor alone, an inrush of twice i_s bends the torque, or the friction, within a step.
    bends = ("saturation", "torque_friction")
    assert pack == pytest.approx(2.0 * one_motor + onboard, rel=1e-4 if effect in bends else 2e-6)


def open_circuit(soc: np.ndarray) -> np.ndarray:
    return -1.031 * np.exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201))


@pytest.mark.parametrize("effect", ["", *(name for name in effects_of("motor") if not name.startswith("directional_"))])
def test_a_motor_driven_backwards_mirrors_itself(effect: str):
    """Nothing in the motor knows left from right: currents and speeds change sign, temperatures do not."""
    drive = staircase(3, 60, 12.0)
    load = 0.012 * drive

    def turned(sign: float) -> Trajectory:
        inputs = {"voltage_V": sign * drive, "load_torque_Nm": sign * load, "ambient_degC": np.full(60, 30.0)}
        return run(changed(switched("motor"), **on(effect)), Profile(np.arange(60.0), inputs))

    one, other = turned(1.0).readings, turned(-1.0).readings
    for name in ("current_A", "speed_rad_s"):
        np.testing.assert_allclose(other[name], -np.asarray(one[name]), rtol=1e-9, atol=1e-9, err_msg=name)
    for name in ("winding_temperature_degC", "case_temperature_degC"):
        np.testing.assert_allclose(other[name], one[name], rtol=1e-12, err_msg=name)


def drive(kind: str) -> Profile:
    shape = staircase(8, 40, 1.0)
    inputs = {
        "cell": {"current_A": 4.0 * shape},
        "motor": {"voltage_V": 12.0 * shape, "load_torque_Nm": 0.1 * shape},
        "robot": {"duty": 0.5 * shape, "load_torque_Nm": 0.1 * shape},
    }[kind]
    return Profile(np.arange(40.0), inputs | {"ambient_degC": np.linspace(5.0, 40.0, 40)})


@pytest.mark.parametrize("kind", KINDS)
def test_switched_off_every_effect_is_absent(kind: str):
    """To the bit whatever its numbers are; beside the model without effects on the same steps, to rounding."""
    off = changed(switched(kind), initial_soc=0.8)
    others = {f"{e}__{n}": 1.1 * i.default for e in effects_of(kind) for n, i in describe(CATALOGUE[e]).items()}
    found, moved = (run(model, drive(kind)).readings for model in (off, changed(off, **others)))
    base = run_track(Model(kind, Parameters(initial_soc=0.8)), *padded(off, drive(kind))).readings
    for name, values in found.items():
        np.testing.assert_array_equal(moved[name], values, err_msg=name)
        np.testing.assert_allclose(values, base[name][: values.size], rtol=1e-12, atol=1e-10, err_msg=name)


NULLS = {name: {n: i.null for n, i in describe(cls).items() if i.null is not None} for name, cls in CATALOGUE.items()}


@pytest.mark.parametrize(("kind", "effect"), [(k, e) for k in KINDS for e in effects_of(k) if NULLS[e]])
def test_at_its_null_an_effect_changes_nothing(kind: str, effect: str):
    off = changed(switched(kind), initial_soc=0.8)
    null = {f"{effect}__{name}": value for name, value in NULLS[effect].items()}
    at_null = changed(off, **{f"{effect}__switch": 1.0}, **null)
    base, found = run(off, drive(kind)).readings, run(at_null, drive(kind)).readings
    # The weak cell's charge is a sum of its own; the pair of a motor is solved by secants, not by tangents.
    by_secants = kind != "cell" and touches((CATALOGUE[effect](),), *BENDING)
    rounding = 1e-13 if by_secants else 1e-15 if effect == "cell_imbalance" else 0.0
    for name, values in found.items():
        np.testing.assert_allclose(values, base[name], rtol=rounding, atol=rounding, err_msg=name)
