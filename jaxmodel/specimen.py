"""How usual ranges grow with the specimen: a cell of 33 A h is no cell of 5.2 A h with odd numbers.

The ranges of the catalogue were written for the paper's cell of 5.2 A h and its motor, a maxon RE50 at 24 V. A
parameter of an effect says by `scales` how they carry over, as a quotient of the sizes below: "capacity", "1/capacity",
"torque/speed2". For the paper's own hardware every factor is 1.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from jaxmodel.declaration import ParameterInfo
from jaxmodel.errors import EffectError, nearest
from jaxmodel.parameters import TABLE

Numbers = Mapping[str, float]


def _capacity(given: Numbers) -> float:
    """Charge that a cell holds: cells of one chemistry are so many A h per kg, whatever their size."""
    return _ratio(given, "capacity_Ah")


def _surface(given: Numbers) -> float:
    """Surface of a cell: the 2/3 power of its volume, and so of its capacity (assumed: cells of one shape)."""
    return _capacity(given) ** (2.0 / 3.0)


def _supply(given: Numbers) -> float:
    """Voltage that feeds the motor: its pack's, or `supply_V` of those who know; else 24 V as the RE50's."""
    reference = TABLE["n_series"].default * TABLE["nominal_cell_voltage_V"].default
    if "supply_V" in given:
        return given["supply_V"] / reference
    return _ratio(given, "n_series") * _ratio(given, "nominal_cell_voltage_V")


def _speed(given: Numbers) -> float:
    """No-load speed V / k_tau."""
    return _supply(given) / _ratio(given, "k_tau")


def _motor_current(given: Numbers) -> float:
    """Continuous current: that whose copper loss i^2 R_0 warms the winding by a set amount, over R_wc + R_ca.

    Assumed: the set amount is that of the RE50. The same for a motor alone and behind a gear.
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
        parameters: what is known of the specimen, by names of the parameter table, the defaults where it says nothing;
            and `supply_V`, the voltage at a motor's terminals, from those who have seen its runs.

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
    """Return the values at which an effect's shape is tried, for a specimen."""
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
