"""A case's cell as the tables of Simscape's Battery (Table-Based), in a MATLAB file.

Rows are states of charge and columns temperatures, as the block takes them; tau is R C of a pair.
"""

from __future__ import annotations

import io

import numpy as np
from scipy.io import savemat

from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case
from jaxmodel.export.thevenin import Thevenin, thevenin
from jaxmodel.export.wording import heading
from jaxmodel.model.cell import ZERO_DEGC_IN_K

# A table over charge alone is given at these too: the block asks for a temperature axis.
_TWO_DEGC = (-20.0, 60.0)


def export_simscape(case: Case) -> Exported:
    """Return a MATLAB file with `SOC_vec`, `T_vec` in K, and matrices over both.

    These are `V0_mat`, `R0_mat`, `R1_mat`, `tau1_mat`, `R2_mat` and `tau2_mat`, in V, ohm and s. `AH` is the capacity
    in A h. `thermal_mass` in J/K and `heat_transfer` in W/K are there where the case has heat. The variable `notes`
    says what is not carried.

    Args:
        case: of a cell, or of a robot, of whose pack it is one cell.

    Raises:
        ParameterError: the case is of a motor.
    """
    circuit = thevenin(case)
    left_out = (*_left_out(circuit), *circuit.left_out)
    celsius = circuit.temperature_degC if circuit.temperature_degC.size > 1 else np.array(_TWO_DEGC)

    def over_both(values: np.ndarray) -> np.ndarray:
        return np.broadcast_to(values, (celsius.size, circuit.soc.size)).T

    e = {name: over_both(values) for name, values in circuit.elements.items()}
    variables = {
        "SOC_vec": circuit.soc,
        "T_vec": celsius + ZERO_DEGC_IN_K,
        "V0_mat": e["ocv_V"],
        "R0_mat": e["R0_ohm"],
        "R1_mat": e["R1_ohm"],
        "tau1_mat": e["R1_ohm"] * e["C1_F"],
        "R2_mat": e["R2_ohm"],
        "tau2_mat": e["R2_ohm"] * e["C2_F"],
        "AH": circuit.capacity_Ah,
        "initial_SOC": circuit.initial_soc,
        "notes": "\n".join(heading(case, "The cell", left_out)),
    }
    if circuit.dU_dT_V_K is not None:
        variables["dV0_dT_mat"] = over_both(circuit.dU_dT_V_K)
    if circuit.C_th is not None and circuit.hA is not None:
        variables |= {"thermal_mass": circuit.C_th, "heat_transfer": circuit.hA}
    file = io.BytesIO()
    savemat(file, variables, oned_as="row")
    return Exported(file.getvalue(), left_out)


def _left_out(circuit: Thevenin) -> tuple[str, ...]:
    said = ["The tables are the same for charge and discharge, as they are in the case."]
    said.append(f"The capacity is that at {circuit.reference_degC:.4g} degC, the mean ambient of the runs.")
    if circuit.C_th is None:
        said.append("The cell has no heat of its own in the case, so that the file has no thermal mass.")
    return tuple(said)
