"""A compensation map as a C header for a controller: duties in Q15 integers or floats, and the look-up between them."""

from __future__ import annotations

import numpy as np

from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.compensation import Compensation, bilinear, compensate, steady

Q15 = 32768
_NO_DUTY = 0  # the robot must not drive there

_TEMPLATE = """/* Duty that holds the slope of the state of charge, by ambient and torque; by jaxmodel compensate.
 * Model: {model}
 * Reference: {ambient:g} degC, {torque:g} mN m, duty {duty:g}: {slope:.4e} per s.
 * Between grid points: bilinear, held at the ends. Largest error midway: {error:.2e} of duty.
 * A 0 is a point where no duty holds the slope. */
#ifndef {guard}
#define {guard}

#include <stdint.h>

#define {prefix}_AMBIENTS {rows}
#define {prefix}_TORQUES {columns}
#define {prefix}_AMBIENT_FIRST ({ambient_first})  /* 0.01 degC */
#define {prefix}_AMBIENT_STEP ({ambient_step})
#define {prefix}_TORQUE_FIRST ({torque_first})  /* 0.01 mN m */
#define {prefix}_TORQUE_STEP ({torque_step})

static const {type} {lower}_table[{prefix}_AMBIENTS][{prefix}_TORQUES] = {{
{table}
}};

static inline {type} {lower}(int32_t ambient_centi_degC, int32_t torque_centi_mNm)
{{
    int32_t t = ambient_centi_degC - {prefix}_AMBIENT_FIRST, m = torque_centi_mNm - {prefix}_TORQUE_FIRST;
    const int32_t most_t = ({prefix}_AMBIENTS - 1) * {prefix}_AMBIENT_STEP;
    const int32_t most_m = ({prefix}_TORQUES - 1) * {prefix}_TORQUE_STEP;
    t = t < 0 ? 0 : t > most_t ? most_t : t;
    m = m < 0 ? 0 : m > most_m ? most_m : m;
    int32_t row = t / {prefix}_AMBIENT_STEP, column = m / {prefix}_TORQUE_STEP;
    if (row > {prefix}_AMBIENTS - 2) row = {prefix}_AMBIENTS - 2;
    if (column > {prefix}_TORQUES - 2) column = {prefix}_TORQUES - 2;
    t -= row * {prefix}_AMBIENT_STEP;
    m -= column * {prefix}_TORQUE_STEP;
    const {type} *low = {lower}_table[row] + column, *high = {lower}_table[row + 1] + column;
    if (low[0] == 0 || low[1] == 0 || high[0] == 0 || high[1] == 0) return 0;
{body}
}}

#endif
"""
_INTEGERS = """    const int64_t from = (int64_t)low[0] * ({prefix}_TORQUE_STEP - m) + (int64_t)low[1] * m;
    const int64_t to = (int64_t)high[0] * ({prefix}_TORQUE_STEP - m) + (int64_t)high[1] * m;
    const int64_t area = (int64_t){prefix}_TORQUE_STEP * {prefix}_AMBIENT_STEP;
    return (uint16_t)((from * ({prefix}_AMBIENT_STEP - t) + to * t + area / 2) / area);"""
_FLOATS = """    const float u = (float)t / {prefix}_AMBIENT_STEP, v = (float)m / {prefix}_TORQUE_STEP;
    return (1.0f - u) * ((1.0f - v) * low[0] + v * low[1]) + u * ((1.0f - v) * high[0] + v * high[1]);"""


