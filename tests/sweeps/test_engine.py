from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import xarray as xr

from jaxmodel.base.errors import RemarkWarning
from jaxmodel.lanes import compiled
from jaxmodel.model.cell import storage_factor
from jaxmodel.model.electrothermal import Model, read
from jaxmodel.model.names import with_values
from jaxmodel.model.profile import BENDING_STEP_SHARE, SETTLED, Profile, constant
from jaxmodel.model.simulation import Cutoff, Status, Trajectory, simulate, track
from jaxmodel.sweeps import Metric, Study, by_vectors, plan, run, runner

TABLE_2 = {0.175: -2.05e-4, 0.25: -2.80e-4, 0.30: -3.30e-4, 0.35: -3.80e-4}


def simulate_lane(study: Study, number: int, profile: Profile) -> tuple[Model, Profile, Trajectory]:
    """The same lane by way of `simulate`: the model and profile of that lane alone."""
    lane = {name: float(values[0]) for name, values in study.lanes(np.array([number])).items()}
    inputs = {name: np.full_like(values, lane.get(name, values)) for name, values in profile.inputs.items()}
    numbers = {name: jnp.asarray(value) for name, value in lane.items() if name not in inputs}
    model = with_values(study.prepared.model, numbers)
    profile = Profile(profile.time_s, inputs)
    return model, profile, simulate(model, profile, study.prepared.cutoff)


def test_lanes_equal_a_loop_over_simulate(robot_study, robot_result):
    flat = robot_result.drop_dims("time_s").to_dataframe().reset_index()
    stored = {name: robot_result[name].values.reshape(robot_study.size, -1) for name in robot_study.store}
    assert set(flat["status"]) == {Status.COMPLETE, Status.REACHED_CUTOFF}
    for number in range(robot_study.size):
        _, _, course = simulate_lane(robot_study, number, robot_study.prepared.profile)
        row = flat.loc[number]
        rows = slice(0, int(course.end_row) + 1)
        assert row["status"] == course.status
        ended_s = float(course.time_s[course.end_row])
        readings = {name: np.asarray(values)[rows] for name, values in course.readings.items()}
        expected = {
            "soc_gradient": (readings["soc"][-1] - readings["soc"][0]) / ended_s,
            "final_soc": readings["soc"][-1],
            "time_to_cutoff_s": ended_s if course.status == Status.REACHED_CUTOFF else np.nan,
            "min_pack_voltage_V": readings["pack_voltage_V"].min(),
            "valid_share": np.asarray(course.valid)[rows].mean(),
        }
        for part in ("cell", "winding", "case"):
            temperature = readings[f"{part}_temperature_degC"]
            expected[f"peak_{part}_temperature_degC"] = temperature.max()
            expected[f"final_{part}_temperature_degC"] = temperature[-1]
        for name, value in expected.items():
            np.testing.assert_allclose(row[name], value, rtol=1e-12, atol=1e-12, err_msg=f"lane {number}, {name}")
        for name, values in stored.items():
            np.testing.assert_allclose(values[number], course.readings[name][:: robot_study.store_every], rtol=1e-12)


