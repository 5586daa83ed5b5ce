"""Blind cases: hardware, profiles, noise and hidden effect drawn from a seed, by the independent simulator."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.bench import BENCH_FROM, draw_bench, fitting
from benchmarks.discrepancy.hidden import Blind, Drawn
from benchmarks.discrepancy.outside import OUTSIDE_CELL, OUTSIDE_DRIVE, apply
from benchmarks.discrepancy.ranges import (
    CONFUSABLE,
    EFFECTS,
    KNOWN_TO,
    NOISE,
    TEMPERATURES,
    amplitude,
    hardware,
    names,
)
from benchmarks.discrepancy.truth import write_answer
from benchmarks.independent.effects import reported_inputs
from benchmarks.independent.forms import OTHER_FORMS
from benchmarks.independent.integrate import simulate
from benchmarks.independent.make_case import Run, write_case
from benchmarks.independent.profiles import make_profile

KINDS = {"cell": 0.45, "motor": 0.3, "robot": 0.25}
CLASSES = {"null": 0.25, "single": 0.42, "double": 0.1, "sensor": 0.11, "outside": 0.12}
# By how many sigma an effect that is there moves all readings together at least.
LEAST_MOVE = 1.0
# From this seed on cases are harder: effects that have another form than the catalogue's have that, noise of one sensor
# is heavy-tailed in every other case, and in half of the clean nulls one number is far from what is stated of it.
HARDER_FROM = 3000
DECOY_SD = 3.0
# From this seed on one of two effects is hidden that look alike, in runs that hardly tell them apart: all at one
# temperature, never reversed, and at nearly one load.
CONFUSABLE_FROM = 4000
NEARLY_ONE_LOAD = 0.8
# Of the independent simulator; far below any sensor.
TOLERANCE = 1e-7
PATTERNS = ("load steps", "varying load", "pulse train", "rests with pulses", "constant load")


def draw(seed: int) -> Drawn:
    """Return what a seed says of a case."""
    if seed >= BENCH_FROM:
        return draw_bench(seed)
    rng = np.random.default_rng([7, seed])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    confusable = seed >= CONFUSABLE_FROM
    if confusable:
        group, effects, rival = _one_of_two(rng, kind)
    else:
        group, rival = str(rng.choice(list(CLASSES), p=list(CLASSES.values()))), ""
        effects = _effects(rng, kind, group)
    law = ""
    if group == "outside":
        law = str(rng.choice(list(OUTSIDE_CELL if kind == "cell" else OUTSIDE_DRIVE)))
    hostile = bool(group == "null" and rng.uniform() < 0.5)
    stated, true = hardware(rng, kind)
    sensors = {name: float(np.exp(rng.uniform(*np.log(span)))) for name, span in NOISE[kind].items()}
    if rng.uniform() < 0.5 or any(e.get("column") == TEMPERATURES[kind] for e in effects.values()):
        sensors[TEMPERATURES[kind]] = float(rng.uniform(0.05, 0.3))
    runs = _runs(rng, kind, true, effects, narrow=confusable)
    strength = float(np.exp(rng.uniform(np.log(0.5), np.log(2.0))))
    options: dict[str, Any] = {}
    if hostile:
        first = next(iter(sensors))
        options = {"autocorrelation": {first: float(rng.uniform(0.3, 0.9))}, "unstated_sensors": [first]}
    if rng.uniform() < 0.5:
        options["quantisation"] = {name: 10.0 ** np.floor(np.log10(sd)) for name, sd in sensors.items()}
    blind = Blind(kind, group, effects, law, hostile, rival=rival)
    drawn = Drawn(blind, stated, true, sensors, runs, strength, options)
    return harder(drawn, np.random.default_rng([8, seed])) if HARDER_FROM <= seed < CONFUSABLE_FROM else drawn


def harder(drawn: Drawn, rng: np.random.Generator) -> Drawn:
    """Return a case with other forms, heavy tails and decoys."""
    blind, true, options = drawn.blind, dict(drawn.true), dict(drawn.options)
    effects = {
        name: {**numbers, "other": 1.0} if name in OTHER_FORMS else numbers for name, numbers in blind.effects.items()
    }
    heavy = str(rng.choice(list(drawn.sensors))) if rng.uniform() < 0.5 else ""
    if heavy:
        options["heavy_tails"] = [heavy]
    decoy = ""
    if blind.group == "null" and not blind.hostile and rng.uniform() < 0.5:
        decoy = str(rng.choice(list(KNOWN_TO[blind.kind])))
        value, sd = drawn.stated[decoy]
        true[decoy] = value + float(rng.choice([-DECOY_SD, DECOY_SD])) * sd
    blind = dataclasses.replace(blind, effects=effects, heavy=heavy, decoy=decoy)
    return dataclasses.replace(drawn, blind=blind, true=true, options=options)


def make(folder: Path, seed: int) -> Blind:
    """Write the blind case of a seed and return what is hidden in it.

    Raises:
        RuntimeError: the simulator cannot integrate it; its cell is discharged beyond empty, where no voltage means
            anything; or what is hidden moves no reading, as a law of temperature in runs at its reference.
    """
    drawn = fitting(draw(seed))
    moved = {} if seed >= BENCH_FROM else moves(drawn)  # of several effects each stands out less: see `truth`
    if idle := [name for name, sigma in moved.items() if sigma < LEAST_MOVE]:
        raise RuntimeError(f"no reading is moved by {' and '.join(idle)}")
    blind, runs = drawn.blind, drawn.runs
    reported = [run.profile for run in runs]
    if blind.outside and blind.kind != "cell":
        drive = {"motor": "voltage_V", "robot": "duty"}[blind.kind]
        law = OUTSIDE_DRIVE[blind.outside]
        runs = [dataclasses.replace(r, profile=law(r.profile, drawn.strength, drive)) for r in runs]
    clean = write_case(
        folder,
        blind.kind,
        drawn.true,
        drawn.stated,
        runs,
        effects=blind.effects,
        sensors=drawn.sensors,
        seed=seed,
        tolerance=TOLERANCE,
        **drawn.options,
    )
    if any(float(np.min(truth["soc"])) < 0.0 for truth in clean if "soc" in truth):
        raise RuntimeError("its cell is discharged beyond empty")
    if blind.outside:
        apply(folder, blind.kind, blind.outside, drawn.strength, clean, reported)
    if seed >= BENCH_FROM:
        return write_answer(folder, drawn)
    return dataclasses.replace(blind, moves=moved)


def moves(drawn: Drawn) -> dict[str, float]:
    """Return by how many sigma each hidden effect moves all readings together, from the same reported inputs."""
    effects = drawn.blind.effects
    squares = dict.fromkeys(effects, 0.0)
    for run in drawn.runs:
        reported, truth = reported_inputs(run.profile, effects), drawn.true | dict(run.parameters)

        def readings(present: Mapping[str, Any], run=run, reported=reported, truth=truth):
            return simulate(drawn.blind.kind, truth, reported, present, run.initial_soc, tolerance=TOLERANCE)

        with_all = readings(effects)
        for name in effects:
            without = readings({other: numbers for other, numbers in effects.items() if other != name})
            for column, sd in drawn.sensors.items():
                if column not in reported:
                    squares[name] += float(np.sum(((with_all[column] - without[column]) / sd) ** 2))
    return {name: float(np.sqrt(square)) for name, square in squares.items()}


def _runs(rng, kind: str, true: Mapping[str, float], effects: Mapping[str, Any], narrow: bool) -> list[Run]:
    """Draw three or four fit runs and a check run, at one to four temperatures, or narrow ones, all at one."""
    count = int(rng.integers(4, 6))
    spread = rng.uniform() < 0.6
    one_for_all = float(rng.choice([0, 40])) if narrow else 20.0
    runs = []
    for number in range(count):
        ambient = float(rng.choice([-10, 0, 10, 25, 30, 40])) if spread and not narrow else one_for_all
        pattern = str(rng.choice(PATTERNS))
        drive = {"cell": 1.2 * true.get("capacity_Ah", 5.0), "motor": 14.0, "robot": 0.8}[kind]
        profile = make_profile(
            kind,
            pattern,
            int(rng.integers(1_000_000)),
            duration_s=2400.0,
            step_s=1.5,
            ambient_degC=ambient,
            largest_drive=drive,
            largest_load_Nm=0.18,
            least=NEARLY_ONE_LOAD if narrow else 0.2,
            reversing=bool(rng.uniform() < 0.3) and not narrow,
        )
        soc = float(rng.uniform(0.75, 1.0))
        stated = (float(np.clip(soc + 0.01 * rng.standard_normal(), 0.0, 1.0)), 0.01)
        split = "check" if number == 2 else "fit"
        runs.append(Run(profile, soc, stated, split, f"{ambient:.0f} degC, {pattern}"))
    if "resistance_ageing" in effects:
        runs = [dataclasses.replace(r, parameters={"cycles": float(rng.choice([20, 150, 300]))}) for r in runs]
    return runs


def _one_of_two(rng, kind: str) -> tuple[str, dict[str, dict[str, Any]], str]:
    """Draw one of two effects that look alike: its group, it, and the other."""
    pair = CONFUSABLE[kind][int(rng.integers(len(CONFUSABLE[kind])))]
    name, rival = (str(each) for each in rng.permutation(pair))
    return "sensor" if EFFECTS[name].is_sensor else "single", {name: amplitude(rng, kind, name)}, rival


def _effects(rng, kind: str, group: str) -> dict[str, dict[str, Any]]:
    count = {"single": 1, "double": 2, "sensor": 1}.get(group, 0)
    drawn = rng.choice(names(kind, group == "sensor"), size=count, replace=False)
    return {str(name): amplitude(rng, kind, str(name)) for name in drawn}
