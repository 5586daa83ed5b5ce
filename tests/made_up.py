"""A small case whose truth is known, and a diagnosis of it put together by hand, to try pictures and reports on."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.remark import Remark
from jaxmodel.case.known import Known
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.diagnosis.result import (
    ChannelError,
    CurveFound,
    Diagnosis,
    Estimate,
    Extrapolated,
    Immaterial,
    NamedEffect,
    Remaining,
    Removed,
    RunFound,
    Rung,
    ScoreEntry,
    Sensor,
    ToleranceUsed,
)
from jaxmodel.diagnosis.wording import is_law
from jaxmodel.effects.curves import MEDIUM

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

[tolerance]
voltage_V = { rms = 0.01, max = 0.03 }
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
CHANNELS = ("voltage_V", "cell_temperature_degC")
TAKEN = {"voltage_V": Removed(0.0123, 0.0101), "cell_temperature_degC": Removed(1.92, float("nan"))}


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


def ocv_curve(stated: bool = True) -> CurveFound:
    """Return an open-circuit voltage that is 12 mV too low about the middle, badly known where no run has been."""
    at = np.array(MEDIUM)
    value = 0.012 * np.exp(-(((at - 0.6) / 0.15) ** 2))
    sd = np.where(at > 0.3, 0.0012, 0.019)
    return CurveFound("ocv_curve", "open_circuit_voltage", "soc", at, value, sd, "V", TAKEN, stated)


def factor_curve(label: str, at: np.ndarray, over: str = "soc") -> CurveFound:
    """Return a resistance or capacitance that is off by up to a third."""
    port = label.removesuffix("_curve")
    value = 0.3 * np.sin(2.0 * np.linspace(0.0, np.pi, at.size))
    return CurveFound(label, port, over, at, value, np.full(at.size, 0.04), "", TAKEN, True)


def law() -> CurveFound:
    """Return a law in no catalogue."""
    at = np.linspace(0.0, 9.0, 9)
    return CurveFound(
        "overpotential(current_A)", "overpotential", "current_A", at, 0.001 * at**2, np.full(9, 0.002), "V", {}, False
    )


def contact(run: str = "run-02") -> RunFound:
    """Return a contact that is 11 mohm worse in one run."""
    return RunFound(
        f"contact_resistance@{run}", run, f"{run}.csv", "series_resistance_ohm", 0.0112, 0.0008, "ohm", TAKEN
    )


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
    ladder = (
        _rung("nominal", (), case, {}, ()),
        _rung("calibrated", (), calibrated, base, ("series_resistance_scale",)),
        _rung("with self_heating", ("self_heating",), heating, with_heating, ()),
        _rung(
            "with self_heating + arrhenius_resistance",
            ("self_heating", "arrhenius_resistance"),
            both,
            full,
            ("series_resistance_scale",),
        ),
    )
    return Diagnosis(
        case=case,
        verdict="missing_effect",
        effects=(
            NamedEffect("self_heating", "self_heating", "", 0.97, of_heating, (), TAKEN),
            NamedEffect(
                "arrhenius_resistance",
                "arrhenius_resistance",
                "",
                0.81,
                of_arrhenius,
                ("charge_transfer",),
                {},
                "run-02",
            ),
        ),
        candidates=(
            ("self_heating+arrhenius_resistance", 0.79),
            ("self_heating+charge_transfer", 0.14),
            ("something_else", 0.06),
            ("base", 0.01),
        ),
        unexplained=None,
        blind_to=("self_discharge", "clock_shift"),
        noise={c: Sensor(case.sensors[c], 0.0, f"stated ({case.sensors[c]:g})", 1e-4) for c in CHANNELS},
        ladder=ladder,
        scores=(
            ScoreEntry("self_heating", 2310.0, True, False),
            ScoreEntry("arrhenius_resistance", -141.0, True, False),
            ScoreEntry("charge_transfer", -128.0, True, False),
            ScoreEntry("voltage_offset:voltage_V", 4.1, True, False),
            ScoreEntry("ocv_hysteresis", -1.8, False, False),
            ScoreEntry("clock_shift", 0.4, False, True),
            ScoreEntry("self_discharge", 0.02, False, True),
        ),
        critical_z=3.12,
        remarks=(
            Remark("The temperature sensor scatters by 0.0001.", "noise_not_stated", "cell_temperature_degC", sd=1e-4),
        ),
        immaterial=(
            Immaterial("slow_diffusion", {}, "slow_diffusion: the fitted runs show it, and no run left out is better"),
        ),
        remaining={
            "voltage_V": Remaining(
                0.0011, 120.0, ("above SOC 0.9: 4, 7, 14 mV below the model, growing with current",)
            ),
            "cell_temperature_degC": Remaining(0.06, 0.0, ()),
        },
        extrapolated=(Extrapolated("run-03.csv", "current_A", (3.0, 6.0), (9.0, 9.0)),),
        tolerance={
            "voltage_V": ToleranceUsed(0.01, 0.03, False),
            "cell_temperature_degC": ToleranceUsed(1.0, None, True),
        },
        fit_for_purpose={"voltage_V": {"run-03": False}, "cell_temperature_degC": {"run-03": True}},
        where_base={
            "voltage_V": ("runs at 6 A lie 24 mV above the model, growing with time",),
            "cell_temperature_degC": ("the thermometer rises by 8 K where the model stays at ambient",),
        },
        errors=errors_of(case, {"base": ladder[1], "final": ladder[-1]}),
    )


def errors_of(case: Case, models: dict[str, Rung]) -> pd.DataFrame:
    """Return the errors by run as a diagnosis has them."""
    rows = []
    for model, rung in models.items():
        for run in case.runs:
            for channel in CHANNELS:
                error = run.measured.outputs[channel] - rung.predictions[run.name][channel]
                rms, noise = float(np.sqrt(np.mean(error**2))), case.sensors[channel]
                tolerance = case.tolerance[channel].rms if channel in case.tolerance else np.nan
                rows.append(
                    {
                        "model": model,
                        "run": run.name,
                        "split": run.split,
                        "channel": channel,
                        "unit": "V" if channel == "voltage_V" else "K",
                        "readings": error.size,
                        "rms": rms,
                        "mean": float(error.mean()),
                        "max": float(np.abs(error).max()),
                        "noise_sd": noise,
                        "rms_over_noise": rms / noise,
                        "tolerance": tolerance,
                        "within_tolerance": rms <= tolerance if np.isfinite(tolerance) else None,
                    }
                )
    return pd.DataFrame(rows)


def with_additions(
    diagnosis: Diagnosis,
    *,
    estimates: dict[str, Estimate] | None = None,
    curves: tuple[CurveFound, ...] = (),
    runs: tuple[RunFound, ...] = (),
) -> Diagnosis:
    """Return a diagnosis whose final model holds more: numbers, curves or laws, and what single runs have."""
    final = diagnosis.final
    laws = tuple(curve for curve in curves if is_law(curve.label))
    labels = (*final.added, *(law.label for law in laws), *(run.label for run in runs))
    final = dataclasses.replace(final, added=labels, estimates=final.estimates | (estimates or {}))
    return dataclasses.replace(
        diagnosis,
        ladder=(*diagnosis.ladder[:-1], final),
        curves=curves,
        runs=runs,
        corrections=tuple(curve for curve in curves if not is_law(curve.label)),
    )


def _rung(name, added, case, estimates, at_bound) -> Rung:
    outcomes = simulate_case(case)
    errors = {}
    for channel in CHANNELS:
        by_split = {"fit": [], "check": []}
        for o in outcomes:
            by_split[o.run.split].append(o.run.measured.outputs[channel] - o.table[channel].to_numpy())
        together = {split: np.concatenate(r) for split, r in by_split.items() if r}
        rms = {split: float(np.sqrt(np.nanmean(r**2))) for split, r in together.items()}
        worst = float(np.nanmax(np.abs(together["check"]))) if "check" in together else np.nan
        errors[channel] = ChannelError(
            rms.get("fit", np.nan), rms.get("check", np.nan), rms.get("check", np.nan), worst
        )
    predictions = {o.run.name: {c: o.table[c].to_numpy() for c in CHANNELS} for o in outcomes}
    readings = sum(o.run.measured.time_s.size for o in outcomes) * len(CHANNELS)
    return Rung(name, added, estimates, at_bound, errors, predictions, 1234.5, readings)
