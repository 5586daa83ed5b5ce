"""Made measurements in the layout of a case folder: simulated truth, noise, rounding, and what the user would state."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.independent.effects import Columns, Effects, reported_inputs
from benchmarks.independent.integrate import simulate

INPUTS = (
    "current_A",
    "voltage_V",
    "duty",
    "V_set",
    "load_torque_Nm",
    "incline_deg",
    "acceleration_m_s2",
    "ambient_degC",
)
Stated = float | tuple[float, float] | Mapping[str, Any]


@dataclasses.dataclass(frozen=True)
class Run:
    """One run of a case: what was done, and what its user says of it.

    Attributes:
        profile: time_s and the inputs that really acted.
        initial_soc: the true state of charge at row 0.
        stated_soc: (value, sd) that the case states; None states the truth as known exactly.
        split: "fit" or "check".
        label: free text.
        parameters: parameters of this run in place of the case's, exact (`cycles`).
        hidden: parameters of this run in place of the case's, not stated anywhere.
    """

    profile: Columns
    initial_soc: float = 1.0
    stated_soc: tuple[float, float] | None = None
    split: str = "fit"
    label: str = ""
    parameters: Mapping[str, float] = dataclasses.field(default_factory=dict)
    hidden: Mapping[str, float] = dataclasses.field(default_factory=dict)


def write_case(
    folder: Path,
    kind: str,
    true_parameters: Mapping[str, Any],
    stated_parameters: Mapping[str, Stated],
    runs: Sequence[Run],
    *,
    effects: Effects | None = None,
    sensors: Mapping[str, float],
    seed: int = 0,
    quantisation: Mapping[str, float] | None = None,
    autocorrelation: Mapping[str, float] | None = None,
    unstated_sensors: Collection[str] = (),
    heavy_tails: Collection[str] = (),
    stated_sensors: Mapping[str, float] | None = None,
    accepted: Mapping[str, float] | None = None,
    readings: Sequence[Columns] | None = None,
    title: str = "Made measurement",
    tolerance: float = 1e-8,
) -> list[Columns]:
    """Write case.toml, one CSV per run and answer.toml (the truth); return each run's readings without noise.

    Args:
        folder: where to write; it is made if need be.
        kind: "cell", "motor" or "robot".
        true_parameters: what the hardware really is; tables under the names of the design.
        stated_parameters: a number known exactly, (value, sd), or a table.
        runs: the runs, in the order of their files.
        effects: hidden effects with their parameters; a sensor effect has its column.
        sensors: sd of the noise of every column that is measured; these outputs, and no others, are written.
        seed: of the noise.
        quantisation: the step of each column's last digit; the rest are written to ten digits.
        autocorrelation: AR(1) coefficient of a column's noise; its sd stays that of `sensors`.
        unstated_sensors: columns whose sd the case does not state.
        heavy_tails: columns whose noise is Student's t with 4 degrees of freedom, of the same sd.
        stated_sensors: stated sd in place of the true one.
        accepted: acceptable error of a column, stated under [tolerance].
        readings: of each run without noise, where they were simulated before.
        title: the case's title.
        tolerance: of the integration; far below any sensor.
    """
    effects, steps, rhos = effects or {}, quantisation or {}, autocorrelation or {}
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(seed)
    clean: list[Columns] = []
    for number, run in enumerate(runs, start=1):
        reported = reported_inputs(run.profile, effects)
        truth = {**true_parameters, **run.parameters, **run.hidden}
        if readings is None:
            clean.append(simulate(kind, truth, reported, effects, run.initial_soc, tolerance=tolerance))
        else:
            clean.append(readings[number - 1])
        columns = reported | {name: clean[-1][name] for name in sensors if name in clean[-1] and name not in reported}
        order = ["time_s", *(name for name in INPUTS if name in reported), *(n for n in columns if n not in reported)]
        text = {}
        for name in order:
            noise = _noise(rng, len(columns[name]), sensors.get(name, 0.0), rhos.get(name, 0.0), name in heavy_tails)
            text[name] = _rounded(columns[name] + noise, steps.get(name))
        pd.DataFrame(text).to_csv(folder / _file(number), index=False)
    stated = {name: sd for name, sd in {**sensors, **(stated_sensors or {})}.items() if name not in unstated_sensors}
    (folder / "case.toml").write_text(_case_toml(title, kind, stated_parameters, runs, stated, accepted or {}))
    (folder / "answer.toml").write_text(_answer_toml(kind, true_parameters, effects, runs))
    return clean


def _noise(rng: np.random.Generator, rows: int, sd: float, rho: float, heavy: bool = False) -> np.ndarray:
    """Return stationary AR(1) noise of the given standard deviation; white where rho is 0."""
    noise = (rng.standard_t(4, rows) / np.sqrt(2.0) if heavy else rng.standard_normal(rows)) * sd
    if rho != 0.0:
        for row in range(1, rows):
            noise[row] = rho * noise[row - 1] + np.sqrt(1.0 - rho**2) * noise[row]
    return noise


def _rounded(values: np.ndarray, step: float | None) -> list[str]:
    """Return the values as a logger would write them, to the nearest multiple of `step`."""
    if step is None:
        return [f"{value:.10g}" for value in values]
    digits = max(0, int(np.ceil(-np.log10(step) - 1e-9)))
    return [f"{value:.{digits}f}" for value in np.round(values / step) * step]


def _file(number: int) -> str:
    return f"run-{number:02d}.csv"


def _case_toml(
    title: str,
    kind: str,
    stated: Mapping[str, Stated],
    runs: Sequence[Run],
    sensors: Mapping[str, float],
    accepted: Mapping[str, float],
) -> str:
    lines = [f"title = {in_toml(title)}", f"kind = {in_toml(kind)}", 'preset = "paper"', "", "[parameters]"]
    lines += [f"{name} = {in_toml(value)}" for name, value in stated.items()]
    lines += ["", "[sensors]", *(f"{name} = {in_toml(sd)}" for name, sd in sensors.items())]
    if accepted:
        lines += ["", "[tolerance]", *(f"{name} = {in_toml(limit)}" for name, limit in accepted.items())]
    for number, run in enumerate(runs, start=1):
        lines += ["", "[[runs]]", f"file = {in_toml(_file(number))}", f"split = {in_toml(run.split)}"]
        lines += [f"label = {in_toml(run.label)}"]
        if kind != "motor":
            lines += [f"initial_soc = {in_toml(run.stated_soc or run.initial_soc)}"]
        lines += [f"{name} = {in_toml(value)}" for name, value in run.parameters.items()]
    return "\n".join(lines) + "\n"


def _answer_toml(kind: str, true_parameters: Mapping[str, Any], effects: Effects, runs: Sequence[Run]) -> str:
    lines = [f"kind = {in_toml(kind)}", f"effects = {in_toml(list(effects))}"]
    if kind != "motor":
        lines += [f"true_initial_soc = {in_toml([run.initial_soc for run in runs])}"]
    lines += ["", "[effect_parameters]", *(f"{name} = {in_toml(values)}" for name, values in effects.items())]
    lines += ["", "[true_parameters]", *(f"{name} = {in_toml(value)}" for name, value in true_parameters.items())]
    return "\n".join(lines) + "\n"


def in_toml(value: Any) -> str:
    """Return a value as TOML: a pair is a value and its standard deviation."""
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, tuple):
        return f"{{ value = {in_toml(value[0])}, sd = {in_toml(value[1])} }}"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {in_toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | np.ndarray):
        return "[" + ", ".join(in_toml(item) for item in value) + "]"
    return repr(int(value) if isinstance(value, int | np.integer) else float(value))
