"""The first case of a cell, from extractions and a linear start: what its calibration may move, and how far."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from jaxmodel.case.known import Known, Table
from jaxmodel.case.records import Case, Run
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.layout import was_at_rest
from jaxmodel.parameterisation.linear import lagged
from jaxmodel.parameterisation.linear_start import PACE, RESISTANCES, LinearStart, linear_start
from jaxmodel.parameterisation.result import Extraction
from jaxmodel.parameterisation.rows import Rows
from jaxmodel.parameterisation.thermal_start import thermal_start

AGE = ("cycles", "storage_months")
SCALES = ("series_resistance_scale", "rc_resistance_scale", "rc_capacitance_scale")
SCALE_SD = 0.5  # of all resistances together, and of the time constants: a linear start is no better. Assumed.
# What tells of activation energies: two ambients so far apart (design), or a cell that warms so far by its own heat (on
# made cells energies found from 4 K on predicted better than none).
APART_K, WARMS_K = 5.0, 4.0
ENTROPY_SD = 1e-4  # V/K, usual
HEATS_K = 10.0  # of a cell by its own heat, that tells of details of its heat and of its entropy
# Contacts and electrolyte 13 to 27 kJ/mol, reactions and diffusion 23 to 37. Assumed.
ENERGIES = {"R_0": 2e4, "R_S": 3e4, "R_L": 3e4}
ENERGY_SD = 7e3
EFFECTS_OF_ENERGIES = {
    "arrhenius_resistance": ("E_a", 2e4),
    "arrhenius_polarisation": ("E_rc", 1e4),
    "arrhenius_long_polarisation": ("E_l", 0.0),
}
LEAST_HYSTERESIS_V = 0.005
TILT_SD = 0.4  # of b: half its usual range. Assumed.
THERMAL_SD = 0.3  # share of C_th and hA of a linear start. Assumed.
FIRST_READING_K = 0.3  # sd of the first reading of a thermometer. Assumed.


@dataclasses.dataclass(frozen=True, eq=False)
class FirstCase:
    """Where a calibration starts.

    Attributes:
        case: with everything that it may move, to an sd.
        curves: labels of the curves that may correct its tables.
        varied: activation energies are sought.
    """

    case: Case
    curves: tuple[str, ...]
    varied: bool


def first_case(
    case: Case,
    runs: Sequence[Rows],
    drawn: Extraction,
    ohm: float,
    gaps: Sequence[Extraction],
    taus_s: Sequence[tuple[float, float]],
    noise: Sequence[Extraction],
) -> FirstCase:
    """Return the case that is calibrated.

    Args:
        case: as the user gives it.
        runs: its fit runs.
        drawn: the capacity.
        ohm: typical resistance of the cell.
        gaps: half the gap between slow branches, by temperature.
        taus_s: pairs of time constants that rests show.
        noise: of the sensors.
    """
    hysteresis = bool(gaps) and float(np.median([gap.value for gap in gaps])) > LEAST_HYSTERESIS_V
    varied = _tells_of_energies(runs)
    energies = ENERGIES if varied else dict.fromkeys(ENERGIES, 0.0)
    soc = {rows.name: counted_start(rows, drawn.value) - rows.drawn_Ah / drawn.value for rows in runs}
    h = {rows.name: _hysteresis_of(rows, drawn.value) for rows in runs} if hysteresis else None
    start = linear_start(runs, soc, h, energies, ohm, taus_s)
    heat = {rows.name: _heat(rows, soc[rows.name], start) for rows in runs}
    node = thermal_start(runs, heat, drawn.value)
    kept = {name: table for name, table in case.tables.items() if table.sd is None}
    effects, effect_sd = dict(case.effects), dict(case.effect_sd)

    def put(name: str, numbers: dict[str, tuple[float, float]]) -> None:
        if name not in effects:
            effects[name] = {key: value for key, (value, _) in numbers.items()}
            effect_sd[name] = {key: sd for key, (_, sd) in numbers.items()}

    if node is not None:
        C_th, hA = node
        put("self_heating", {"C_th": (C_th, THERMAL_SD * C_th), "hA": (hA, THERMAL_SD * hA)})
    if varied and not {"R_ints", "R_TS", "R_TL"} & set(kept):
        for name, (field, energy) in EFFECTS_OF_ENERGIES.items():
            put(name, {field: (energy, ENERGY_SD)})
    if hysteresis:
        M_V = max(start.M_V, LEAST_HYSTERESIS_V)
        put("ocv_hysteresis", {"M_V": (M_V, 0.5 * M_V), "g": (PACE, PACE), "b": (0.0, TILT_SD)})
    sd = drawn.sd if math.isfinite(drawn.sd) else 0.05 * drawn.value
    found = {"capacity_Ah": Known(drawn.value, sd)} | dict.fromkeys(SCALES, Known(1.0, SCALE_SD))
    found |= dict.fromkeys(AGE, Known(0.0))
    exact = {
        name: known
        for name, known in case.parameters.items()
        if name not in AGE and (known.sd is None or name not in found)
    }
    tables = _tables(start) | kept
    # Two ambients, or a cell that heats itself far, tell of the entropy; one ambient without heat does not.
    if "dU_dT" not in tables and (_ambients_differ(runs) or _rise_K(runs) >= HEATS_K):
        tables["dU_dT"] = Table(start.coarse, np.zeros(start.coarse.size), None, ENTROPY_SD)
    own = {rows.name: rows for rows in runs}
    # Where nothing is quiet, second differences hold what the cell does: a sensor is no worse than what a model leaves.
    sensors = {one.name.removeprefix("noise of "): one.value for one in noise}
    if "voltage_V" in sensors:
        sensors["voltage_V"] = min(sensors["voltage_V"], start.rms_V)
    changed = dataclasses.replace(
        case,
        path=None,
        parameters=found | exact,
        tables=tables,
        effects=effects,
        effect_sd=effect_sd,
        sensors=sensors | case.sensors,
        runs=tuple(_run(case, run, own.get(run.name), drawn, node is not None, hysteresis) for run in case.runs),
    )
    return FirstCase(changed, _curves(changed, kept, _rise_K(runs) >= HEATS_K), varied)


def _curves(case: Case, kept: dict[str, Table], heats: bool) -> tuple[str, ...]:
    """Return the curves of tables that may change, and of what effects of the case leave open."""
    found = []
    for name, one in CURVES.items():
        if "cell" not in one.kinds or set(kept) & set(one.tables) or not set(one.needs) <= set(case.effects):
            continue
        if "self_heating" in one.needs and not heats:
            continue
        if name.endswith("_energy") or (name == "entropy_curve" and "dU_dT" not in case.tables):
            continue
        found.append(name)
    return tuple(found)


def _tables(start: LinearStart) -> dict[str, Table]:
    ohm = start.ohm
    found = {"ocv": Table(start.soc, start.ocv_V, None, 0.01)}
    found |= {
        table: Table(start.coarse, ohm[name], None, 0.3)
        for table, name in zip(("R_ints", "R_TS", "R_TL"), RESISTANCES, strict=True)
    }
    for table, name, tau in zip(("C_TS", "C_TL"), RESISTANCES[1:], start.tau_s, strict=True):
        found[table] = Table(start.coarse, tau / ohm[name], None, 0.3)
    return found


def _run(case: Case, run: Run, rows: Rows | None, drawn: Extraction, heats: bool, hysteresis: bool) -> Run:
    """Return a run with what is known of its start; of a fit run its state of charge and capacity are uncertain."""
    changes: dict = {}
    overrides = dict(run.overrides)
    if hysteresis:
        overrides = {"initial_hysteresis": Known(initial_h(run))} | overrides
    if rows is not None and run.initial_soc.sd is not None:
        changes["initial_soc"] = Known(float(np.clip(counted_start(rows, drawn.value), 0.0, 1.0)), run.initial_soc.sd)
    read = run.measured.outputs.get("cell_temperature_degC")
    warm = heats and run.initial_cell_temperature is None and not was_at_rest(case, run)
    if warm and read is not None and np.isfinite(read).any():
        changes["initial_cell_temperature"] = Known(float(read[np.isfinite(read)][0]), FIRST_READING_K)
    return dataclasses.replace(run, overrides=overrides, **changes)


def counted_start(rows: Rows, capacity_Ah: float) -> float:
    """Return the state of charge at which a run starts: as stated, or counted back from full or empty.

    Where the count of the charge leaves 0 to 1, the stated start is wrong: the run is then full at its fullest, or
    empty at its emptiest. Where it passes more than the capacity, the end that it leaves further decides.
    """
    stated = rows.run.initial_soc.value
    soc = stated - rows.drawn_Ah / capacity_Ah
    above, below = max(float(soc.max()) - 1.0, 0.0), max(-float(soc.min()), 0.0)
    return stated - above if above > below else stated + below


def initial_h(run: Run) -> float:
    """Return the state of the hysteresis at the start: -1 after a charge to full, 1 after a discharge to empty."""
    soc = run.initial_soc.value
    return -1.0 if soc > 0.9 else 1.0 if soc < 0.1 else 0.0


def _hysteresis_of(rows: Rows, capacity_Ah: float) -> np.ndarray:
    """Return h at each row: dh/dt = |g i / Q| (sgn(i) - h)."""
    passed = np.append(0.0, np.cumsum(np.diff(rows.time_s) * np.abs(rows.current_A[1:]))) / 3600.0
    return lagged(passed, np.sign(rows.current_A), capacity_Ah / PACE, first=initial_h(rows.run))


def _heat(rows: Rows, soc: np.ndarray, start: LinearStart) -> np.ndarray:
    """Return i (U - V) at each row."""
    voltage = np.interp(rows.time_s, rows.time_s[rows.read], rows.voltage_V[rows.read])
    return rows.current_A * (np.interp(soc, start.soc, start.ocv_V) - voltage)


def _ambients_differ(runs: Sequence[Rows]) -> bool:
    return float(np.ptp([np.median(rows.ambient_degC) for rows in runs])) >= APART_K


def _tells_of_energies(runs: Sequence[Rows]) -> bool:
    """Return True if two ambients are far apart, or a cell warms far by its own heat."""
    return _ambients_differ(runs) or _rise_K(runs) >= WARMS_K


def _rise_K(runs: Sequence[Rows]) -> float:
    """Return by how much a cell warms in any run."""
    return max(float(np.ptp(np.percentile(rows.degC - rows.ambient_degC, [1, 99]))) for rows in runs)
