"""Scaling of usual ranges with the size of the specimen.

The ranges of the catalogue were written for the paper's cell of 5.2 A h and its motor, a maxon RE50 at 24 V. `scales`
of an effect's parameter states how its range scales, as a quotient of the sizes below: "capacity", "1/capacity",
"torque/speed2". For the hardware of the paper every factor is 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from jaxmodel.base.errors import EffectError, nearest
from jaxmodel.model.declaration import ParameterInfo
from jaxmodel.model.parameters import TABLE

Numbers = Mapping[str, float]


def _capacity(given: Numbers) -> float:
    """Capacity of the cell: cells of one chemistry have equal A h per kg, whatever their size."""
    return _ratio(given, "capacity_Ah")


def _surface(given: Numbers) -> float:
    """Surface of a cell: the 2/3 power of its volume, and so of its capacity (assumed: cells of one shape)."""
    return _capacity(given) ** (2.0 / 3.0)


def _supply(given: Numbers) -> float:
    """Supply voltage of the motor: that of its pack, or `supply_V`; else 24 V as for the RE50."""
    reference = TABLE["n_series"].default * TABLE["nominal_cell_voltage_V"].default
    if "supply_V" in given:
        return given["supply_V"] / reference
    return _ratio(given, "n_series") * _ratio(given, "nominal_cell_voltage_V")


def _speed(given: Numbers) -> float:
    """No-load speed V / k_tau."""
    return _supply(given) / _ratio(given, "k_tau")


def _motor_current(given: Numbers) -> float:
    """Continuous current: its copper loss i^2 R_0 warms the winding by a fixed amount, over R_wc + R_ca.

    The amount is assumed to be that of the RE50, for a motor with and without gear.
    """
    thermal = (_value(given, "R_wc") + _value(given, "R_ca")) / (TABLE["R_wc"].default + TABLE["R_ca"].default)
    return 1.0 / math.sqrt(_ratio(given, "R_0") * thermal)


def _torque(given: Numbers) -> float:
    """Continuous torque: k_tau times the continuous current."""
    return _ratio(given, "k_tau") * _motor_current(given)


SIZES: dict[str, Callable[[Numbers], float]] = {
    "capacity": _capacity,
    "surface": _surface,
    "supply": _supply,
    "speed": _speed,
    "motor_current": _motor_current,
    "torque": _torque,
}


def scale_of(scales: str, parameters: Numbers) -> float:
    """Return the factor from the paper's hardware to a specimen's.

    Args:
        scales: "" (a factor of 1), or sizes of `SIZES` with whole powers: "torque", "1/capacity", "torque/speed2".
        parameters: of the specimen, by names of the parameter table, with defaults for missing ones; and `supply_V`,
            the voltage at a motor's terminals, if known.

    Raises:
        EffectError: a size is unknown.
    """
    above, *below = scales.split("/") if scales else ["1"]
    return _product(above, parameters) / math.prod(_product(size, parameters) for size in below)


def usual_range(info: ParameterInfo, parameters: Numbers) -> tuple[float, float]:
    """Return the usual range of an effect's parameter for a specimen, within its bounds.

    Raises:
        EffectError: the parameter has no usual range, or scales with an unknown size.
    """
    if info.typical is None:
        raise EffectError(f"parameter '{info.name}' of an effect has no usual range; declare one, typical=(low, high).")
    low, high = (_within(info, end * scale_of(info.scales, parameters)) for end in info.typical)
    return low, high


def shape_grid(info: ParameterInfo, parameters: Numbers) -> tuple[float, ...]:
    """Return the values at which an effect's shape is tested, for a specimen."""
    return tuple(_within(info, value * scale_of(info.scales, parameters)) for value in info.shape_grid)


def _product(size: str, parameters: Numbers) -> float:
    if size == "1":
        return 1.0
    name, power = re.fullmatch(r"(.*?)(\d*)", size).groups()  # type: ignore[union-attr]
    if name not in SIZES:
        raise EffectError(
            f"scales '{size}' is no size of a cell or motor.{nearest(name, SIZES)} Sizes are {', '.join(SIZES)}."
        )
    return SIZES[name](parameters) ** int(power or 1)


def _within(info: ParameterInfo, value: float) -> float:
    return min(max(value, info.lower), info.upper)


def _value(given: Numbers, name: str) -> float:
    return given.get(name, TABLE[name].default)


def _ratio(given: Numbers, name: str) -> float:
    return _value(given, name) / TABLE[name].default