def test_integrals_over_a_pulsed_cell_equal_those_of_the_trajectory(tmp_path):
    """Both ends of each step count under the step's own current: a jump between rows costs nothing."""
    current = np.repeat([0.0, 3.0, -1.0, 2.0, 0.0, 4.0], 5)
    time_s = np.cumsum(np.r_[0.0, np.full(current.size - 1, 7.0)])
    rows = "\n".join(f"{t},{i},20" for t, i in zip(time_s, current, strict=True))
    (tmp_path / "pulses.csv").write_text(f"time_s,current_A,ambient_degC\n{rows}\n")
    study = Study(
        kind="cell",
        profile={"csv": str(tmp_path / "pulses.csv")},
        axes={"cycles": [0.0, 200.0], "initial_soc": [0.4, 0.9]},
        metrics=["delivered_charge_Ah", "delivered_energy_Wh"],
    )
    result = run(study)
    for number in range(study.size):
        model, profile, course = simulate_lane(study, number, study.prepared.profile)
        own = {name: jnp.asarray(values[1:]) for name, values in profile.inputs.items()}
        read_rows = jax.vmap(lambda s, u, m=model: read(m, s, u)["voltage_V"])
        before = read_rows({n: x[:-1] for n, x in course.states.items()}, own)
        after = read_rows({n: x[1:] for n, x in course.states.items()}, own)
        watt = 0.5 * (before + after) * own["current_A"]
        lane = result.stack(lane=tuple(study.axes)).isel(lane=number)
        step_s = np.diff(profile.time_s)
        np.testing.assert_allclose(lane.delivered_energy_Wh, np.sum(watt * step_s) / 3600.0, rtol=1e-12)
        np.testing.assert_allclose(lane.delivered_charge_Ah, np.sum(own["current_A"] * step_s) / 3600.0, rtol=1e-12)


def test_gradient_at_constant_current_is_the_closed_form(cell_study):
    study = cell_study()
    result = run(study)
    current, months = np.meshgrid(study.axes["current_A"], study.axes["storage_months"], indexing="ij")
    left = jax.vmap(storage_factor, in_axes=(0, None))(jnp.asarray(months.ravel()), jnp.asarray(20.0))
    charge = 3600.0 * 5.2 * left.reshape(months.shape)
    np.testing.assert_allclose(result.soc_gradient, -current / charge, rtol=1e-12)
    np.testing.assert_allclose(result.delivered_charge_Ah, current * 600.0 / 3600.0, rtol=1e-12)


@pytest.fixture(scope="module")
def robot_over_torque() -> Callable[[float], xr.Dataset]:
    """Ten minutes of the paper's robot, in rows of so many seconds, over torques of which Table 2 has the last four."""

    @functools.cache
    def result(step_s: float) -> xr.Dataset:
        return run(
            Study(
                kind="robot",
                profile={"duration_s": 600, "step_s": step_s, "duty": 0.3, "ambient_degC": 20.0},
                axes={"load_torque_Nm": [0.0, *TABLE_2]},
                metrics=["soc_gradient", "final_soc", "delivered_charge_Ah", "delivered_energy_Wh", "mean_speed_rad_s"],
            )
        )

    return result


def test_gradients_are_those_of_table_2(robot_over_torque):
    gradient = robot_over_torque(1.0).soc_gradient.sel(load_torque_Nm=list(TABLE_2))
    np.testing.assert_allclose(gradient, list(TABLE_2.values()), atol=0.005e-4)


def test_robot_delivers_the_charge_that_its_cells_lose(robot_over_torque):
    result = robot_over_torque(1.0)
    usable_Ah = 5.2 * float(storage_factor(jnp.asarray(18.0), jnp.asarray(20.0)))
    np.testing.assert_allclose(result.delivered_charge_Ah, (1.0 - result.final_soc) * usable_Ah, atol=1e-5)


def test_rows_of_ten_seconds_keep_the_state_of_charge_to_1e_6(robot_over_torque):
    difference = np.abs(robot_over_torque(1.0).final_soc - robot_over_torque(10.0).final_soc)
    assert 0.0 < float(difference.max()) < 1e-6


def test_more_torque_slows_the_motor(robot_over_torque):
    """Eqs. 11-14 in equilibrium: w = (rho V_pack - i_a R) / k_tau; energy / charge is the mean voltage of the pack."""
    result = robot_over_torque(1.0)
    assert np.all(np.diff(result.mean_speed_rad_s) < 0.0)
    no_load = result.isel(load_torque_Nm=0)
    pack_V = no_load.delivered_energy_Wh / no_load.delivered_charge_Ah
    np.testing.assert_allclose(no_load.mean_speed_rad_s, (0.3 * pack_V - 0.01 / 0.0385 * 0.103) / 0.0385, rtol=2e-4)


