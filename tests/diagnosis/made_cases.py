"""Cells from the independent simulator: runs at four temperatures, stated parameters that are wrong, hidden effects.

All cases have the same layout, so that they share compiled programs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.independent import Run as Drive
from benchmarks.independent import make_profile, simulate, write_case
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.case.measurements import Measured
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.space import ModelSpace
from jaxmodel.model.simulation import simulate as simulated

NOISE_V = 0.002
TRUE = {"capacity_Ah": 2.05, "series_resistance_scale": 1.09, "rc_resistance_scale": 0.93, "storage_months": 0}
STATED = {
    "capacity_Ah": (2.0, 0.05),
    "series_resistance_scale": (1.0, 0.1),
    "rc_resistance_scale": (1.0, 0.1),
    "storage_months": 0,
}
# Temperature, pattern of the load, whether it also charges, true state of charge, by how much it is misstated, split.
RUNS = (
    (0.0, "pulse train", True, 0.95, 0.008, "fit"),
    (20.0, "varying load", True, 0.75, -0.012, "fit"),
    (40.0, "load steps", False, 0.80, 0.005, "fit"),
    (10.0, "varying load", False, 0.85, -0.007, "check"),
)
SOC_SD = 0.01


@dataclasses.dataclass(frozen=True)
class MadeCell:
    """A case, and the noise that was really added to each run's voltage."""

    case: Case
    noise_V: dict[str, np.ndarray]

    def noise_rms(self, split: str) -> float:
        """The RMS that a perfect model would be left with."""
        noise = [self.noise_V[run.name] for run in self.case.runs if run.split == split]
        return float(np.sqrt(np.mean(np.concatenate(noise) ** 2)))


def drives() -> list[Drive]:
    """What was done to the cell: 401 readings a run, three seconds apart, at up to 6 A."""
    made = []
    for number, (ambient, pattern, reversing, soc, off, split) in enumerate(RUNS, start=1):
        profile = make_profile(
            "cell",
            pattern,
            number,
            duration_s=1200.0,
            step_s=3.0,
            ambient_degC=ambient,
            largest_drive=6.0,
            reversing=reversing,
        )
        made.append(Drive(profile, initial_soc=soc, stated_soc=(soc + off, SOC_SD), split=split))
    return made


def made_cell(folder: Path, effects: Mapping[str, Mapping[str, Any]], seed: int = 0, **options: Any) -> MadeCell:
    """Write and read a cell with hidden effects; `options` are those of the independent simulator's `write_case`."""
    options = {"sensors": {"voltage_V": NOISE_V}} | options
    clean = write_case(folder, "cell", TRUE, STATED, drives(), effects=effects, seed=seed, **options)
    case = read_case(folder)
    noise = {
        run.name: run.measured.outputs["voltage_V"] - truth["voltage_V"]
        for run, truth in zip(case.runs, clean, strict=True)
    }
    return MadeCell(case, noise)


def made_cell_with_unknown_law(folder: Path, ohm_per_soc: float, seed: int = 0) -> MadeCell:
    """Write and read a cell whose resistance grows below half charge, as under no effect of the catalogue.

    Its drop is subtracted from the simulated voltages: in a cell driven by current there is no feedback.
    """
    made = made_cell(folder, {}, seed)
    for run, drive in zip(made.case.runs, drives(), strict=True):
        soc = simulate("cell", TRUE, drive.profile, {}, drive.initial_soc)["soc"]
        table = pd.read_csv(run.source)
        table["voltage_V"] -= table["current_A"] * ohm_per_soc * np.maximum(0.5 - soc, 0.0)
        table.to_csv(run.source, index=False)
    return MadeCell(read_case(folder), made.noise_V)


def all_but(case: Case, *kept: str) -> list[str]:
    """Return everything that could be missing from a case, but for some names: ruled out, they need not be compiled."""
    return [one.label for one in ModelSpace(case).candidates.values() if not {one.label, one.name} & set(kept)]


def cache_of(case: Case, *kept: str) -> FitCache:
    """Return the models of a case in which only these candidates could be missing."""
    return FitCache(case, without=all_but(case, *kept))


