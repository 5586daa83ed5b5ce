"""A case's cell as parameter values of PyBaMM's Thevenin model: a file of Python that builds them."""

from __future__ import annotations

import numpy as np

from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.export.thevenin import ELEMENTS, Thevenin, thevenin
from jaxmodel.export.wording import heading

_A_LINE = 6
# Where the cell has no heat of its own it is held to the ambient, and where it has the jig is: a small mass behind a
# large transfer, W/K for each W/K of the cell's, which leaves 1e-6 of a temperature rise.
_HELD, _MASS = 1e6, 1.0

_TEXT = '''"""{heading}
"""

import numpy as np
import pybamm

OPTIONS = {{"number of rc elements": 2}}  # of pybamm.equivalent_circuit.Thevenin

# Tables are linear between breakpoints. The first and last breakpoints stand far outside, so that ends are held.
{arrays}


def _over_soc_and_temperature(name, values):
    """Return an element as PyBaMM calls it: by cell temperature in degC, current in A, and state of charge."""

    def element(T_cell, current, soc):
        if len(values) == 1:
            return pybamm.Interpolant(SOC, values[0], soc, name)
        return pybamm.Interpolant((TEMPERATURE_DEGC, SOC), values, [T_cell, soc], name)

    return element


def open_circuit_voltage(soc):
    """Return the open-circuit voltage in V."""
    return pybamm.Interpolant(SOC, OCV_V, soc, "open-circuit voltage")


def entropic_change(ocv, T_cell):
    """Return the derivative of the open-circuit voltage by temperature in V/K."""
{entropy}


def get_parameter_values():
    """Return the values for pybamm.ParameterValues; current is positive on discharge."""
    return {{
        "chemistry": "ecm",
        "Initial SoC": {initial_soc!r},
        "Initial temperature [K]": 273.15 + {initial_degC!r},
        "Ambient temperature [K]": 273.15 + {ambient!r},
        "Cell capacity [A.h]": {capacity!r},
        "Nominal cell capacity [A.h]": {capacity!r},
        "Current function [A]": {capacity!r},
        "Upper voltage cut-off [V]": {upper!r},
        "Lower voltage cut-off [V]": {lower!r},
        "Cell thermal mass [J/K]": {C_th!r},
        "Cell-jig heat transfer coefficient [W/K]": {hA!r},
        "Jig thermal mass [J/K]": {jig_mass!r},
        "Jig-air heat transfer coefficient [W/K]": {jig_transfer!r},
        "Open-circuit voltage [V]": open_circuit_voltage,
        "R0 [Ohm]": _over_soc_and_temperature("R0", R0_OHM),
        "R1 [Ohm]": _over_soc_and_temperature("R1", R1_OHM),
        "C1 [F]": _over_soc_and_temperature("C1", C1_F),
        "R2 [Ohm]": _over_soc_and_temperature("R2", R2_OHM),
        "C2 [F]": _over_soc_and_temperature("C2", C2_F),
        "Element-1 initial overpotential [V]": 0.0,
        "Element-2 initial overpotential [V]": 0.0,
        "Entropic change [V/K]": entropic_change,
    }}


def thevenin():
    """Return PyBaMM's model with two RC pairs and these values."""
    model = pybamm.equivalent_circuit.Thevenin(options=OPTIONS)
    return model, pybamm.ParameterValues(get_parameter_values())
'''
_ENTROPY = """    if len(DU_DT_V_K) == 1:
        return pybamm.Interpolant(RISING_OCV_V, DU_DT_V_K[0], ocv, "entropic change")
    return pybamm.Interpolant((TEMPERATURE_DEGC, RISING_OCV_V), DU_DT_V_K, [T_cell, ocv], "entropic change")"""


