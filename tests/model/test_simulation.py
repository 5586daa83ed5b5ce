"""Runs: how they end, lane by lane, which row acts when, and that one shape compiles once."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.effects.sensors import ClockShift, VoltageOffset
from jaxmodel.model import simulation as module
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile, constant
from jaxmodel.model.scan import ROUND
from jaxmodel.model.simulation import Cutoff, Needed, Status, Trajectory, run_track, simulate, to_frame, track
from tests.model.runs import padded, readings, run

ROBOT = Model("robot", Parameters(initial_soc=0.9))
DRIVE = constant(40.0, 1.0, duty=0.3, load_torque_Nm=0.2, ambient_degC=20.0)
CELL = Model("cell", Parameters(initial_soc=0.9))


def test_a_cut_off_is_judged_where_a_row_ends():
    """The inrush of the start pulls the cells below 3.55 V for milliseconds; no row reads less than 3.6 V."""
    free, watched = run(ROBOT, DRIVE, Cutoff()), run(ROBOT, DRIVE, Cutoff(voltage_V=3.55))
    assert float(jnp.min(free.readings["pack_voltage_V"])) > 6.0 * 3.6
    assert int(watched.status) == Status.COMPLETE
    for name, values in free.readings.items():
        np.testing.assert_array_equal(watched.readings[name], values, err_msg=name)


@pytest.mark.parametrize("which", ["soc", "voltage_V"])
def test_a_run_ends_at_the_first_row_below_and_holds_its_state(which: str):
    free = run(ROBOT, DRIVE, Cutoff())
    values = free.readings["soc"] if which == "soc" else free.readings["pack_voltage_V"] / 6.0
    limit = float(0.5 * (values[24] + values[25]))
    ended = run(ROBOT, DRIVE, Cutoff(**{which: limit}))
    assert (int(ended.status), int(ended.end_row)) == (Status.REACHED_CUTOFF, 25)
    for name, values in free.states.items():
        np.testing.assert_array_equal(ended.states[name][:26], values[:26], err_msg=name)
        np.testing.assert_array_equal(ended.states[name][26:], values[25], err_msg=name)


def test_a_row_acts_over_the_interval_that_ends_at_it():
    """Charge taken in row k is missing at row k; the current of row 0 only shows in its own reading."""
    current = np.array([3.0, 0.0, 5.0, 0.0, -2.0])
    time = np.array([0.0, 10.0, 14.0, 30.0, 31.0])
    found = readings(CELL, Profile(time, {"current_A": current, "ambient_degC": np.full(5, 20.0)}))
    lost = -np.diff(found["soc"])
    np.testing.assert_allclose(lost / lost[1] * 20.0, [0.0, 20.0, 0.0, -2.0], atol=1e-9)
    at_rest = readings(CELL, Profile(time, {"current_A": 0.0 * current, "ambient_degC": np.full(5, 20.0)}))
    assert at_rest["voltage_V"][0] - found["voltage_V"][0] > 0.1
    np.testing.assert_array_equal(found["voltage_V"][1], at_rest["voltage_V"][1])


def test_the_order_in_which_inputs_are_named_does_not_matter():
    turned = Profile(DRIVE.time_s, dict(reversed(DRIVE.inputs.items())))
    for name, values in readings(ROBOT, DRIVE).items():
        np.testing.assert_array_equal(readings(ROBOT, turned)[name], values, err_msg=name)


def test_a_lane_that_is_not_a_number_spoils_no_other():
    run_steps, time_s = padded(CELL, constant(40.0, 1.0, current_A=2.0, ambient_degC=20.0))
    capacities = jnp.array([5.2, jnp.nan, 3.0])
    lanes = jax.vmap(lambda value: run_track(with_values(CELL, {"capacity_Ah": value}), run_steps, time_s))(capacities)
    np.testing.assert_array_equal(lanes.status, [Status.COMPLETE, Status.NOT_FINITE, Status.COMPLETE])
    for lane in (0, 2):
        alone = run_track(with_values(CELL, {"capacity_Ah": capacities[lane]}), run_steps, time_s)
        for name, values in alone.readings.items():
            np.testing.assert_allclose(lanes.readings[name][lane], values, rtol=1e-14, err_msg=name)


@pytest.mark.parametrize("watched", [False, True])
def test_steps_that_no_lane_needs_are_left_out_and_change_nothing(watched: bool):
    """A clock that runs early looks past the end of the run, where the last state is held."""
    clock = ClockShift(d=-3.0, switch=jnp.asarray(1.0))
    model = Model("cell", Parameters(initial_soc=0.9), effects=(clock,))
    run_steps, time_s = padded(model, constant(40.0, 1.0, current_A=2.0, ambient_degC=20.0))
    cutoff = Cutoff(soc=0.895) if watched else None
    currents = jnp.array([0.5, 1.0, 2.0])

    def lanes(needed: Needed | None) -> Trajectory:
        def of_one(scale):
            inputs = run_steps.inputs | {"current_A": scale * run_steps.inputs["current_A"]}
            return run_track(model, dataclasses.replace(run_steps, inputs=inputs), time_s, cutoff, needed)

        return jax.vmap(of_one)(currents)

    needed = Needed(jnp.max(run_steps.last_step) + 1, jnp.array([True]))
    everything = lanes(None)
    for one, other in zip(jax.tree.leaves(everything), jax.tree.leaves(jax.jit(lanes)(needed)), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-14)


def test_steps_past_those_needed_are_not_taken():
    run_steps, time_s = padded(CELL, constant(300.0, 1.0, current_A=2.0, ambient_degC=20.0), rows=512)
    soc = run_track(CELL, run_steps, time_s, None, Needed(jnp.asarray(1), jnp.zeros(0, dtype=bool))).states["soc"]
    assert np.all(np.diff(soc[: ROUND + 1]) < 0.0)
    np.testing.assert_array_equal(soc[ROUND:], soc[ROUND])


def test_a_memory_that_no_lane_needs_is_left_out():
    clock, offset = ClockShift(d=5.0, switch=jnp.asarray(1.0)), VoltageOffset(column="voltage_V", c=0.5)
    model = Model("cell", Parameters(initial_soc=0.9), effects=(clock, offset))
    plain = Model("cell", Parameters(initial_soc=0.9), effects=(offset,))
    run_steps, time_s = padded(model, constant(40.0, 1.0, current_A=2.0, ambient_degC=20.0))
    steps = jnp.max(run_steps.last_step) + 1
    late, prompt = (run_track(model, run_steps, time_s, None, Needed(steps, jnp.asarray([on]))) for on in (True, False))
    expected = run_track(plain, run_steps, time_s).readings
    np.testing.assert_allclose(prompt.readings["voltage_V"], expected["voltage_V"], rtol=1e-14)
    assert float(jnp.max(jnp.abs(late.readings["voltage_V"] - expected["voltage_V"]))) > 1e-3


@pytest.fixture
def traces(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Each call of the model's step, which only a trace makes."""
    seen, plain = [], module.step
    monkeypatch.setattr(module, "step", lambda model, *rest: seen.append(model.kind) or plain(model, *rest))
    return seen


