"""The candidate effects at their null values, and the sensor effects applied to readings and reported inputs."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.independent.forms import OTHER_FORMS

Effects = Mapping[str, Mapping[str, Any]]
Columns = dict[str, np.ndarray]

NULL: dict[str, dict[str, float]] = {
    "arrhenius_resistance": {"E_a": 0.0},
    "capacity_temperature": {"a": 0.0},
    "rate_capacity": {"p": 1.0},
    "ocv_hysteresis": {"M_V": 0.0, "g": 0.0, "b": 0.0},
    "entropic_ocv": {"dU_dT": 0.0},
    "self_heating": {"on": 0.0, "C_th": 1.0, "hA": 0.0},
    "slow_diffusion": {"R_3": 0.0, "tau_3": 1.0e3},
    "charge_transfer": {"i_0": math.inf, "E_i": 0.0},
    "self_discharge": {"R_self": math.inf},
    "cell_imbalance": {"d": 0.0},
    "resistance_ageing": {"c": 0.0},
    "magnet_temperature": {"psi_k": 0.0},
    "saturation": {"i_s": math.inf},
    "brush_drop": {"V_b": 0.0},
    "viscous_friction": {"b": 0.0},
    "stribeck_friction": {"tau_s": 0.0, "w_s": 1.0},
    "windage": {"c": 0.0},
    "friction_temperature": {"b_T": 0.0},
    "gear_loss": {"e": 0.0},
    "iron_loss": {"T_h": 0.0, "w_e": 1.0},
    "heat_path": {"s": 0.0},
    "pwm_ripple": {"k_r": 0.0},
    "bridge_resistance": {"R_on": 0.0},
    "constant_power_load": {"s": 0.0},
    "onboard_temperature": {"a": 0.0},
    "arrhenius_polarisation": {"E_rc": 0.0},
    "capacity_fade": {"f": 0.0},
    "discharge_resistance": {"d": 0.0},
    "directional_friction": {"a": 0.0},
    "brush_current_drop": {"V_l": 0.0, "i_b": 1.0},
    "bridge_dead_time": {"d": 0.0},
    "temperature_lag": {"tau": math.inf, "cell": 0.0, "winding": 0.0, "case": 0.0},
}
for _name in OTHER_FORMS:
    NULL[_name]["other"] = 0.0
GAINS = ("voltage_gain", "current_gain", "speed_gain", "torque_gain", "temperature_gain")
OFFSETS = ("current_offset", "voltage_offset", "temperature_offset", "torque_offset", "chamber_offset")
READING_EFFECTS = (*GAINS, *OFFSETS, "clock_shift")
LAGGING = {
    "cell_temperature_degC": "cell",
    "winding_temperature_degC": "winding",
    "case_temperature_degC": "case",
}


def complete(effects: Effects) -> dict[str, dict[str, float]]:
    """Return the parameters of every effect that the equations know: those given, the rest at their null.

    Raises:
        ValueError: an effect or one of its parameters is not in the catalogue.
    """
    full = copy.deepcopy(NULL)
    for name, given in effects.items():
        if name in READING_EFFECTS:
            continue
        if name not in full:
            raise ValueError(f"no effect is called {name!r}")
        values = {key: float(value) for key, value in given.items() if key != "column"}
        if name == "temperature_lag":
            values[LAGGING[given["column"]]] = 1.0
        if name == "self_heating":
            values["on"] = 1.0
        if not values.keys() <= full[name].keys():
            raise ValueError(f"{name} has no parameter {sorted(values.keys() - full[name].keys())}")
        full[name] |= values
    return full


def true_inputs(reported: Columns, effects: Effects) -> Columns:
    """Return the inputs that really acted, where the sensor of an input has a fault: reported less c, or over 1 + g."""
    true = dict(reported)
    for column, gain, offset in _faults(effects):
        if column in true:
            true[column] = (true[column] - offset) / (1.0 + gain)
    return true


def reported_inputs(true: Columns, effects: Effects) -> Columns:
    """Return what the sensors of the inputs report: the inverse of `true_inputs`."""
    reported = dict(true)
    for column, gain, offset in _faults(effects):
        if column in reported:
            reported[column] = reported[column] * (1.0 + gain) + offset
    return reported


def sensed(time_s: np.ndarray, outputs: Columns, effects: Effects) -> Columns:
    """Return the outputs as faulty sensors read them: gain and offset, then the late clock.

    The lag is a state of the equations, because a temperature moves between two rows. A clock that is late by d reads
    at t what was there at t - d, linearly between rows, and holds the first (or last) value beyond the data.
    """
    read = dict(outputs)
    for column, gain, offset in _faults(effects):
        if column in read:
            read[column] = read[column] * (1.0 + gain) + offset
    shift = effects.get("clock_shift")
    if shift is not None:
        for column in [shift["column"]] if "column" in shift else list(read):
            read[column] = np.interp(time_s - shift["d"], time_s, read[column])
    return read


def _faults(effects: Effects) -> list[tuple[str, float, float]]:
    """Return column, gain and offset of each fault of a linear sensor."""
    found = []
    for name in (*GAINS, *OFFSETS):
        if name in effects:
            fault = effects[name]
            gain, offset = float(fault.get("g", 0.0)), float(fault.get("c", 0.0))
            # A thermometer was calibrated at 25 degC: there it reads right whatever its gain.
            found.append((fault["column"], gain, offset - 25.0 * gain if name == "temperature_gain" else offset))
    return found
