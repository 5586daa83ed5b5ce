"""Parameters of a motor from its fit runs: winding, torque constant, friction, inertia, heating, noise."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.errors import FitError
from jaxmodel.base.remark import Remark
from jaxmodel.case.build import with_preset
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.fit.likelihood import autocorrelation_time
from jaxmodel.model.parameters import info
from jaxmodel.parameterisation.motor_electrical import electrical
from jaxmodel.parameterisation.motor_friction import Mechanics, mechanics
from jaxmodel.parameterisation.motor_refine import refine, refined_case
from jaxmodel.parameterisation.motor_rows import MotorRows, dead_time, motor_rows
from jaxmodel.parameterisation.motor_thermal import motor_thermal
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
LATE_GAINED = 0.8  # of the error: what a dead time must leave at most. Assumed.
UNKNOWN_SHARE = 0.5  # relative sd of a thermal resistance that neither case nor data tell. Assumed.
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
    if "clock_shift" not in case.effects and (late_s := dead_time(fitted)):
        effects = case.effects | {"clock_shift": dict[str, float | str](d=late_s)}
        shifted = dataclasses.replace(case, effects=effects, effect_sd=case.effect_sd | {"clock_shift": {"d": late_s}})
        other, less = _extracted(shifted, progress, late_s)
        if less < LATE_GAINED * error:
            return other
    return found


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
    runs = [motor_rows(run, late_s) for run in fitted]
    if not any(
        rows.speed_rad_s is not None or (rows.voltage_V is not None and rows.current_A is not None) for rows in runs
    ):
        raise FitError(
            f"{case.label}: no fit run has a speed, or voltage and current together; add 'speed_rad_s' or 'current_A'."
        )
    stated = with_preset(case).parameters
    exact = {name: known for name, known in case.parameters.items() if known.sd is None}
    tell("winding and torque constant")
    found, volts = electrical(runs, _stated(case, "psi_R"), _stated(case, "T_0"))
    if found_late_s:
        names = tuple(rows.name for rows in runs)
        found.append(Extraction(LATE, found_late_s, found_late_s, "s", names, "speed and voltage", "least squares"))
    found = [one for one in found if one.name not in exact]
    numbers = {one.name: one.value for one in found}

    def value(name: str) -> float:
        return numbers[name] if name in numbers else _stated(case, name)

    if "k_tau" not in numbers and "k_tau" not in exact and (seen := _speed_constant(runs)):
        found.append(seen)
        numbers["k_tau"] = seen.value
    tell("friction and inertia")
    turning = mechanics(runs, value("k_tau"), value("R_0"))
    if turning is not None:
        found += [one for one in _mechanical(turning) if one.name not in exact]
    tell("heating")
    terms = turning.values if turning else {"tau_0": value("tau_0")}

    def friction(speed: np.ndarray) -> np.ndarray:
        size = np.abs(speed)
        return terms.get("tau_0", 0.0) + terms.get("b", 0.0) * size + terms.get("c", 0.0) * size**2

    heat, warmed = motor_thermal(
        runs, value("R_0"), value("psi_R"), value("T_0"), friction, {name: known.value for name, known in exact.items()}
    )
    found += [one for one in heat if one.name not in exact]
    noise = [one for column, unit in READINGS.items() if (one := sensor_noise(fitted, column, unit))]
    found += noise
    if (
        not {"J"} & (numbers.keys() | stated.keys() | {one.name for one in found})
        and {"k_tau", "R_0"} <= numbers.keys()
    ):
        inertia = _usual_inertia(numbers["k_tau"], numbers["R_0"])
        case = dataclasses.replace(case, parameters=case.parameters | {"J": Known(inertia, 0.5 * inertia)})
        found.append(absent("J", inertia, UNITS["J"], "the mechanical time constant of the paper's motor", TESTS["J"]))
    have = {one.name for one in found}
    found += [_absent(case, name, stated) for name in UNITS if name not in have and name not in exact]
    points = {"electrical": volts, "friction": turning.points if turning else pd.DataFrame(), "thermal": warmed}
    points = {name: table for name, table in points.items() if len(table)}
    tell("output error of the forward model")
    said, found, error = _refined(_case(case, found, turning, noise), found, any(rows.follows for rows in runs))
    return Parameterisation(said, tuple(found), points, _remarks(turning)), error


def _refined(case: Case, found: list[Extraction], follows: bool) -> tuple[Case, list[Extraction], float]:
    """Return the case, the extractions and the error after the fit of the forward model to current and speed.

    Derivatives of a coarse log hide a friction that grows with speed, and show no lag between voltage and torque. The
    forward model is fitted with each of them too, and keeps one while it lowers the error to `GAINED`.

    Args:
        case: with first values.
        found: so far.
        follows: whether the rows show accelerations.
    """
    names = _places(case, found)
    better = refine(case, names)
    if better is None:
        return case, found, math.inf
    further = [one for one in (_growing_friction(case, found), _lag(case, found) if follows else None) if one]
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
        further = [one for one in (_growing_friction(case, found), _lag(case, found) if follows else None) if one]
    if "R_0" in names:
        unseen = better.values["R_0"] * _unseen_heat(refined_case(case, names, better))
        better = dataclasses.replace(better, sd=better.sd | {"R_0": math.hypot(better.sd["R_0"], unseen)})
    said = []
    for one in found:
        if one.name in names:
            sign = -1.0 if one.name == "torque of constant sign" else 1.0
            method = f"{one.method}, then output error of the forward model"
            sd = max(better.sd[one.name], 1e-3 * abs(better.values[one.name]))
            one = dataclasses.replace(one, value=sign * better.values[one.name], sd=sd, method=method)
        said.append(one)
    return refined_case(case, names, better), said, better.after


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

    None where the case states one, it is found already, or no run is driven by its voltage.
    """
    driven = [run for run in case.runs if run.split == "fit" and "voltage_V" in run.measured.inputs]
    if any(one.name == "L_a" and one.found for one in found) or "L_a" in case.parameters or not driven:
        return None
    seconds = LAG_ROWS * float(np.median(np.concatenate([np.diff(run.measured.time_s) for run in driven])))
    first = seconds * _stated(case, "R_0")
    term = Extraction("L_a", first, 0.0, "H", tuple(run.name for run in driven), "current and speed", LAGGING)
    return dataclasses.replace(case, parameters=case.parameters | {"L_a": Known(first, first)}), term