def test_lane_that_fails_harms_no_other(cell_study):
    study = cell_study()
    whole = run(study)
    broken = study.model_copy(update={"axes": {**study.axes, "current_A": [0.5, float("nan"), 2.0]}})
    result = run(broken)
    assert (result.status.isel(current_A=1) == Status.NOT_FINITE).all()
    assert (result.status.isel(current_A=[0, 2]) == Status.COMPLETE).all()
    for name in ("soc_gradient", "delivered_charge_Ah", "min_voltage_V"):
        assert result[name].isel(current_A=1).isnull().all()
        np.testing.assert_array_equal(result[name].isel(current_A=[0, 2]), whole[name].isel(current_A=[0, 2]))


def test_chunks_change_nothing_and_are_reported(cell_study, monkeypatch):
    study = cell_study(axes={"current_A": np.linspace(0.1, 3.0, 300)})
    whole = run(study)
    monkeypatch.setattr(by_vectors, "LANE_STEPS_PER_CALL", 1)
    monkeypatch.setattr(plan, "LANE_STEPS_PER_CHUNK", 1)
    seen: list[tuple[int, int]] = []
    chunked = run(study, lambda done, total: seen.append((done, total)))
    assert len(seen) > 1
    assert seen[-1] == (300, 300)
    assert [done for done, _ in seen] == sorted({done for done, _ in seen})
    for name in whole:
        np.testing.assert_array_equal(chunked[name], whole[name])


def test_second_sweep_of_a_kind_compiles_nothing(cell_study):
    run(cell_study())
    before = compiled._kernel.cache_info()
    run(cell_study(parameters={"capacity_Ah": 4.0}))
    after = compiled._kernel.cache_info()
    assert (after.hits, after.misses) == (before.hits + 1, before.misses)


def test_operation_without_vector_instructions_still_runs_and_is_named(cell_study):
    @dataclasses.dataclass(frozen=True)
    class MedianOfThree(Metric):
        def init(self, first):
            return jnp.full(3, first.columns["soc"])

        def update(self, carry, step):
            return jnp.concatenate([carry[1:], step.after.columns["soc"][None]])

        def finish(self, carry, end):
            return jnp.linalg.solve(jnp.eye(3), jnp.sort(carry))[1]

    median = MedianOfThree("median_soc", "", "median of the last three rows", ("cell",))
    study = cell_study(metrics=["final_soc", "soc_gradient", median])
    with pytest.warns(RemarkWarning, match='runs through XLA: the operation "sort" has no vector instructions'):
        result = run(study)
    one_row_back = result.final_soc - 10.0 * result.soc_gradient
    np.testing.assert_allclose(result.median_soc, one_row_back, rtol=1e-12)


def test_lane_whose_metric_overflows_says_so_and_has_no_number(cell_study: Callable[..., Study]) -> None:
    class Growing(Metric):
        def init(self, first):
            return first.columns["current_A"]

        def update(self, carry, step):
            return carry * carry

        def finish(self, carry, end):
            return carry

    growing = Growing("growing", "", "of a start above 1 it overflows", ("cell",))
    study = cell_study(metrics=["final_soc", growing], axes={"current_A": [0.5, 2.0]})
    for engine in ("local", "xla"):
        result = run(study, engine=engine)
        assert result.status.values.tolist() == [Status.COMPLETE, Status.NOT_FINITE]
        assert np.isfinite(result.growing[0])
        assert np.isnan(result.growing[1])
        assert np.isfinite(result.final_soc[0])
        assert np.isnan(result.final_soc[1])


def test_current_axis_sets_duty_by_the_operators_signal():
    def speed(axes: dict, **inputs: float):
        profile = {"duration_s": 20, "load_torque_Nm": 0.1, "ambient_degC": 20.0, **inputs}
        return run(Study(kind="robot", profile=profile, axes=axes, metrics=["mean_speed_rad_s"])).mean_speed_rad_s

    np.testing.assert_array_equal(speed({"V_set": [3.25, 3.75]}), speed({"duty": [0.3, 0.5]}))