def c_header(compensation: Compensation, model: str, error: float, *, integers: bool, name: str = "duty_map") -> str:
    """Return a C header with a map whose axes have even steps, and the function that interpolates in it.

    Args:
        compensation: the map.
        model: name of the model it was made from, for its comment.
        error: its interpolation error in duty, for its comment; see `interpolation_error`.
        integers: Q15 (32768 is a duty of 1) in uint16_t, else float.
        name: of the table and of its function, in C.

    Raises:
        ValueError: an axis is uneven.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import operation, preset_model
        >>> robot = preset_model("paper", "robot")
        >>> found = operation.compensate(robot, np.array([0.0, 20.0]), np.array([0.1, 0.175]))
        >>> print(operation.c_header(found, "paper", 0.001, integers=True).splitlines()[1])
         * Model: paper
    """
    ambient, torque = (_axis(axis) for axis in (100.0 * compensation.ambient_degC, 1e5 * compensation.load_torque_Nm))
    duty = np.where(np.isfinite(compensation.duty) & compensation.drives, compensation.duty, _NO_DUTY)
    cells = np.minimum(np.round(duty * Q15), Q15 * 2 - 1).astype(int) if integers else duty
    rows = ["    {" + ", ".join(str(value) if integers else f"{value:.7f}f" for value in row) + "}," for row in cells]
    prefix = name.upper()
    return _TEMPLATE.format(
        model=model,
        ambient=compensation.reference.ambient_degC,
        torque=1e3 * compensation.reference.load_torque_Nm,
        duty=compensation.reference.duty,
        slope=compensation.slope,
        error=error,
        guard=f"{prefix}_H",
        prefix=prefix,
        lower=name,
        rows=len(compensation.ambient_degC),
        columns=len(compensation.load_torque_Nm),
        ambient_first=ambient[0],
        ambient_step=ambient[1],
        torque_first=torque[0],
        torque_step=torque[1],
        type="uint16_t" if integers else "float",
        table="\n".join(rows),
        body=(_INTEGERS if integers else _FLOATS).format(prefix=prefix),
    )


def looked_up(
    compensation: Compensation, ambient_degC: np.ndarray, load_torque_Nm: np.ndarray, *, integers: bool
) -> np.ndarray:
    """Return what the header's function returns, as a duty: the rounded table, interpolated.

    Args:
        compensation: the map.
        ambient_degC: any shape.
        load_torque_Nm: the same shape.
        integers: as in `c_header`.
    """
    duty = np.where(compensation.drives, compensation.duty, np.nan)
    table = np.round(duty * Q15) / Q15 if integers else duty.astype(np.float32).astype(float)
    found = bilinear(compensation.ambient_degC, compensation.load_torque_Nm, table, ambient_degC, load_torque_Nm)
    return np.round(found * Q15) / Q15 if integers else found


def interpolation_error(model: Model, compensation: Compensation, *, integers: bool) -> tuple[float, float]:
    """Return the largest error of the header's look-up midway between grid points: of duty, and of the relative slope.

    The duty there is solved for, the slope simulated with the duty looked up; where the robot drives, NaN if nowhere.

    Args:
        model: the one that the map was made from.
        compensation: the map.
        integers: as in `c_header`.
    """
    ambient = compensation.ambient_degC[:-1] + 0.5 * np.diff(compensation.ambient_degC)
    torque = compensation.load_torque_Nm[:-1] + 0.5 * np.diff(compensation.load_torque_Nm)
    t, m = (grid.ravel() for grid in np.meshgrid(ambient, torque, indexing="ij"))
    true = compensate(model, ambient, torque, compensation.reference).duty.ravel()
    found = looked_up(compensation, t, m, integers=integers)
    there = np.isfinite(true) & np.isfinite(found)
    if not there.any():
        return np.nan, np.nan
    slope = steady(model, t[there], m[there], found[there]).soc_gradient
    return float(np.abs(found - true)[there].max()), float(np.abs(slope / compensation.slope - 1.0).max())


def _axis(values: np.ndarray) -> tuple[int, int]:
    """Return start and step of an even axis in whole units."""
    whole = np.round(values).astype(int)
    steps = np.diff(whole)
    if np.any(np.abs(values - whole) > 1e-6) or np.any(steps != steps[0]):
        raise ValueError("A header needs axes of even steps, of whole hundredths of a degree and of a mN m.")
    return int(whole[0]), int(steps[0])
