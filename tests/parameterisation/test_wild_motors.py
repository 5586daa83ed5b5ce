"""What people bring of motors: spikes, a start under load, a dead time; and no file that nobody can read."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import case_model
from jaxmodel.case.known import Known
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.data.importing import import_case
from jaxmodel.parameterisation import parameterise
from tests.conftest import Wild

MOTOR = {"k_tau": 0.06, "R_0": 0.8, "J": 4e-4, "tau_0": 0.02, "L_a": 1e-4}
LATE_S = 0.12


def steps(rows: int = 500, step_s: float = 0.005, volts: float = 10.0) -> pd.DataFrame:
    time_s = np.arange(rows) * step_s
    columns = {"time_s": time_s, "voltage_V": np.where(time_s > 0.2, volts, 0.0)}
    return pd.DataFrame(columns | {"load_torque_Nm": 0.0, "ambient_degC": 25.0})


def measured(effects: dict, frames: dict[str, pd.DataFrame], columns=("speed_rad_s",)) -> dict[str, pd.DataFrame]:
    """Readings of a made motor with noise."""
    truth = Case.from_dataframes(frames, kind="motor", parameters=MOTOR, effects=effects)
    found = {}
    for one in simulate_case(truth):
        rng, frame = np.random.default_rng(len(found)), frames[one.run.name].copy()
        for name, sd in (("speed_rad_s", 0.2), ("current_A", 0.02)):
            if name in columns:
                frame[name] = one.table[name] + sd * rng.standard_normal(len(frame))
        found[one.run.name] = frame
    return found


def test_a_dead_time_is_found_and_a_lag_is_none() -> None:
    frames = {f"u{volts:g}": steps(volts=volts) for volts in (5.0, 8.0, 12.0)}
    found = parameterise(
        Case.from_dataframes(
            measured({"clock_shift": {"d": LATE_S}}, frames),
            kind="motor",
            parameters={"R_0": MOTOR["R_0"], "k_tau": (0.07, 0.02)},
            check=["u8"],
        )
    )
    assert found["dead time of the readings"].value == pytest.approx(LATE_S, abs=0.003)
    assert found.case.effects["clock_shift"]["d"] == pytest.approx(LATE_S, abs=0.003)
    assert not found["L_a"].found
    assert found["k_tau"].value == pytest.approx(MOTOR["k_tau"], rel=0.02)
    assert found["J"].value == pytest.approx(MOTOR["J"], rel=0.05)
    assert found.errors.set_index("run").loc["u8", "rms"] < 0.3
    prompt = parameterise(
        Case.from_dataframes(
            measured({}, frames), kind="motor", parameters={"R_0": MOTOR["R_0"], "k_tau": (0.07, 0.02)}
        )
    )
    assert "clock_shift" not in prompt.case.effects


def test_the_parameters_do_without_spikes_and_the_case_keeps_what_was_read() -> None:
    frames = measured({}, {"ramp": steps().assign(voltage_V=np.linspace(0.0, 12.0, 500)), "step": steps()})
    spoilt = {name: frame.copy() for name, frame in frames.items()}
    for frame in spoilt.values():
        frame.loc[[43, 250, 401], "speed_rad_s"] = (-400.0, 900.0, -900.0)
    stated = {"R_0": MOTOR["R_0"]}
    clean, found = (parameterise(Case.from_dataframes(of, kind="motor", parameters=stated)) for of in (frames, spoilt))
    for name in ("k_tau", "J", "tau_0"):
        assert found[name].value == pytest.approx(clean[name].value, rel=0.02)
    told = {(one.code, one.subject): one.numbers for one in found.remarks}
    assert told["outliers_excluded", "speed_rad_s"]["readings"] == 6.0
    assert found.case.runs[0].measured.outputs["speed_rad_s"][250] == 900.0


def first_currents(frame: pd.DataFrame) -> tuple[float, float]:
    """The model's current in the first row of the run, and in the second."""
    case = Case.from_dataframes({"run": frame}, kind="motor", parameters=MOTOR)
    case = dataclasses.replace(
        case, runs=tuple(dataclasses.replace(r, overrides={"initial_speed_rad_s": Known(120.0)}) for r in case.runs)
    )
    found = simulate_case(case)[0].table["current_A"]
    return float(found[0]), float(found[1])


def test_a_winding_under_load_begins_in_equilibrium_or_as_read() -> None:
    load = 0.06 * (10.0 - 0.06 * 120.0) / 0.8 - 0.02  # at which 10 V turn it at 120 rad/s
    frame = steps(20, 5.0).assign(voltage_V=10.0, load_torque_Nm=load, speed_rad_s=120.0)
    at_once, later = first_currents(frame)
    assert at_once == pytest.approx((10.0 - 0.06 * 120.0) / 0.8)
    assert at_once == pytest.approx(later, rel=1e-3)
    assert first_currents(frame.assign(current_A=3.4))[0] == 3.4
    off = frame.assign(voltage_V=np.where(np.arange(20) > 0, 10.0, 0.0))
    assert first_currents(off)[0] == 0.0, "the voltage is off in the first row"
    standing = Case.from_dataframes({"run": frame.assign(speed_rad_s=0.0)}, kind="motor", parameters=MOTOR)
    assert float(case_model(standing, standing.runs[0]).parameters.initial_current_A) == 0.0, "just switched on"


def test_nothing_is_written_that_could_not_be_read(tmp_path: Path) -> None:
    frames = measured({}, {"step": steps()})
    case = Case.from_dataframes(frames, kind="motor", parameters=MOTOR)
    assert read_case(case.write(tmp_path / "good")).runs[0].name == "step"
    for wrong in ({"R_0": Known(-1.0, 0.1)}, {"J": Known(float("nan"), 1.0)}):
        with pytest.raises(MeasurementError, match=r"case.toml is not written, because it could not be read again"):
            dataclasses.replace(case, parameters=case.parameters | wrong).write(tmp_path / "wrong")
        assert not list((tmp_path / "wrong").iterdir())


def test_a_speed_that_comes_a_third_of_a_second_late(wild: Wild) -> None:
    files = wild("16-dead-time-of-a-motor")
    found = parameterise(import_case(files, "motor", ambient=25.0, constants={"load_torque_Nm": 0.0}).case)
    assert found["dead time of the readings"].value == pytest.approx(0.33, abs=0.003)
    errors = found.errors
    assert errors.loc[errors["split"] == "check", "rms"].max() < 0.125


def test_points_of_a_loaded_motor(wild: Wild) -> None:
    files = wild("18-motor-run-begins-under-load")
    columns = {"voltage_V": "voltage_V", "step": "voltage_V"}
    one = import_case(files, "motor", ambient=25.0, seconds_per_row=10.0, columns=columns, split_at="steps")
    errors = parameterise(one.case).errors.set_index("reading")
    assert errors.loc["current_A", "rms"].max() < 0.009


def test_spikes_of_a_motor_move_no_parameter(wild: Wild) -> None:
    files = wild("28-spikes-of-a-motor")
    one = import_case(files, "motor", ambient=25.0, constants={"load_torque_Nm": 0.0}, check=("*reverse",))
    found = parameterise(one.case)
    assert found["k_tau"].value == pytest.approx(0.12, rel=0.01)
    assert found.errors["rms"].max() < 0.16


def test_a_charge_that_does_not_balance_is_written_and_read(wild: Wild, tmp_path: Path) -> None:
    files = wild("12-parameterise-writes-what-nobody-reads")
    found = parameterise(import_case(files, "cell").case)
    assert read_case(found.write(tmp_path / "case", pictures=False)).kind == "cell"
