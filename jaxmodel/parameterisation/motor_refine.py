"""Refinement of a motor's numbers by output error: the forward model itself against the readings.

Least squares on derivatives is biased where a log is coarse against the mechanical time constant. So the numbers it
gives are only the start of a Gauss-Newton fit of `simulate_case` to current and speed of the fit runs.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np
from scipy.optimize import least_squares

from jaxmodel.case.known import Known
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.fit.likelihood import autocorrelation_time

CHANNELS = ("current_A", "voltage_V", "speed_rad_s")  # a voltage is a reading under a controller
MOST_CALLS = 12
STEP = 1e-3
LEAST_GAIN = 0.999  # of the misfit: else the first values stay


@dataclasses.dataclass(frozen=True)
class Refined:
    """Values and sd by name, and the RMS error by channel before and after."""

    values: dict[str, float]
    sd: dict[str, float]
    before: float
    after: float


def refine(case: Case, names: Mapping[str, tuple[str, str]]) -> Refined | None:
    """Return numbers of a case refitted by output error; None where the fit runs have neither current nor speed.

    Args:
        case: with first values; only its fit runs are used.
        names: of the numbers, each with the effect and field that hold it, `("", name)` for a parameter. A number is
            searched as a multiple of its first value, but for that of `torque_offset`, which may change its sign.
    """
    fitted = dataclasses.replace(case, runs=tuple(run for run in case.runs if run.split == "fit"))
    read = {name for run in fitted.runs for name in CHANNELS if name in run.measured.outputs}
    if not read or not names:
        return None
    first = np.array([_value(fitted, *place) for place in names.values()])
    unit = np.where(np.abs(first) > 0.0, np.abs(first), 1.0)
    scale = {name: _scale(fitted, name) for name in read}

    def residuals(x: np.ndarray) -> np.ndarray:
        simulation = simulate_case(_with(fitted, dict(zip(names.values(), (x * unit).tolist(), strict=True))))
        parts = []
        for one in simulation:
            for name in sorted(read & one.run.measured.outputs.keys()):
                left = (one.run.measured.outputs[name] - one.table[name].to_numpy()) / scale[name]
                parts.append(np.where(np.isfinite(left), left, 0.0))
        return np.concatenate(parts)

    start = first / unit
    low = [-np.inf if place[0] == "torque_offset" else 0.05 for place in names.values()]
    high = [np.inf if place[0] == "torque_offset" else 20.0 for place in names.values()]
    before = residuals(start)
    found = least_squares(
        residuals, start, bounds=(low, high), diff_step=STEP, max_nfev=MOST_CALLS, x_scale="jac", ftol=1e-5, xtol=1e-6
    )
    if not 2.0 * found.cost < LEAST_GAIN * float(before @ before):
        found.x, found.fun = start, before
    ends = np.cumsum(
        [0, *(run.measured.time_s.size for run in fitted.runs for name in read if name in run.measured.outputs)]
    )
    inflation = autocorrelation_time([found.fun[a:b] for a, b in itertools.pairwise(ends)])
    variance = float(np.mean(found.fun**2)) * inflation
    spread = np.sqrt(np.abs(np.diag(np.linalg.pinv(found.jac.T @ found.jac)) * variance))
    return Refined(
        dict(zip(names, (found.x * unit).tolist(), strict=True)),
        dict(zip(names, (spread * unit).tolist(), strict=True)),
        math.sqrt(float(np.mean(before**2))),
        math.sqrt(float(np.mean(found.fun**2))),
    )


def _scale(case: Case, name: str) -> float:
    """Return the size of a channel: so that both are fitted alike in relative terms."""
    values = np.concatenate([run.measured.outputs[name] for run in case.runs if name in run.measured.outputs])
    return float(np.nanstd(values)) + 1e-12


def _value(case: Case, effect: str, field: str) -> float:
    return float(case.effects[effect][field]) if effect else case.parameters[field].value


def _with(case: Case, values: Mapping[tuple[str, str], float]) -> Case:
    """Return the case with other values."""
    parameters, effects = dict(case.parameters), {name: dict(fields) for name, fields in case.effects.items()}
    for (effect, field), value in values.items():
        if effect:
            effects[effect][field] = value
        else:
            parameters[field] = dataclasses.replace(parameters.get(field, Known(value)), value=value)
    return dataclasses.replace(case, parameters=parameters, effects=effects)


def refined_case(case: Case, names: Mapping[str, tuple[str, str]], found: Refined) -> Case:
    """Return the case with the refined values and their sd."""
    case = _with(case, {names[name]: value for name, value in found.values.items()})
    parameters, effect_sd = dict(case.parameters), {name: dict(fields) for name, fields in case.effect_sd.items()}
    for name, (effect, field) in names.items():
        if effect:
            effect_sd.setdefault(effect, {})[field] = found.sd[name]
        else:
            parameters[field] = Known(found.values[name], found.sd[name])
    return dataclasses.replace(case, parameters=parameters, effect_sd=effect_sd)
