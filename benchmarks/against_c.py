"""Ours against C written by hand: the same equations, steps, lanes and results."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.by_hand import ByHand, NoCompiler
from benchmarks.timing import alternate
from benchmarks.work import Ours, study_of

LANES = 4096
# What two orders of the same additions may differ by after 1,800 steps.
MOST_APART = {"final_soc": 1e-12, "voltage_V": 1e-11}
# In float32 both keep what a sum of charge loses: without that, C is 5e-5 of the charge off.
MOST_APART_SINGLE = {"final_soc": 1e-6, "voltage_V": 1e-4}


def differences(ours: dict[str, np.ndarray], by_hand: list[np.ndarray]) -> dict[str, float]:
    """Return the greatest difference of final SOC and of voltage over the lanes."""
    pairs = zip(MOST_APART, ours.values(), by_hand, strict=True)
    return {name: float(np.max(np.abs(mine - other))) for name, mine, other in pairs}


def _refuse_if_apart(apart: dict[str, float], most: dict[str, float]) -> None:
    if any(apart[name] > most[name] for name in most):
        raise AssertionError(f"the C program and ours differ: {apart}")


def against_c(
    kind: str, lanes: int = LANES, devices: int = 1, rounds: int = 5, step_s: float = 1.0, others: bool = False
) -> dict[str, Any]:
    """Time a kind of model, agreement checked first; without a compiler the reason stands for the times.

    With `others` also ours through XLA, and both in float32.
    """
    ours = Ours(study_of(kind, lanes, step_s), devices)
    lane_steps = lanes * ours.steps
    row: dict[str, Any] = {"kind": kind, "lanes": lanes, "steps": ours.steps, "cores": devices}
    try:
        by_hand = ByHand(ours, devices)
    except NoCompiler as reason:
        return row | {"ours": alternate({"ours": ours}, rounds)["ours"].as_row(lane_steps), "left_out": str(reason)}
    apart = differences(ours(), by_hand())
    _refuse_if_apart(apart, MOST_APART)
    contestants: dict[str, Any] = {"ours": ours, "c": by_hand}
    if others:
        contestants["xla"] = Ours(ours.study, devices, through_xla=True)
        single = Ours(study_of(kind, lanes, step_s, precision="float32"), devices)
        contestants |= {"float32": single, "c_float32": ByHand(single, devices)}
        contestants["xla"]()
        _refuse_if_apart(differences(single(), contestants["c_float32"]()), MOST_APART_SINGLE)
    times = {name: timing.as_row(lane_steps) for name, timing in alternate(contestants, rounds, warm=True).items()}
    mine, other = times["ours"], times["c"]
    ratios = {"ratio": mine["best_s"] / other["best_s"], "ratio_cpu": mine["cpu_s"] / other["cpu_s"]}
    if others:
        ratios["ratio_float32"] = times["float32"]["best_s"] / times["c_float32"]["best_s"]
    return row | {"apart": apart, **times, **ratios}