def export_pybamm(case: Case) -> Exported:
    """Return a file of Python with `get_parameter_values()` for PyBaMM's Thevenin model, as PyBaMM's own sets have.

    Args:
        case: of a cell, or of a robot, of whose pack it is one cell.

    Raises:
        ParameterError: the case is of a motor.
    """
    circuit = thevenin(case)
    at = circuit.reference_degC
    ocv = _at(circuit, circuit.elements["ocv_V"], at)
    entropy, arrays = _entropy(circuit, ocv)
    left_out = (*_left_out(circuit), *circuit.left_out)
    warm = circuit.C_th is not None and circuit.hA is not None
    arrays = {
        "SOC": _padded(circuit.soc, -10.0, 10.0),
        "TEMPERATURE_DEGC": _padded(circuit.temperature_degC, -1000.0, 1000.0),
        "OCV_V": _held(ocv),
        **{_name(key): _held(circuit.elements[key]) for key in ELEMENTS[1:]},
        **arrays,
    }
    text = _TEXT.format(
        heading="\n".join(heading(case, "The cell", left_out)).replace("\\", "/").replace('"""', "'''"),
        arrays="\n".join(f"{key} = np.array({_array(values)})" for key, values in arrays.items()),
        entropy=entropy,
        initial_soc=circuit.initial_soc,
        initial_degC=at + (circuit.initial_rise_K if warm else 0.0),
        ambient=at,
        capacity=circuit.capacity_Ah,
        upper=float(ocv.max()) + 1.0,
        lower=float(case.cutoff.get("voltage_V", 0.0)),
        C_th=circuit.C_th if warm else _MASS,
        hA=circuit.hA if warm else _HELD,
        jig_mass=_MASS,
        jig_transfer=_HELD * (circuit.hA or 1.0),
    )
    return Exported(text, left_out)


def _left_out(circuit: Thevenin) -> tuple[str, ...]:
    at = f"{circuit.reference_degC:.4g} degC"
    said = []
    varies = np.ptp(circuit.elements["ocv_V"], axis=0).max() > 0.0
    if varies:
        said.append(f"PyBaMM's open-circuit voltage knows no temperature: it is that at {at}, the mean of the runs.")
    if circuit.C_th is None:
        said.append("The cell has no heat of its own in the case: in PyBaMM it is held to the ambient temperature.")
    said.append(f"The capacity is that at {at}; PyBaMM's is one number.")
    return tuple(said)


def _at(circuit: Thevenin, values: np.ndarray, celsius: float) -> np.ndarray:
    """Return a table over state of charge at one temperature."""
    if len(values) == 1:
        return values[0]
    return np.array([np.interp(celsius, circuit.temperature_degC, column) for column in values.T])


def _entropy(circuit: Thevenin, ocv: np.ndarray) -> tuple[str, dict[str, np.ndarray]]:
    """Return the body of the entropic change, and its arrays: over voltages that rise, by which PyBaMM asks."""
    if circuit.dU_dT_V_K is None:
        return "    return 0.0 * ocv", {}
    rising = np.concatenate([[True], ocv[1:] > np.maximum.accumulate(ocv)[:-1] + 1e-9])
    return _ENTROPY, {
        "RISING_OCV_V": _padded(ocv[rising], -100.0, 100.0),
        "DU_DT_V_K": _held(circuit.dU_dT_V_K[:, rising]),
    }


def _padded(breakpoints: np.ndarray, first: float, last: float) -> np.ndarray:
    return np.concatenate([[first], breakpoints, [last]])


def _held(values: np.ndarray) -> np.ndarray:
    """Return a table whose ends are repeated, over state of charge and, if it has rows, over temperature."""
    if values.ndim == 1 or len(values) == 1:
        return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(1, 1)], mode="edge")
    return np.pad(values, 1, mode="edge")


def _name(element: str) -> str:
    return element.upper()


def _array(values: np.ndarray) -> str:
    if values.ndim == 2:
        rows = ",\n".join(f"    {_array(row)}" for row in values)
        return f"[\n{rows},\n]"
    texts = [repr(float(value)) for value in values]
    lines = [", ".join(texts[first : first + _A_LINE]) for first in range(0, len(texts), _A_LINE)]
    return f"[{lines[0]}]" if len(lines) == 1 else "[\n        " + ",\n        ".join(lines) + ",\n    ]"
