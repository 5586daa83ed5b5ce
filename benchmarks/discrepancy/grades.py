"""Whether an answer is right about a made case: the one judge of cases with an `answer.toml` and of the proving ground.

It reads the answer alone, as the contract has it, and the truth in the form of `answer.toml`.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np

Grade = Literal["right", "part", "wrong"]
# A name with less belief than this is no claim.
CLAIMED = 0.5
# A candidate with this much belief is told, where the answer is undecided.
TOLD = 0.2
# Where a correction of a table acts; of an answer's own words, any will do.
PORTS = {
    "ocv": ("open_circuit_voltage",),
    "R_ints": ("series_resistance",),
    "R_TS": ("rc_resistance", "R_TS"),
    "R_TL": ("rc_resistance", "R_TL"),
}
NOISE_REMARK = re.compile(r"\b(noise|sd|scatter|standard deviation)\b", re.IGNORECASE)
OUTSIDE_REMARK = re.compile(r"extrapolat|outside|beyond what|not fitted|never fitted", re.IGNORECASE)
# How many sd an interval is wide to each side.
WIDTH = 2.0


@dataclasses.dataclass(frozen=True)
class Judgement:
    """What is right and wrong in an answer.

    Attributes:
        grade: "right"; "part", where some of what is hidden is told; "wrong".
        missed: hidden effects that are not named.
        extra: effects that are claimed and not hidden.
        why: what else keeps the answer from being right.
    """

    grade: Grade
    missed: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    why: str = ""


def judge(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """Judge an answer.

    Args:
        truth: `class`, `verdict`, `effects`, `effect_parameters` and what the class has beside, as in `answer.toml`.
        said: an answer.
    """
    if "error" in said and "verdict" not in said:
        return Judgement("wrong", why=str(said["error"]))
    return JUDGES.get(truth["class"], _effects)(truth, said)


def named(said: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the effects of an answer by name, in its order."""
    return {effect["name"]: effect for effect in said.get("effects") or ()}


