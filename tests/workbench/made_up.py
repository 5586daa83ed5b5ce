"""A small case whose truth is known, and a diagnosis of it put together by hand, to try pictures and reports on."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd

from discrepancy.failure import Failure, Shift
from discrepancy.ladder import ChannelError, Estimate, Rung
from discrepancy.noise import NoiseModel
from discrepancy.result import Diagnosis, NamedEffect, ScoreEntry
from discrepancy.where import Regressor, map_over_two, split_excess
from discrepancy.whiteness import floor_ratio, ljung_box
from jaxmodel.cases import Case, Known, read_case
from workbench.runs import simulate_case

ROWS = 61
CASE = """title = "Small cell <bench> & load"
kind = "cell"
preset = "paper"

[parameters]
capacity_Ah = { value = 3.0, sd = 0.03 }
series_resistance_scale = { value = 1.0, sd = 0.1 }
storage_months = 0

[sensors]
voltage_V = 0.001
cell_temperature_degC = 0.05
"""
RUN = """
[[runs]]
file = "{name}.csv"
split = "{split}"
label = "{label}"
initial_soc = {{ value = 0.95, sd = 0.01 }}
"""
TRUTH = {"self_heating": {"C_th": 80.0, "hA": 0.1}}
RUNS = {"run-01": ("fit", 3.0, "3 A, 10 degC"), "run-02": ("fit", 6.0, "6 A pulses"), "run-03": ("check", 9.0, "9 A")}


def write_case(folder: Path, effects: dict[str, dict[str, float]] | None = None) -> Path:
    """Write a case whose measurements are the model's own with hidden effects and noise; return its folder."""
    folder.mkdir(parents=True, exist_ok=True)
    text = CASE + "".join(RUN.format(name=n, split=s, label=label) for n, (s, _, label) in RUNS.items())
    (folder / "case.toml").write_text(text, encoding="utf-8")
    time = np.linspace(0.0, 600.0, ROWS)
    for number, (name, (_, current, _)) in enumerate(RUNS.items()):
        pulses = np.where((time // 60.0) % 2 == 0, current, 0.5 * current) if number == 1 else np.full(ROWS, current)
        inputs = {"time_s": time, "current_A": pulses, "ambient_degC": np.full(ROWS, 10.0 + 5.0 * number)}
        blank = {"voltage_V": np.full(ROWS, 3.7), "cell_temperature_degC": np.full(ROWS, 20.0)}
        pd.DataFrame(inputs | blank).to_csv(folder / f"{name}.csv", index=False)
    truth = dataclasses.replace(read_case(folder), effects=TRUTH if effects is None else effects)
    rng = np.random.default_rng(1)
    for outcome in simulate_case(truth):
        file = folder / f"{outcome.run.name}.csv"
        table = pd.read_csv(file)
        for column, sd in truth.sensors.items():
            table[column] = np.round(outcome.table[column] + sd * rng.standard_normal(ROWS), 4)
        table.to_csv(file, index=False)
    return folder


def diagnosis_of(case: Case) -> Diagnosis:
    """Return a diagnosis of a case with self-heating, with errors computed from real predictions."""
    fitted = {name: Known(known.value * 1.01, known.sd) for name, known in case.parameters.items() if known.sd}
    calibrated = dataclasses.replace(case, parameters=case.parameters | fitted)
    heating = dataclasses.replace(calibrated, effects=case.effects | {"self_heating": {"C_th": 82.0, "hA": 0.11}})
    both = dataclasses.replace(heating, effects=heating.effects | {"arrhenius_resistance": {"E_a": 9000.0}})
    base = {n: Estimate(k.value, 0.3 * k.sd, "A h" if "Ah" in n else "") for n, k in fitted.items() if k.sd}
    base |= {f"initial_soc[{run.name}]": Estimate(run.initial_soc.value, 0.001, "") for run in case.runs}
    of_heating = {"C_th": Estimate(82.0, 3.0, "J/K"), "hA": Estimate(0.11, 0.01, "W/K")}
    of_arrhenius = {"E_a": Estimate(9000.0, 700.0, "J/mol")}
    with_heating = base | {f"self_heating.{n}": e for n, e in of_heating.items()}
    full = with_heating | {f"arrhenius_resistance.{n}": e for n, e in of_arrhenius.items()}
    return Diagnosis(
        case=case,
        verdict="missing_effect",
        effects=(
            NamedEffect("self_heating", "self_heating", "", 0.97, of_heating, ()),
            NamedEffect("arrhenius_resistance", "arrhenius_resistance", "", 0.81, of_arrhenius, ("charge_transfer",)),
        ),
        candidates=(
            ("self_heating+arrhenius_resistance", 0.79),
            ("self_heating+charge_transfer", 0.14),
            ("something_else", 0.06),
            ("base", 0.01),
        ),
        unexplained=None,
        blind_to=("self_discharge", "clock_shift"),
        noise={c: NoiseModel(sd, 0.0, f"stated ({sd:g})", 1e-4) for c, sd in case.sensors.items() if c != "current_A"},
        ladder=(
            _rung("nominal", (), case, {}, ()),
            _rung("calibrated", (), calibrated, base, ("series_resistance_scale",)),
            _rung("with self_heating", ("self_heating",), heating, with_heating, ()),
            _rung("with arrhenius_resistance", ("self_heating", "arrhenius_resistance"), both, full, ()),
        ),
        scores=(
            ScoreEntry("self_heating", 2310.0, True, False, "series_resistance_scale"),
            ScoreEntry("arrhenius_resistance", -141.0, True, False, "series_resistance_scale"),
            ScoreEntry("charge_transfer", -128.0, True, False, "series_resistance_scale"),
            ScoreEntry("voltage_offset:voltage_V", 4.1, True, False, "initial_soc[run-01]"),
            ScoreEntry("ocv_hysteresis", -1.8, False, False, "capacity_Ah"),
            ScoreEntry("clock_shift", 0.4, False, True, "capacity_Ah"),
            ScoreEntry("self_discharge", 0.02, False, True, "capacity_Ah"),
        ),
        critical_z=3.12,
        failure=_failure(),
        remarks=("The temperature sensor rounds to 0.0001 degC.",),
    )


def _failure() -> Failure:
    """Two channels that fail at 9 A, in two runs."""
    rng = np.random.default_rng(2)
    values = {"current_A": rng.uniform(0.0, 9.0, 400), "soc": rng.uniform(0.2, 1.0, 400), "run": np.arange(400) // 200}
    w = rng.standard_normal(400) + 3.0 * (values["current_A"] > 6.0)
    regressors = [Regressor(name, "", of_rows.astype(float)) for name, of_rows in values.items()]
    pair = {("current_A", "soc"): map_over_two(w, regressors[0], regressors[1], np.arange(400) // 10)}
    cells = split_excess(w, regressors, np.arange(400) // 10)
    names = ("run-01", "run-02")
    wanted, sd = dict(zip(names, (1.1, 0.9), strict=True)), dict.fromkeys(names, 0.01)
    return Failure(
        floor={name: floor_ratio(w) for name in ("voltage_V", "cell_temperature_degC")},
        cells={"voltage_V": cells, "cell_temperature_degC": cells},
        maps={"voltage_V": pair, "cell_temperature_degC": pair},
        sentences=("62 % of the excess error is in 9 % of the samples: current above 6 A and time above 480 s",),
        shifts=(Shift("series_resistance_scale", 1.0, wanted, sd, 200.0, 1e-40, ""),),
        shift_share=0.7,
        memory=ljung_box({"voltage_V in run-01": w}),
        excess=float(np.sum(w**2 - 1.0)),
    )


def _rung(name, added, case, estimates, at_bound) -> Rung:
    outcomes = simulate_case(case)
    channels = [name for name in case.sensors if name != "current_A"]
    errors = {}
    for channel in channels:
        by_split = {"fit": [], "check": []}
        for o in outcomes:
            by_split[o.run.split].append(o.run.measured.outputs[channel] - o.table[channel].to_numpy())
        rms = {split: float(np.sqrt(np.nanmean(np.concatenate(r) ** 2))) for split, r in by_split.items() if r}
        errors[channel] = ChannelError(rms.get("fit", np.nan), rms.get("check", np.nan))
    predictions = {o.run.name: {c: o.table[c].to_numpy() for c in channels} for o in outcomes}
    readings = sum(o.run.measured.time_s.size for o in outcomes) * len(channels)
    return Rung(name, added, estimates, at_bound, errors, predictions, 1234.5, readings)
