"""A number of a study in another unit is said with what mends it; the study runs, and right ones hear nothing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel import Status, sweeps
from jaxmodel.base.errors import RemarkWarning, SweepError
from jaxmodel.sweeps.plausible import odd_values

REPOSITORY = Path(__file__).parents[2]
TIMES = {"duration_s": 600, "step_s": 10, "ambient_degC": 20.0}
MOTOR = {"voltage_V": 14.0, "load_torque_Nm": 0.1}


def study(kind: str, profile: dict[str, Any], axes: dict[str, Any], **more: Any) -> sweeps.Study:
    return sweeps.Study(kind=kind, profile={**TIMES, **profile}, axes=axes, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "profile", "axes", "parameters", "said"),
    [
        ("motor", {"voltage_V": 14.0}, {"load_torque_Nm": [50.0, 175.0]}, {}, ("axes.load_torque_Nm: 175 N m", "mN m")),
        ("motor", MOTOR | {"load_torque_Nm": 20.0}, {"R_0": [0.1, 0.2]}, {}, ("profile.load_torque_Nm: 20", "N cm")),
        ("robot", {"duty": 0.3}, {"load_torque_Nm": [100.0, 200.0]}, {}, ("axes.load_torque_Nm: 200", "mN m")),
        ("motor", MOTOR | {"voltage_V": 14e3}, {"R_0": [0.1, 0.2]}, {}, ("profile.voltage_V: 14000 V", "mV")),
        ("motor", MOTOR, {"R_0": [0.1, 0.2]}, {"J": 560.0}, ("parameters.J: 560 kg m2", "g cm2")),
        ("motor", MOTOR, {"R_0": [0.1, 0.2]}, {"k_tau": 38.5}, ("parameters.k_tau: 38.5", "mN m/A")),
        ("cell", {}, {"current_A": [500.0, 2500.0]}, {}, ("axes.current_A: 2500 A", "mA,")),
        ("cell", {"current_A": 2.0}, {"scale.current_A": [1.0, 1e3]}, {}, ("axes.scale.current_A: 2000 A", "mA,")),
        ("cell", {"current_A": 2.0}, {"cycles": [1, 2]}, {"capacity_Ah": 5200.0}, ("parameters.capacity_Ah", "mA h")),
    ],
)
def test_a_number_in_another_unit_is_said(
    kind: str, profile: dict[str, Any], axes: dict[str, Any], parameters: dict[str, float], said: tuple[str, str]
):
    (sentence,) = odd_values(study(kind, profile, axes, parameters=parameters))
    assert sentence.startswith(said[0])
    assert f"if it is in {said[1]}" in sentence


@pytest.mark.parametrize(
    ("kind", "profile", "axes"),
    [
        ("motor", {"voltage_V": 14.0}, {"load_torque_Nm": [0.0, 0.35, 5.0]}),  # up to standstill
        ("motor", {"load_torque_Nm": 0.1}, {"current_A": [1.0, 20.0]}),
        ("robot", {"V_set": 3.0}, {"load_torque_Nm": [-0.1, 0.35], "mass_kg": [5.0, 50.0]}),
        ("cell", {}, {"current_A": [-10.0, 0.0, 100.0], "capacity_Ah": [2.0, 300.0]}),  # a pulse at 50 C
    ],
)
def test_what_can_be_is_not_said(kind: str, profile: dict[str, Any], axes: dict[str, Any]):
    assert not list(odd_values(study(kind, profile, axes)))


@pytest.mark.parametrize("file", ["docs/paper_tables.toml", "examples/paper_sweep.toml", "examples/pulsed_cell.toml"])
def test_studies_that_are_shipped_are_not_doubted(file: str):
    assert not list(odd_values(sweeps.read_study(REPOSITORY / file)))


@pytest.mark.parametrize(
    ("name", "value", "todo"),
    [
        ("duty", 30.0, "if it is in percent, multiply duty by 0.01"),
        ("ambient_degC", 293.0, "if it is in kelvin, subtract 273.15 from ambient_degC"),
        ("V_set", 3000.0, "if it is in mV, multiply V_set by 0.001"),
    ],
)
def test_an_input_beyond_its_bounds_is_refused_with_its_mend(name: str, value: float, todo: str):
    others = {"duty": 0.3, "load_torque_Nm": 0.1} if name != "V_set" else {"load_torque_Nm": 0.1}
    with pytest.raises(SweepError, match=todo):
        study("robot", others | {name: value}, {"cycles": [1, 2]})


def test_a_torque_in_mNm_leaves_no_lane_complete_and_harms_no_other():
    """200 times the stall torque heats the winding far above the 1085 degC at which its copper melts."""
    with pytest.warns(RemarkWarning, match="times the torque at which this motor stands still"):
        found = sweeps.run(study("motor", {"voltage_V": 14.0}, {"load_torque_Nm": [0.1, 1000.0]}))
    assert found["status"].values.tolist() == [Status.COMPLETE, Status.IMPOSSIBLE]
    assert float(found["peak_winding_temperature_degC"][1]) > 1e6
    alone = sweeps.run(study("motor", {"voltage_V": 14.0}, {"load_torque_Nm": [0.1]}))
    np.testing.assert_array_equal(found["peak_winding_temperature_degC"][:1], alone["peak_winding_temperature_degC"])
    assert "impossible" in found["status"].attrs["flag_meanings"]


def test_a_lane_that_is_impossible_for_a_while_is_not_complete():
    """A load that ends: the winding cools below the melting point again, and the lane stays impossible."""
    load = {"load_torque_Nm": {"high": 30.0, "on_s": 20, "period_s": 36_000}}
    profile = {"duration_s": 36_000, "step_s": 10, "ambient_degC": 20.0, "voltage_V": 2.0, "pulses": load}
    with pytest.warns(RemarkWarning, match="stands still"):
        found = sweeps.run(sweeps.Study(kind="motor", profile=profile, axes={"psi_R": [0.0039]}))
    assert float(found["peak_winding_temperature_degC"][0]) > 1085.0 > float(found["final_winding_temperature_degC"][0])
    assert found["status"].values.tolist() == [Status.IMPOSSIBLE]
