"""What the pages show of a case and of the present model, as one value for JSON."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.app.browser.worker.words import (
    GROUPS,
    NO_REASON,
    beside_the_best,
    channel_words,
    error_text,
    finite,
    in_words,
    reason_for,
    title_of,
)
from jaxmodel.base.units import readable, split_unit
from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case
from jaxmodel.data.importing import Imported
from jaxmodel.data.importing.imported import sentences, shortened
from jaxmodel.diagnosis import Investigation
from jaxmodel.diagnosis.headline import undetectable
from jaxmodel.diagnosis.opening import opening
from jaxmodel.diagnosis.residuals.regime_map import RUN, RegimeMap
from jaxmodel.diagnosis.residuals.regimes import Bins
from jaxmodel.diagnosis.result import Diagnosis, Rung
from jaxmodel.diagnosis.wording import physics_of, step_names, verdict_title, with_sd
from jaxmodel.model.names import parameter_table
from jaxmodel.model.names import value as value_of
from jaxmodel.sweeps import Study
from jaxmodel.sweeps.idle import acting

_MOST_LINES = 60
# Times are drawn in this unit where the longest run takes longer than so many seconds.
_TIMES = ((6 * 3600.0, 1.0 / 3600.0, "h"), (1200.0, 1.0 / 60.0, "min"))


def case_view(case: Case) -> dict[str, Any]:
    """Return a case's title, what it says of load and drive, runs, channels and inputs."""
    longest = max(float(run.measured.time_s[-1] - run.measured.time_s[0]) for run in case.runs)
    time = next(({"factor": f, "unit": u} for least, f, u in _TIMES if longest > least), {"factor": 1.0, "unit": "s"})
    readings = dict.fromkeys(name for run in case.runs for name in run.measured.outputs)
    inputs = dict.fromkeys(name for run in case.runs for name in run.measured.inputs)
    return {
        "title": case.title,
        "kind": case.kind,
        "load": case.load,
        "drive": case.servo.drive,
        "controller": case.servo.controller,
        "time": time,
        "runs": [
            {
                "name": run.name,
                "split": run.split,
                "specimen": run.specimen,
                "label": run.label,
                "rows": int(run.measured.time_s.size),
                "duration_s": float(run.measured.time_s[-1] - run.measured.time_s[0]),
            }
            for run in case.runs
        ],
        "channels": [channel_words(name) for name in readings],
        "inputs": [channel_words(name) for name in inputs],
        "uncertain": [
            {"name": name, "text": f"{known.value:g} ± {known.sd:g}"}
            for name, known in case.parameters.items()
            if known.sd is not None
        ],
        "formulas": list(case.formulas),
    }


def import_view(imported: Imported) -> dict[str, Any]:
    """Return what an import decided and found, in sentences."""
    decided = shortened([one for one in imported.decisions if one.about not in ("reading", "clock", "convention")])
    noted = sentences(one for one in imported.findings if one.weight != "warning")
    return {
        "decided": decided[:_MOST_LINES],
        "warned": imported.warned()[:_MOST_LINES],
        "noted": noted[:_MOST_LINES],
        "missing": imported.missing(),
    }


def model_view(investigation: Investigation, previews: pd.DataFrame, maps: list[RegimeMap]) -> dict[str, Any]:
    """Return everything on the present model: errors, where it fails, candidates, ladder, parameters.

    Args:
        investigation: with its present model fitted.
        previews: of all candidates, as `Investigation.preview` returns it.
        maps: of each channel.
    """
    models = investigation.models()
    present = investigation.present()
    return {
        "added": [_addition(investigation, label) for label in investigation.added],
        "residuals": _residuals(investigation, models[0]),
        "errors": _errors(investigation.errors()),
        "where": investigation.where().to_dict("records"),
        "maps": [map_view(one) for one in maps],
        "candidates": _candidates(investigation, previews),
        "ladder": _ladder(models, present.added),
        "parameters": [
            {"name": name, "text": with_sd(one), "strained": name in present.at_bound}
            for name, one in present.estimates.items()
        ],
    }


