"""Blind cases: hardware, profiles, noise and hidden effect drawn from a seed, simulated by the independent referee."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.declaration import describe
from jaxmodel.effects import CATALOGUE
from tests.independent.effects import reported_inputs
from tests.independent.forms import OTHER_FORMS
from tests.independent.integrate import DEFAULTS, simulate
from tests.independent.make_case import Run, write_case
from tests.independent.profiles import make_profile

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
CONFUSABLE = {
    "cell": (
        ("entropic_ocv", "voltage_offset"),
        ("self_discharge", "current_offset"),
        ("ocv_hysteresis", "charge_transfer"),
    ),
    "motor": (
        ("windage", "viscous_friction"),
        ("brush_drop", "voltage_offset"),
        ("magnet_temperature", "friction_temperature"),
    ),
    "robot": (
        ("windage", "viscous_friction"),
        ("brush_drop", "bridge_resistance"),
        ("ocv_hysteresis", "charge_transfer"),
    ),
}
NEARLY_ONE_LOAD = 0.8
# Of the referee; far below any sensor.
TOLERANCE = 1e-7
PATTERNS = ("load steps", "varying load", "pulse train", "rests with pulses", "constant load")

# What a user knows of the hardware, as a share of the value; the truth is drawn from it.
KNOWN_TO = {
    "cell": {
        "capacity_Ah": 0.03,
        "series_resistance_scale": 0.15,
        "rc_resistance_scale": 0.15,
        "rc_capacitance_scale": 0.15,
    },
    "motor": {
        "R_0": 0.03,
        "k_tau": 0.025,
        "tau_0": 0.15,
        "R_wc": 0.12,
        "R_ca": 0.12,
        "tau_wc": 0.12,
        "tau_ca": 0.12,
    },
    "robot": {
        "capacity_Ah": 0.03,
        "series_resistance_scale": 0.15,
        "rc_resistance_scale": 0.15,
        "R_0": 0.03,
        "k_tau": 0.025,
        "tau_0": 0.15,
        "R_wc": 0.12,
        "R_ca": 0.12,
        "onboard_current_A": 0.1,
    },
}
# Noise of each sensor as (smallest, largest) sd; which temperatures are measured is drawn.
NOISE = {
    "cell": {"voltage_V": (5e-4, 4e-3), "current_A": (2e-3, 0.02)},
    "motor": {"current_A": (0.01, 0.05), "speed_rad_s": (0.2, 1.0), "winding_temperature_degC": (0.1, 0.4)},
    "robot": {
        "pack_voltage_V": (5e-3, 0.03),
        "pack_current_A": (0.02, 0.1),
        "speed_rad_s": (0.2, 1.0),
        "winding_temperature_degC": (0.1, 0.4),
    },
}
TEMPERATURES = {"cell": "cell_temperature_degC", "motor": "case_temperature_degC", "robot": "case_temperature_degC"}


@dataclasses.dataclass(frozen=True)
class Blind:
    """What was hidden in a case.

    Attributes:
        kind: "cell", "motor" or "robot".
        group: a name of CLASSES.
        effects: the hidden effects of the catalogue with their parameters.
        outside: the name of a law outside the catalogue, or "".
        hostile: whether the noise of one sensor is coloured and unstated.
        moves: by how many sigma each effect moves all readings together, the other numbers as they truly are; an
            Arrhenius law in runs at its reference temperature moves none.
        heavy: the sensor with heavy-tailed noise, or "".
        decoy: the number that is far from what is stated, or "": it looks like an effect, and is none.
        rival: the effect that the one hidden can hardly be told from, or "".
    """

    kind: str
    group: str
    effects: dict[str, dict[str, Any]]
    outside: str
    hostile: bool
    moves: dict[str, float] = dataclasses.field(default_factory=dict)
    heavy: str = ""
    decoy: str = ""
    rival: str = ""

    @property
    def verdict(self) -> str:
        """Return the verdict that is right if the effect can be seen at all."""
        return {"null": "adequate", "sensor": "sensor_fault", "outside": "unknown_effect"}.get(
            self.group, "missing_effect"
        )


# Laws in no catalogue. Those of a cell act on the voltage, and nothing feeds back; those of a drive distort what truly
# acts on it, given what the bench reports.
def _low_soc_resistance(columns, strength):
    columns["voltage_V"] -= columns["current_A"] * 0.06 * strength * np.maximum(0.5 - columns["soc"], 0.0)


def _quadratic_resistance(columns, strength):
    columns["voltage_V"] -= 1.5e-3 * strength * columns["current_A"] * np.abs(columns["current_A"])


def _contact_that_loosens(columns, strength):
    columns["voltage_V"] -= columns["current_A"] * 0.01 * strength * (columns["time_s"] / 1800.0) ** 2


OUTSIDE_CELL: dict[str, Callable] = {
    "low_soc_resistance": _low_soc_resistance,
    "quadratic_resistance": _quadratic_resistance,
    "contact_that_loosens": _contact_that_loosens,
}
OUTSIDE_DRIVE: dict[str, Callable] = {
    "amplifier_that_saturates": lambda p, s, drive: p | {drive: p[drive] * (1.0 - 0.05 * s * _share(p[drive]))},
    "brake_that_fades": lambda p, s, drive: (
        p | {"load_torque_Nm": p["load_torque_Nm"] * (1.0 - 0.05 * s * p["time_s"] / 1800.0)}
    ),
    "torque_sensor_that_bends": lambda p, s, drive: (
        p | {"load_torque_Nm": p["load_torque_Nm"] * (1.0 + 0.1 * s * _share(p["load_torque_Nm"]) ** 2)}
    ),
}

# Where these laws act, in the words in which a diagnosis names an equation or a channel.
ACTS_ON = {
    **dict.fromkeys(OUTSIDE_CELL, ("acts on voltage_V",)),
    "amplifier_that_saturates": ("the armature voltage", "the duty"),
    "brake_that_fades": ("the torque balance",),
    "torque_sensor_that_bends": ("the torque balance",),
}


def _share(values):
    return np.abs(values) / max(1e-9, float(np.abs(values).max()))


@dataclasses.dataclass(frozen=True)
class Drawn:
    """All that a seed says of a case.

    Attributes:
        blind: what is hidden.
        stated: the numbers that the user knows, each with its sd.
        true: those numbers as they are.
        sensors: sd of the noise of each column that is measured.
        runs: the runs, with what truly acts in them.
        strength: of a law outside the catalogue.
        options: of the noise and of the logger's digits.
    """

    blind: Blind
    stated: dict[str, Any]
    true: dict[str, float]
    sensors: dict[str, float]
    runs: list[Run]
    strength: float
    options: dict[str, Any]


def draw(seed: int) -> Drawn:
    """Return what a seed says of a case."""
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
    stated, true = {}, {}
    for name, share in KNOWN_TO[kind].items():
        other_hardware = name in ("capacity_Ah", "R_0", "onboard_current_A")
        nominal = DEFAULTS[name] * (rng.uniform(0.6, 1.6) if other_hardware else 1.0)
        stated[name] = (nominal, share * nominal)
        true[name] = nominal * (1.0 + share * float(np.clip(rng.standard_normal(), -2.0, 2.0)))
    if kind != "motor":
        stated |= {"storage_months": 0.0, "cycles": 25.0}
        true |= {"storage_months": 0.0, "cycles": 25.0}
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
        RuntimeError: the referee cannot integrate it; its cell is discharged beyond empty, where no voltage means
            anything; or what is hidden moves no reading, as a law of temperature in runs at its reference.
    """
    drawn = draw(seed)
    moved = moves(drawn)
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
        _apply(folder, blind.kind, blind.outside, drawn.strength, clean, reported)
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


