"""Thermal resistances and time constants of a motor from its heating (eqs. 15 and 16), by variable projection.

T_c = T_amb + lag(P, tau_ca) R_ca,    T_w = T_c + lag(P, tau_wc) R_wc,    P = i^2 R + |w| friction

Where a share s of P reaches the case through the winding (`heat_path`), (1 - s) P + s (T_w - T_c)/R_wc stands for P in
the first and T_w - T_c + s (T_c - lag(T_c, tau_wc)) for T_w - T_c in the second; iron loss adds to the first.

The start of each run is its first reading, which is as noisy as any other: it is fitted too, with that as its prior.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy.optimize import fminbound

from jaxmodel.case.records import Case
from jaxmodel.effects.drive import HeatPath, IronLoss
from jaxmodel.fit.likelihood import autocorrelation_time
from jaxmodel.model.declaration import describe
from jaxmodel.parameterisation.linear import lagged
from jaxmodel.parameterisation.motor_rows import MotorRows
from jaxmodel.parameterisation.result import Extraction

LEAST_RISE_K = 2.0
TAU_S = {"wc": (2.0, 2000.0), "ca": (30.0, 50_000.0)}


def motor_thermal(
    runs: Sequence[MotorRows],
    R: float,
    psi_R: float,
    T_0: float,
    friction,
    exact: Mapping[str, float],
    iron: Callable[[np.ndarray], np.ndarray] = np.zeros_like,
    share: float = 0.0,
) -> tuple[list[Extraction], pd.DataFrame]:
    """Return R_wc, tau_wc, R_ca and tau_ca as far as thermometers show them, and the readings with the fit.

    Args:
        runs: of one motor.
        R: winding resistance at T_0 [ohm].
        psi_R: its temperature coefficient [1/K].
        T_0: reference temperature [degC].
        friction: returns the friction torque [N m] at speeds [rad/s].
        exact: resistances and time constants that are known.
        iron: returns the drag of the iron [N m] at speeds [rad/s].
        share: of the winding's heat that reaches the case through the winding.
    """
    found: list[Extraction] = []
    tables = []
    over_case = exact.get("R_wc")
    jobs = (
        ("wc", lambda rows: rows.winding_degC, lambda rows: rows.case_degC),
        ("ca", lambda rows: rows.case_degC, lambda rows: rows.ambient_degC),
    )
    for name, top, base in jobs:
        parts = []
        for rows in runs:
            if rows.current_A is None or top(rows) is None or base(rows) is None:
                continue
            rise = top(rows) - base(rows)
            if np.isfinite(rise).sum() < 10 or np.nanmax(rise) < LEAST_RISE_K:
                continue
            speed = np.zeros(rows.time_s.size) if rows.speed_rad_s is None else np.nan_to_num(rows.speed_rad_s)
            warm_R = R * (1.0 + psi_R * (rows.hot_degC(T_0) - T_0))
            power = np.nan_to_num(rows.current_A) ** 2 * warm_R + np.abs(speed) * friction(speed)
            follows = np.zeros(rows.time_s.size)
            if name == "wc":
                follows = share * _filled(rows.time_s, base(rows))
            else:
                through = power
                if share and over_case is not None and rows.winding_degC is not None:
                    through = _over_steps(_filled(rows.time_s, rows.winding_degC - rows.case_degC)) / over_case
                power = power + share * (through - power) + np.abs(speed * iron(speed))
            parts.append((rows, rise, power, follows))
        if not parts:
            continue
        one, table = _node(parts, name, exact.get(f"R_{name}"), exact.get(f"tau_{name}"))
        if name == "wc":
            over_case = one[0].value
        found = one + found
        tables.insert(0, table)
    return found, pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def heat_of_effects(case: Case) -> tuple[Callable[[np.ndarray], np.ndarray], float]:
    """Return what effects of a case say: the iron's drag [N m] over the speed, and the share through the winding."""
    iron, path = case.effects.get("iron_loss"), case.effects.get("heat_path")

    def drag(speed: np.ndarray) -> np.ndarray:
        if iron is None:
            return np.zeros_like(speed)
        T_h, w_e = (float(iron.get(name, info.default)) for name, info in describe(IronLoss).items())
        return T_h * (1.0 + np.abs(speed) / w_e)

    return drag, 0.0 if path is None else float(path.get("s", describe(HeatPath)["s"].default))


