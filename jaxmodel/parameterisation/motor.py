"""Parameters of a motor from its fit runs: winding, torque constant, friction, inertia, heating, noise."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import lsq_linear

from jaxmodel.base.errors import FitError
from jaxmodel.base.remark import Remark
from jaxmodel.case.build import with_preset
from jaxmodel.case.known import Known
from jaxmodel.case.load import free_number
from jaxmodel.case.presets import read_preset
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.effects.controllers import CONTROLLERS
from jaxmodel.fit.likelihood import autocorrelation_time
from jaxmodel.model.declaration import describe
from jaxmodel.model.parameters import info
from jaxmodel.parameterisation.motor_electrical import electrical
from jaxmodel.parameterisation.motor_friction import Mechanics, mechanics
from jaxmodel.parameterisation.motor_refine import refine, refined_case
from jaxmodel.parameterisation.motor_rows import MotorRows, dead_time, motor_rows
from jaxmodel.parameterisation.motor_size import by_size
from jaxmodel.parameterisation.motor_thermal import heat_of_effects, motor_thermal
from jaxmodel.parameterisation.noise import sensor_noise
from jaxmodel.parameterisation.result import Extraction, Parameterisation, absent

UNITS = {"R_0": "ohm", "k_tau": "N m/A", "J": "kg m2", "tau_0": "N m", "L_a": "H", "R_wc": "K/W", "tau_wc": "s"}
UNITS |= {"R_ca": "K/W", "tau_ca": "s"}
TESTS = {
    "R_0": "Voltage and current with the rotor locked, or at several loads, would give it.",
    "k_tau": "Voltage, current and speed at no load would give it.",
    "J": "A step of the voltage or a coast-down, logged at 20 ms or faster, would give it.",
    "tau_0": "Steady runs at several speeds would give it.",
    "L_a": "The current after a step of the voltage with the rotor locked, logged faster than L/R, would give it.",
    "R_wc": "A thermometer in the winding while the motor heats under load would give it.",
    "tau_wc": "A thermometer in the winding while the motor heats under load would give it.",
    "R_ca": "A thermometer on the case while the motor heats for an hour under load would give it.",
    "tau_ca": "A thermometer on the case while the motor heats for an hour under load would give it.",
}
TERMS = {"b": ("viscous_friction", "b", "N m s/rad"), "c": ("windage", "c", "N m s2/rad2"), "e": ("gear_loss", "e", "")}
PLACES = {
    "viscous friction b": ("viscous_friction", "b"),
    "windage c": ("windage", "c"),
    "gear loss e": ("gear_loss", "e"),
}
LATE = "dead time of the readings"
PLACES |= {"torque of constant sign": ("torque_offset", "c"), LATE: ("clock_shift", "d")}
PLACES |= {name: ("", name) for name in ("R_0", "k_tau", "tau_0", "J", "L_a")}
GAINED = 0.98  # of the error
# Runs contradict each other if together they leave so much of the scatter of their readings, and each alone so small a
# share of that; of more runs not each is fitted alone. Assumed.
MISSED, ALONE, MOST_ALONE = 0.1, 0.25, 8
LATE_GAINED = 0.8  # of the error: what a dead time must leave at most. Assumed.
UNKNOWN_SHARE = 0.5  # relative sd of a thermal resistance that neither case nor data tell. Assumed.
USUAL = "a motor of this size: the paper's, scaled by its no-load speed"
# Of a motor at the full speed of its propeller, what its winding drops as a share of the voltage: mean and sd. Between
# the load of most efficiency and that of most power (0.5). Assumed.
PROPELLER_DROP = (0.35, 0.15)
LAG_ROWS = 4.0  # first value of the lag, in rows
LAGGING = "lag L_a / R_0 between voltage and torque: inductance, or a filter of drive or sensor"
READINGS = {"current_A": "A", "speed_rad_s": "rad/s", "winding_temperature_degC": "K", "case_temperature_degC": "K"}


def parameterise_motor(case: Case, progress: Callable[[str], None] | None = None) -> Parameterisation:
    """Return first parameters of a motor.

    Raises:
        FitError: the fit runs have neither a speed nor a current beside a voltage.
    """
    fitted = [run for run in case.runs if run.split == "fit"]
    if not fitted:
        raise FitError(f'{case.label}: there is no fit run; parameters are extracted from runs with split = "fit".')
    found, error = _extracted(case, progress)
    if "clock_shift" not in case.effects and (late_s := dead_time(case, fitted)):
        effects = case.effects | {"clock_shift": dict[str, float | str](d=late_s)}
        shifted = dataclasses.replace(case, effects=effects, effect_sd=case.effect_sd | {"clock_shift": {"d": late_s}})
        other, less = _extracted(shifted, progress, late_s)
        if less < LATE_GAINED * error:
            found, error = other, less
    contradicting = _contradicting(case, error, progress)
    return dataclasses.replace(found, remarks=(*found.remarks, *contradicting)) if contradicting else found


def _contradicting(case: Case, error: float, progress: Callable[[str], None] | None) -> tuple[Remark, ...]:
    """Say that the fit runs contradict each other, if each of them alone is fitted well and all together are not.

    Args:
        case: before anything was found.
        error: relative error of the forward model that was fitted to all of them.
        progress: is told that each run is fitted alone.
    """
    fitted = [run for run in case.runs if run.split == "fit"]
    if not 1 < len(fitted) <= MOST_ALONE or not MISSED < error < math.inf:
        return ()
    if progress is not None:
        progress("each fit run alone")
    alone = 0.0
    for run in fitted:
        try:
            alone = max(alone, _extracted(dataclasses.replace(case, runs=(run,)), None)[1])
        except FitError:  # it lacks what another run has
            return ()
        if alone > ALONE * error:
            return ()
    names = ", ".join(run.name for run in fitted)
    sentence = (
        f"The fit runs contradict each other: a motor fitted to one of them alone leaves at most {alone:.1%} of its "
        f"readings' scatter, one motor for all of {names} leaves {error:.0%}. They are of different motors or loads: "
        "state the load of each (load_torque_Nm, or --load with a law), or import them separately."
    )
    return (Remark(sentence, "runs_contradict", names, alone=alone, together=error),)


def _extracted(
    case: Case, progress: Callable[[str], None] | None, found_late_s: float = 0.0
) -> tuple[Parameterisation, float]:
    """Return first parameters of a motor, and the relative error of its forward model.

    Args:
        case: of a motor, with `clock_shift` where its readings come late.
        progress: is told each stage.
        found_late_s: the shift, where it is a first value from the readings.
    """
    tell = progress or (lambda stage: None)
    fitted = [run for run in case.runs if run.split == "fit"]
    late_s = float(case.effects.get("clock_shift", {}).get("d", 0.0))
    runs = [motor_rows(case, run, late_s) for run in fitted]
    if not any(
        rows.speed_rad_s is not None or (rows.voltage_V is not None and rows.current_A is not None) for rows in runs
    ):
        raise FitError(
            f"{case.label}: no fit run has a speed, or voltage and current together; add 'speed_rad_s' or 'current_A'."
        )
    stated = with_preset(case).parameters
    constant = _known_constant(case)
    exact = {name: known for name, known in case.parameters.items() if known.sd is None}
    usual: dict[str, Known] = {}
    lags = any(rows.follows for rows in runs) and "L_a" not in case.parameters
    tell("winding and torque constant")
    found, volts = electrical(runs, _stated(case, "psi_R"), _stated(case, "T_0"), constant)
    if found_late_s:
        names = tuple(rows.name for rows in runs)
        found.append(Extraction(LATE, found_late_s, found_late_s, "s", names, "speed and voltage", "least squares"))
    found = [one for one in found if one.name not in exact]
    numbers = {one.name: one.value for one in found}

    def value(name: str) -> float:
        return numbers[name] if name in numbers else _stated(case, name)

    if "k_tau" not in numbers and not (constant is not None and "R_0" in numbers):
        seen = [one for one in _without_current(runs, case.load == "propeller", constant) if one.name not in exact]
        found += seen
        numbers |= {one.name: one.value for one in seen}
    if constant is not None or "k_tau" in numbers:
        resistance = value("R_0") if {"R_0"} & (numbers.keys() | stated.keys()) else None
        usual = by_size(runs, value("k_tau"), resistance, blown=case.load == "propeller")
        usual = {name: known for name, known in usual.items() if name not in stated and name not in numbers}
        case = dataclasses.replace(case, parameters=case.parameters | usual)
    tell("friction and inertia")
    turning = mechanics([rows for rows in runs if rows.load_known], value("k_tau"), value("R_0"))
    if turning is not None:
        found += [one for one in _mechanical(case, turning) if one.name not in exact]
    tell("heating")
    terms = turning.values if turning else {"tau_0": value("tau_0")}

    def friction(speed: np.ndarray) -> np.ndarray:
        size = np.abs(speed)
        return terms.get("tau_0", 0.0) + terms.get("b", 0.0) * size + terms.get("c", 0.0) * size**2

    fixed = {name: known.value for name, known in exact.items()}
    heat, warmed = motor_thermal(
        runs, value("R_0"), value("psi_R"), value("T_0"), friction, fixed, *heat_of_effects(case)
    )
    found += [one for one in heat if one.name not in exact]
    found += _gains(case, tuple(rows.name for rows in runs))
    noise = [one for column, unit in READINGS.items() if (one := sensor_noise(fitted, column, unit))]
    found += noise
    have = {one.name for one in found}
    found += [
        absent(name, usual[name].value, UNITS[name], USUAL, TESTS[name], usual[name].sd or math.nan)
        if name in usual
        else _absent(case, name, stated)
        for name in UNITS
        if name not in have and name not in exact
    ]
    points = {"electrical": volts, "friction": turning.points if turning else pd.DataFrame(), "thermal": warmed}
    points = {name: table for name, table in points.items() if len(table)}
    tell("output error of the forward model")
    said, found, error = _refined(_case(case, found, turning, noise), found, lags)
    if all(rows.current_A is None for rows in runs):
        said, found = _by_resistance(said, found)
    return Parameterisation(said, tuple(found), points, _remarks(turning)), error


def _refined(case: Case, found: list[Extraction], lags: bool) -> tuple[Case, list[Extraction], float]:
    """Return the case, the extractions and the error after the fit of the forward model to current and speed.

    Derivatives of a coarse log hide a friction that grows with speed, and show no lag between voltage and torque. The
    forward model is fitted with each of them too, and keeps one while it lowers the error to `GAINED`.

    Args:
        case: with first values.
        found: so far.
        lags: whether the rows show accelerations, and no inductance is stated.
    """
    names = _places(case, found)
    better = refine(case, names)
    if better is None:
        return case, found, math.inf
    further = [one for one in (_growing_friction(case, found), _lag(case, found) if lags else None) if one]
    while further:
        tried = []
        for wider, term in further:
            more = dataclasses.replace(case, parameters=case.parameters | wider.parameters, effects=wider.effects)
            again = refine(more, names | {term.name: PLACES[term.name]})
            if again is not None:
                tried.append((again.after, more, again, term))
        best = min(tried, key=lambda one: one[0], default=None)
        if best is None or best[0] >= GAINED * better.after:
            break
        _, case, better, term = best
        names, found = names | {term.name: PLACES[term.name]}, [one for one in found if one.name != term.name] + [term]
        further = [one for one in (_growing_friction(case, found), _lag(case, found) if lags else None) if one]
    if "R_0" in names:
        unseen = better.values["R_0"] * _unseen_heat(refined_case(case, names, better))
        by_constant = 0.0 if "k_tau" in names else next(one.sd for one in found if one.name == "R_0")
        better = dataclasses.replace(better, sd=better.sd | {"R_0": math.hypot(better.sd["R_0"], unseen, by_constant)})
    said = []
    for one in found:
        if one.name in names:
            sign = -1.0 if one.name == "torque of constant sign" else 1.0
            method = f"{one.method}, then output error of the forward model"
            sd = max(better.sd[one.name], 1e-3 * abs(better.values[one.name]))
            one = dataclasses.replace(one, value=sign * better.values[one.name], sd=sd, method=method)
        said.append(one)
    return refined_case(case, names, better), said, better.after


def _by_resistance(case: Case, found: Sequence[Extraction]) -> tuple[Case, list[Extraction]]:
    """Return a case and extractions whose sd say what an unknown resistance leaves open.

    Voltage and speed tell k/R and J R/k^2: of a torque in N m nothing is known but by R_0.
    """
    resistance = next((one for one in found if one.name == "R_0" and not one.found), None)
    if resistance is None:
        return case, list(found)
    share = resistance.sd / resistance.value if math.isfinite(resistance.sd) else 1.0
    terms, parameters, told = {"tau_0", "J", "viscous friction b", "windage c", "L_a"}, dict(case.parameters), []
    for one in found:
        if one.name in terms and one.found:
            why = f"{one.method}; in proportion to {'' if one.name == 'L_a' else '1 / '}R_0, which no reading tells"
            one = dataclasses.replace(one, sd=max(one.sd, share * abs(one.value)), method=why)
            if one.name in parameters:
                parameters[one.name] = Known(one.value, one.sd)
        told.append(one)
    return dataclasses.replace(case, parameters=parameters), told


def _unseen_heat(case: Case) -> float:
    """Return the relative sd of R_0 where no thermometer is in the winding: psi_R times the sd of its rise."""
    fitted = [run for run in case.runs if run.split == "fit"]
    if any("winding_temperature_degC" in run.measured.outputs for run in fitted):
        return 0.0
    rises = [
        one.table["winding_temperature_degC"].to_numpy() - one.run.measured.inputs["ambient_degC"]
        for one in simulate_case(dataclasses.replace(case, runs=tuple(fitted)))
    ]
    rise = float(np.nanmean(np.abs(np.concatenate(rises))))
    known = [case.parameters.get(name) for name in ("R_wc", "R_ca")]
    share = max(UNKNOWN_SHARE if one is None else (one.sd or 0.0) / one.value for one in known)
    return _stated(case, "psi_R") * rise * share


def _growing_friction(case: Case, found: Sequence[Extraction]) -> tuple[Case, Extraction] | None:
    """Return the case with a little viscous friction to be refined; None where it has some, or no constant friction."""
    if "viscous_friction" in case.effects or "tau_0" not in case.parameters or not case.parameters["tau_0"].value:
        return None
    fastest = max(float(np.nanmax(np.abs(r.measured.outputs.get("speed_rad_s", np.ones(1))))) for r in case.runs)
    more = dict(case.effects) | {"viscous_friction": {"b": 0.1 * case.parameters["tau_0"].value / fastest}}
    term = Extraction(
        "viscous friction b", 0.0, 0.0, TERMS["b"][2], found[0].runs, "current and speed", "friction over speed"
    )
    return dataclasses.replace(case, effects=more), term


def _lag(case: Case, found: Sequence[Extraction]) -> tuple[Case, Extraction] | None:
    """Return the case with an inductance that lags by some rows, to be refined.

    None where it is found already, or no run is driven by its voltage.
    """
    driven = [run for run in case.runs if run.split == "fit" and "voltage_V" in run.measured.inputs]
    if any(one.found for one in found if one.name == "L_a") or not driven:
        return None
    seconds = LAG_ROWS * float(np.median(np.concatenate([np.diff(run.measured.time_s) for run in driven])))
    first = seconds * _stated(case, "R_0")
    term = Extraction("L_a", first, 0.0, "H", tuple(run.name for run in driven), "current and speed", LAGGING)
    return dataclasses.replace(case, parameters=case.parameters | {"L_a": Known(first, first)}), term


def _places(case: Case, found: Sequence[Extraction]) -> dict[str, tuple[str, str]]:
    """Return the effect and field of each number that the forward model refines."""
    free = free_number(case)
    places = PLACES if free is None else PLACES | {_of_load(free): free[:2]}
    for one in _gains(case, ()):
        effect, field = one.name.split(".")
        places = places | {one.name: (effect, field)}
    return {
        one.name: places[one.name]
        for one in found
        if one.found
        and one.value
        and one.name in places
        and (places[one.name][0] in case.effects or one.name in case.parameters)
    }


def _gains(case: Case, runs: tuple[str, ...]) -> list[Extraction]:
    """Return the gains of a controller that the case leaves to the data, as it states them."""
    if not case.servo.controller:
        return []
    effect = CONTROLLERS[case.servo.controller]
    units = {name: one.unit for name, one in describe(effect).items()}
    return [
        Extraction(
            f"{effect.name}.{name}",
            float(case.effects[effect.name][name]),
            sd,
            units[name],
            runs,
            "all rows",
            "as stated",
        )
        for name, sd in case.effect_sd.get(effect.name, {}).items()
    ]


def _stated(case: Case, name: str) -> float:
    """Return a number that the case or its preset states, else the default."""
    stated = with_preset(case).parameters
    return stated[name].value if name in stated else float(info(name).default)


def _known_constant(case: Case) -> Known | None:
    """Return the torque constant that a preset states, or the case as exact; a first value of the case is none."""
    own = case.parameters.get("k_tau")
    return own if own is not None and own.sd is None else read_preset(case.preset).parameters.get("k_tau")


def _without_current(runs: Sequence[MotorRows], at_propeller: bool, known: Known | None = None) -> list[Extraction]:
    """Return k_tau from voltage and speed alone, and R_0 where a load is known, none negative.

    V = k w + B sgn(w) + C dw/dt + D times the load, known or by its law up to a number; with a known one D is R_0 / k.
    k holds the loss that grows with speed. Over the few speeds of a flight a propeller's torque looks like a back-EMF:
    there the usual drop of such a motor decides (`PROPELLER_DROP`). A torque constant that is known stays as it is.
    """
    parts = [rows for rows in runs if rows.voltage_V is not None and rows.speed_rad_s is not None and rows.moving.any()]
    if not parts:
        return []
    loaded = all(rows.law is None and float(np.ptp(rows.load_Nm)) > 0.0 for rows in parts)
    blocks, targets = [], []
    for rows in parts:
        at = rows.read & rows.moving
        assert rows.speed_rad_s is not None
        assert rows.voltage_V is not None
        speed = rows.speed_rad_s[at]
        lawful = [rows.load_Nm[at]] if loaded else [] if rows.law is None else [rows.law[at]]
        blocks.append(np.column_stack([speed, np.sign(speed), rows.rate[at], *lawful]))
        targets.append(rows.voltage_V[at])
    matrix, volts = np.vstack(blocks), np.concatenate(targets)
    if known is not None:
        return _resistance_by_load(matrix, volts, known, tuple(rows.name for rows in parts)) if loaded else []
    size = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-30
    scaled = matrix / size
    left = volts - scaled @ lsq_linear(scaled, volts, (0.0, np.inf)).x
    ends = np.cumsum([0, *map(len, targets)])
    inflation = autocorrelation_time([left[a:b] for a, b in itertools.pairwise(ends)])
    variance = float(left @ left) / left.size * inflation
    if at_propeller and matrix.shape[1] > 3:
        usual, spread = PROPELLER_DROP
        top = float(np.max(np.abs(volts)))
        weight = math.sqrt(variance) / (spread * top)
        row = weight * np.max(np.abs(scaled), axis=0) * np.array([0.0, 0.0, 0.0, 1.0])
        scaled, volts = np.vstack([scaled, row]), np.append(volts, weight * usual * top)
    values = lsq_linear(scaled, volts, (0.0, np.inf)).x / size
    sd = np.sqrt(np.diag(np.linalg.pinv(scaled.T @ scaled)) * variance) / size
    k, names, samples = float(values[0]), tuple(rows.name for rows in parts), f"{left.size} rows"
    if not k > sd[0]:
        return []
    method = "voltage over speed, no current was measured: it holds the loss that grows with speed"
    found = [Extraction("k_tau", k, float(sd[0]), "N m/A", names, samples, method)]
    if loaded and values[3] > sd[3]:
        R, share = k * float(values[3]), math.hypot(sd[3] / values[3], sd[0] / k)
        method = "voltage over speed and known load, no current was measured"
        found.append(Extraction("R_0", R, R * share, "ohm", names, samples, method))
    return found


def _resistance_by_load(matrix: np.ndarray, volts: np.ndarray, known: Known, runs: tuple[str, ...]) -> list[Extraction]:
    """Return R_0 at a known torque constant from columns speed, its sign, acceleration and known load."""
    rest = matrix[:, 1:] / (np.sqrt(np.mean(matrix[:, 1:] ** 2, axis=0)) + 1e-30)
    unit = float(np.sqrt(np.mean(matrix[:, 3] ** 2)))
    beside = volts - known.value * matrix[:, 0]
    per_load = lsq_linear(rest, beside, (0.0, np.inf)).x
    left = beside - rest @ per_load
    variance = float(left @ left) / left.size * autocorrelation_time([left])
    spread = np.sqrt(np.diag(np.linalg.pinv(rest.T @ rest)) * variance)
    if not per_load[2] > spread[2]:
        return []
    R = known.value * float(per_load[2]) / unit
    share = math.hypot(spread[2] / per_load[2], (known.sd or 0.0) / known.value)
    method = "voltage less k w over known load, k_tau as it is stated, no current was measured"
    return [Extraction("R_0", R, R * share, "ohm", runs, f"{left.size} rows", method)]


def _of_load(free: tuple[str, str, str]) -> str:
    """Return what the free number of a load's law is called."""
    return f"{free[0]}.{free[1]}"


