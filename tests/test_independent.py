"""Tests of the independent simulator: reference trajectories, conservation laws and closed forms."""

from __future__ import annotations

import tomllib
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import CubicSpline
from scipy.linalg import expm

from benchmarks.independent import Run, make_profile, simulate, write_case
from benchmarks.independent.equations import open_circuit_voltage, series_resistance
from benchmarks.independent.forms import OTHER_FORMS
from benchmarks.independent.integrate import prepare_parameters
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.declaration import describe

REFERENCE = Path(__file__).resolve().parents[1].parent / "shared" / "reference"
INPUTS = {
    "cell": ["current_A", "ambient_degC"],
    "motor": ["voltage_V", "load_torque_Nm", "ambient_degC"],
    "robot": ["duty", "load_torque_Nm", "ambient_degC"],
}
# What a made measurement must not be wrong by, far below any sensor: by the end of the column's name.
LARGEST_ERROR = {"soc": 1e-8, "_V": 1e-6, "_A": 1e-5, "_rad_s": 1e-4, "_degC": 1e-5, "_W": 1e-4}


def steps(time_s: np.ndarray, *levels: tuple[float, float]) -> np.ndarray:
    """Return a staircase: each (start, level) acts on the rows after its start."""
    values = np.zeros_like(time_s)
    for start, level in levels:
        values[time_s > start] = level
    return values


def integral(time_s: np.ndarray, values: np.ndarray) -> float:
    """Return the integral of smooth samples over their whole time."""
    return float(CubicSpline(time_s, values).integrate(time_s[0], time_s[-1]))


@pytest.mark.skipif(not REFERENCE.is_dir(), reason="the reference trajectories lie beside the repository")
@pytest.mark.parametrize(
    ("name", "rows"),
    [
        ("base-13", 250),
        ("effect-self_discharge", 120),
        ("effect-temperature_lag", 60),
        ("base-07", 130),
        ("effect-bridge_resistance", 60),
    ],
)
def test_reference_trajectory(name: str, rows: int) -> None:
    described = tomllib.loads((REFERENCE / f"{name}.toml").read_text())
    data = pd.read_csv(REFERENCE / f"{name}.csv").iloc[:rows]
    profile = {column: data[column].to_numpy() for column in ["time_s", *INPUTS[described["kind"]]]}
    soc = described.get("initial_soc", 1.0)
    result = simulate(described["kind"], described["parameters"], profile, described["effects"], soc)
    readings = [column for column in data if column not in profile]
    assert set(readings) == set(result)
    for column in readings:
        allowed = next(limit for ending, limit in LARGEST_ERROR.items() if column.endswith(ending))
        np.testing.assert_allclose(result[column], data[column], rtol=0.0, atol=allowed, err_msg=column)


@pytest.mark.slow
def test_charge_taken_is_charge_lost() -> None:
    profile = make_profile("cell", "pulse train", 3, duration_s=300.0, step_s=1.5, reversing=True)
    result = simulate("cell", {"capacity_Ah": 4.0, "storage_months": 0}, profile, initial_soc=0.7)
    taken = np.concatenate([[0.0], np.cumsum(profile["current_A"][1:] * np.diff(profile["time_s"]))])
    assert profile["current_A"].min() < 0.0 < profile["current_A"].max()
    np.testing.assert_allclose(0.7 - result["soc"], taken / (3600.0 * 4.0), rtol=0.0, atol=1e-12)


