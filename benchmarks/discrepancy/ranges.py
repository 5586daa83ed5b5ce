"""What cases are drawn from: hardware, what a user knows of it, sensors, and the usual sizes of effects.

The effects and their sizes are written down here, as they were when the first answers were kept, and not read from the
catalogue: a catalogue that grows must not change what a seed draws.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from benchmarks.independent.integrate import DEFAULTS

# Places in an effect's usual range at which the power is asked for: 0 its low end, 1 its high end.
PLACES = np.linspace(0.0, 1.0, 9)
CELL, MOTOR, ROBOT = ("cell", "robot"), ("motor", "robot"), ("robot",)
ANY = ("cell", "motor", "robot")


@dataclasses.dataclass(frozen=True)
class Usual:
    """An effect that may be hidden.

    Attributes:
        kinds: of cases that may have it.
        ranges: by parameter, the range that is usual; one that spans the null is drawn with either sign.
        is_sensor: a fault of a sensor.
        strongest_low: the smaller the number, the stronger the effect.
    """

    kinds: tuple[str, ...]
    ranges: dict[str, tuple[float, float]]
    is_sensor: bool = False
    strongest_low: bool = False


# In the catalogue's order of that time, on which the draw of a name rests.
EFFECTS: dict[str, Usual] = {
    "arrhenius_resistance": Usual(CELL, {"E_a": (5e3, 40e3)}),
    "capacity_temperature": Usual(CELL, {"a": (0.0005, 0.012)}),
    "cell_imbalance": Usual(ROBOT, {"d": (0.03, 0.3)}),
    "charge_transfer": Usual(CELL, {"i_0": (0.1, 10.0)}, strongest_low=True),
    "entropic_ocv": Usual(CELL, {"dU_dT": (-1e-3, 1e-3)}),
    "ocv_hysteresis": Usual(CELL, {"M_V": (0.005, 0.06), "g": (5.0, 200.0)}),
    "rate_capacity": Usual(CELL, {"p": (1.02, 1.3)}),
    "resistance_ageing": Usual(CELL, {"c": (1e-5, 1e-3)}),
    "self_discharge": Usual(CELL, {"R_self": (20.0, 2000.0)}, strongest_low=True),
    "self_heating": Usual(CELL, {"C_th": (30.0, 300.0), "hA": (0.05, 1.0)}),
    "slow_diffusion": Usual(CELL, {"R_3": (0.005, 0.05), "tau_3": (200.0, 4000.0)}),
    "bridge_resistance": Usual(ROBOT, {"R_on": (5e-3, 0.1)}),
    "brush_drop": Usual(MOTOR, {"V_b": (0.1, 1.5)}),
    "constant_power_load": Usual(ROBOT, {"s": (0.3, 1.0)}),
    "friction_temperature": Usual(MOTOR, {"b_T": (0.005, 0.05)}),
    "gear_loss": Usual(MOTOR, {"e": (0.004, 0.4)}),
    "magnet_temperature": Usual(MOTOR, {"psi_k": (-0.003, -0.0001)}),
    "onboard_temperature": Usual(ROBOT, {"a": (-0.03, 0.03)}),
    "pwm_ripple": Usual(ROBOT, {"k_r": (1e-3, 0.1)}),
    "saturation": Usual(MOTOR, {"i_s": (25.0, 80.0)}, strongest_low=True),
    "stribeck_friction": Usual(MOTOR, {"tau_s": (0.002, 0.04), "w_s": (5.0, 100.0)}),
    "viscous_friction": Usual(MOTOR, {"b": (1e-6, 2e-4)}),
    "windage": Usual(MOTOR, {"c": (1e-9, 1e-6)}),
    "clock_shift": Usual(ANY, {"d": (-20.0, 20.0)}, is_sensor=True),
    "current_offset": Usual(ANY, {"c": (-0.5, 0.5)}, is_sensor=True),
    "temperature_lag": Usual(ANY, {"tau": (5.0, 300.0)}, is_sensor=True),
    "voltage_gain": Usual(ANY, {"g": (-0.05, 0.05)}, is_sensor=True),
    "voltage_offset": Usual(ANY, {"c": (-0.1, 0.1)}, is_sensor=True),
}

# Pairs that look alike where runs are all alike.
CONFUSABLE = {
    "cell": (
        ("entropic_ocv", "voltage_offset"),
        ("self_discharge", "current_offset"),
        ("ocv_hysteresis", "charge_transfer"),
    ),
    "motor": (
        ("windage", "viscous_friction"),
        ("brush_drop", "voltage_offset"),
        ("magnet_temperature", "friction_temperature"),
    ),
    "robot": (
        ("windage", "viscous_friction"),
        ("brush_drop", "bridge_resistance"),
        ("ocv_hysteresis", "charge_transfer"),
    ),
}

# What a user knows of the hardware, as a share of the value; the truth is drawn from it.
KNOWN_TO = {
    "cell": {
        "capacity_Ah": 0.03,
        "series_resistance_scale": 0.15,
        "rc_resistance_scale": 0.15,
        "rc_capacitance_scale": 0.15,
    },
    "motor": {
        "R_0": 0.03,
        "k_tau": 0.025,
        "tau_0": 0.15,
        "R_wc": 0.12,
        "R_ca": 0.12,
        "tau_wc": 0.12,
        "tau_ca": 0.12,
    },
    "robot": {
        "capacity_Ah": 0.03,
        "series_resistance_scale": 0.15,
        "rc_resistance_scale": 0.15,
        "R_0": 0.03,
        "k_tau": 0.025,
        "tau_0": 0.15,
        "R_wc": 0.12,
        "R_ca": 0.12,
        "onboard_current_A": 0.1,
    },
}
# Noise of each sensor as (smallest, largest) sd; which temperatures are measured is drawn.
NOISE = {
    "cell": {"voltage_V": (5e-4, 4e-3), "current_A": (2e-3, 0.02)},
    "motor": {"current_A": (0.01, 0.05), "speed_rad_s": (0.2, 1.0), "winding_temperature_degC": (0.1, 0.4)},
    "robot": {
        "pack_voltage_V": (5e-3, 0.03),
        "pack_current_A": (0.02, 0.1),
        "speed_rad_s": (0.2, 1.0),
        "winding_temperature_degC": (0.1, 0.4),
    },
}
TEMPERATURES = {"cell": "cell_temperature_degC", "motor": "case_temperature_degC", "robot": "case_temperature_degC"}
# The sensor that has a fault.
COLUMNS = {
    "current_offset": {"cell": "current_A", "motor": "current_A", "robot": "pack_current_A"},
    "voltage_gain": {"cell": "voltage_V", "motor": "voltage_V", "robot": "pack_voltage_V"},
    "voltage_offset": {"cell": "voltage_V", "motor": "voltage_V", "robot": "pack_voltage_V"},
    "temperature_lag": TEMPERATURES,
}


def names(kind: str, sensor: bool) -> list[str]:
    """Return the effects, or the faults of sensors, that a kind may have."""
    return [name for name, usual in EFFECTS.items() if kind in usual.kinds and usual.is_sensor == sensor]


def hardware(rng: np.random.Generator, kind: str) -> tuple[dict[str, Any], dict[str, float]]:
    """Draw hardware: what is stated of each number, (value, sd), and what it truly is, within two sd."""
    stated: dict[str, Any] = {}
    true: dict[str, float] = {}
    for name, share in KNOWN_TO[kind].items():
        other_hardware = name in ("capacity_Ah", "R_0", "onboard_current_A")
        nominal = DEFAULTS[name] * (rng.uniform(0.6, 1.6) if other_hardware else 1.0)
        stated[name] = (nominal, share * nominal)
        true[name] = nominal * (1.0 + share * float(np.clip(rng.standard_normal(), -2.0, 2.0)))
    if kind != "motor":
        stated |= {"storage_months": 0.0, "cycles": 25.0}
        true |= {"storage_months": 0.0, "cycles": 25.0}
    return stated, true


def amplitude(rng: np.random.Generator, kind: str, name: str) -> dict[str, Any]:
    """Draw an effect's parameters from their usual ranges, log-uniform."""
    values: dict[str, Any] = {}
    for parameter, (low, high) in EFFECTS[name].ranges.items():
        if low > 0.0:
            values[parameter] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        else:
            values[parameter] = float(rng.choice([low, high]) * rng.uniform(0.3, 1.0))
    return values | column_of(kind, name)


def strong(rng: np.random.Generator, kind: str, name: str) -> dict[str, Any]:
    """Draw an effect's first number from the stronger half of its usual range, log-uniform; the others as they are."""
    values, usual = amplitude(rng, kind, name), EFFECTS[name]
    first, (low, high) = next(iter(usual.ranges.items()))
    if name == "self_heating":  # has no weak end
        return values
    if low * high > 0.0:
        ends = sorted((abs(low), abs(high)))
        middle = math.sqrt(ends[0] * ends[1])
        weak, far = (ends[0], middle) if usual.strongest_low else (middle, ends[1])
        values[first] = math.copysign(float(np.exp(rng.uniform(np.log(weak), np.log(far)))), low)
    else:
        values[first] = float(rng.choice([low, high]) * rng.uniform(0.5, 1.0))
    return values


def column_of(kind: str, name: str) -> dict[str, str]:
    """Return the column of a sensor's fault, as its parameters have it."""
    return {"column": COLUMNS[name][kind]} if name in COLUMNS else {}
