"""Cases nearer to a bench, drawn from a seed: several effects at once, tables, runs and numbers that are off."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.discrepancy.hidden import Blind, Drawn
from benchmarks.discrepancy.ranges import (
    CONFUSABLE,
    EFFECTS,
    KNOWN_TO,
    NOISE,
    TEMPERATURES,
    column_of,
    hardware,
    names,
    strong,
)
from benchmarks.discrepancy.tables import stated_table, true_tables
from benchmarks.independent.integrate import simulate
from benchmarks.independent.make_case import Run
from benchmarks.independent.profiles import make_profile

BENCH_FROM = 5000
GROUPS = {
    "several": 0.28,
    "table": 0.2,
    "run": 0.12,
    "noise": 0.12,
    "prior": 0.14,
    "extrapolation": 0.07,
    "immaterial": 0.07,
}
KINDS = {"cell": 0.6, "motor": 0.25, "robot": 0.15}
HOW_MANY = {3: 0.5, 4: 0.35, 5: 0.15}
WITH_FAULT = 0.4
# What the effects beside a wrong table are drawn from: others can hardly be told from it.
BESIDE_A_TABLE = ("self_heating", "arrhenius_resistance", "slow_diffusion", "charge_transfer")
NOISE_RATIOS = (0.2, 5.0)
OFF_BY_SD = (4.0, 6.0)
# How far beyond their usual range effects go that no usual range foretells.
BELOW_USUAL, ABOVE_USUAL = 1.0 / 3.0, 2.0
# In runs warmer than this an effect of the cold does not act at all.
COLD_DEGC = 10.0
# The error that a user can live with, by the end of a column's name, where it is stated; a share of it is immaterial.
ACCEPTED = {"pack_voltage_V": 0.06, "voltage_V": 0.01, "_A": 0.3, "_rad_s": 5.0, "_degC": 1.0}
IMMATERIAL_SHARE = (0.04, 0.09)
# Numbers of an effect on whose size its reach rests in proportion.
PROPORTIONAL = ("E_a", "a", "M_V", "dU_dT", "R_3", "V_b", "b_T", "e", "psi_k", "b", "c", "R_on")
ROWS, STEP_S = 1200, {"cell": 2.5, "motor": 1.5, "robot": 1.5}
TOLERANCE = 1e-7


def draw_bench(seed: int) -> Drawn:
    """Return what a seed says of a case."""
    rng = np.random.default_rng([9, seed])
    group = str(rng.choice(list(GROUPS), p=list(GROUPS.values())))
    kind = "cell" if group == "table" else str(rng.choice(list(KINDS), p=list(KINDS.values())))
    effects = _effects(rng, kind, group)
    stated, true = hardware(rng, kind)
    sensors = {name: float(np.exp(rng.uniform(*np.log(span)))) for name, span in NOISE[kind].items()}
    thermometers = {"cell_temperature_degC"} if "self_heating" in effects else set()
    if rng.uniform() < 0.5 or "temperature_lag" in effects:
        thermometers.add(TEMPERATURES[kind])
    sensors |= {column: float(rng.uniform(0.05, 0.3)) for column in sorted(thermometers)}
    runs = _runs(rng, kind, true, effects, warm=group in ("run", "extrapolation"))
    options: dict[str, Any] = {}
    if rng.uniform() < 0.5:
        options["quantisation"] = {name: 10.0 ** np.floor(np.log10(sd)) for name, sd in sensors.items()}
    blind = Blind(kind, group, effects, "", False)
    drawn = Drawn(blind, stated, true, sensors, runs, 1.0, options)
    return {
        "table": _wrong_table,
        "run": _bad_run,
        "noise": _wrong_noise,
        "prior": _far_number,
        "extrapolation": _only_in_the_cold,
        "immaterial": _accepted,
    }.get(group, lambda rng, drawn: drawn)(rng, drawn)


def _effects(rng: np.random.Generator, kind: str, group: str) -> dict[str, dict[str, Any]]:
    if group == "several":
        count = int(rng.choice(list(HOW_MANY), p=list(HOW_MANY.values())))
        fault = rng.uniform() < WITH_FAULT
        chosen = _together(rng, kind, count, fault)
        return {name: strong(rng, kind, name) for name in chosen}
    if group == "table":
        count = int(rng.choice([0, 1, 2], p=[0.4, 0.35, 0.25]))
        chosen = [str(name) for name in rng.choice(BESIDE_A_TABLE, size=count, replace=False)]
        return {name: strong(rng, kind, name) for name in chosen}
    physics = [name for name in names(kind, sensor=False) if name != "resistance_ageing"]
    if group == "noise":
        chosen = [str(rng.choice(physics))] if rng.uniform() < 0.6 else []
        return {name: strong(rng, kind, name) for name in chosen}
    if group == "prior" and rng.uniform() < 0.5:
        count = int(rng.integers(1, 3))
        return {name: _beyond_usual(rng, kind, name) for name in _together(rng, kind, count, fault=False)}
    if group == "immaterial":
        small = [name for name in physics if next(iter(EFFECTS[name].ranges)) in PROPORTIONAL]
        name = str(rng.choice(small))
        return {name: strong(rng, kind, name)}
    return {}


def _together(rng: np.random.Generator, kind: str, count: int, fault: bool) -> list[str]:
    """Draw effects of which no two can stand in for each other, the last of them a sensor's fault if so wanted."""
    physics, faults = names(kind, sensor=False), names(kind, sensor=True)
    alike = {frozenset(pair) for pairs in CONFUSABLE.values() for pair in pairs}
    while True:
        chosen = [str(name) for name in rng.choice(physics, size=count - fault, replace=False)]
        if fault:
            chosen.append(str(rng.choice(faults)))
        if any(pair <= set(chosen) for pair in alike):
            continue
        # A thermometer of a cell that has no temperature of its own reads the ambient, late or not.
        if kind == "cell" and "temperature_lag" in chosen and "self_heating" not in chosen:
            continue
        return chosen


