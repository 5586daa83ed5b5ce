"""The numbers of a calibrated cell with their sd: curves at points, time constants, activation energies."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jaxmodel.case.known import Table
from jaxmodel.effects.curves import Curve
from jaxmodel.model.cell import GAS_CONSTANT, REFERENCE_DEGC, ZERO_DEGC_IN_K
from jaxmodel.parameterisation.calibration import Calibrated
from jaxmodel.parameterisation.linear import hats
from jaxmodel.parameterisation.result import Extraction
from jaxmodel.parameterisation.rows import Rows

REFIT = "joint refit of all curves"
SOC = (0.2, 0.5, 0.9)  # at which tables are told
MERGED_K = 6.0  # ambients closer than this are told as one temperature
WARM_K = 10.0  # a cell that warms by more above its warmest ambient is told there too
TOLD_DEGC = 25.0  # at which a time constant is told
LEAST_SD, LEAST_SD_V = 0.01, 2e-4  # share; V
UNITS = {"ocv": "V", "R_ints": "ohm", "R_TS": "ohm", "R_TL": "ohm"}
# What moves the logarithm of a resistance or of a time constant: curves, scales and activation energies.
_CURVES = {
    "ocv": ("ocv_curve",),
    "R_ints": ("series_resistance_curve",),
    "R_TS": ("short_resistance_curve",),
    "R_TL": ("long_resistance_curve",),
    "tau_S": ("short_time_curve",),
    "tau_L": ("long_time_curve",),
}
_SCALES = {"R_ints": ("series_resistance_scale",)}
_SCALES |= dict.fromkeys(("R_TS", "R_TL"), ("rc_resistance_scale",))
_SCALES |= dict.fromkeys(("tau_S", "tau_L"), ("rc_resistance_scale", "rc_capacitance_scale"))
_ENERGIES = ("arrhenius_resistance.E_a", "arrhenius_polarisation.E_rc", "arrhenius_long_polarisation.E_l")
_OF_ENERGIES = {"R_ints": 1, "R_TS": 2, "tau_S": 2, "R_TL": 3, "tau_L": 3}


class Numbers:
    """Numbers of a calibrated case, with the sd that follow from those of its unknowns to first order."""

    def __init__(self, found: Calibrated) -> None:
        """Take the calibrated case."""
        self._found = found
        fit, layout = found.fit, found.cache.space.layout
        self._size = len(fit.spec.free)
        of_all = [number for number, place in enumerate(fit.spec.free) if layout.runs[place] < 0]
        self._columns = {layout.names[fit.spec.free[number]]: number for number in of_all}
        # As the sd of single unknowns: the larger of posterior and sandwich over runs.
        larger = fit.sd / np.sqrt(np.diag(fit.covariance))
        self._covariance = fit.covariance * larger[:, None] * larger

    @property
    def covered(self) -> tuple[float, float]:
        """Return the states of charge between which the fit runs were."""
        soc = self._found.case.tables["ocv"].soc
        return float(soc[0]), float(soc[-1])

    def at(self, name: str, soc: float, degC: float) -> tuple[float, float]:
        """Return a table [V or ohm] or a time constant (`tau_S`, `tau_L`) [s] at a point, and its sd."""
        slope = self._slope(name, np.array([soc]), degC)[0]
        sd = float(np.sqrt(max(slope @ self._covariance @ slope, 0.0)))
        tables = self._found.case.tables
        if name == "ocv":
            moved = _at(tables["dU_dT"], soc, degC) * (degC - REFERENCE_DEGC) if "dU_dT" in tables else 0.0
            return _at(tables["ocv"], soc, degC) + moved, sd
        ohm = _at(tables[name if name in tables else f"R_T{name[-1]}"], soc, degC)
        farad = 1.0 if name in tables else _at(tables[f"C_T{name[-1]}"], soc, degC)
        energy, _ = self.energy(name)
        # A scale is in its tables, or one of these is exact, and it is a number of the case.
        scale = math.prod(self._found.case.parameters[one].value for one in _SCALES[name])
        value = scale * ohm * farad * float(np.exp(energy * _colder(degC)))
        return value, sd * value

    def energy(self, name: str) -> tuple[float, float]:
        """Return the activation energy of a resistance or time constant [J/mol], and its sd."""
        slope, total = np.zeros(self._size), 0.0
        for full in _ENERGIES[: _OF_ENERGIES[name]]:
            effect, field = full.split(".")
            total += float(self._found.case.effects.get(effect, {}).get(field, 0.0))
            if full in self._columns:
                slope[self._columns[full]] = self._rate(full)
        return total, float(np.sqrt(max(slope @ self._covariance @ slope, 0.0)))

    def table_sd(self, name: str) -> float:
        """Return the typical sd of a table: V of `ocv`, else a share."""
        parts = {"C_TS": ("R_TS", "tau_S"), "C_TL": ("R_TL", "tau_L")}.get(name, (name,))
        soc = self._found.case.tables[name].soc
        slopes = [self._slope(part, soc, REFERENCE_DEGC) for part in parts]
        sd = np.sqrt(sum(np.maximum(np.sum((one @ self._covariance) * one, axis=1), 0.0) for one in slopes))
        typical = float(np.median(sd))
        return max(typical, LEAST_SD_V) if name == "ocv" else float(np.clip(typical, LEAST_SD, 1.0))

    def _slope(self, name: str, soc: np.ndarray, degC: float) -> np.ndarray:
        """Return the derivatives of `ocv`, or of a logarithm, by the free coordinates, (soc, free)."""
        slope, space, fit = np.zeros((soc.size, self._size)), self._found.cache.space, self._found.fit
        factors = dict.fromkeys(_CURVES[name], 1.0)
        factors |= {"entropy_curve": degC - REFERENCE_DEGC} if name == "ocv" else {}
        for label, factor in factors.items():
            if label in fit.spec.labels:
                candidate = space.candidates[label]
                assert isinstance(candidate.effect, Curve)
                columns = [fit.spec.free.index(place) for place in space.layout.of[label]]
                slope[:, columns] += factor * hats(soc, candidate.effect.knots) @ candidate.mix
        for scale in _SCALES.get(name, ()):
            if scale in self._columns:
                slope[:, self._columns[scale]] = self._rate(scale) / self._found.estimates[scale].value
        for full in _ENERGIES[: _OF_ENERGIES.get(name, 0)]:
            if full in self._columns:
                slope[:, self._columns[full]] = self._rate(full) * _colder(degC)
        return slope

    def _rate(self, name: str) -> float:
        """Return d(value)/d(coordinate) of a number of all runs."""
        place = self._found.fit.spec.free[self._columns[name]]
        return self._found.cache.space.layout.coordinates[place].slope(self._found.fit.x[place])


def _at(table: Table, soc: float, degC: float) -> float:
    """Return the value of a table at a point."""
    of_rows = [float(np.interp(soc, table.soc, row)) for row in np.atleast_2d(table.values)]
    return of_rows[0] if table.temperature_degC is None else float(np.interp(degC, table.temperature_degC, of_rows))


def _colder(degC: float) -> float:
    """Return (1 / T_K - 1 / 293.15 K) / 8.314 in mol/J."""
    return (1.0 / (degC + ZERO_DEGC_IN_K) - 1.0 / (REFERENCE_DEGC + ZERO_DEGC_IN_K)) / GAS_CONSTANT


def temperatures(runs: Sequence[Rows]) -> list[float]:
    """Return the temperatures at which curves are told: the ambients of the runs, and that of a cell that warms far."""
    levels: list[list[float]] = []
    for middle in sorted(float(np.median(rows.ambient_degC)) for rows in runs):
        if levels and middle - np.mean(levels[-1]) < MERGED_K:
            levels[-1].append(middle)
        else:
            levels.append([middle])
    degC = [float(np.mean(level)) for level in levels]
    warmest = float(np.percentile(np.concatenate([rows.degC for rows in runs]), 98))
    if warmest > degC[-1] + WARM_K:
        degC.append(warmest)
    return [round(one, 1) for one in degC]


def table_extractions(numbers: Numbers, runs: Sequence[Rows], varied: bool, samples: str) -> list[Extraction]:
    """Return the curves at a few states of charge for each temperature, the time constants and the energies."""
    names, said = tuple(rows.name for rows in runs), []
    low, high = numbers.covered
    levels = temperatures(runs) if varied else temperatures(runs)[:1]
    for name, unit in UNITS.items():
        for T in temperatures(runs) if name == "ocv" else levels:
            for soc in (one for one in SOC if low <= one <= high):
                where = f"{name} at SOC {soc:g}, {T:.3g} degC"
                said.append(Extraction(where, *numbers.at(name, soc, T), unit, names, samples, REFIT))
    middle = float(np.clip(0.5, low, high))
    for which, name in (("short", "tau_S"), ("long", "tau_L")):
        method, tau = f"{REFIT}; at SOC {middle:.2g}, {TOLD_DEGC:g} degC", numbers.at(name, middle, TOLD_DEGC)
        said.append(Extraction(f"time constant, {which} pair", *tau, "s", names, samples, method))
    for name in ("R_ints", "R_TS", "R_TL") if varied else ():
        method = f"{REFIT}, with one Arrhenius law for all of its states of charge"
        said.append(Extraction(f"activation energy of {name}", *numbers.energy(name), "J/mol", names, samples, method))
    return said
