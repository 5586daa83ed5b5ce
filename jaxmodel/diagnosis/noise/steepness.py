"""How steep the open-circuit voltage is where a voltage was read, compared with its average slope.

A model that is wrong about charge by 1 % is wrong by 10 mV where the OCV is flat, and by 200 mV where the cell is
nearly empty. Both are the same error of the model. Whether an addition is material, and how much of an error remains,
is therefore judged on errors of a voltage divided by

    g = max(1, |dU_OC/dSOC| / (U_OC(1) - U_OC(0)))

with the steepest slope within the uncertainty of the state of charge. Without it, the last minutes of a discharge
outweigh all else, and no effect is material unless it acts there.
"""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.noise.model_error import Series
from jaxmodel.model.curves import Curve

# Points of the OCV; the slope is that between neighbours.
_POINTS = 1001
_STEEP = ("voltage_V", "pack_voltage_V")


def steepness(case: Case, soc: Sequence[np.ndarray], uncertainty: float) -> dict[Series, np.ndarray]:
    """Return g at all rows of every voltage of a cell or pack, by channel and run; that of other channels is 1.

    Args:
        case: with its runs.
        soc: state of charge at the rows of each run; a missing one has g = 1.
        uncertainty: of the state of charge.
    """
    found: dict[Series, np.ndarray] = {}
    for number, (run, of_run) in enumerate(zip(case.runs, soc, strict=True)):
        ambient = float(np.mean(run.measured.inputs["ambient_degC"]))
        slopes = _slopes(case_model(case, run).curves.ocv, ambient, uncertainty)
        found |= {(name, number): _at(of_run, slopes) for name in run.measured.outputs if name in _STEEP}
    return found


def _at(soc: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    place = np.nan_to_num(np.clip(soc, 0.0, 1.0)) * (slopes.size - 1)
    return np.where(np.isfinite(soc), slopes[np.round(place).astype(int)], 1.0)


def _slopes(ocv: Curve, ambient_degC: float, uncertainty: float) -> np.ndarray:
    """Return g on a grid of states of charge from 0 to 1."""
    voltage = np.asarray(_voltages(ocv, *jax.device_put((np.linspace(0.0, 1.0, _POINTS), np.asarray(ambient_degC)))))
    span = abs(float(voltage[-1] - voltage[0]))
    if not span > 0.0:
        return np.ones(_POINTS)
    slope = np.abs(np.gradient(voltage)) * (_POINTS - 1) / span
    reach = round(uncertainty * (_POINTS - 1))
    padded = np.pad(slope, reach, mode="edge")
    return np.maximum(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).max(axis=1), 1.0)


@eqx.filter_jit
def _voltages(ocv: Curve, soc: Array, temperature_degC: Array) -> Array:
    return jax.vmap(ocv, in_axes=(0, None))(soc, temperature_degC)