def test_cutoff_by_voltage_is_that_of_one_cell():
    cutoff = Cutoff(voltage_V=3.3)
    study = Study(
        kind="cell",
        parameters={"capacity_Ah": 0.5, "initial_soc": 0.4},
        profile={"duration_s": 600, "step_s": 5, "ambient_degC": 20.0},
        axes={"current_A": [0.2, 1.0, 2.0]},
        metrics=["time_to_cutoff_s", "min_voltage_V"],
        cutoff={"voltage_V": 3.3},
    )
    result = run(study)
    for number, current in enumerate(study.axes["current_A"]):
        course = simulate(study.prepared.model, constant(600.0, 5.0, current_A=current, ambient_degC=20.0), cutoff)
        ended = course.status == Status.REACHED_CUTOFF
        assert result.status[number] == course.status
        expected = float(course.time_s[course.end_row]) if ended else np.nan
        np.testing.assert_array_equal(result.time_to_cutoff_s[number], expected)
    assert set(result.status.values) == {Status.COMPLETE, Status.REACHED_CUTOFF}


def test_weak_cell_begins_at_the_charge_that_an_axis_gives_the_others() -> None:
    shared = {
        "kind": "robot",
        "profile": {"duration_s": 60, "step_s": 2, "duty": 0.3, "load_torque_Nm": 0.1, "ambient_degC": 20.0},
        "effects": {"cell_imbalance": {"d": 0.1}},
        "metrics": ["min_pack_voltage_V", "final_soc"],
    }
    state = run(Study(**shared, axes={"initial.soc": [0.5, 0.8]}))
    parameter = run(Study(**shared, axes={"initial_soc": [0.5, 0.8]}))
    for name in shared["metrics"]:
        np.testing.assert_allclose(state[name].values, parameter[name].values, rtol=1e-12)


def test_cell_without_capacity_left_is_out_of_range(cell_study) -> None:
    """Eq. 8 leaves nothing after 107 months at 20 degC; the state of charge would rise on discharge."""
    found = run(cell_study(axes={"current_A": [1.0], "storage_months": [36.0, 120.0]}, metrics=["valid_share"]))
    assert found["valid_share"].values.ravel().tolist() == [1.0, 0.0]


def test_lane_whose_readings_overflow_is_not_finite(cell_study) -> None:
    """exp(-35 SOC) of the paper's cell overflows below -20: the charge itself is still a number."""
    profile = {"duration_s": 100_000, "step_s": 100, "ambient_degC": 20.0}
    axes = {"current_A": [1.0, 6.0], "storage_months": [0.0]}
    found = run(cell_study(profile=profile, axes=axes, metrics=["min_voltage_V"], cutoff={}))
    assert found["status"].values.ravel().tolist() == [Status.IMPOSSIBLE, Status.NOT_FINITE]


def test_steps_serve_the_slowest_and_the_fastest_motor_of_a_sweep() -> None:
    """Brush drop asks for steps by the least R_0 J / k_tau^2, starts for those by the least L_a / R_0."""
    shared = {
        "kind": "motor",
        "profile": {"duration_s": 60, "step_s": 20, "voltage_V": 10.0, "load_torque_Nm": 0.05, "ambient_degC": 20.0},
        "effects": {"brush_drop": {}},
        "metrics": ["final_winding_temperature_degC"],
    }
    axes = {"R_0": [0.1, 1.0], "J": [1e-4, 1e-3]}
    profile = Study(**shared, axes=axes).prepared.profile
    steps = np.asarray(track(runner._stiffest(Study(**shared, axes=axes)), profile).duration_s)
    begun = np.cumsum(steps) - steps
    p = Study(**shared, axes=axes).prepared.model.parameters
    for resistance, inertia in itertools.product(*axes.values()):
        constant_s = resistance * inertia / float(p.k_tau) ** 2
        settling = begun < SETTLED * constant_s
        assert np.all(steps[settling] <= 1.001 * BENDING_STEP_SHARE * constant_s)
        assert settling.sum() > 10
    assert steps[0] < float(p.L_a) / 1.0
