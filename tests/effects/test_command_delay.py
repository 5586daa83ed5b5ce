"""A lag between command and voltage: against an independent integration, in an open and in a closed loop."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from jaxmodel import Case
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.controllers import SpeedController
from jaxmodel.fit.distinguishable import is_distinguishable
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

K, J, TAU_0, R, L, LAG = 0.0385, 2e-4, 0.01, 0.5, 2e-4, 0.03
NUMBERS = Parameters(k_tau=K, J=J, tau_0=TAU_0, R_0=R, L_a=L, psi_R=0.0)
DELAY = CATALOGUE["command_delay"](tau=LAG)


def ran(effects, time_s: np.ndarray, **inputs) -> dict[str, np.ndarray]:
    given = {"ambient_degC": 20.0, "load_torque_Nm": 0.0} | inputs
    columns = {name: np.broadcast_to(np.asarray(values, dtype=float), time_s.shape) for name, values in given.items()}
    found = simulate(Model("motor", NUMBERS, effects=tuple(effects)), Profile(time_s, columns))
    return {name: np.asarray(values) for name, values in {**found.readings, **found.states}.items()}


def test_a_driven_motor_follows_an_independent_integration():
    time = np.arange(0.0, 0.6005, 1e-3)
    found = ran([DELAY], time, voltage_V=np.where((time < 0.2005) | (time > 0.4005), 12.0, 4.0))

    def rates(t, y):
        current, speed, volts = y
        command = 12.0 if t < 0.2 or t > 0.4 else 4.0
        turning = (K * current - TAU_0 * np.tanh(speed / 1e-3)) / J
        return (volts - R * current - K * speed) / L, turning, (command - volts) / LAG

    exact = solve_ivp(rates, (0.0, 0.6), (0.0, 0.0, 12.0), "Radau", t_eval=time, rtol=1e-8, atol=1e-8, max_step=1e-3).y
    assert found["command_delay.voltage_V"][0] == 12.0  # a run begins with the voltage of its first row
    for name, row in (("current_A", 0), ("speed_rad_s", 1), ("command_delay.voltage_V", 2)):
        # In the first milliseconds the inrush is as steep as one step.
        assert np.abs(found[name] - exact[row])[5:].max() < 4e-3 * np.ptp(exact[row]), name


def test_a_slow_row_ends_where_a_motor_without_a_lag_does():
    time = np.arange(0.0, 10.0, 1.0)
    voltage = np.where(time < 5.0, 0.0, 12.0)
    late, base = (ran(effects, time, voltage_V=voltage) for effects in ([DELAY], []))
    np.testing.assert_allclose(late["speed_rad_s"], base["speed_rad_s"], rtol=1e-6, atol=1e-6)


def test_a_loop_that_is_late_swings_as_its_differential_equation():
    """A speed loop on a voltage: fast without the lag, and ringing with it."""
    gain, limit = 0.3, 24.0
    controller = SpeedController(k_p=gain, limit=limit, column="voltage_V")
    time = np.arange(0.0, 0.5, 5e-4)
    found = ran([controller, DELAY], time, reference_speed_rad_s=100.0)

    def rates(_, y):
        current, speed, volts = y
        command = np.clip(gain * (100.0 - speed), -limit, limit)
        turning = (K * current - TAU_0 * np.tanh(speed / 1e-3)) / J
        return (volts - R * current - K * speed) / L, turning, (command - volts) / LAG

    exact = solve_ivp(rates, (0.0, 0.4995), np.zeros(3), "Radau", t_eval=time, rtol=1e-8, atol=1e-8, max_step=1e-3).y
    assert exact[1].max() > 1.15 * exact[1][-1]
    assert np.abs(found["speed_rad_s"] - exact[1]).max() < 0.01 * exact[1].max()


def test_at_its_null_it_is_not_there():
    time = np.arange(0.0, 1.0, 0.01)
    voltage = 6.0 * np.sin(9.0 * time)
    base, null = (ran(effects, time, voltage_V=voltage) for effects in ([], [CATALOGUE["command_delay"](tau=0.0)]))
    for name, values in base.items():
        np.testing.assert_allclose(null[name], values, rtol=1e-13, atol=1e-13, err_msg=name)


@pytest.mark.parametrize(("row_s", "driven", "told"), [(0.01, True, True), (1.0, True, False), (0.01, False, False)])
def test_it_is_tried_where_a_voltage_drives_a_rotor_in_fast_rows(row_s: float, driven: bool, told: bool):
    time = np.arange(50) * row_s
    table = pd.DataFrame({"time_s": time, "current_A": 1.0, "ambient_degC": 20.0, "speed_rad_s": 127.0})
    if driven:
        table["voltage_V"] = 5.0
    case = Case.from_dataframes({"run": table}, kind="motor", load="free", drive=None if driven else "current")
    assert is_distinguishable(case, CATALOGUE["command_delay"]) is told
