"""Small cells with realistic measurements, for tests of the whole diagnosis, from the independent simulator.

One cell, driven in three fit runs at 10, 25 and 35 degC and a check run at 20 degC, seven hours of it in some 1,700
rows. What is hidden differs from case to case; simulated once is what several cases share.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.independent import Run, make_profile, simulate, write_case
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case

SOC = np.round(np.linspace(0.0, 1.0, 21), 2)
OCV = np.round(-1.031 * np.exp(-35.0 * SOC) + 3.685 + 0.2156 * SOC - 0.1178 * SOC**2 + 0.3201 * SOC**3, 4)
R_INTS = np.round(0.07 + 0.05 * np.exp(-8.0 * SOC), 5)
TRUE: dict[str, Any] = {
    "capacity_Ah": 2.04,
    "series_resistance_scale": 1.08,
    "rc_resistance_scale": 0.94,
    "rc_capacitance_scale": 1.06,
    "storage_months": 0,
    "ocv": {"soc": SOC.tolist(), "voltage_V": OCV.tolist()},
    "R_ints": {"soc": SOC.tolist(), "ohm": R_INTS.tolist()},
}
STATED: dict[str, Any] = TRUE | {
    "capacity_Ah": (2.0, 0.04),
    "series_resistance_scale": (1.0, 0.12),
    "rc_resistance_scale": (1.0, 0.12),
    "rc_capacitance_scale": (1.0, 0.15),
}
NOISE = {"voltage_V": 0.002, "cell_temperature_degC": 0.1}
# Of a current that is logged in steps of 20 mA.
COARSE_A = 0.02
# Temperature, pattern of the load, whether it also charges, true state of charge, by how much it is misstated, split.
RUNS = (
    (10.0, "pulse train", True, 0.95, 0.008, "fit"),
    (25.0, "load steps", False, 1.0, -0.006, "fit"),
    (35.0, "varying load", True, 0.9, 0.005, "fit"),
    (20.0, "varying load", False, 0.98, -0.007, "check"),
)
SOC_SD = 0.01
ROWS, STEP_S, LARGEST_A = 421, 6.0, 2.8

HEATING: dict[str, dict[str, Any]] = {
    "self_heating": {"C_th": 60.0, "hA": 0.1},
    "arrhenius_resistance": {"E_a": 15e3},
}
THREE = HEATING | {"ocv_hysteresis": {"M_V": 0.02, "g": 40.0}}
FOUR = HEATING | {
    "slow_diffusion": {"R_3": 0.03, "tau_3": 700.0},
    "current_offset": {"c": 0.06, "column": "current_A"},
}
DIFFUSION = {"slow_diffusion": FOUR["slow_diffusion"]}
ARRHENIUS = {"arrhenius_resistance": HEATING["arrhenius_resistance"]}
# What a table is off by, a bump about the middle that no start and no capacity makes up for.
BUMP = np.exp(-0.5 * ((SOC - 0.6) / 0.13) ** 2)
OCV_OFF_V = 0.02 * (BUMP - 0.3)
R_INTS_OFF = 0.35 * (BUMP - 0.3)
CONTACT_OHM, DRIFT_OHM_PER_H = 0.015, 0.02
# In the cold of a check run all resistances are this much larger; in no fit run.
COLD_DEGC, COLD_FACTOR = -10.0, 2.0
BAD_RUN = 1
STUCK_RUN, STUCK_FROM = 2, ROWS // 2


@dataclasses.dataclass(frozen=True)
class Made:
    """A case that was measured.

    Attributes:
        case: as its user brings it.
        effects: that are hidden.
        numbers: what the stated numbers truly are.
        tables: what the stated tables truly are.
        of_runs: by run, numbers of its own.
        drop_V: by run, what hidden contacts take off the voltage.
        clean: readings without noise, by run.
    """

    case: Case
    effects: dict[str, dict[str, Any]]
    numbers: dict[str, float]
    tables: dict[str, dict[str, Any]]
    of_runs: dict[str, dict[str, float]]
    drop_V: dict[str, np.ndarray]
    clean: dict[str, dict[str, np.ndarray]]

    @property
    def starts(self) -> list[float]:
        """The true states of charge at the starts of the runs."""
        return [soc for _, _, _, soc, _, _ in RUNS]


def drives(times: Sequence[np.ndarray | None] = (None,) * 4) -> list[Run]:
    """What was done to the cell, at even times or at those given."""
    made = []
    for number, ((ambient, pattern, reversing, soc, off, split), time_s) in enumerate(zip(RUNS, times, strict=True)):
        profile = make_profile(
            "cell",
            pattern,
            number + 1,
            duration_s=(ROWS - 1) * STEP_S,
            step_s=STEP_S,
            time_s=time_s,
            ambient_degC=ambient,
            largest_drive=LARGEST_A,
            reversing=reversing,
        )
        label = f"{ambient:.0f} degC, {pattern}"
        made.append(Run(profile, initial_soc=soc, stated_soc=(round(soc + off, 3), SOC_SD), split=split, label=label))
    return made


def uneven_times() -> list[np.ndarray]:
    """Times as loggers keep them: jittered, slower from the middle on, with two gaps, and jittered about 4 s."""
    rng = np.random.default_rng(11)
    jittered = np.append(0.0, STEP_S * np.arange(1, ROWS) + rng.uniform(-2.0, 2.0, ROWS - 1))
    mixed = np.cumsum(np.append(0.0, np.where(np.arange(ROWS - 1) < 280, 3.0, 12.0)))
    even = STEP_S * np.arange(ROWS)
    gaps = even[~((even > 600.0) & (even < 780.0)) & ~((even > 1500.0) & (even < 1740.0))]
    other = np.cumsum(np.append(0.0, rng.uniform(3.0, 5.0, ROWS - 1)))
    return [np.round(each, 2) for each in (jittered, mixed, gaps, other)]


@functools.cache
def _measured(which: str, uneven: bool = False) -> tuple[list[Run], list[dict[str, np.ndarray]]]:
    """Return the drives and what perfect sensors read of them, simulated once."""
    effects = {"none": {}, "three": THREE, "four": FOUR, "diffusion": DIFFUSION, "arrhenius": ARRHENIUS}[which]
    made = drives(uneven_times()) if uneven else drives()
    # `current_offset`: the profile is the true one, and the independent simulator is given the reported one.
    from benchmarks.independent.effects import reported_inputs

    read = [simulate("cell", TRUE, reported_inputs(r.profile, effects), effects, r.initial_soc) for r in made]
    return made, read


def make(
    folder: Path,
    which: str = "none",
    *,
    seed: int,
    stated: Mapping[str, Any] | None = None,
    stated_noise: Mapping[str, float] | None = None,
    contact_ohm: Mapping[int, float] | None = None,
    drift_ohm_per_h: float = 0.0,
    cold_check: bool = False,
    stuck: bool = False,
    uneven: bool = False,
) -> Made:
    """Write and read a case.

    Args:
        folder: where.
        which: hidden effects are there: "none", "three", "four", "diffusion", "arrhenius".
        seed: of the noise.
        stated: in place of what the user states otherwise.
        stated_noise: sd that the user states in place of the true ones.
        contact_ohm: in the leads, by place of the run.
        drift_ohm_per_h: that a contact gains while a run lasts.
        cold_check: whether the check run is at -10 degC, where all resistances are twice as large.
        stuck: whether the thermometer of one run stays where it is from its middle on.
        uneven: whether times are uneven, readings are missing and the current is logged coarsely.
    """
    runs, readings = _measured(which, uneven)
    if cold_check:
        hidden = {n: COLD_FACTOR * TRUE[n] for n in ("series_resistance_scale", "rc_resistance_scale")}
        profile = runs[3].profile | {"ambient_degC": np.full(ROWS, COLD_DEGC)}
        runs = [*runs[:3], dataclasses.replace(runs[3], profile=profile, hidden=hidden, label="-10 degC, varying load")]
        readings = [*readings[:3], simulate("cell", TRUE | hidden, profile, {}, runs[3].initial_soc)]
    drops = [
        run.profile["current_A"]
        * ((contact_ohm or {}).get(place, 0.0) + drift_ohm_per_h * run.profile["time_s"] / 3600.0)
        for place, run in enumerate(runs)
    ]
    readings = [each | {"voltage_V": each["voltage_V"] - drop} for each, drop in zip(readings, drops, strict=True)]
    effects = {"none": {}, "three": THREE, "four": FOUR, "diffusion": DIFFUSION, "arrhenius": ARRHENIUS}[which]
    heated = "self_heating" in effects
    write_case(
        folder,
        "cell",
        TRUE,
        {**STATED, **(stated or {})},
        runs,
        effects=effects,
        sensors={name: sd for name, sd in NOISE.items() if heated or name == "voltage_V"},
        stated_sensors={**(stated_noise or {}), **({"current_A": COARSE_A / np.sqrt(12.0)} if uneven else {})},
        quantisation={"current_A": COARSE_A} if uneven else {},
        seed=seed,
        readings=readings,
    )
    if stuck:
        _rewrite(folder, STUCK_RUN, lambda table: _stick(table))
    if uneven:
        for place in range(len(runs)):
            _rewrite(folder, place, lambda table, place=place: _lose(table, place))
    case = read_case(folder)
    names = [run.name for run in case.runs]
    return Made(
        case=case,
        effects={name: dict(numbers) for name, numbers in effects.items()},
        numbers={name: value for name, value in TRUE.items() if not isinstance(value, dict)},
        tables={name: value for name, value in TRUE.items() if isinstance(value, dict)},
        of_runs={name: dict(run.hidden) for name, run in zip(names, runs, strict=True)},
        drop_V=dict(zip(names, drops, strict=True)),
        clean=dict(zip(names, readings, strict=True)),
    )


def _rewrite(folder: Path, place: int, change) -> None:
    path = folder / f"run-{place + 1:02d}.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)


def _stick(table: pd.DataFrame) -> pd.DataFrame:
    """A thermometer stays at what it read."""
    column = "cell_temperature_degC"
    table.loc[STUCK_FROM:, column] = table.loc[STUCK_FROM, column]
    return table


def _lose(table: pd.DataFrame, place: int) -> pd.DataFrame:
    """One reading in twenty is missing, and the thermometer of a minute of each run."""
    rng = np.random.default_rng([13, place])
    for column in NOISE:
        table.loc[rng.uniform(size=len(table)) < 0.05, column] = np.nan
    table.loc[100:110, "cell_temperature_degC"] = np.nan
    return table