def _mechanical(case: Case, turning: Mechanics) -> list[Extraction]:
    samples = f"{len(turning.points)} rows, {turning.rms_Nm:.2g} N m left"
    method = "k i - load = friction + J dw/dt by least squares"
    units = {"tau_0": "N m", "J": "kg m2", "direction": "N m"} | {name: unit for name, (_, _, unit) in TERMS.items()}
    names = {"direction": "torque of constant sign", "b": "viscous friction b", "c": "windage c", "e": "gear loss e"}
    if (free := free_number(case)) is not None:
        units["load"], names["load"] = free[2], _of_load(free)
    return [
        Extraction(names.get(term, term), size, turning.sd[term], units[term], turning.runs, samples, method)
        for term, size in turning.values.items()
        if term != "J" or size > turning.sd[term]
    ]


def _absent(case: Case, name: str, stated: dict[str, Known]) -> Extraction:
    known = stated.get(name)
    of_preset = known is not None and known == read_preset(case.preset).parameters.get(name)
    own = name in case.parameters and not of_preset
    where = "the case's stated value" if own else f"the preset '{Path(case.preset).name}'"
    value = known.value if known is not None else float(info(name).default)
    return absent(name, value, UNITS[name], where, TESTS[name], known.sd if known and known.sd else math.nan)