def _beyond_usual(rng: np.random.Generator, kind: str, name: str) -> dict[str, Any]:
    """Draw an effect's first number log-uniform from a range wider than the usual one."""
    values = strong(rng, kind, name)
    first, (low, high) = next(iter(EFFECTS[name].ranges.items()))
    if name == "rate_capacity":  # its null is 1
        return values | {first: 1.0 + float(np.exp(rng.uniform(np.log(0.007), np.log(0.4))))}
    if low * high > 0.0:
        near, far = sorted((abs(low), abs(high)))
    else:
        near, far = 0.1 * high, high
    size = float(np.exp(rng.uniform(np.log(BELOW_USUAL * near), np.log(ABOVE_USUAL * far))))
    sign = float(np.sign(low)) if low * high > 0.0 else float(rng.choice([-1.0, 1.0]))
    limit = {"s": 1.0, "d": 0.5, "E_a": 6e4}.get(first, np.inf)
    return values | {first: sign * min(size, limit)}


def _runs(
    rng: np.random.Generator, kind: str, true: Mapping[str, float], effects: Mapping[str, Any], warm: bool
) -> list[Run]:
    """Draw four fit runs and a check run, each at a temperature of its own; some go both ways."""
    choices = [20.0, 22.0, 25.0, 28.0, 30.0] if warm else [-5.0, 0.0, 5.0, 10.0, 15.0, 25.0, 30.0, 40.0]
    ambients = [float(each) for each in rng.choice(choices, size=5, replace=False)]
    inner = sorted(ambients[:4])
    ambients[4] = float(np.round(rng.uniform(inner[1], inner[2])))  # within what was fitted
    patterns = ["load steps", "varying load", "pulse train", "rests with pulses"]
    order = [patterns[place] for place in rng.permutation(4)] + [str(rng.choice(patterns[:3]))]
    check = int(rng.integers(5))
    runs = []
    for number, (ambient, pattern) in enumerate(zip(ambients, order, strict=True)):
        reversing = bool(rng.uniform() < 0.5)
        profile = make_profile(
            kind,
            pattern,
            int(rng.integers(1_000_000)),
            duration_s=(ROWS - 1) * STEP_S[kind],
            step_s=STEP_S[kind],
            ambient_degC=ambient,
            largest_drive={"cell": 1.2 * true.get("capacity_Ah", 5.0), "motor": 14.0, "robot": 0.8}[kind],
            largest_load_Nm=0.15,
            reversing=reversing,
        )
        soc = float(rng.uniform(0.8, 1.0))
        if kind == "cell":
            soc, profile = _enough_charge(soc, profile, true["capacity_Ah"])
        stated = (float(np.round(np.clip(soc + 0.01 * rng.standard_normal(), 0.0, 1.0), 4)), 0.01)
        label = f"{ambient:.0f} degC, {pattern}{', both ways' if reversing else ''}"
        runs.append(Run(profile, soc, stated, "check" if number == 4 else "fit", label))
    runs.insert(check, runs.pop())
    if "resistance_ageing" in effects:
        cycles = rng.permutation([20, 80, 150, 300, 500])
        runs = [dataclasses.replace(r, parameters={"cycles": float(n)}) for r, n in zip(runs, cycles, strict=True)]
    return runs


