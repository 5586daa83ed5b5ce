"""The answer file of a diagnosis, in the form of the case contract."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.schema import with_schema
from jaxmodel.diagnosis.headline import possible, undetectable
from jaxmodel.diagnosis.result import ChannelError, Diagnosis, Removed


def number(value: float) -> float | None:
    """Return a number with six digits, ready for JSON; None if it is not finite."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _split(error: ChannelError | Removed) -> dict[str, float | None]:
    return {"fit": number(error.fit), "check": number(error.check)}


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the answer in the form of the case contract, ready for JSON; undefined numbers are null."""
    before, after = diagnosis.base.errors, diagnosis.final.errors
    return {
        "verdict": diagnosis.verdict,
        "effects": [
            {
                "name": effect.name,
                "probability": number(effect.probability),
                "parameters": {
                    **{n: {"value": number(e.value), "sd": number(e.sd)} for n, e in effect.parameters.items()},
                    **({"column": effect.column} if effect.column else {}),
                },
                "cannot_tell_apart_from": list(effect.cannot_tell_apart_from),
                "removes": {c: _split(one) for c, one in effect.removes.items()},
                **({"rests_on": effect.rests_on} if effect.rests_on else {}),
            }
            for effect in diagnosis.effects
        ],
        "candidates": [{"name": name, "probability": number(p)} for name, p in diagnosis.candidates],
        "unexplained": diagnosis.unexplained,
        "blind_to": list(undetectable(diagnosis)),
        "error": {
            channel: {
                "noise_floor": number(diagnosis.noise[channel].sd),
                "before": _split(before[channel]),
                "after": _split(after[channel]),
                "check_prediction_sd": number(after[channel].prediction_sd),
                "check_as_stated": {
                    "before": number(before[channel].stated),
                    "after": number(after[channel].stated),
                },
            }
            for channel in diagnosis.noise
        },
        "tolerance": {
            channel: {"rms": number(one.rms), "max": one.largest and number(one.largest), "assumed": one.assumed}
            for channel, one in diagnosis.tolerance.items()
        },
        "fit_for_purpose": {channel: dict(of_run) for channel, of_run in diagnosis.fit_for_purpose.items()},
        "curves": [
            {
                "port": curve.port,
                "over": curve.over,
                "at": [number(x) for x in curve.at],
                "value": [number(x) for x in curve.value],
                "sd": [number(x) for x in curve.sd],
                "unit": curve.unit or "log of a factor",
                "removes": {c: _split(one) for c, one in curve.removes.items()},
            }
            for curve in diagnosis.curves
        ],
        "runs": [
            {
                "file": run.file,
                "parameter": run.parameter,
                "value": number(run.value),
                "sd": number(run.sd),
                "unit": run.unit,
                "removes": {c: _split(one) for c, one in run.removes.items()},
            }
            for run in diagnosis.runs
        ],
        "immaterial": [
            {"name": one.name, "removes": {c: _split(r) for c, r in one.removes.items()}} for one in possible(diagnosis)
        ],
        "remaining": {
            channel: {"rms": number(one.rms), "tau_s": number(one.tau_s), "where": list(one.where)}
            for channel, one in diagnosis.remaining.items()
        },
        "extrapolated": [
            {
                "file": one.file,
                "condition": one.condition,
                "span_fitted": [number(x) for x in one.span_fitted],
                "span": [number(x) for x in one.span],
            }
            for one in diagnosis.extrapolated
        ],
        "errors_by_run": [] if diagnosis.errors is None else _rows(diagnosis.errors),
        "remarks": list(diagnosis.remarks),
    }


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    def plain(value: Any) -> Any:
        if isinstance(value, float | np.floating):
            return number(float(value))
        return value.item() if isinstance(value, np.generic) else value

    return [{str(key): plain(value) for key, value in row.items()} for row in table.to_dict("records")]


def write_answer(diagnosis: Diagnosis, path: Path) -> None:
    """Write the answer as JSON."""
    write_whole(path, json.dumps(with_schema(answer(diagnosis)), indent=2) + "\n")