@pytest.mark.slow
def test_constant_current_fills_two_capacitors() -> None:
    # Near SOC 1 and with a huge capacity the printed curves are constant to 2e-6.
    time_s = np.linspace(0.0, 600.0, 121)
    profile = {"time_s": time_s, "current_A": np.full(121, 3.0), "ambient_degC": np.full(121, 20.0)}
    parameters = {"capacity_Ah": 1e7, "series_resistance_scale": 2.0, "rc_resistance_scale": 1.5, "cycles": 100}
    result = simulate("cell", parameters, profile)
    short = 3.0 * 1.5 * 0.04669 * (1.0 - np.exp(-time_s / (1.5 * 0.04669 * 703.6)))
    long = 3.0 * 1.5 * 0.04984 * (1.0 - np.exp(-time_s / (1.5 * 0.04984 * 4475.0)))
    series = 2.0 * (-1.399e-5 * 400.0 - 2.768e-4 * 20.0 + 0.07446 + 0.0015 * 10.0)
    np.testing.assert_allclose(result["v_ts_V"], short, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(result["voltage_V"], 4.1029 - 3.0 * series - short - long, rtol=0.0, atol=2e-6)


@pytest.mark.slow
def test_heat_made_is_heat_stored_or_lost() -> None:
    time_s = np.arange(0.0, 401.0, 2.0)
    profile = {"time_s": time_s, "current_A": np.full(201, 4.0), "ambient_degC": np.full(201, 5.0)}
    effects = {"self_heating": {"C_th": 40.0, "hA": 0.2}, "entropic_ocv": {"dU_dT": -2e-4}}
    result = simulate("cell", {}, profile, effects, 0.9)
    warmer = result["cell_temperature_degC"] - 5.0
    reversible = 4.0 * (result["cell_temperature_degC"] + 273.15) * 2e-4
    heat = 4.0 * (result["open_circuit_voltage_V"] - result["voltage_V"]) + reversible
    assert warmer[-1] > 3.0
    stored_or_lost = 40.0 * warmer[-1] + 0.2 * integral(time_s, warmer)
    assert stored_or_lost == pytest.approx(integral(time_s, heat), rel=1e-7)


def test_tables_are_interpolated_and_held() -> None:
    cold_and_warm = [[0.10, 0.06], [0.04, 0.02]]
    p = prepare_parameters(
        {
            "ocv": {"soc": [0.0, 0.5, 1.0], "voltage_V": [3.0, 3.6, 4.2]},
            "R_ints": {"soc": [0.0, 1.0], "temperature_degC": [0.0, 20.0], "ohm": cold_and_warm},
        }
    )
    for soc, voltage in [(0.25, 3.3), (-0.1, 3.0), (1.2, 4.2)]:
        assert open_circuit_voltage(jnp.asarray(soc), jnp.asarray(7.0), p) == pytest.approx(voltage, abs=1e-14)
    for temperature, ohm in [(5.0, 0.0675), (-30.0, 0.08), (50.0, 0.03)]:
        assert series_resistance(jnp.asarray(0.5), jnp.asarray(temperature), p) == pytest.approx(ohm, abs=1e-14)


@pytest.mark.slow
def test_friction_drives_stops_and_holds() -> None:
    # Without a torque constant the load alone moves the rotor, and every speed is a straight line.
    time_s = np.arange(0.0, 1.0001, 0.01)
    load = steps(time_s, (0.1, -0.03), (0.3, 0.0), (0.8, 0.0099), (0.9, 0.02))
    profile = {"time_s": time_s, "voltage_V": 0.0 * time_s, "load_torque_Nm": load, "ambient_degC": 20.0 + 0.0 * time_s}
    result = simulate("motor", {"k_tau": 0.0, "tau_0": 0.01, "J": 1e-4}, profile)
    up = 200.0 * np.clip(time_s - 0.1, 0.0, 0.2)
    down = 100.0 * np.clip(time_s - 0.3, 0.0, 0.4)
    backwards = 100.0 * np.clip(time_s - 0.9, 0.0, None)
    np.testing.assert_allclose(result["speed_rad_s"], up - down - backwards, rtol=0.0, atol=1e-8)
    assert np.all(result["speed_rad_s"][(time_s > 0.705) & (time_s < 0.9)] == 0.0)
    np.testing.assert_allclose(result["motor_loss_W"], 0.01 * np.abs(up - down - backwards), rtol=0.0, atol=1e-9)


@pytest.mark.slow
def test_start_of_a_linear_motor() -> None:
    resistance, inductance, k, inertia = 0.1, 7.2e-5, 0.0385, 5.42e-5
    time_s = np.concatenate([[0.0], np.geomspace(1e-5, 0.05, 60)])
    profile = {"time_s": time_s, "voltage_V": np.full(61, 12.0), "load_torque_Nm": np.zeros(61)}
    profile["ambient_degC"] = np.full(61, 20.0)
    result = simulate("motor", {"R_0": resistance, "psi_R": 0.0, "tau_0": 0.0}, profile)
    system = np.array([[-resistance / inductance, -k / inductance], [k / inertia, 0.0]])
    settled = np.array([0.0, 12.0 / k])
    exact = np.array([settled - expm(system * t) @ settled for t in time_s])
    np.testing.assert_allclose(result["current_A"], exact[:, 0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(result["speed_rad_s"], exact[:, 1], rtol=0.0, atol=1e-6)


@pytest.mark.slow
def test_motor_driven_by_current() -> None:
    time_s = np.arange(0.0, 0.2001, 0.01)
    current = steps(time_s, (0.0, 2.0))
    profile = {"time_s": time_s, "current_A": current, "load_torque_Nm": 0.0 * time_s}
    profile["ambient_degC"] = np.full_like(time_s, 25.0)
    result = simulate("motor", {"psi_R": 0.0}, profile)
    speed = (0.0385 * 2.0 - 0.01) / 5.42e-5 * time_s
    np.testing.assert_allclose(result["speed_rad_s"], speed, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(result["voltage_V"], 0.103 * current + 0.0385 * speed, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_robot_keeps_charge_and_energy_through_a_start() -> None:
    time_s = np.concatenate([[0.0], np.geomspace(2e-6, 1.0, 500)])
    duty, load, rows = 0.3, 0.008, len(time_s)
    profile = {"time_s": time_s, "duty": np.full(rows, duty), "load_torque_Nm": np.full(rows, load)}
    profile["ambient_degC"] = np.full(rows, 20.0)
    effects = {"constant_power_load": {"s": 0.7}, "charge_transfer": {"i_0": 1.0}, "viscous_friction": {"b": 1e-5}}
    result = simulate("robot", {"storage_months": 0}, profile, effects, 0.9)
    current, pack_voltage = result["motor_current_A"], result["pack_voltage_V"]
    assert current.max() > 3.0 * current[-1]
    onboard = 0.3 * (0.3 + 0.7 * 3.8 * 6 / pack_voltage)
    np.testing.assert_allclose(result["pack_current_A"], 2.0 * duty * current + onboard, rtol=1e-12)
    lost = (0.9 - result["soc"][-1]) * 3600.0 * 5.2
    assert lost == pytest.approx(integral(time_s, result["pack_current_A"]), rel=1e-6)
    given = integral(time_s, duty * pack_voltage * current)
    used = integral(time_s, result["motor_loss_W"] + load * result["speed_rad_s"])
    stored = 0.5 * 7.2e-5 * current[-1] ** 2 + 0.5 * 5.42e-5 * result["speed_rad_s"][-1] ** 2
    assert given == pytest.approx(used + stored, rel=1e-5)


@pytest.mark.slow
def test_sensor_faults_change_what_is_read_not_what_happened() -> None:
    profile = make_profile("cell", "varying load", 1, duration_s=120.0)
    truth = simulate("cell", {}, profile)
    reported = {**profile, "current_A": profile["current_A"] + 0.2}
    offset = simulate("cell", {}, reported, {"current_offset": {"column": "current_A", "c": 0.2}})
    np.testing.assert_allclose(offset["voltage_V"], truth["voltage_V"], rtol=0.0, atol=1e-12)
    late = simulate("cell", {}, profile, {"clock_shift": {"d": 3.0}})
    np.testing.assert_array_equal(late["voltage_V"][3:], truth["voltage_V"][:-3])
    np.testing.assert_array_equal(late["voltage_V"][:3], truth["voltage_V"][0])
    gained = simulate("cell", {}, profile, {"voltage_gain": {"column": "voltage_V", "g": 0.01}})
    np.testing.assert_allclose(gained["voltage_V"], 1.01 * truth["voltage_V"], rtol=1e-15)
    with pytest.raises(ValueError, match="no effect is called"):
        simulate("cell", {}, profile, {"self_heeting": {"C_th": 40.0}})


@pytest.mark.slow
def test_written_case_holds_the_truth_and_its_noise(tmp_path: Path) -> None:
    profile = make_profile("cell", "load steps", 5, duration_s=900.0)
    run = Run(
        profile, initial_soc=0.93, stated_soc=(0.95, 0.01), split="check", label="steps", parameters={"cycles": 60}
    )
    hidden = {"ocv_hysteresis": {"M_V": 0.02, "g": 60.0}, "current_offset": {"column": "current_A", "c": 0.05}}
    stated = {"capacity_Ah": (5.2, 0.15), "storage_months": 0}
    made = {"effects": hidden, "sensors": {"voltage_V": 0.002, "current_A": 0.003}, "quantisation": {"voltage_V": 5e-4}}
    for folder, seed in [("a", 1), ("again", 1), ("other", 2)]:
        clean = write_case(tmp_path / folder, "cell", {"storage_months": 0}, stated, [run], seed=seed, **made)[0]
    case = tomllib.loads((tmp_path / "a" / "case.toml").read_text())
    assert case["parameters"] == {"capacity_Ah": {"value": 5.2, "sd": 0.15}, "storage_months": 0}
    assert case["runs"][0] | {"cycles": 60, "split": "check"} == case["runs"][0]
    assert case["runs"][0]["initial_soc"] == {"value": 0.95, "sd": 0.01}
    answer = tomllib.loads((tmp_path / "a" / "answer.toml").read_text())
    assert answer["effect_parameters"] == hidden
    assert answer["true_initial_soc"] == [0.93]
    written = pd.read_csv(tmp_path / "a" / "run-01.csv")
    assert list(written) == ["time_s", "current_A", "ambient_degC", "voltage_V"]
    on_grid = written["voltage_V"] / 5e-4
    np.testing.assert_allclose(on_grid, np.round(on_grid), rtol=0.0, atol=1e-8)
    assert np.std(written["voltage_V"] - clean["voltage_V"]) == pytest.approx(0.002, rel=0.1)
    assert np.mean(written["current_A"] - profile["current_A"]) == pytest.approx(0.05, abs=5e-4)
    texts = {folder: (tmp_path / folder / "run-01.csv").read_text() for folder in ("a", "again", "other")}
    assert texts["a"] == texts["again"] != texts["other"]


@pytest.mark.slow
def test_coloured_noise_keeps_its_size(tmp_path: Path) -> None:
    profile = make_profile("cell", "constant load", 2, duration_s=1200.0, step_s=0.5, largest_drive=2.0)
    clean = write_case(
        tmp_path, "cell", {}, {}, [Run(profile)], sensors={"voltage_V": 0.01}, autocorrelation={"voltage_V": 0.6}
    )[0]
    noise = pd.read_csv(tmp_path / "run-01.csv")["voltage_V"].to_numpy() - clean["voltage_V"]
    assert np.std(noise) == pytest.approx(0.01, rel=0.1)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.6, abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHER_FORMS)
def test_other_forms_are_like_the_catalogues_and_not_the_same(name: str) -> None:
    kind = next(kind for kind in ("cell", "motor") if kind in CATALOGUE[name].kinds)
    profile = make_profile(kind, "varying load", 5, duration_s=240.0, step_s=3.0, ambient_degC=-5.0)
    given = {parameter: info.typical[-1] for parameter, info in describe(CATALOGUE[name]).items() if info.typical}
    if name == "charge_transfer":
        given = {"i_0": 0.5, "E_i": 0.0}
    forms = [{}, {name: given}, {name: given | {"other": 1.0}}]
    read = [simulate(kind, {}, profile, effects, 0.6) for effects in forms]
    usual, other = (
        np.concatenate([(moved[column] - read[0][column]) / (1e-3 + np.ptp(read[0][column])) for column in read[0]])
        for moved in read[1:]
    )
    cosine = usual @ other / (np.linalg.norm(usual) * np.linalg.norm(other))
    assert 0.6 < cosine < 1.0 - 1e-6
    assert 0.4 < np.linalg.norm(other) / np.linalg.norm(usual) < 2.5
