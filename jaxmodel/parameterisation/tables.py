"""From the curves of a joint fit to the tables of a case, with their sd, and the numbers that tell them."""

from __future__ import annotations

import numpy as np

from jaxmodel.case.known import Table
from jaxmodel.parameterisation.design import COARSE, colder
from jaxmodel.parameterisation.joint import JointFit
from jaxmodel.parameterisation.result import Extraction

LEAST_OHM = 1e-5  # the model wants more than nothing
BEYOND_K, STEP_K = 20.0, 5.0  # tables over temperature reach beyond the data by the Arrhenius law, in such steps
CURVES = {"R_ints": "R_0", "R_TS": "R_S", "R_TL": "R_L"}
LEAST_SD = 0.01  # share


def temperatures(fit: JointFit) -> np.ndarray:
    """Return the temperatures of the tables: the points of the fit, between and beyond them every few kelvin."""
    inner = fit.grid.degC
    grid = np.arange(np.floor((inner[0] - BEYOND_K) / STEP_K) * STEP_K, inner[-1] + BEYOND_K + 0.1, STEP_K)
    far = np.all(np.abs(grid[:, None] - inner[None, :]) > 0.4 * STEP_K, axis=1)
    return np.sort(np.concatenate([inner, grid[far]]))


def tables_of(fit: JointFit, over_temperature: bool) -> dict[str, Table]:
    """Return the tables `ocv`, `R_ints`, `R_TS`, `R_TL`, `C_TS` and `C_TL` of a fit.

    A pair has a constant time constant: C = tau / R at each point.

    Args:
        fit: of the curves.
        over_temperature: whether the fit knows how resistances depend on temperature.
    """
    fine, coarse = (
        fit.grid.fine,
        np.unique(np.concatenate([fit.grid.coarse, 0.5 * (fit.grid.coarse[1:] + fit.grid.coarse[:-1])])),
    )
    many = fit.grid.degC.size > 1
    found = {}
    ocv_degC = fit.grid.degC
    ocv = np.array([fit.curve("U", fine, float(T)) for T in ocv_degC])
    ocv_sd = float(np.median([fit.curve_sd("U", fine, float(T)) for T in ocv_degC]))
    found["ocv"] = Table(fine, ocv if many else ocv[0], ocv_degC if many else None, max(ocv_sd, 2e-4))
    degC = temperatures(fit) if over_temperature else fit.grid.degC[:1]
    for name, curve in CURVES.items():
        ohm = np.maximum([fit.curve(curve, coarse, float(T)) for T in degC], LEAST_OHM)
        inside = [float(T) for T in fit.grid.degC]
        spread = np.array(
            [fit.curve_sd(curve, coarse, T) / np.maximum(fit.curve(curve, coarse, T), 1e-4) for T in inside]
        )
        sd = float(np.clip(np.median(spread), LEAST_SD, 1.0))
        found[name] = _table(coarse, ohm, degC, sd)
        if name == "R_ints":
            continue
        tau = fit.shape.tau_S if curve == "R_S" else fit.shape.tau_L
        tau_sd = fit.shape_sd.get("tau_S" if curve == "R_S" else "tau_L", 0.3)
        times = tau * np.exp((fit.shape.E_S if curve == "R_S" else fit.shape.E_L) * colder(degC))
        found[f"C_{name[2:]}"] = _table(
            coarse, times[:, None] / ohm, degC, float(np.clip(np.hypot(sd, tau_sd), LEAST_SD, 1.0))
        )
    return found


def _table(soc: np.ndarray, values: np.ndarray, degC: np.ndarray, sd: float) -> Table:
    if degC.size == 1:
        return Table(soc, values[0], None, sd)
    return Table(soc, values, degC, sd)


def table_extractions(fit: JointFit, runs: tuple[str, ...]) -> list[Extraction]:
    """Return the curves at SOC 0.2, 0.5 and 0.9 for each temperature, the time constants and the energies."""
    said = []
    samples = (
        f"{sum(r.size for r in fit.residuals.values())} readings, {1e3 * np.sqrt(fit.solution.variance):.3g} mV left"
    )
    names = {"ocv": ("U", "V")} | {name: (curve, "ohm") for name, curve in CURVES.items()}
    low, high = fit.grid.coarse[0], fit.grid.coarse[-1]
    for name, (curve, unit) in names.items():
        for T in fit.grid.degC:
            for soc in (s for s in (0.2, 0.5, 0.9) if low <= s <= high):
                value = float(fit.curve(curve, np.array([soc]), float(T))[0])
                sd = float(fit.curve_sd(curve, np.array([soc]), float(T))[0])
                where = f"{name} at SOC {soc:g}, {T:.3g} degC"
                said.append(Extraction(where, value, sd, unit, runs, samples, "joint refit of all curves"))
    for name, field in (("short", "tau_S"), ("long", "tau_L")):
        value = getattr(fit.shape, field)
        sd = value * fit.shape_sd.get(field, float("nan"))
        said.append(
            Extraction(
                f"time constant, {name} pair", value, sd, "s", runs, samples, "variable projection in the joint refit"
            )
        )
    for name, field in (("R_ints", "E_0"), ("R_TS", "E_S"), ("R_TL", "E_L")):
        if field in fit.shape_sd:
            value = getattr(fit.shape, field)
            said.append(
                Extraction(
                    f"activation energy of {name}",
                    value,
                    fit.shape_sd[field],
                    "J/mol",
                    runs,
                    samples,
                    "variable projection in the joint refit, with tables held to the Arrhenius law",
                )
            )
    return said


def pooled_sd(fit: JointFit, curves: tuple[str, ...]) -> float:
    """Return the relative sd of the mean of some curves over the middle of the charge: that of one scale for all."""
    soc = COARSE[(COARSE >= fit.grid.coarse[0]) & (COARSE <= fit.grid.coarse[-1])]
    soc = soc[(soc >= 0.1) & (soc <= 0.95)] if np.any((soc >= 0.1) & (soc <= 0.95)) else fit.grid.coarse
    T = float(fit.grid.degC[-1])
    weights = sum(fit.weights(curve, soc, T).mean(axis=0) for curve in curves)
    mean = float(weights @ fit.solution.values)
    return float(np.clip(np.sqrt(weights @ fit.solution.covariance @ weights) / max(mean, 1e-6), LEAST_SD, 1.0))