def _case(case: Case, found: Sequence[Extraction], turning: Mechanics | None, noise: Sequence[Extraction]) -> Case:
    """Return the case with everything found; what it states as exact stays."""
    parameters = {
        one.name: Known(one.value, one.sd)
        for one in found
        if one.found and one.name in UNITS and math.isfinite(one.sd) and (one.value > 0.0 or one.name == "tau_0")
    }
    effects, effect_sd = dict(case.effects), dict(case.effect_sd)
    for term, (effect, field, _) in TERMS.items():
        if turning is not None and turning.values.get(term, 0.0) > 0.0 and effect not in effects:
            effects[effect] = {field: turning.values[term]}
            effect_sd[effect] = {field: turning.sd[term]}
    if turning is not None and (free := free_number(case)) is not None and turning.values.get("load", 0.0) > 0.0:
        effects[free[0]] = effects[free[0]] | {free[1]: turning.values["load"]}
        effect_sd[free[0]] = effect_sd[free[0]] | {free[1]: turning.sd["load"]}
    measured = any("load_torque_Nm" in run.measured.inputs for run in case.runs)
    if turning is not None and "direction" in turning.values and "torque_offset" not in effects and measured:
        # The measured load is the true one plus c: a torque that always hinders one way is a load not measured.
        effects["torque_offset"] = {"column": "load_torque_Nm", "c": -turning.values["direction"]}
        effect_sd["torque_offset"] = {"c": turning.sd["direction"]}
    sensors = {one.name.removeprefix("noise of "): one.value for one in noise} | case.sensors
    exact = {name: known for name, known in case.parameters.items() if known.sd is None or name not in parameters}
    runs = []
    for run in case.runs:
        speed = run.measured.outputs.get("speed_rad_s")
        first = {} if speed is None or not np.isfinite(speed[0]) else {"initial_speed_rad_s": Known(float(speed[0]))}
        runs.append(dataclasses.replace(run, overrides=first | run.overrides))
    return dataclasses.replace(
        case,
        path=None,
        parameters=parameters | exact,
        effects=effects,
        effect_sd=effect_sd,
        sensors=sensors,
        runs=tuple(runs),
    )


def _remarks(turning: Mechanics | None) -> tuple[Remark, ...]:
    if turning is None:
        return (Remark("No run shows the motor turning: friction and inertia are not extracted.", "never_turns"),)
    return (Remark(f"The torque balance leaves {turning.rms_Nm:.2g} N m.", "torque_error", rms_Nm=turning.rms_Nm),)
