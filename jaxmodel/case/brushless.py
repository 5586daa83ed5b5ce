"""What a case says of a brushless motor: what its current means, and constants of a phase or between two lines.

The model has one armature. It stands for the q-axis of three phases, whose field current i_d is 0, if its current,
voltage and power belong together: V i = 3/2 v_q i_q = 3 V_rms I_rms. With F = 3/2 for the amplitude i_q and F = 3 for
the RMS of a phase, R_0 = F R and L_a = F L of a phase of the star, half of what is measured between two lines (of a
delta too, whose star it is then), V = F v, and k_tau is torque over that current and, by the power, back-EMF over
speed. P. C. Krause et al., Analysis of Electric Machinery and Drive Systems, 3rd ed., 2013, sections 3.3 and 8.
"""

from __future__ import annotations

import math

from jaxmodel.base.errors import MeasurementError, ParameterError
from jaxmodel.case.forms import BrushlessEntry
from jaxmodel.case.known import Known

FACTOR = {"peak": 1.5, "rms": 3.0}
"""By what a current is, the factor F from a phase to the model's armature."""
WAYS: dict[str, set[str]] = {
    "R_0": {"R_phase_ohm", "R_line_to_line_ohm"},
    "L_a": {"L_phase_H", "L_line_to_line_H"},
    "k_tau": {"KV_rpm_per_V", "Nm_per_A_rms", "Nm_per_A_peak"},
}
"""By parameter of the model, what states it."""
_KV_TO_SI = 60.0 / (2.0 * math.pi)  # 1/(rpm/V) to V s/rad


def armature(entry: BrushlessEntry | None, kind: str, stated: dict[str, Known], where: str) -> dict[str, Known]:
    """Return R_0 [ohm], L_a [H] and k_tau [N m/A] of the armature that stands for a brushless motor, as far as stated.

    KV is the speed in rpm over the amplitude of the voltage between two lines, as data sheets have it: the back-EMF of
    a phase has the amplitude 1/sqrt(3) of that, and k_tau = 3/2 of it for an amplitude.

    Args:
        entry: what the case says; None for a motor with brushes.
        kind: of the case.
        stated: parameters of the case.
        where: the case in messages.

    Raises:
        MeasurementError: the case is of a cell.
        ParameterError: one constant is stated twice.
    """
    if entry is None:
        return {}
    if kind == "cell":
        raise MeasurementError(f"{where}: [brushless] is of a motor, and the case is of a cell; remove it.")
    found: dict[str, Known] = {}
    for name, ways in WAYS.items():
        given = {key: one for key in sorted(ways) if (one := getattr(entry, key)) is not None}
        if len(given) + (name in stated and bool(given)) > 1:
            said = " and ".join([*given, *([name] if name in stated else [])])
            raise ParameterError(f"{where}: {said} state the same constant; keep one of them.")
        for key, one in given.items():
            value = _of_armature(key, one.value, entry.current)
            found[name] = Known(value, None if one.sd is None else value * one.sd / one.value)
    return found


def _of_armature(key: str, value: float, current: str) -> float:
    """Return the constant of the armature whose current is of a kind, in SI."""
    if key.startswith(("R_", "L_")):
        return FACTOR[current] * value * (0.5 if "line_to_line" in key else 1.0)
    if key == "KV_rpm_per_V":
        per_peak = 1.5 / math.sqrt(3.0) * _KV_TO_SI / value
    else:
        per_peak = value if key == "Nm_per_A_peak" else value / math.sqrt(2.0)
    return per_peak if current == "peak" else per_peak * math.sqrt(2.0)
