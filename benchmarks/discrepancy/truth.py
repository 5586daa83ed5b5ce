"""The truth of a made case as `answer.toml` tells it: what is hidden, what of it can be seen, what can be reached."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.hidden import Blind, Drawn
from benchmarks.discrepancy.tables import VALUES
from benchmarks.discrepancy.visible import fit, residuals, rms_of, stands_out, with_truth, without
from benchmarks.independent.make_case import in_toml
from jaxmodel.case.known import Table
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case

# What a perfect model leaves may be so much more than the noise that was added. Else the independent simulator and the
# engine do not mean the same by what is hidden.
MOST_OVER_NOISE = 1.5
USUAL_OHM = 0.15  # of a cell, from one reading to the next
# What stands out less cannot be asked to be named beside other things.
LEAST_SIGMA = 4.0
EXPECTED = {
    "table": "a correction of the table as a function of soc, and the effects",
    "run": "the run is named; no effect of the catalogue is claimed",
    "noise": "verdict as without the wrong sd; remark that the stated noise is wrong",
    "prior": "adequate, with a remark that the stated value is far off",
    "extrapolation": "undecided, unknown_effect or missing_effect with the remark that the check condition is outside "
    "what was fitted; adequate without a remark is wrong",
    "immaterial": "adequate; the effect may be told as immaterial",
}


def write_answer(folder: Path, drawn: Drawn) -> Blind:
    """Write the truth of a case beside it, and return what is hidden with how far each thing stands out.

    Raises:
        RuntimeError: what is to be hidden is not what the readings hold, or too faint to be seen in them.
    """
    case = read_case(folder)
    true = as_it_is(case, drawn)
    reachable = rms_of(true, residuals(true))
    sd = {name: splits["fit"] for name, splits in reachable.items()}
    for name, left in sd.items():
        if not left < MOST_OVER_NOISE * _noise(drawn, name):
            raise RuntimeError(f"the truth leaves {left:g} of {name}, where {drawn.sensors[name]:g} is noise")
    seen = stands_out(true, sd, lacking(case, true, drawn))
    if faint := [name for name, sigma in seen.items() if sigma < LEAST_SIGMA and drawn.blind.group != "immaterial"]:
        raise RuntimeError(f"{' and '.join(faint)} stands out by less than {LEAST_SIGMA:g} sigma")
    blind = dataclasses.replace(drawn.blind, stands_out={name: float(f"{sigma:.4g}") for name, sigma in seen.items()})
    base = fit(case, sd)
    lines = _head(case, drawn, blind)
    for title, table in {
        "effect_parameters": blind.effects,
        "true_parameters": {name: value for name, value in drawn.true.items() if name not in VALUES},
        "noise_sd": {name: drawn.sensors[name] for name in reachable},
        "stated_noise_sd": drawn.options.get("stated_sensors", {}),
        "tolerance": drawn.options.get("accepted", {}),
        "true_tables": {name: value for name, value in drawn.true.items() if name in VALUES},
        "true_of_runs": {run.name: own.hidden for run, own in zip(case.runs, drawn.runs, strict=True) if own.hidden},
        "snr_without": blind.stands_out,
        "before_fit": {name: splits["fit"] for name, splits in base.rms.items()},
        "before_check": {name: splits["check"] for name, splits in base.rms.items()},
        "reachable_fit": sd,
        "reachable_check": {name: splits["check"] for name, splits in reachable.items()},
        "base_parameters": {name: value for name, value in base.values.items() if "." not in name},
    }.items():
        if table or title == "effect_parameters":
            lines += ["", f"[{title}]", *(f"{name} = {in_toml(_short(value))}" for name, value in table.items())]
    (folder / "answer.toml").write_text("\n".join(lines) + "\n")
    return blind


def _head(case: Case, drawn: Drawn, blind: Blind) -> list[str]:
    fitted = [run for run in case.runs if run.split == "fit"]
    told: dict[str, Any] = {"case": case.name, "kind": blind.kind}
    told |= {name: value for name, value in blind.truth.items() if not isinstance(value, dict)}
    told["rows_fitted"] = sum(int(np.isfinite(v).sum()) for run in fitted for v in run.measured.outputs.values())
    if blind.told_as in EXPECTED:
        told["expected"] = EXPECTED[blind.told_as]
    if blind.kind != "motor":
        told["true_initial_soc"] = [round(run.initial_soc, 5) for run in drawn.runs]
    return [f"{name} = {in_toml(value)}" for name, value in told.items()]


def as_it_is(case: Case, drawn: Drawn) -> Case:
    """Return a case with all that is hidden in its model.

    A contact of a run is no part of the model: its drop is added to the run's voltages.
    """
    effects = {name: dict(numbers) for name, numbers in drawn.blind.effects.items()}
    if "clock_shift" in effects:  # the independent simulator's logger interpolates between rows
        effects["clock_shift"]["resampled"] = 1.0
    tables = {
        name: Table(np.array(drawn.true[name]["soc"]), np.array(drawn.true[name][VALUES[name]]))
        for name in VALUES
        if name in drawn.true
    }
    own = {run.name: drawn.runs[place].hidden for place, run in enumerate(case.runs)}
    starts = None if drawn.blind.kind == "motor" else [run.initial_soc for run in drawn.runs]
    numbers = {name: {n: v for n, v in hidden.items() if n != "contact_ohm"} for name, hidden in own.items()}
    plain = {name: value for name, value in drawn.true.items() if name not in VALUES}
    true = with_truth(case, plain, starts, effects, tables, numbers)
    runs = []
    for run in true.runs:
        ohm = own[run.name].get("contact_ohm", 0.0)
        outputs = dict(run.measured.outputs)
        if ohm:
            outputs["voltage_V"] = outputs["voltage_V"] + ohm * run.measured.inputs["current_A"]
        runs.append(dataclasses.replace(run, measured=dataclasses.replace(run.measured, outputs=outputs)))
    return dataclasses.replace(true, runs=tuple(runs))


def lacking(case: Case, true: Case, drawn: Drawn) -> dict[str, Case]:
    """Return by name the case in whose model one hidden thing is not; what acts on no fit run is not among them."""
    found = {name: without(true, name) for name in drawn.blind.effects}
    if table := drawn.blind.beside.get("table"):
        found[f"table_{table}"] = dataclasses.replace(true, tables={**true.tables, table: case.tables[table]})
    if "run" in drawn.blind.beside:
        runs = [
            dataclasses.replace(run, measured=stated.measured, overrides=stated.overrides)
            for run, stated in zip(true.runs, case.runs, strict=True)
        ]
        found["run"] = dataclasses.replace(true, runs=tuple(runs))
    return found


def _noise(drawn: Drawn, name: str) -> float:
    """Return about the sd of a channel's noise: the sensor's, its last digit's, a cell's measured current's."""
    own, digit = drawn.sensors[name], drawn.options.get("quantisation", {}).get(name, 0.0)
    current = drawn.sensors.get("current_A", 0.0) if drawn.blind.kind == "cell" and name == "voltage_V" else 0.0
    return float(np.sqrt(own**2 + digit**2 + (USUAL_OHM * current) ** 2))


def _short(value: Any) -> Any:
    """Return a number to six digits."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, dict):
        return {name: _short(each) for name, each in value.items()}
    return [_short(each) for each in value] if isinstance(value, list) else value