def _residuals(investigation: Investigation, base: Rung) -> dict[str, Any]:
    """Return, by channel, in which unit residuals are drawn, and noise and tolerance in it."""
    found = {}
    for name, noise in investigation.cache.noise.items():
        sizes = [error.worst for error in base.by_run[name].values()]
        factor, unit = readable(sizes, channel_words(name)["difference"])
        tolerance = investigation.case.tolerance.get(name)
        found[name] = {
            "factor": factor,
            "unit": unit,
            "noise": factor * noise.sd,
            "tolerance": None if tolerance is None else factor * tolerance.rms,
            "noise_text": error_text(name, noise.sd),
            "tolerance_text": "" if tolerance is None else error_text(name, tolerance.rms),
        }
    return found


def _addition(investigation: Investigation, label: str) -> dict[str, str]:
    candidate = investigation.cache.space.candidates[label]
    group = GROUPS.get(candidate.group, "Laws")
    physics = physics_of(type(candidate.effect))
    return {"name": label, "title": title_of(candidate), "physics": physics, "group": group}


def _errors(table: pd.DataFrame) -> list[dict[str, Any]]:
    rows = []
    for row in table.to_dict("records"):
        channel = str(row["channel"])
        rows.append(
            {
                "run": row["run"],
                "split": row["split"],
                "channel": channel,
                "rms": finite(row["rms"]),
                "text": error_text(channel, row["rms"]),
                "mean": error_text(channel, row["mean"]),
                "worst": error_text(channel, row["max"]),
                "noise": error_text(channel, row["noise_sd"]),
                "over_noise": finite(row["rms_over_noise"]),
                "tolerance": error_text(channel, row["tolerance"]),
                "within": row["within_tolerance"] if isinstance(row["within_tolerance"], bool | np.bool_) else None,
            }
        )
        if rows[-1]["within"] is not None:
            rows[-1]["within"] = bool(rows[-1]["within"])
    return rows


def map_view(one: RegimeMap) -> dict[str, Any]:
    """Return a regime map with the words on its axes; residuals in a readable unit."""
    scale, unit = readable(one.mean[np.isfinite(one.mean)], one.unit)
    return {
        **channel_words(one.channel),
        "unit": unit,
        "x": _axis(one.across, one.run_names),
        "y": _axis(one.along, one.run_names),
        "mean": [[finite(scale * value) for value in row] for row in one.mean],
        "rms": [[finite(scale * value) for value in row] for row in one.rms],
        "seconds": one.seconds.tolist(),
    }


def _axis(bins: Bins, runs: tuple[str, ...]) -> dict[str, Any]:
    quantity, unit = split_unit(bins.name)
    if bins.name == RUN:
        return {"title": "run", "labels": [runs[int(value)] for value in bins.middle]}
    title = f"{quantity} [{unit}]" if unit else quantity
    if bins.are_levels:
        return {"title": title, "labels": [f"{value:.3g}" for value in bins.middle]}
    labels = []
    for low, high in zip(bins.lower, bins.upper, strict=True):
        if not np.isfinite(low) and not np.isfinite(high):
            labels.append("all")
        elif not np.isfinite(low):
            labels.append(f"< {high:.4g}")
        elif not np.isfinite(high):
            labels.append(f"> {low:.4g}")
        else:
            labels.append(f"{low:.4g} to {high:.4g}")
    return {"title": title, "labels": labels}