def investigation_of(case: Case, *kept: str) -> Investigation:
    """Return an investigation in which these candidates alone could be missing."""
    return Investigation(case, without=all_but(case, *kept))


def run_of(
    number: int,
    inputs: Mapping[str, np.ndarray],
    outputs: Mapping[str, np.ndarray],
    *,
    initial_soc: Known = Known(0.9, 0.01),  # noqa: B008  (frozen)
    step_s: float = 3.0,
    split: str = "fit",
    **overrides: Known,
) -> Run:
    """A run in memory, its rows a constant step apart."""
    rows = len(next(iter(inputs.values())))
    name = f"run-{number:02d}"
    measured = Measured(step_s * np.arange(rows), dict(inputs), dict(outputs))
    return Run(name, f"{name}.csv", split, "", initial_soc, overrides, measured, Path(f"{name}.csv"))


def case_of(
    kind: str, parameters: Mapping[str, Known], runs: list[Run], sensors: Mapping[str, float] | None = None
) -> Case:
    """A case in memory."""
    return Case(
        name="small",
        path=Path("small/case.toml"),
        title="small",
        kind=kind,
        preset="paper",
        parameters=dict(parameters),
        tables={},
        effects={},
        sensors=dict(sensors or {}),
        runs=tuple(runs),
        cutoff={},
    )


SMALL_TRUE = {"capacity_Ah": 2.03, "series_resistance_scale": 1.05}
SMALL_NOISE = {"voltage_V": 0.002, "cell_temperature_degC": 0.05}
# What could be missing from a small cell in these tests: of every group some.
SMALL_KEPT = (
    "self_heating",
    "arrhenius_resistance",
    "ocv_hysteresis",
    "voltage_offset",
    "ocv_curve",
    "series_resistance_curve",
    "contact_resistance@run-01",
    "contact_resistance@run-02",
    "overpotential(current_A)",
    "overpotential(soc) x current_A",
)


def small_cell(
    effects: Mapping[str, Mapping[str, Any]] | None = None,
    seed: int = 0,
    rows: int = 150,
    creeping: tuple[float, float] = (0.0, 1.0),
) -> Case:
    """Return a cell of two fit runs and a check run, simulated with some effects hidden and noise added.

    All are of one layout, and share the programs of a process. Loads are held for ten rows, or go up and down between
    by so many amperes, once in 2 pi times so many rows.
    """
    stated = {"capacity_Ah": Known(2.0, 0.05), "series_resistance_scale": Known(1.0, 0.1), "cycles": Known(200.0)}
    truth = stated | {name: Known(value) for name, value in SMALL_TRUE.items()}
    rng, runs = np.random.default_rng(seed), []
    for number, (ambient, soc, off, split) in enumerate(
        ((15.0, 0.95, 0.008, "fit"), (30.0, 0.8, -0.006, "fit"), (22.0, 0.9, 0.004, "check"))
    ):
        load = np.random.default_rng(100 + number).uniform(-1.5, 4.0, -(-rows // 10))
        creep = creeping[0] * np.sin(np.arange(rows) / creeping[1])
        inputs = {"current_A": np.repeat(load, 10)[:rows] + creep, "ambient_degC": np.full(rows, ambient)}
        empty = {name: np.zeros(rows) for name in SMALL_NOISE}
        true = run_of(number + 1, inputs, empty, initial_soc=Known(soc), step_s=10.0)
        known = case_of("cell", truth, [true])
        hidden = dataclasses.replace(known, effects={name: dict(values) for name, values in (effects or {}).items()})
        found = simulated(case_model(hidden, true), run_profile(true)).readings
        outputs = {name: np.asarray(found[name]) + sd * rng.standard_normal(rows) for name, sd in SMALL_NOISE.items()}
        runs.append(run_of(number + 1, inputs, outputs, initial_soc=Known(soc + off, SOC_SD), step_s=10.0, split=split))
    return case_of("cell", stated, runs, SMALL_NOISE)
