"""A compensation map as a C header for a controller: duties in Q15 integers or floats, and the look-up between them."""

from __future__ import annotations

import numpy as np

from operation.compensation import Compensation, bilinear

Q15 = 32768
_HELD = 0  # a place without a duty: the robot must not drive there

_TEMPLATE = """/* Duty that holds the pace of the charge over ambient temperature and torque, by jaxmodel compensate.
 * Model: {model}
 * Reference: {ambient:g} degC, {torque:g} mN m, duty {duty:g}: {slope:.4e} per s.
 * Between the places: linear in both, held at the ends. Largest error at mid-places: {error:.2e} of duty.
 * A 0 is a place where no duty holds the pace. */
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


def header(compensation: Compensation, model: str, error: float, *, integers: bool, name: str = "duty_map") -> str:
    """Return the header of a map whose axes have even steps.

    Args:
        compensation: the map.
        model: what it was made from.
        error: its interpolation error, duty.
        integers: Q15 (32768 is a duty of 1) in uint16_t, else float.
        name: of the table and of its function, in C.

    Raises:
        ValueError: an axis is uneven.
    """
    ambient, torque = (_axis(axis) for axis in (100.0 * compensation.ambient_degC, 1e5 * compensation.load_torque_Nm))
    duty = np.where(np.isfinite(compensation.duty) & compensation.drives, compensation.duty, _HELD)
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


def looked_up(compensation: Compensation, ambient_degC, load_torque_Nm, *, integers: bool) -> np.ndarray:
    """Return what the header's function returns, as a duty: the rounded table, interpolated."""
    duty = np.where(compensation.drives, compensation.duty, np.nan)
    table = np.round(duty * Q15) / Q15 if integers else duty.astype(np.float32).astype(float)
    found = bilinear(compensation.ambient_degC, compensation.load_torque_Nm, table, ambient_degC, load_torque_Nm)
    return np.round(found * Q15) / Q15 if integers else found


def _axis(values: np.ndarray) -> tuple[int, int]:
    """Return start and step of an even axis in whole units."""
    whole = np.round(values).astype(int)
    steps = np.diff(whole)
    if np.any(np.abs(values - whole) > 1e-6) or np.any(steps != steps[0]):
        raise ValueError("A header needs axes of even steps, of whole hundredths of a degree and of a mN m.")
    return int(whole[0]), int(steps[0])