@pytest.mark.parametrize("kind", ["cell", "motor", "robot"])
def test_a_second_case_of_the_same_shape_is_not_traced_again(kind: str, traces: list[str]):
    """Other parameters, other inputs, another ambient, another cut-off: the same program."""
    drive = {"cell": {"current_A": 1.5}, "motor": {"voltage_V": 6.0}, "robot": {"duty": 0.2}}[kind]
    load = {} if kind == "cell" else {"load_torque_Nm": 0.05}

    def case(capacity: float, strength: float, ambient: float, lowest_V: float):
        inputs = {name: strength * value for name, value in (drive | load).items()}
        profile = constant(17.0, 1.0, **inputs, ambient_degC=ambient)
        return simulate(Model(kind, Parameters(capacity_Ah=capacity, k_tau=0.03)), profile, Cutoff(voltage_V=lowest_V))

    first = case(5.2, 1.0, 20.0, 3.0)
    count = len(traces)
    assert count > 0
    second = case(3.1, 0.8, -5.0, 2.5)
    assert len(traces) == count
    assert not eqx.tree_equal(first.readings, second.readings)


def test_a_trajectory_becomes_a_table():
    ran = run(CELL, constant(5.0, 1.0, current_A=2.0, ambient_degC=20.0))
    frame = to_frame(eqx.tree_at(lambda t: t.time_s, ran, jnp.arange(6.0)))
    assert list(frame) == ["time_s", *ran.readings]
    np.testing.assert_array_equal(frame["soc"], ran.readings["soc"])


@pytest.mark.slow("soc")
@pytest.mark.parametrize("reading", ["soc", "pack_voltage_V"])
def test_a_run_may_be_part_of_a_program_that_holds_its_profile(reading: str):
    """Closed over, not passed: XLA would abort the process on a kernel that is given constant arrays."""
    profile = constant(300.0, 1.0, duty=0.3, load_torque_Nm=0.175, ambient_degC=20.0)
    run_steps, times = track(Model("robot"), profile), jnp.asarray(profile.time_s)

    def last(k_tau):
        return run_track(with_values(Model("robot"), {"k_tau": k_tau}), run_steps, times).readings[reading][-1]

    expected = simulate(Model("robot"), profile).readings[reading][-1]
    assert float(jax.jit(last)(jnp.asarray(0.0385))) == pytest.approx(float(expected), rel=1e-12)
    lanes = jax.jit(jax.vmap(last))(jnp.asarray([0.0385, 0.04]))
    assert float(lanes[0]) == pytest.approx(float(expected), rel=1e-12)