def _enough_charge(soc: float, profile: dict[str, np.ndarray], capacity_Ah: float) -> tuple[float, dict]:
    """Return a start and a profile that leave a fifth of the charge: effects may count more than is taken."""
    taken = np.cumsum(np.append(0.0, profile["current_A"][1:] * np.diff(profile["time_s"]))) / (3600.0 * capacity_Ah)
    gentler = min(1.0, 0.75 / float(np.ptp(taken)))
    soc = float(np.clip(soc, gentler * taken.max() + 0.22, 1.0 + gentler * taken.min()))
    return soc, profile | {"current_A": np.round(gentler * profile["current_A"], 3)}


def _wrong_table(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """Let the case state tables, one of which is off."""
    wrong = str(rng.choice(["ocv", "R_ints"]))
    tables = true_tables(rng)
    given = ["ocv", "R_ints"] if rng.uniform() < 0.5 else [wrong]
    stated = {name: stated_table(rng, name, tables[name]) if name == wrong else tables[name] for name in given}
    true = {name: tables[name] for name in given}
    blind = dataclasses.replace(drawn.blind, beside={"table": wrong})
    return dataclasses.replace(drawn, blind=blind, stated={**drawn.stated, **stated}, true={**drawn.true, **true})


def _bad_run(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """Give one fit run a contact, a heat transfer or a friction of its own."""
    kind, true = drawn.blind.kind, drawn.true
    fitted = [number for number, run in enumerate(drawn.runs) if run.split == "fit"]
    number = int(rng.choice(fitted))
    parameter, factor = {
        "cell": ("contact_ohm", 1.0),
        "motor": (("R_ca", "tau_0")[int(rng.integers(2))], float(rng.uniform(1.3, 1.6))),
        "robot": (("series_resistance_scale", "tau_0")[int(rng.integers(2))], float(rng.uniform(1.3, 1.6))),
    }[kind]
    value = round(float(rng.uniform(0.006, 0.016)), 4) if kind == "cell" else factor * true[parameter]
    runs = list(drawn.runs)
    runs[number] = dataclasses.replace(runs[number], hidden={parameter: value})
    beside = {"run": f"run-{number + 1:02d}.csv", "parameter": parameter, "of_the_run": value}
    return dataclasses.replace(drawn, blind=dataclasses.replace(drawn.blind, beside=beside), runs=runs)


def _wrong_noise(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """Let the case state the noise of its first output far too small or too large."""
    ratio = float(rng.choice(NOISE_RATIOS))
    column = {"cell": "voltage_V", "motor": "speed_rad_s", "robot": "pack_voltage_V"}[drawn.blind.kind]
    told = {column: ratio * drawn.sensors[column]}
    blind = dataclasses.replace(drawn.blind, beside={"stated_over_true": [ratio], "stated_noise_sd": told})
    return dataclasses.replace(drawn, blind=blind, options={**drawn.options, "stated_sensors": told})


def _far_number(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """Put one number far from what is stated of it, where no effect is hidden that is far beyond its usual range."""
    if drawn.blind.effects:
        return drawn
    name = str(rng.choice(list(KNOWN_TO[drawn.blind.kind])))
    value, sd = drawn.stated[name]
    off = float(rng.uniform(*OFF_BY_SD))
    if rng.uniform() < 0.5 and off * sd < 0.6 * value:
        off = -off
    blind = dataclasses.replace(drawn.blind, beside={"parameter": name, "off_by_sd": round(off, 3)})
    accepted = _limits(drawn) if rng.uniform() < 0.5 else {}
    true = {**drawn.true, name: value + off * sd}
    return dataclasses.replace(drawn, blind=blind, true=true, options={**drawn.options, "accepted": accepted})


def _only_in_the_cold(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """Let the check run be far colder than all others, where something sets in."""
    kind, cold = drawn.blind.kind, float(rng.choice([-15.0, -10.0]))
    beside: dict[str, Any] = {"below_degC": COLD_DEGC}
    hidden: dict[str, float] = {}
    if kind != "motor":
        beside["E_a"] = round(float(rng.uniform(18e3, 30e3)), -2)
        factor = float(np.exp(beside["E_a"] / 8.314 * (1.0 / (cold + 273.15) - 1.0 / (COLD_DEGC + 273.15))))
        hidden |= {name: factor * drawn.true[name] for name in ("series_resistance_scale", "rc_resistance_scale")}
    if kind != "cell":
        beside["b_T"] = round(float(rng.uniform(0.03, 0.05)), 4)
        hidden["tau_0"] = drawn.true["tau_0"] * float(np.exp(beside["b_T"] * (COLD_DEGC - cold)))
    runs = []
    for run in drawn.runs:
        if run.split == "check":
            profile = run.profile | {"ambient_degC": np.full_like(run.profile["time_s"], cold)}
            label = f"{cold:.0f} degC, {run.label.partition(', ')[2]}"
            run = dataclasses.replace(run, profile=profile, hidden=hidden, label=label)
        runs.append(run)
    return dataclasses.replace(drawn, blind=dataclasses.replace(drawn.blind, beside=beside), runs=runs)


def _accepted(rng: np.random.Generator, drawn: Drawn) -> Drawn:
    """State what error the user can live with, beside good sensors; `fitting` makes the effect far smaller."""
    share, least = float(rng.uniform(*IMMATERIAL_SHARE)), NOISE[drawn.blind.kind]
    sensors = {name: float(np.sqrt(sd * least.get(name, (sd,))[0])) for name, sd in drawn.sensors.items()}
    drawn = dataclasses.replace(drawn, sensors=sensors, strength=share)
    return dataclasses.replace(drawn, options={**drawn.options, "accepted": _limits(drawn)})


def _limits(drawn: Drawn) -> dict[str, float]:
    """Return what error is accepted of each output: usual, and never below four times its noise."""
    limits = {}
    for name, sd in drawn.sensors.items():
        if name not in drawn.runs[0].profile:
            usual = next(limit for ending, limit in ACCEPTED.items() if name.endswith(ending))
            limits[name] = max(usual, float(f"{4.0 * sd:.1g}"))
    return limits


def fitting(drawn: Drawn) -> Drawn:
    """Return a case whose effect is immaterial with the effect as small as it is to be, by trying it once."""
    if drawn.blind.group != "immaterial":
        return drawn
    ((name, numbers),) = drawn.blind.effects.items()
    kind, limits = drawn.blind.kind, drawn.options["accepted"]
    worst = 0.0
    for run in drawn.runs:
        with_it, without = (
            simulate(
                kind, drawn.true | dict(run.parameters), run.profile, effects, run.initial_soc, tolerance=TOLERANCE
            )
            for effects in ({name: numbers}, {})
        )
        moved = [float(np.sqrt(np.mean((with_it[c] - without[c]) ** 2))) / limit for c, limit in limits.items()]
        worst = max(worst, *moved)
    if worst == 0.0:
        raise RuntimeError(f"no reading is moved by {name}")
    first = next(iter(EFFECTS[name].ranges))
    smaller = {**numbers, first: numbers[first] * drawn.strength / worst, **column_of(kind, name)}
    blind = dataclasses.replace(drawn.blind, effects={name: smaller})
    return dataclasses.replace(drawn, blind=blind)
