"""A robot of known truth is recovered from its log: cells, motors, on-board draw, and what its readings cannot give."""

from __future__ import annotations

from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel import read_case
from jaxmodel.base.errors import FitError
from jaxmodel.model.cell import cycle_resistance, storage_factor
from jaxmodel.parameterisation import Parameterisation, parameterise
from tests.parameterisation import made_robot
from tests.parameterisation.made_robot import EXACT, NOISE, TRUE

SIGMAS = 4.0


@pytest.fixture(scope="module")
def found() -> Parameterisation:
    frames = {"one": made_robot.drive(0), "slope": made_robot.drive(1, incline=True), "check": made_robot.drive(2, 600)}
    case = made_robot.robot(frames, check=["check"])
    for values in case.runs[0].measured.outputs.values():
        values[100:110] = np.nan  # a gap is no reading
    return parameterise(case)


@pytest.mark.parametrize("name", ["R_0", "k_tau", "tau_0", "R_wc", "R_ca", "onboard_current_A"])
def test_numbers_of_motors_and_electronics_are_recovered(found: Parameterisation, name: str) -> None:
    one = found[name]
    assert one.found
    assert abs(one.value - TRUE[name]) < SIGMAS * one.sd
    assert one.sd < 0.1 * TRUE[name]
    assert found.case.parameters[name].value == pytest.approx(one.value, rel=1e-5)


def test_cells_are_those_of_today(found: Parameterisation) -> None:
    parameters = found.case.parameters
    assert parameters["cycles"].value == parameters["storage_months"].value == 0.0
    left = float(
        storage_factor(*(jnp.asarray(EXACT[n], float) for n in ("storage_months", "storage_temperature_degC")))
    )
    assert parameters["capacity_Ah"].value == pytest.approx(left * TRUE["capacity_Ah"], rel=0.03)
    series = found["R_ints at SOC 0.9, 20 degC"]
    assert series.value > float(cycle_resistance(jnp.asarray(EXACT["cycles"], float)))  # the age is in the resistance
    assert "age_included" in {one.code for one in found.remarks}


def test_forward_simulation_is_as_good_as_the_sensors(found: Parameterisation) -> None:
    errors = found.errors.set_index(["run", "reading"])["rms"]
    for (run, reading), rms in errors.items():  # pyright: ignore[reportGeneralTypeIssues]
        limit = 3.0 if reading == "pack_voltage_V" and run == "check" else 1.6
        assert rms < limit * NOISE[reading], (run, reading)


def test_noise_is_that_of_the_sensors_of_the_robot(found: Parameterisation) -> None:
    for name, sd in NOISE.items():
        assert found[f"noise of {name}"].value == pytest.approx(sd, rel=0.3)
        assert found.case.sensors[name] == pytest.approx(found[f"noise of {name}"].value, rel=5e-3)
    assert "voltage_V" not in found.case.sensors


def test_case_that_is_written_is_read_again(found: Parameterisation, tmp_path: Path) -> None:
    again = read_case(found.write(tmp_path / "out", pictures=False))
    assert again.kind == "robot"
    assert again.parameters["R_0"].value == pytest.approx(found["R_0"].value, rel=1e-5)
    assert set(again.tables) == {"ocv", "R_ints", "R_TS", "R_TL", "C_TS", "C_TL"}


def test_a_robot_without_a_motors_current_gives_its_cells_and_no_draw() -> None:
    readings = ("pack_voltage_V", "pack_current_A")
    found = parameterise(made_robot.robot({"one": made_robot.drive(0)}, readings))
    assert found["R_ints at SOC 0.9, 20 degC"].found
    for name in ("motors", "onboard_current_A"):
        assert not found[name].found
        assert "motor" in found[name].test
    assert found.case.parameters["R_0"].value == pytest.approx(1.1 * TRUE["R_0"])  # as stated


def test_a_robot_without_a_packs_current_gives_its_motors() -> None:
    readings = ("pack_voltage_V", "motor_current_A", "speed_rad_s")
    found = parameterise(made_robot.robot({"one": made_robot.drive(0, 400)}, readings))
    assert abs(found["R_0"].value - TRUE["R_0"]) < SIGMAS * found["R_0"].sd
    assert "pack current" in found["cells"].test
    assert found.case.parameters["cycles"].value == EXACT["cycles"]
    assert not found.case.tables


def test_a_robot_with_neither_is_refused_in_one_sentence() -> None:
    case = made_robot.robot({"one": made_robot.drive(0, 300)}, ("winding_temperature_degC",))
    with pytest.raises(FitError, match=r"cells or motors; give 'pack_voltage_V'"):
        parameterise(case)