def _candidates(investigation: Investigation, previews: pd.DataFrame) -> list[dict[str, Any]]:
    """Return all candidates in the order of the share that the page shows: what each explains of what the best does.

    What a candidate explains is the drop in chi-square that it promises. One that gains no evidence, or reduces the
    error of no channel, has a share of nothing.
    """
    names = [str(name) for name in previews.columns[4:]]
    size = {
        str(channel): np.sqrt(np.mean(part[["residual", *names]].to_numpy() ** 2, axis=0))
        for channel, part in previews.groupby("channel", sort=False)
    }
    found: list[dict[str, Any]] = []
    for row in investigation.candidates().to_dict("records"):
        name, candidate = str(row["name"]), investigation.cache.space.candidates[str(row["name"])]
        if name not in names:
            continue
        own = 1 + names.index(name)
        expected = {channel: (float(rms[0]), float(rms[own])) for channel, rms in size.items()}
        reason = reason_for(expected) if float(row["log_evidence"]) > 0.0 else ""
        found.append(
            {
                "name": name,
                "title": title_of(candidate),
                "group": GROUPS[candidate.group],
                "physics": physics_of(type(candidate.effect)),
                "equation": type(candidate.effect).equation,
                "share": max(float(row["chi2"]), 0.0) if reason else 0.0,
                "reason": reason or NO_REASON,
                "expected": {channel: list(pair) for channel, pair in expected.items()},
            }
        )
    found.sort(key=lambda one: -one["share"])  # of equal ones the first is the one that gains most
    most = found[0]["share"] if found else 0.0
    for one in found:
        if one["share"] > 0.0:
            one["share"] /= most
            one["reason"] += f" {beside_the_best(one['share'], found[0]['title'])}"
    return found


def _ladder(models: list[Rung], present: tuple[str, ...]) -> list[dict[str, Any]]:
    names = step_names([one.added for one in models])
    return [
        {
            "name": f"{name[:1].upper()}{name[1:]}".replace("_", " "),
            "present": one.added == present,
            "errors": {
                channel: {
                    "fit": finite(error.fit),
                    "check": finite(error.check),
                    "fit_text": error_text(channel, error.fit),
                    "check_text": error_text(channel, error.check),
                }
                for channel, error in one.errors.items()
            },
        }
        for name, one in zip(names, models, strict=True)
    ]


def sweepable(case: Case) -> list[dict[str, Any]]:
    """Return the parameters and inputs that may be axes, each with a first range: a fifth about its value.

    One on which no result of a sweep depends is none of them: the mass of a cell, the temperature of a storage that
    lasted no month. An axis of whole numbers has a `count`, so that its values are whole.

    Args:
        case: with the additions of the present model.
    """
    model = case_model(case)
    found, values = [], {"ambient_degC": 20.0}
    of_sensors = {effect.label for effect in model.effects if effect.is_sensor}
    for name, info in parameter_table(model).items():
        value = float(value_of(model, name))
        if not np.isfinite(value) or value == 0.0 or name.rpartition(".")[0] in of_sensors:
            continue
        ends = sorted((0.8 * value, 1.2 * value))
        if info.whole:
            ends = [min(np.floor(ends[0]), value - 1.0), max(np.ceil(ends[1]), value + 1.0)]
        low, high = (float(np.clip(end, info.lower, info.upper)) for end in ends)
        if low < high:
            count = int(high - low) + 1 if info.whole else None
            low, high = (float(f"{end:.3g}") for end in (low, high))
            found.append({"name": name, "unit": info.unit, "meaning": info.meaning, "low": low, "high": high})
            found[-1]["count"], values[name] = count, value
    ambient = {"name": "ambient_degC", "unit": "°C", "meaning": "ambient temperature", "low": -10.0, "high": 45.0}
    acts = _acting(case, values) - ({"storage_temperature_degC"} if "storage_months" not in values else set())
    return [one for one in (ambient | {"count": None}, *found) if one["name"] in acts]


def _acting(case: Case, values: Mapping[str, float]) -> frozenset[str]:
    """Return the names of some parameters and inputs on which results depend, of sweeps that a run of a case drives."""
    run = case.runs[0]
    with tempfile.TemporaryDirectory() as folder:
        run.to_dataframe().to_csv(Path(folder) / "profile.csv", index=False)
        axes = {name: [value] for name, value in values.items()}
        study = Study(case=case, profile={"csv": "profile.csv"}, axes=axes, folder=Path(folder))
    return acting(study)


def verdict_view(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis in words."""
    return {
        "verdict": diagnosis.verdict,
        "title": verdict_title(diagnosis),
        "lines": [[name, in_words(text, diagnosis.case.catalogue)] for name, text in opening(diagnosis).lines()],
        "remarks": [in_words(remark, diagnosis.case.catalogue) for remark in diagnosis.remarks],
        "hidden": [in_words(name, diagnosis.case.catalogue) for name in undetectable(diagnosis)],
    }
