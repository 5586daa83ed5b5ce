"""Sensor faults against a plain computation of what the sensor would have read."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from tests.model.runs import readings, staircase

TIME = np.arange(100) * 1.0
DRIVEN_BY = {"cell": ("current_A", 4.0), "motor": ("voltage_V", 12.0), "robot": ("duty", 0.5)}


def profile(kind: str, **changes: np.ndarray) -> Profile:
    """A staircase under an ambient that swings."""
    levels = staircase(5, TIME.size, 1.0)
    name, largest = DRIVEN_BY[kind]
    inputs = {"ambient_degC": 20.0 + 5.0 * np.sin(TIME / 17.0), name: largest * levels}
    if kind != "cell":
        inputs["load_torque_Nm"] = 0.1 * levels
    return Profile(TIME, inputs | changes)


def sensed(given: Profile, kind: str, fault: str = "", **values) -> dict[str, np.ndarray]:
    faults = (CATALOGUE[fault](**values),) if fault else ()
    return readings(Model(kind, Parameters(initial_soc=0.8), effects=faults), given)


@pytest.mark.parametrize("kind", ["cell", "motor", "robot"])
@pytest.mark.parametrize(
    ("fault", "null"), [("temperature_lag", {"tau": 0.0}), ("clock_shift", {"d": 0.0, "resampled": 0.7})]
)
def test_a_sensor_without_memory_reads_the_truth_to_the_bit(kind: str, fault: str, null: dict[str, float]):
    truth, read = sensed(profile(kind), kind), sensed(profile(kind), kind, fault, **null)
    for name, values in truth.items():
        np.testing.assert_array_equal(read[name], values, err_msg=name)


def test_a_lag_follows_the_ambient_in_one_exponential_a_row():
    given, tau = profile("cell"), 12.0
    expected = [given.inputs["ambient_degC"][0]]
    for temperature in given.inputs["ambient_degC"][1:]:
        expected.append(temperature + (expected[-1] - temperature) * np.exp(-1.0 / tau))
    read = sensed(given, "cell", "temperature_lag", column="cell_temperature_degC", tau=tau)
    np.testing.assert_allclose(read["cell_temperature_degC"], expected, rtol=1e-13)


def test_a_lag_follows_a_winding_that_warms():
    """Against a fine integration of the lag behind a spline of the true temperature."""
    steady = {"voltage_V": np.full(100, 12.0), "load_torque_Nm": np.full(100, 0.2), "ambient_degC": np.full(100, 20.0)}
    given, tau = profile("motor", **steady), 8.0
    truth = sensed(given, "motor")["winding_temperature_degC"]
    trajectory = CubicSpline(TIME[1:], truth[1:])
    read = sensed(given, "motor", "temperature_lag", column="winding_temperature_degC", tau=tau)
    found = read["winding_temperature_degC"]
    lag = solve_ivp(
        lambda t, y: (trajectory(t) - y) / tau, (1.0, 99.0), [found[1]], t_eval=TIME[1:], rtol=1e-9, atol=1e-9
    )
    np.testing.assert_allclose(found[1:], lag.y[0], rtol=0.0, atol=1e-4)
    assert np.max(truth - found) > 0.5


@pytest.mark.parametrize("delay", [3.0, -7.0, 0.25, -1.5, 60.0])
def test_a_late_clock_shows_what_was(delay: float):
    """Charge is straight within a row, the ambient constant: both are known at every moment; ends are held."""
    given = profile("cell")
    truth, read = sensed(given, "cell"), sensed(given, "cell", "clock_shift", d=delay)
    moment = np.clip(TIME - delay, 0.0, TIME[-1])
    np.testing.assert_allclose(read["soc"], np.interp(moment, TIME, truth["soc"]), rtol=0.0, atol=1e-14)
    acting = np.ceil(moment).astype(int)
    np.testing.assert_allclose(read["cell_temperature_degC"], given.inputs["ambient_degC"][acting], rtol=1e-14)
    if delay == round(delay):
        np.testing.assert_allclose(read["voltage_V"], truth["voltage_V"][moment.astype(int)], rtol=1e-14)


@pytest.mark.parametrize("delay", [3.0, -7.0, 0.25])
def test_a_resampled_clock_shows_straight_lines_between_rows(delay: float):
    given = profile("cell")
    truth, read = sensed(given, "cell"), sensed(given, "cell", "clock_shift", d=delay, resampled=1.0)
    for name in truth:
        np.testing.assert_allclose(read[name], np.interp(TIME - delay, TIME, truth[name]), rtol=1e-13, err_msg=name)


@pytest.mark.parametrize(
    ("kind", "fault", "column", "values", "seen"),
    [
        ("motor", "current_offset", "current_A", {"c": 0.3}, lambda x: x + 0.3),
        ("cell", "voltage_gain", "voltage_V", {"g": -0.02}, lambda x: 0.98 * x),
        ("robot", "voltage_offset", "pack_voltage_V", {"c": 0.1}, lambda x: x + 0.1),
    ],
)
def test_a_faulty_scale_changes_one_reading_and_nothing_that_happened(kind, fault, column, values, seen):
    truth, read = sensed(profile(kind), kind), sensed(profile(kind), kind, fault, column=column, **values)
    for name in truth:
        expected = seen(truth[name]) if name == column else truth[name]
        np.testing.assert_allclose(read[name], expected, rtol=1e-15, atol=1e-14, err_msg=name)


@pytest.mark.parametrize(
    ("kind", "fault", "column", "values", "true"),
    [
        ("cell", "current_offset", "current_A", {"c": 0.3}, lambda x: x - 0.3),
        ("motor", "voltage_gain", "voltage_V", {"g": 0.02}, lambda x: x / 1.02),
    ],
)
def test_a_faulty_sensor_of_an_input_tells_what_truly_acted(kind, fault, column, values, true):
    reported = profile(kind)
    acted = profile(kind, **{column: true(reported.inputs[column])})
    faulty, truth = sensed(reported, kind, fault, column=column, **values), sensed(acted, kind)
    for name in truth:
        np.testing.assert_allclose(faulty[name], truth[name], rtol=1e-11, atol=1e-11, err_msg=name)
