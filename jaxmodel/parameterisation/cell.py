"""Parameters of a cell from its fit runs: each extraction in turn, and the case that holds them all."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.errors import FitError
from jaxmodel.base.remark import Remark
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.parameterisation.capacity import capacity
from jaxmodel.parameterisation.design import COARSE, FINE, Grid, Shape, Start
from jaxmodel.parameterisation.joint import JointFit, fit_joint
from jaxmodel.parameterisation.noise import sensor_noise
from jaxmodel.parameterisation.ocv import branches, hysteresis_gap, rested
from jaxmodel.parameterisation.relaxation import relaxations, time_constants
from jaxmodel.parameterisation.resistance import first_sample, step_resistances
from jaxmodel.parameterisation.result import Extraction, Parameterisation, absent
from jaxmodel.parameterisation.rows import Rows, rows_of
from jaxmodel.parameterisation.search import ENERGIES, PRIORS
from jaxmodel.parameterisation.tables import pooled_sd, table_extractions, tables_of
from jaxmodel.parameterisation.thermal import Thermal, fit_thermal, thermal_extractions

AGE = ("cycles", "storage_months")
MERGED_K = 6.0  # temperatures closer than this share a point of the tables
LEAST_SPAN_K = 4.0  # of all fit runs, for an activation energy to be sought
WARM_K = 10.0  # a cell that warms by more above its warmest run gets a point there
FIRST_TAU_S = (4.0, 120.0)  # of the pairs: usual of cells of 2 to 5 A h. Assumed.
FIRST_ENERGY = {name: PRIORS[name][0] for name in ENERGIES}  # J/mol
LEAST_SPAN = 0.05  # of the state of charge, over which curves have points
LEAST_HYSTERESIS_V = 0.005
FIRST_PACE = 40.0
LEAST_ROWS = 30
LEAST_FADE = 1e-3
FADE_SD, OWN_FADE_SD = 0.02, 0.003  # of the capacity from run to run, and of runs that define it. Assumed.
EXACT = 1e-6
MOVED_SOC = 0.01  # of a start, from which that is said
MOST_SHARE_SD = 0.7  # relative sd of C_th or hA from which the data do not give them


def parameterise_cell(case: Case, progress: Callable[[str], None] | None = None) -> Parameterisation:
    """Return first parameters of a cell.

    Raises:
        FitError: the fit runs have no voltage, or no current flows in them.
    """
    runs = _usable(case)
    tell = progress or (lambda stage: None)
    tell("capacity, resting and slow voltages")
    drawn = capacity(case, runs)
    Q = drawn.value
    noise = _noise(runs)
    noise_V = next((n.value for n in noise if n.name == "noise of voltage_V"), 1e-3)
    steps = step_resistances(runs, Q, noise_V)
    relaxed = relaxations(runs, Q)
    slow = branches(runs, Q)
    ohm = float(np.median(steps["ohm"].to_numpy())) if len(steps) else 0.15 / Q
    gaps = hysteresis_gap(slow, 2.0 * ohm)
    fit = _joint(drawn, runs, 2.0 * ohm, gaps, tell)
    tell("heating and cooling")
    thermal = fit_thermal(runs, fit, Q)
    if thermal is not None and max(thermal.C_th_sd / thermal.C_th, thermal.hA_sd / thermal.hA) > MOST_SHARE_SD:
        thermal = None
    varied = any(name.startswith("E_") for name in fit.shape_sd)
    found = [drawn, *first_sample(steps), *time_constants(relaxed), *gaps]
    found += table_extractions(fit, tuple(rows.name for rows in runs))
    found += _capacity_of_runs(drawn, fit)
    found += _hysteresis(fit, runs)
    found += thermal_extractions(thermal) if thermal else []
    found += noise
    found += _missing(runs, fit, thermal, steps, slow, varied)
    points = {
        "slow": slow,
        "rests": rested(runs, Q),
        "resistance": steps,
        "relaxation": relaxed,
        "fit": _fitted(runs, fit),
    }
    if thermal:
        points["thermal"] = thermal.points
    said = _case(case, drawn, fit, thermal, noise, varied)
    points = {name: table for name, table in points.items() if len(table)}
    remarks = _remarks(fit, runs)
    if any(case.parameters[name].value for name in AGE if name in case.parameters):
        sentence = "The numbers hold the cell's age; cycles and storage_months count from here."
        remarks = (*remarks, Remark(sentence, "age_included", ", ".join(AGE)))
    return Parameterisation(said, tuple(found), points, remarks)


def _usable(case: Case) -> list[Rows]:
    fitted = [run for run in case.runs if run.split == "fit"]
    if not fitted:
        raise FitError(f'{case.label}: there is no fit run; parameters are extracted from runs with split = "fit".')
    without = [run.name for run in fitted if "voltage_V" not in run.measured.outputs]
    runs = [rows_of(run) for run in fitted if "voltage_V" in run.measured.outputs]
    if not runs:
        raise FitError(f"{case.label}: no fit run has the reading 'voltage_V' ({', '.join(without)}); add that column.")
    runs = [rows for rows in runs if rows.read.sum() >= LEAST_ROWS and np.ptp(rows.drawn_Ah) > 0.0]
    if not runs:
        raise FitError(
            f"{case.label}: no fit run has a current and {LEAST_ROWS} readings of the voltage; "
            "give a run with pulses, or a discharge."
        )
    return runs


def _noise(runs: Sequence[Rows]) -> list[Extraction]:
    """Return the noise of voltage, current and temperature; voltage and current where the current is quiet."""
    measured = [rows.run for rows in runs]
    still = []
    for rows in runs:
        current = rows.run.measured.inputs["current_A"]
        level = 0.02 * float(np.max(np.abs(current)))
        still.append(np.abs(np.gradient(current)) < level)
    found = [sensor_noise(measured, "voltage_V", "V", still), sensor_noise(measured, "current_A", "A", still)]
    found.append(sensor_noise(measured, "cell_temperature_degC", "K"))
    return [one for one in found if one is not None]


def grid_of(runs: Sequence[Rows], starts: dict[str, Start], capacity_Ah: float) -> Grid:
    """Return the points of the curves: over the span of the charge, and at the temperatures of the runs."""
    soc = np.concatenate(
        [
            starts[rows.name].soc
            - rows.drawn_Ah[[int(np.argmin(rows.drawn_Ah)), int(np.argmax(rows.drawn_Ah))]] / capacity_Ah
            for rows in runs
        ]
    )
    low = float(np.clip(soc.min(), 0.0, 1.0 - LEAST_SPAN))
    high = float(np.clip(soc.max(), low + LEAST_SPAN, 1.0))
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
    free = tuple(rows.name for rows in runs if starts[rows.name].sd is not None)
    return Grid(low + (high - low) * FINE, low + (high - low) * COARSE, np.round(degC, 1), free)


def _counted_start(rows: Rows, capacity_Ah: float) -> float:
    """Return the state of charge at which a run starts: as stated, or counted back from full or empty.

    Where the count of the charge leaves 0 to 1, the stated start is wrong: the run is then full at its fullest, or
    empty at its emptiest. Where it passes more than the capacity, the end that it leaves further decides.
    """
    stated = rows.run.initial_soc.value
    soc = stated - rows.drawn_Ah / capacity_Ah
    above, below = max(float(soc.max()) - 1.0, 0.0), max(-float(soc.min()), 0.0)
    return stated - above if above > below else stated + below


def _joint(drawn: Extraction, runs: Sequence[Rows], ohm: float, gaps: Sequence[Extraction], tell) -> JointFit:
    hysteresis = bool(gaps) and float(np.median([gap.value for gap in gaps])) > LEAST_HYSTERESIS_V
    starts = {}
    for rows in runs:
        start, stated = _counted_start(rows, drawn.value), rows.run.initial_soc
        h = _initial_h(rows.run) if hysteresis else 0.0
        # Without a run that defines the capacity, that of a run is not told from a shift of its charge.
        fade_sd = EXACT if not drawn.found else OWN_FADE_SD if rows.name in drawn.runs else FADE_SD
        starts[rows.name] = Start(start, stated.sd, h, fade_sd=fade_sd)
    grid = grid_of(runs, starts, drawn.value)
    span = float(np.ptp(np.concatenate([np.percentile(rows.degC, [2, 98]) for rows in runs])))
    energies = FIRST_ENERGY if span > LEAST_SPAN_K else {}
    first = Shape(*FIRST_TAU_S, **energies, g=FIRST_PACE if hysteresis else None)
    searched = ["tau_S", "tau_L", *energies, *(["g"] if hysteresis else [])]
    return fit_joint(runs, grid, drawn.value, starts, first, searched, ohm, tell)


def _initial_h(run: Run) -> float:
    """Return the state of the hysteresis at the start: -1 after a charge to full, 1 after a discharge to empty."""
    soc = run.initial_soc.value
    return -1.0 if soc > 0.9 else 1.0 if soc < 0.1 else 0.0


def _capacity_of_runs(drawn: Extraction, fit: JointFit) -> list[Extraction]:
    if len(fit.grid.runs) < 2 or not drawn.found:
        return []
    typical = _typical_capacity(drawn, fit)
    method = "joint refit: a capacity of its own for each run, by age or by the gain of its current sensor"
    sd = typical.sd or math.nan
    return [Extraction("capacity over all fit runs", typical.value, sd, "A h", fit.grid.runs, "all readings", method)]


def _hysteresis(fit: JointFit, runs: Sequence[Rows]) -> list[Extraction]:
    if fit.shape.g is None:
        return []
    M, sd = fit.value("M")
    names = tuple(rows.name for rows in runs)
    g_sd = fit.shape.g * fit.shape_sd.get("g", math.nan)
    return [
        Extraction("M_V", M, sd, "V", names, "all readings", "joint refit, effect ocv_hysteresis"),
        Extraction("g", fit.shape.g, g_sd, "", names, "all readings", "variable projection in the joint refit"),
    ]


def _missing(runs, fit: JointFit, thermal: Thermal | None, steps, slow, varied: bool) -> list[Extraction]:
    """Return what the data cannot give, where it comes from, and the test that would give it."""
    said = []
    if not varied:
        where = f"a constant, the value at {fit.grid.degC[0]:.3g} degC"
        test = "Pulses at two temperatures 10 K apart or more would give it."
        said.append(absent("activation energies", 0.0, "J/mol", where, test))
    if thermal is None:
        why = "nothing: the cell is taken to have the ambient temperature"
        test = "A thermometer on the cell in a discharge at 1C or more, with the cooling after it, would give them."
        said.append(absent("C_th and hA", math.nan, "", why, test))
    if not len(steps):
        test = "Pulses logged at 1 s or faster would give it."
        said.append(absent("first-sample resistance", math.nan, "ohm", "the joint refit", test))
    if not len(slow):
        test = "A C/20 discharge and charge would show it, and the hysteresis."
        said.append(absent("slow open-circuit voltage", math.nan, "V", "rests and the joint refit", test))
    elif set(slow["branch"]) != {"charge", "discharge"}:
        test = "The other slow branch (charge or discharge) would give it."
        said.append(
            absent("hysteresis", 0.0, "V", "nothing: the slow branch is taken for the open-circuit voltage", test)
        )
    low = float(fit.grid.coarse[0])
    if low > 0.05:
        test = "A discharge to empty would give them."
        said.append(absent(f"curves below SOC {low:.2g}", math.nan, "", f"their value at SOC {low:.2g}", test))
    return said


def _fitted(runs: Sequence[Rows], fit: JointFit) -> pd.DataFrame:
    """Return readings with the joint fit: run, time_s, voltage_V, fit_V."""
    tables = []
    for rows in runs:
        at = fit.kept[rows.name]
        voltage = rows.voltage_V[at]
        columns = {"time_s": rows.time_s[at], "voltage_V": voltage, "fit_V": voltage - fit.residuals[rows.name]}
        tables.append(pd.DataFrame({"run": rows.name, **columns}))
    return pd.concat(tables, ignore_index=True)


def _case(case: Case, drawn: Extraction, fit: JointFit, thermal: Thermal | None, noise, varied: bool) -> Case:
    """Return the case with everything found; what it states as exact stays, but for the age, which the numbers hold."""
    found = {"capacity_Ah": _typical_capacity(drawn, fit)}
    found["series_resistance_scale"] = Known(1.0, pooled_sd(fit, ("R_0",)))
    found["rc_resistance_scale"] = Known(1.0, pooled_sd(fit, ("R_S", "R_L")))
    spread = float(np.clip(max(fit.shape_sd.get("tau_S", 0.3), fit.shape_sd.get("tau_L", 0.3)), 0.02, 1.0))
    found["rc_capacitance_scale"] = Known(1.0, spread)
    found |= dict.fromkeys(AGE, Known(0.0))
    found["nominal_cell_voltage_V"] = Known(_mean_voltage(fit))
    exact = {
        name: known
        for name, known in case.parameters.items()
        if name not in AGE and (known.sd is None or name not in found)
    }
    effects, effect_sd = dict(case.effects), dict(case.effect_sd)
    if thermal is not None and "self_heating" not in effects:
        effects["self_heating"] = {"C_th": thermal.C_th, "hA": thermal.hA}
        effect_sd["self_heating"] = {"C_th": thermal.C_th_sd, "hA": thermal.hA_sd}
    hysteresis = fit.shape.g is not None and "ocv_hysteresis" not in effects
    if hysteresis:
        M, M_sd = fit.value("M")
        effects["ocv_hysteresis"] = {"M_V": M, "g": float(fit.shape.g or FIRST_PACE)}
        effect_sd["ocv_hysteresis"] = {"M_V": M_sd, "g": float(fit.shape.g or FIRST_PACE) * fit.shape_sd.get("g", 0.5)}
    sensors = {one.name.removeprefix("noise of "): one.value for one in noise} | case.sensors
    typical = found["capacity_Ah"].value
    runs = tuple(_run(run, fit, typical, thermal is not None, hysteresis) for run in case.runs)
    tables = tables_of(fit, varied) | {name: table for name, table in case.tables.items() if table.sd is None}
    parameters = found | exact
    return dataclasses.replace(
        case,
        path=None,
        parameters=parameters,
        tables=tables,
        effects=effects,
        effect_sd=effect_sd,
        sensors=sensors,
        runs=runs,
    )


def _mean_voltage(fit: JointFit) -> float:
    """Return the mean of the open-circuit voltage over the charge [V]."""
    soc = np.linspace(0.0, 1.0, 101)
    middle = float(fit.grid.degC[fit.grid.degC.size // 2])
    return round(float(np.mean(fit.curve("U", soc, middle))), 4)


def _typical_capacity(drawn: Extraction, fit: JointFit) -> Known:
    """Return the capacity that a run which was not fitted will have: the mean over fit runs, with their spread.

    Over those that do not define it, where there are any: a slow discharge gives more than a profile.
    """
    starts = [fit.starts[name] for name in fit.grid.runs]
    loose = max((start.fade_sd for start in starts), default=0.0)
    fades = np.array([start.fade for start in starts if start.fade_sd == loose])
    sd = drawn.sd if math.isfinite(drawn.sd) else 0.05 * drawn.value
    if not fades.size:
        return Known(drawn.value, sd)
    return Known(drawn.value * (1.0 + float(fades.mean())), math.hypot(sd, drawn.value * float(fades.std())))


def _run(run: Run, fit: JointFit, typical_Ah: float, heating: bool, hysteresis: bool) -> Run:
    """Return a run with its fitted start, the first reading of its thermometer, and the state of its hysteresis."""
    changes: dict = {}
    if run.name in fit.grid.runs:
        at = fit.layout["soc"].start + fit.grid.runs.index(run.name)
        sd = float(np.sqrt(fit.solution.covariance[at, at]))
        changes["initial_soc"] = Known(float(np.clip(fit.starts[run.name].soc, 0.0, 1.0)), max(sd, 1e-4))
        own = fit.capacity_Ah * (1.0 + fit.starts[run.name].fade)
        if "capacity_Ah" not in run.overrides and abs(own / typical_Ah - 1.0) > LEAST_FADE:
            changes["overrides"] = run.overrides | {"capacity_Ah": Known(own)}
    read = run.measured.outputs.get("cell_temperature_degC")
    if heating and run.initial_cell_temperature is None and read is not None and np.isfinite(read).any():
        changes["initial_cell_temperature"] = Known(float(read[np.isfinite(read)][0]), 0.3)
    if hysteresis:
        changes["overrides"] = {"initial_hysteresis": Known(_initial_h(run))} | changes.get("overrides", run.overrides)
    return dataclasses.replace(run, **changes)


def _remarks(fit: JointFit, runs: Sequence[Rows]) -> tuple[Remark, ...]:
    said = []
    for rows in runs:
        stated, now = rows.run.initial_soc.value, _counted_start(rows, fit.capacity_Ah)
        if abs(now - stated) > MOVED_SOC:
            said.append(
                Remark(
                    f"From the stated start {stated:.3g}, the charge of {rows.name} counts beyond full or empty; its "
                    f"start is taken as {now:.3g}, counted back from there. Check initial_soc and capacity_Ah.",
                    "start_counted_back",
                    f"initial_soc@{rows.name}",
                    value=now,
                    stated=stated,
                )
            )
    for rows in runs:
        left = float(np.sqrt(np.mean(fit.residuals[rows.name] ** 2)))
        sentence = f"The joint refit leaves {1e3 * left:.3g} mV of {rows.name}."
        said.append(Remark(sentence, "refit_error", f"voltage_V@{rows.name}", rms=left))
    sentence = (
        f"One in {fit.inflation:.0f} readings counts: what the model misses is correlated, and the sd allow for it."
    )
    said.append(Remark(sentence, "readings_correlated", "voltage_V", readings=fit.inflation))
    return tuple(said)
