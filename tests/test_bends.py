"""Long rows of a nonlinear motor, against the independent simulator: no ringing, no divergence, correct heat."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.independent import simulate
from jaxmodel.case.build import make_effect
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate as run

STRONG = {"R_0": 0.063, "k_tau": 0.039}  # an inrush of two hundred ampere
SLOW = STRONG | {"J": 0.003}  # on a brake, with a time constant of an eighth of a second
# Of the independent simulator. At 1e-10 rounding stalls it at coasting brushes, on some processors.
TOLERANCE = 1e-9


def held(*levels: float) -> np.ndarray:
    """Each level for six rows."""
    return np.append(levels[0], np.repeat(levels, 6))


# A drop so large that the rotor coasts for a tenth of a second without current; starts and stops of saturated iron.
DRIVES = held(12.1, 3.0, 13.2, 10.4, 0.0, -5.0), held(0.1, 0.04, 0.1, 0.04, 0.0, -0.1)
STARTS = held(0.0, 12.0, 0.0, -10.0, 0.0, 14.0), held(0.0, 0.15, 0.0, -0.12, 0.0, 0.17)
REVERSALS = held(6.0, 12.0, -8.0, 10.0, 0.0, 14.0), held(0.0, 0.1, 0.0, 0.1, 0.0, 0.1)
CASES = {
    "coasting": (STRONG, "brush_drop", {"V_b": 1.5}, *DRIVES),
    "little drop": (STRONG, "brush_drop", {"V_b": 0.1}, *DRIVES),
    "starting": (STRONG, "saturation", {"i_s": 40.0}, *STARTS),
    "reversing": (STRONG, "saturation", {"i_s": 60.0}, *REVERSALS),
    "slow": (SLOW, "brush_drop", {"V_b": 0.35}, *DRIVES),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_long_rows_of_a_motor_whose_law_bends(case: str):
    hardware, effect, numbers, voltage, load = CASES[case]
    inputs = {"voltage_V": voltage, "load_torque_Nm": load, "ambient_degC": np.full(voltage.size, 20.0)}
    time = 1.5 * np.arange(voltage.size)
    truth = simulate("motor", hardware, {"time_s": time, **inputs}, {effect: numbers}, tolerance=TOLERANCE)
    model = Model("motor", Parameters(**hardware), effects=(make_effect(effect, numbers, case),))
    found = run(model, Profile(time, inputs)).readings
    warmest = truth["winding_temperature_degC"].max() - 20.0
    # Within a row of a slow rotor its start goes on, and with it the errors of the steps.
    current, speed = (0.1, 0.7) if hardware is SLOW else (2e-3, 0.05)
    np.testing.assert_allclose(found["current_A"], truth["current_A"], rtol=0.0, atol=current)
    np.testing.assert_allclose(found["speed_rad_s"], truth["speed_rad_s"], rtol=0.0, atol=speed)
    heat = found["winding_temperature_degC"] - truth["winding_temperature_degC"]
    assert np.abs(heat).max() < 0.003 * warmest, (np.abs(heat).max(), warmest)


HEAVY = (0.0005, 0.003, 0.03)  # kg m^2; up to a rotor that draws some 100 A for seconds


@pytest.mark.slow
@pytest.mark.parametrize("J", HEAVY)
def test_a_heavy_rotor_starts_in_long_rows_while_its_winding_warms(J: float):
    time = np.arange(0.0, 4.1, 0.5)
    inputs = {name: np.full(time.size, value) for name, value in (("voltage_V", 14.0), ("ambient_degC", 20.0))}
    inputs["load_torque_Nm"] = np.zeros(time.size)
    truth = simulate("motor", {"J": J}, {"time_s": time, **inputs}, {}, tolerance=TOLERANCE)
    found = run(Model("motor", Parameters(J=J)), Profile(time, inputs)).readings
    np.testing.assert_allclose(found["current_A"], truth["current_A"], rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(found["speed_rad_s"], truth["speed_rad_s"], rtol=0.0, atol=0.01)
