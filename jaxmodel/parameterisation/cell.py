"""Parameters of a cell from its fit runs: extractions, a calibration that starts from them, and what it found."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from jaxmodel.base.errors import FitError
from jaxmodel.base.remark import Remark
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case
from jaxmodel.fit.lanes import one_thread_of_blas
from jaxmodel.parameterisation.calibration import Calibrated, calibrated
from jaxmodel.parameterisation.capacity import COUNTER_SD, capacity
from jaxmodel.parameterisation.first_case import AGE, counted_start, first_case
from jaxmodel.parameterisation.noise import sensor_noise
from jaxmodel.parameterisation.numbers import REFIT, Numbers, table_extractions, temperatures
from jaxmodel.parameterisation.ocv import branches, hysteresis_gap, rested
from jaxmodel.parameterisation.relaxation import relaxations, time_constants
from jaxmodel.parameterisation.resistance import first_sample, median_ohm, step_resistances, typical_ohm
from jaxmodel.parameterisation.result import Extraction, Parameterisation, absent
from jaxmodel.parameterisation.rounding import rounded
from jaxmodel.parameterisation.rows import Rows, rows_of

LEAST_ROWS = 30
MOVED_SOC = 0.01  # of a start, from which that is said
MOVED = 0.005  # of a capacity, as a share, from which that is said
# Numbers of effects, by what they are told as: their unit, and how they are found.
TOLD = {
    "self_heating.C_th": ("C_th", "J/K", "heating and cooling of one node under the losses of the model"),
    "self_heating.hA": ("hA", "W/K", "heating and cooling of one node under the losses of the model"),
    "ocv_hysteresis.M_V": ("M_V", "V", f"{REFIT}, effect ocv_hysteresis"),
    "ocv_hysteresis.g": ("g", "", f"{REFIT}, effect ocv_hysteresis"),
    "ocv_hysteresis.b": ("b", "", f"{REFIT}, effect ocv_hysteresis"),
    "charge_transfer.i_0": ("i_0", "A", f"{REFIT}, effect charge_transfer: the data tell of it"),
    "charge_transfer.E_i": ("E_i", "J/mol", f"{REFIT}, effect charge_transfer"),
    "slow_diffusion.R_3": ("R_3", "ohm", f"{REFIT}, effect slow_diffusion: the data tell of it"),
    "slow_diffusion.tau_3": ("tau_3", "s", f"{REFIT}, effect slow_diffusion"),
}


@one_thread_of_blas
def parameterise_cell(case: Case, progress: Callable[[str], None] | None = None) -> Parameterisation:
    """Return first parameters of a cell.

    Raises:
        FitError: the fit runs have no voltage, or no current flows in them.
    """
    runs = _usable(case)
    tell = progress or (lambda stage: None)
    tell("capacity, resting and slow voltages")
    drawn = capacity(case, runs)
    noise = _noise(runs)
    steps = step_resistances(runs, drawn.value, next((n.value for n in noise if n.name == "noise of voltage_V"), 1e-3))
    relaxed = relaxations(runs, drawn.value)
    slow = branches(runs, drawn.value)
    ohm = 2.0 * median_ohm(steps, drawn.value)
    gaps = hysteresis_gap(slow, 2.0 * typical_ohm(steps, drawn.value))
    rests = time_constants(relaxed)
    taus = [(rests[0].value, rests[1].value)] if rests else []
    first = first_case(case, runs, drawn, ohm, gaps, taus, noise)
    found = calibrated(first.case, first.curves, tell)
    numbers = Numbers(found)
    said = rounded(_case(found, numbers))
    extractions = [_capacity(drawn, said), *first_sample(steps), *rests, *gaps]
    extractions += table_extractions(numbers, runs, first.varied, _samples(found))
    extractions += [*_of_effects(found, runs), *noise]
    extractions += _missing(runs, found, steps, slow, first.varied)
    points = {"slow": slow, "rests": rested(runs, drawn.value), "resistance": steps, "relaxation": relaxed}
    points["fit"] = _fitted(found, "voltage_V", "fit_V")
    if "self_heating" in found.case.effects:
        points["thermal"] = _fitted(found, "cell_temperature_degC", "fit_degC").rename(
            columns={"cell_temperature_degC": "degC"}
        )
    points = {name: table for name, table in points.items() if len(table)}
    remarks = _remarks(found, runs, drawn.value)
    if any(case.parameters[name].value for name in AGE if name in case.parameters):
        sentence = "The numbers hold the cell's age; cycles and storage_months count from here."
        remarks = (*remarks, Remark(sentence, "age_included", ", ".join(AGE)))
    return Parameterisation(said, tuple(extractions), points, remarks)


def _usable(case: Case) -> list[Rows]:
    fitted = [run for run in case.runs if run.split == "fit"]
    if not fitted:
        raise FitError(f'{case.label}: there is no fit run; parameters are extracted from runs with split = "fit".')
    without = [run.name for run in fitted if "voltage_V" not in run.measured.outputs]
    runs = [_as_new(case, rows_of(run)) for run in fitted if "voltage_V" in run.measured.outputs]
    if not runs:
        raise FitError(f"{case.label}: no fit run has the reading 'voltage_V' ({', '.join(without)}); add that column.")
    runs = [rows for rows in runs if rows.read.sum() >= LEAST_ROWS and np.ptp(rows.drawn_Ah) > 0.0]
    if not runs:
        raise FitError(
            f"{case.label}: no fit run has a current and {LEAST_ROWS} readings of the voltage; "
            "give a run with pulses, or a discharge."
        )
    return runs


def _as_new(case: Case, rows: Rows) -> Rows:
    """Return the rows of a run with the charge that a cell of the case's capacity would have passed.

    An aged cell, whose run states what it holds, is empty after less charge; its state of charge is that of the others.
    """
    whole, own = case.parameters.get("capacity_Ah"), rows.run.overrides.get("capacity_Ah")
    if whole is None or own is None:
        return rows
    return dataclasses.replace(rows, drawn_Ah=rows.drawn_Ah * (whole.value / own.value))


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


def _missing(
    runs: Sequence[Rows], found: Calibrated, steps: pd.DataFrame, slow: pd.DataFrame, varied: bool
) -> list[Extraction]:
    """Return what the data cannot give, where it comes from, and the test that would give it."""
    said = []
    if not varied:
        where = f"a constant, the value at {temperatures(runs)[0]:.3g} degC"
        test = "Pulses at two temperatures 10 K apart or more would give it."
        said.append(absent("activation energies", 0.0, "J/mol", where, test))
    if "self_heating" not in found.case.effects:
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
    low = float(found.case.tables["ocv"].soc[0])
    if low > 0.05:
        test = "A discharge to empty would give them."
        said.append(absent(f"curves below SOC {low:.2g}", math.nan, "", f"their value at SOC {low:.2g}", test))
    return said


def _case(found: Calibrated, numbers: Numbers) -> Case:
    """Return the calibrated case with the sd of its tables and capacity, and its mean open-circuit voltage."""
    case = found.case
    tables = {
        name: table if table.sd is None or name == "dU_dT" else dataclasses.replace(table, sd=numbers.table_sd(name))
        for name, table in case.tables.items()
    }
    parameters, charge = dict(case.parameters), case.parameters["capacity_Ah"]
    if charge.sd is not None:  # readings agree on it, but they all come from one current sensor
        parameters["capacity_Ah"] = Known(charge.value, math.hypot(charge.sd, COUNTER_SD * charge.value))
    if "nominal_cell_voltage_V" not in parameters or parameters["nominal_cell_voltage_V"].sd is not None:
        ocv = case.tables["ocv"]
        middle = np.atleast_2d(ocv.values)[len(np.atleast_2d(ocv.values)) // 2]
        mean = float(np.mean(np.interp(np.linspace(0.0, 1.0, 101), ocv.soc, middle)))
        parameters["nominal_cell_voltage_V"] = Known(round(mean, 4))
    return dataclasses.replace(case, tables=tables, parameters=parameters)


def _capacity(drawn: Extraction, case: Case) -> Extraction:
    """Return the capacity as it was calibrated."""
    now = case.parameters["capacity_Ah"]
    if now.sd is None:
        return drawn
    method = drawn.method
    if drawn.found:
        method += f"; then {REFIT}"
    elif abs(now.value / drawn.value - 1.0) > MOVED:
        method += f", {drawn.value:.4g} {drawn.unit}, and moved by the {REFIT}"
    return dataclasses.replace(drawn, value=now.value, sd=now.sd, method=method)


def _of_effects(found: Calibrated, runs: Sequence[Rows]) -> list[Extraction]:
    """Return the numbers of the effects in the model, but for activation energies, which are told of resistances."""
    names, said = tuple(rows.name for rows in runs), []
    for full, (name, unit, method) in TOLD.items():
        effect, field = full.split(".")
        if full in found.estimates:
            value = float(found.case.effects[effect][field])
            said.append(Extraction(name, value, found.estimates[full].sd, unit, names, _samples(found), method))
    return said


def _samples(found: Calibrated) -> str:
    """Say how many readings were fitted, and what is left of them."""
    squares = found.fit.mean_squares(found.cache.view)
    left = [f"{1e3 * math.sqrt(squares['voltage_V']):.3g} mV"]
    if "cell_temperature_degC" in squares:
        left.append(f"{math.sqrt(squares['cell_temperature_degC']):.2g} K")
    return f"{found.cache.view.data.count} readings, {' and '.join(left)} left"


def _fitted(found: Calibrated, channel: str, column: str) -> pd.DataFrame:
    """Return the fitted readings of a channel with the model: run, time_s, the channel, and `column`."""
    data, errors, tables = found.cache.view.data, found.fit.errors, []
    for (name, number), rows in data.chains:
        if name == channel:
            read = data.value[rows]
            columns = {"time_s": data.time_s[rows], channel: read, column: read - errors[rows]}
            tables.append(pd.DataFrame({"run": found.case.runs[number].name, **columns}))
    return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()


def _remarks(found: Calibrated, runs: Sequence[Rows], capacity_Ah: float) -> tuple[Remark, ...]:
    said = []
    for rows in runs:
        stated, now = rows.run.initial_soc.value, counted_start(rows, capacity_Ah)
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
    left = {
        str(run): float(np.sqrt(np.mean((table["voltage_V"] - table["fit_V"]) ** 2)))
        for run, table in _fitted(found, "voltage_V", "fit_V").groupby("run", sort=False)
    }
    most = max(left, key=lambda run: left[run])
    least = "" if len(left) == 1 else f"{1e3 * min(left.values()):.3g} to "
    sentence = f"The joint refit leaves {least}{1e3 * left[most]:.3g} mV RMS of the voltage, most in {most}."
    said.append(Remark(sentence, "refit_error", f"voltage_V@{most}", rms=left[most]))
    said += [Remark(note, "written_approximately") for note in found.notes]
    inflation = found.fit.likelihood.channels["voltage_V"].inflation
    sentence = f"One in {inflation:.0f} readings counts: what the model misses is correlated, and the sd allow for it."
    said.append(Remark(sentence, "readings_correlated", "voltage_V", readings=inflation))
    return tuple(said)
