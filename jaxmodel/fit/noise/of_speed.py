"""What the noise of a measured speed adds to the readings, where the speed drives the model in place of a load.

A speed that is off by 0.5 rad/s moves the back-EMF by 20 mV and the current of a motor of 0.1 ohm by 0.2 A: ten times
what a sensor of current is off by. Errors of that size are then no physics.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import robust_sd, white_sd
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.settings import SEED
from jaxmodel.model.pieces import run_in_pieces

SPEED = "speed_rad_s"
# Rows of a run that are enough to learn what noise does. Assumed.
_ENOUGH = 5000


def with_noise_of_speed(case: Case, noise: Mapping[str, NoiseModel]) -> dict[str, NoiseModel]:
    """Return the noise of every output with that of a speed which is an input: the stated model is run with both.

    Args:
        case: whose runs have the same inputs.
        noise: of the sensors of its outputs.
    """
    runs = [run for run in case.runs if SPEED in run.measured.inputs]
    if not runs:
        return dict(noise)
    sd = speed_sd(case)
    run = _short(max(runs, key=lambda one: one.measured.time_s.size))
    added = np.random.default_rng(SEED).normal(0.0, sd, run.measured.time_s.size)
    shaken = run.driven_by(run.measured.inputs | {SPEED: run.measured.inputs[SPEED] + added})
    before, after = (run_in_pieces(case_model(case, one), run_profile(one)).readings for one in (run, shaken))
    found = {}
    for name, model in noise.items():
        moved = robust_sd(after[name] - before[name]) if name in after else 0.0
        source = model.source if moved < model.sd else f"{model.source}, and that of {SPEED}, which drives the model"
        found[name] = dataclasses.replace(model, sd=math.hypot(model.sd, moved), source=source)
    return found


def speed_sd(case: Case) -> float:
    """Return the sd of a speed that is an input [rad/s]: stated, else by how far rows are off their neighbours."""
    if SPEED in case.sensors:
        return case.sensors[SPEED]
    return min(white_sd(run.measured.inputs[SPEED]) for run in case.runs)


def _short(run: Run) -> Run:
    measured, rows = run.measured, slice(_ENOUGH)
    kept = {
        kind: {name: values[rows] for name, values in columns.items()}
        for kind, columns in (("inputs", measured.inputs), ("outputs", measured.outputs))
    }
    return dataclasses.replace(run, measured=dataclasses.replace(measured, time_s=measured.time_s[rows], **kept))