def _names(truth: Mapping[str, Any], said: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the effects that are missed, and those claimed and not hidden. A fault is on its column."""
    told = named(said)

    def found(name: str) -> bool:
        column = truth.get("effect_parameters", {}).get(name, {}).get("column")
        of = told.get(name, {}).get("parameters", {}).get("column", column)
        return name in told and of == column

    hidden = [name for name in truth["effects"] if not name.startswith("x_")]
    missed = tuple(name for name in hidden if not found(name))
    claimed = [name for name, effect in told.items() if (effect.get("probability") or 0.0) >= CLAIMED]
    return missed, tuple(name for name in claimed if name not in hidden)


def _not_ruled_out(said: Mapping[str, Any]) -> set[str]:
    """Return what an answer names, cannot tell from what it names, or is undecided between."""
    rivals = {rival.partition(":")[0] for e in named(said).values() for rival in e.get("cannot_tell_apart_from") or ()}
    likely = {
        name.partition(":")[0]
        for each in said.get("candidates") or ()
        if (each.get("probability") or 0.0) >= TOLD and said["verdict"] == "undecided"
        for name in each["name"].split("+")
    }
    return {*named(said), *rivals, *likely}


def _effects(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """One effect or several: all are named, no other, and the verdict is right."""
    missed, extra = _names(truth, said)
    hidden = [name for name in truth["effects"] if not name.startswith("x_")]
    right_verdict = said["verdict"] == truth["verdict"]
    why = "" if right_verdict else f"verdict {said['verdict']}"
    if not missed and not extra and right_verdict:
        return Judgement("right")
    also = {*hidden, *truth.get("also_fits", ())}
    if truth.get("faint") and set(named(said)) <= also:  # at the limit of what can be seen
        seen = bool(set(named(said)) | (_not_ruled_out(said) & also))
        return Judgement("right" if seen else "part", missed, extra, why)
    told = len(hidden) - len(missed)
    some = told > 0 and 2 * told >= len(hidden) and len(extra) <= told
    some |= len(hidden) == 1 and bool(missed) and hidden[0] in _not_ruled_out(said)
    return Judgement("part" if some else "wrong", missed, extra, why)


def _null(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """Nothing is claimed."""
    _, extra = _names(truth, said)
    if said["verdict"] == "adequate" and not extra:
        return Judgement("right")
    cautious = said["verdict"] in ("adequate", "undecided") and not extra
    return Judgement("part" if cautious else "wrong", (), extra, f"verdict {said['verdict']}")


def _outside(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """What is in no catalogue is called so."""
    if said["verdict"] == truth["verdict"]:
        return Judgement("right")
    _, extra = _names(truth, said)
    cautious = not extra and (said["verdict"] == "undecided" or bool(said.get("curves")))
    return Judgement("part" if cautious else "wrong", (), extra, f"verdict {said['verdict']}")


def told_curves(truth: Mapping[str, Any], said: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the corrections over the state of charge that are told where the wrong table acts."""
    ports = PORTS[truth["table"]]
    return [
        curve
        for curve in said.get("curves") or ()
        if curve.get("over") == "soc" and any(port in str(curve.get("port", "")) for port in ports)
    ]


def _table(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """The table is told as a correction over the state of charge, and the effects beside it."""
    missed, extra = _names(truth, said)
    told, right_verdict = bool(told_curves(truth, said)), said["verdict"] == truth["verdict"]
    lacks = [] if told else [f"no correction of {truth['table']}"]
    lacks += [] if right_verdict else [f"verdict {said['verdict']}"]
    if told and right_verdict and not missed and not extra:
        return Judgement("right")
    effects_alone = bool(truth["effects"]) and not missed and not extra
    return Judgement("part" if told or effects_alone else "wrong", missed, extra, ", ".join(lacks))


def _run(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """The run is named, no other, and no effect is claimed."""
    _, extra = _names(truth, said)
    files = {str(run.get("file")) for run in said.get("runs") or ()}
    if truth["run"] not in files:
        return Judgement("wrong", (), extra, f"{truth['run']} is not named")
    others = sorted(files - {truth["run"]})
    lacks = [f"{file} named too" for file in others]
    lacks += [] if said["verdict"] == truth["verdict"] else [f"verdict {said['verdict']}"]
    return Judgement("part" if lacks or extra else "right", (), extra, ", ".join(lacks))


def _remark(said: Mapping[str, Any], pattern: re.Pattern[str]) -> bool:
    return any(pattern.search(remark) for remark in said.get("remarks") or ())


def _noise(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """Verdict and names are those without the wrong sd, and a remark tells it."""
    missed, extra = _names(truth, said)
    told, right_verdict = _remark(said, NOISE_REMARK), said["verdict"] == truth["verdict"]
    lacks = [] if told else ["no remark on the noise"]
    lacks += [] if right_verdict else [f"verdict {said['verdict']}"]
    if missed or extra:
        return Judgement("wrong", missed, extra, ", ".join(lacks))
    return Judgement(
        "right" if not lacks else "part" if right_verdict or truth["effects"] else "wrong", why=", ".join(lacks)
    )


def _prior(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """Adequate, and a remark names the number that is far from what is stated."""
    _, extra = _names(truth, said)
    if said["verdict"] != "adequate" or extra:
        return Judgement("wrong", (), extra, f"verdict {said['verdict']}")
    words = re.compile(re.escape(truth["parameter"]).replace("_", "[_ ]"))
    told = _remark(said, words)
    return Judgement("right" if told else "part", why="" if told else f"no remark on {truth['parameter']}")


def _extrapolation(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """Not called adequate, and the condition of the check run that was not fitted is told."""
    told = bool(said.get("extrapolated")) or _remark(said, OUTSIDE_REMARK)
    careful = said["verdict"] in ("undecided", "unknown_effect", "missing_effect")
    if told and careful:
        return Judgement("right")
    lacks = [] if told else ["nothing told as extrapolated"]
    lacks += [] if careful else [f"verdict {said['verdict']}"]
    return Judgement("part" if told or careful else "wrong", why=", ".join(lacks))


def _immaterial(truth: Mapping[str, Any], said: Mapping[str, Any]) -> Judgement:
    """Adequate; the effect may be told as immaterial, and is not claimed."""
    _, extra = _names(truth, said)
    if said["verdict"] == "adequate" and not extra:
        return Judgement("right")
    return Judgement("wrong", (), extra, f"verdict {said['verdict']}")


JUDGES: dict[str, Callable[[Mapping[str, Any], Mapping[str, Any]], Judgement]] = {
    "null": _null,
    "outside": _outside,
    "table": _table,
    "run": _run,
    "noise": _noise,
    "prior": _prior,
    "extrapolation": _extrapolation,
    "immaterial": _immaterial,
}


def after_over_reachable(truth: Mapping[str, Any], said: Mapping[str, Any]) -> float:
    """Return the worst channel's error on check runs with all that was added, over what the truth leaves there."""
    errors = said.get("error")
    reachable = truth.get("reachable_check") or truth.get("noise_sd") or {}
    ratios = [
        error["after"]["check"] / reachable[channel]
        for channel, error in (errors.items() if isinstance(errors, dict) else ())  # text: the diagnosis failed
        if reachable.get(channel) and error["after"].get("check")
    ]
    return max(ratios, default=float("nan"))


def parameters_within(truth: Mapping[str, Any], said: Mapping[str, Any]) -> tuple[int, int]:
    """Return how many of the named effects' numbers lie within two of their sd of the truth, and of how many."""
    hits = []
    for name, effect in named(said).items():
        for parameter, true in truth.get("effect_parameters", {}).get(name, {}).items():
            told = effect.get("parameters", {}).get(parameter)
            if isinstance(told, Mapping) and told.get("sd") and isinstance(true, float | int):
                hits.append(abs(told["value"] - true) <= WIDTH * told["sd"])
    return sum(hits), len(hits)


def curve_within(truth: Mapping[str, Any], stated: Mapping[str, Any], said: Mapping[str, Any]) -> tuple[int, int]:
    """Return at how many knots the true error of a table lies within two sd of the correction told, and of how many.

    Of a voltage its level and slope, of a resistance its level are taken off first: calibrated numbers have those.

    Args:
        truth: with `table` and `true_tables`.
        stated: the tables that the case states, by name.
        said: an answer.
    """
    curves = told_curves(truth, said) if "table" in truth else []
    name = truth.get("table", "")
    if not curves or name not in stated or name not in truth.get("true_tables", {}):
        return 0, 0
    curve, true, given = curves[0], truth["true_tables"][name], stated[name]
    at, value, sd = (np.asarray(curve[key], dtype=float) for key in ("at", "value", "sd"))
    key = "voltage_V" if name == "ocv" else "ohm"
    there, here = np.interp(at, true["soc"], true[key]), np.interp(at, given["soc"], given[key])
    as_share = name != "ocv" and curve.get("unit", "") != "ohm"
    left = value - (np.log(there / here) if as_share else there - here)
    known = np.isfinite(sd) & (sd > 0.0)
    if known.sum() < 3:
        return 0, 0
    left = left[known] - _trend(at[known], left[known], sd[known], 1 if name == "ocv" else 0)
    return int(np.sum(np.abs(left) <= WIDTH * sd[known])), int(known.sum())


def _trend(at: np.ndarray, values: Sequence[float] | np.ndarray, sd: np.ndarray, degree: int) -> np.ndarray:
    return np.polyval(np.polyfit(at, values, degree, w=1.0 / sd), at)
