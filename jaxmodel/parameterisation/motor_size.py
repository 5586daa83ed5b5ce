"""Numbers of a motor that its log does not tell, from its size: a 7 mm motor is not given those of a 50 mm one.

Motors of one construction turn at one surface speed, so that the no-load speed goes with 1/D. At a given loss per
surface, and with length in proportion to D, k^2/R goes with D^5, R_wc and R_ca with D^-2, and tau_wc and tau_ca with D;
R J/k^2 and L/R are alike. Assumed to hold from the paper's motor, a maxon RE50 at 24 V, down to motors of some mm.
A propeller blows on its motor, which then sheds heat to the air far better (`BLOWN`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jaxmodel.case.known import Known
from jaxmodel.model.parameters import info
from jaxmodel.parameterisation.motor_rows import MotorRows

# Relative sd of each: how far motors of one size and speed differ. A winding may be on iron or in the air gap, a motor
# in still air or on a frame: their thermal resistances are known as sizes only. Assumed.
SD = {"R_0": 1.0, "L_a": 1.0, "J": 0.5, "R_wc": 1.0, "R_ca": 1.0, "tau_wc": 0.5, "tau_ca": 0.5}
# How many times the heat that still air takes from a case (10 W/m2/K, natural convection and radiation) goes into the
# wash of a propeller: 90 W/m2/K of a cylinder of 7 mm across 5 m/s, Nu = 0.683 Re^0.466 (Hilpert 1933). Assumed.
BLOWN = 9.0


# Diameter over that of the paper's motor from which on numbers are scaled: nearer to it they are as good. Assumed.
FAR_SMALLER = 0.5


def paper_speed() -> float:
    """Return the no-load speed of the paper's motor [rad/s]: its supply of 6 cells of 3.8 V over k_tau."""
    supply = float(info("n_series").default) * float(info("nominal_cell_voltage_V").default)
    return supply / float(info("k_tau").default)


def by_size(runs: Sequence[MotorRows], k: float, R: float | None, blown: bool = False) -> dict[str, Known]:
    """Return what a motor far smaller than the paper's usually has; of others, or with a gear, the inertia alone.

    That is the one at which R J/k^2 is the paper's, and needs the resistance.

    Args:
        runs: of one motor.
        k: its torque constant [N m/A].
        R: its resistance [ohm]; None if no current was read.
        blown: whether it is in the wash of a propeller that it turns.
    """
    volts = max((float(np.nanmax(np.abs(rows.voltage_V))) for rows in runs if rows.voltage_V is not None), default=0.0)
    paper = {name: float(info(name).default) for name in (*SD, "k_tau")}
    size = paper_speed() * k / volts if volts > 0.0 else math.inf
    if R is not None:
        size = min(size, (k**2 / R / (paper["k_tau"] ** 2 / paper["R_0"])) ** 0.2)
    R = k**2 / (paper["k_tau"] ** 2 / paper["R_0"] * size**5) if R is None and size < FAR_SMALLER else R
    if R is None:
        return {}
    found = {"J": paper["J"] * (k / paper["k_tau"]) ** 2 * paper["R_0"] / R}
    small = {
        "R_0": R,
        "L_a": paper["L_a"] / paper["R_0"] * R,
        "R_wc": paper["R_wc"] / size**2,
        "R_ca": paper["R_ca"] / size**2 / (BLOWN if blown else 1.0),
        "tau_wc": paper["tau_wc"] * size,
        "tau_ca": paper["tau_ca"] * size / (BLOWN if blown else 1.0),
    }
    found |= small if size < FAR_SMALLER else {}
    return {name: Known(value, SD[name] * value) for name, value in found.items()}