def _filled(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    there = np.isfinite(values)
    return np.interp(time_s, time_s[there], values[there])


def _over_steps(values: np.ndarray) -> np.ndarray:
    """Return the means over the steps that end at each row of what is read at rows."""
    return np.append(values[:1], 0.5 * (values[1:] + values[:-1]))


def _node(parts, name: str, known_R: float | None, known_tau: float | None) -> tuple[list[Extraction], pd.DataFrame]:
    """Return resistance and time constant of one step of the chain, of which one or both may be known."""

    def solved(log_tau: float):
        """Return the resistance, the squares, and by run what is left and the column of the resistance.

        The start of a run, in columns d of its decay, is eliminated: with x the heat and y the rise,
        start = d (y - R x) / (1 + d d).
        """
        tau, over, under, each = float(np.exp(log_tau)), 0.0, 0.0, []
        for rows, rise, power, follows in parts:
            there = np.isfinite(rise)
            if follows.any():
                rise = rise + follows - lagged(rows.time_s, _over_steps(follows), tau, first=follows[0])
            decay = lagged(rows.time_s, np.zeros(rows.time_s.size), tau, first=1.0)[there]
            share = decay / (1.0 + float(decay @ decay))
            x, y = lagged(rows.time_s, power.copy(), tau)[there], rise[there] - float(rise[there][0]) * decay
            over += float(x @ y) - float(decay @ y) * float(share @ x)
            under += float(x @ x) - float(decay @ x) * float(share @ x)
            each.append((x, y, decay, share))
        ohm = over / max(under, 1e-30) if known_R is None else known_R
        starts = [float(share @ (y - ohm * x)) for x, y, _, share in each]
        left = [y - ohm * x - start * decay for (x, y, decay, _), start in zip(each, starts, strict=True)]
        squares = float(sum(one @ one for one in left)) + float(np.sum(np.square(starts)))
        return ohm, squares, left, [x - decay * float(share @ x) for x, _, decay, share in each]

    if known_tau is None:
        low, high = np.log(TAU_S[name])
        grid = np.linspace(low, high, 30)
        best = grid[int(np.argmin([solved(at)[1] for at in grid]))]
        step = grid[1] - grid[0]
        at = float(np.asarray(fminbound(lambda x: solved(x)[1], best - step, best + step)))
    else:
        at = float(np.log(known_tau))
    ohm, squares, left, warmed = solved(at)
    up, down = solved(at + 0.05), solved(at - 0.05)
    rows_of_all = sum(one.size for one in left)
    # Derivatives by log R and log tau: the fit at a fixed resistance.
    slope = np.concatenate(
        [
            ((lu + (up[0] - ohm) * xu) - (ld + (down[0] - ohm) * xd)) / -0.1
            for lu, ld, xu, xd in zip(up[2], down[2], up[3], down[3], strict=True)
        ]
    )
    by_R = ohm * np.concatenate(warmed)
    jacobian = np.column_stack([by_R * (known_R is None), slope * (known_tau is None)])
    variance = squares / max(rows_of_all - 2, 1) * autocorrelation_time(left)
    sd = np.sqrt(np.diag(np.linalg.pinv(jacobian.T @ jacobian)) * variance)
    names = tuple(rows.name for rows, *_ in parts)
    samples = f"{rows_of_all} readings, {np.sqrt(squares / rows_of_all):.2g} K left"
    method = "heating by the losses of eq. 16"
    tau = float(np.exp(at))
    table = pd.concat(
        [
            pd.DataFrame(
                {
                    "run": rows.name,
                    "node": name,
                    "time_s": rows.time_s[np.isfinite(rise)],
                    "degC": rise[np.isfinite(rise)],
                    "fit_degC": rise[np.isfinite(rise)] - one,
                }
            )
            for (rows, rise, *_), one in zip(parts, left, strict=True)
        ],
        ignore_index=True,
    )
    return [
        Extraction(f"R_{name}", ohm, max(float(sd[0]) * ohm, 0.01 * ohm), "K/W", names, samples, method),
        Extraction(f"tau_{name}", tau, max(float(sd[1]) * tau, 0.01 * tau), "s", names, samples, method),
    ], table