def _places(case: Case, found: Sequence[Extraction]) -> dict[str, tuple[str, str]]:
    """Return the effect and field of each number that the forward model refines."""
    return {
        one.name: PLACES[one.name]
        for one in found
        if one.found
        and one.value
        and one.name in PLACES
        and (PLACES[one.name][0] in case.effects or one.name in case.parameters)
    }


def _stated(case: Case, name: str) -> float:
    """Return a number that the case or its preset states, else the default."""
    stated = with_preset(case).parameters
    return stated[name].value if name in stated else float(info(name).default)


def _usual_inertia(k: float, R: float) -> float:
    """Return the inertia at which the time constant R J / k^2 is that of the paper's motor [kg m2]."""
    k_paper, R_paper, J_paper = (float(info(name).default) for name in ("k_tau", "R_0", "J"))
    return J_paper * (k / k_paper) ** 2 * R_paper / R


def _speed_constant(runs: Sequence[MotorRows]) -> Extraction | None:
    """Return k_tau from voltage and speed alone: V = k w + B sgn(w) + C dw/dt.

    It holds the loss that grows with speed.
    """
    parts = [rows for rows in runs if rows.voltage_V is not None and rows.speed_rad_s is not None and rows.moving.any()]
    if not parts:
        return None
    blocks, targets = [], []
    for rows in parts:
        at = rows.read & rows.moving
        assert rows.speed_rad_s is not None
        assert rows.voltage_V is not None
        speed = rows.speed_rad_s[at]
        blocks.append(np.column_stack([speed, np.sign(speed), rows.rate[at]]))
        targets.append(rows.voltage_V[at])
    matrix, volts = np.vstack(blocks), np.concatenate(targets)
    size = np.sqrt(np.mean(matrix**2, axis=0)) + 1e-30
    values = np.linalg.lstsq(matrix / size, volts, rcond=None)[0] / size
    left = volts - matrix @ values
    ends = np.cumsum([0, *map(len, targets)])
    inflation = autocorrelation_time([left[a:b] for a, b in itertools.pairwise(ends)])
    spread = np.linalg.pinv((matrix / size).T @ (matrix / size)) * float(left @ left) / left.size * inflation
    sd = math.sqrt(spread[0, 0]) / size[0]
    if not values[0] > sd:
        return None
    method = "voltage over speed, no current was measured: it holds the loss that grows with speed"
    return Extraction("k_tau", float(values[0]), sd, "N m/A", tuple(r.name for r in parts), f"{left.size} rows", method)


def _mechanical(turning: Mechanics) -> list[Extraction]:
    samples = f"{len(turning.points)} rows, {turning.rms_Nm:.2g} N m left"
    method = "k i - load = friction + J dw/dt by least squares"
    units = {"tau_0": "N m", "J": "kg m2", "direction": "N m"} | {name: unit for name, (_, _, unit) in TERMS.items()}
    names = {"direction": "torque of constant sign", "b": "viscous friction b", "c": "windage c", "e": "gear loss e"}
    return [
        Extraction(names.get(term, term), size, turning.sd[term], units[term], turning.runs, samples, method)
        for term, size in turning.values.items()
        if term != "J" or size > turning.sd[term]
    ]


def _absent(case: Case, name: str, stated: dict[str, Known]) -> Extraction:
    known = stated.get(name)
    where = "the case's stated value" if name in case.parameters else f"the preset '{Path(case.preset).name}'"
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
    if turning is not None and "direction" in turning.values and "torque_offset" not in effects:
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