def _apply(folder: Path, kind: str, law: str, strength: float, clean: list, reported: list) -> None:
    """Put an unknown law of a cell on its voltages; for a drive put back the inputs that the bench reports."""
    for number, (truth, profile) in enumerate(zip(clean, reported, strict=True), start=1):
        path = folder / f"run-{number:02d}.csv"
        table = pd.read_csv(path)
        if kind == "cell":
            columns = {name: table[name].to_numpy().copy() for name in table} | {"soc": np.asarray(truth["soc"])}
            OUTSIDE_CELL[law](columns, strength)
            table["voltage_V"] = columns["voltage_V"]
        else:
            for name in profile:
                table[name] = profile[name]
        table.to_csv(path, index=False)


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
    return "sensor" if CATALOGUE[name].is_sensor else "single", {name: _amplitude(rng, kind, name)}, rival


def _effects(rng, kind: str, group: str) -> dict[str, dict[str, Any]]:
    count = {"single": 1, "double": 2, "sensor": 1}.get(group, 0)
    names = [n for n, e in CATALOGUE.items() if kind in e.kinds and e.is_sensor == (group == "sensor")]
    return {str(name): _amplitude(rng, kind, str(name)) for name in rng.choice(names, size=count, replace=False)}


def _amplitude(rng, kind: str, name: str) -> dict[str, Any]:
    """Draw an effect's parameters from their usual ranges, log-uniform."""
    values: dict[str, Any] = {}
    for parameter, info in describe(CATALOGUE[name]).items():
        if parameter == "resampled":
            continue  # the referee's logger always interpolates
        low, high = info.typical
        if low > 0.0:
            values[parameter] = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        else:
            values[parameter] = float(rng.choice([low, high]) * rng.uniform(0.3, 1.0))
    column = {
        "current_offset": {"cell": "current_A", "motor": "current_A", "robot": "pack_current_A"},
        "voltage_gain": {"cell": "voltage_V", "motor": "voltage_V", "robot": "pack_voltage_V"},
        "voltage_offset": {"cell": "voltage_V", "motor": "voltage_V", "robot": "pack_voltage_V"},
        "temperature_lag": TEMPERATURES,
    }
    if name in column:
        values["column"] = column[name][kind]
    return values
