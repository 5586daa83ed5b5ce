"""`jaxmodel estimate`: filters for the state of charge, tuned on a case's fit runs and judged on its check runs."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxmodel.build import case_model
from jaxmodel.case import Case
from jaxmodel.cases import read_case
from jaxmodel.errors import MeasurementError
from jaxmodel.measurements import file_label, read_utf8
from jaxmodel.model import Model
from operation.cheap import Cheap, cheap_of
from operation.estimate import Measured, Tuning, rms
from operation.judge import (
    CONVERGED_S,
    UNAWARE_DEGC,
    Entry,
    cheap_ones,
    entries,
    filters,
    tuned,
    tuned_cheap,
)
from plots.operation import estimate_errors, estimates
from plots.style import png
from workbench import terminal
from workbench.article import Picture, Section, Table, write_article
from workbench.commands.start import start

TARGET = 0.02
AWARE, UNAWARE = "filter, knows the temperature", "filter, 25 °C always"
CHEAP, CHEAP_UNAWARE = "cheap, knows the temperature", "cheap, 25 °C always"
COUNTED = "counting alone"
ESTIMATORS = (AWARE, UNAWARE, CHEAP, CHEAP_UNAWARE, COUNTED)
CHEAP_DEGC = (-20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
BATCH, BATCH_ROWS = 4096, 200
MOST_DRAWN = 8


def estimate(path: Path, out: Path, count: int, tuning_path: Path | None, *, pictures: bool = True) -> None:
    """Write `report.html`, `tuning.json`, `errors.csv` and pictures to `out`.

    Args:
        path: a case of kind "cell" whose runs have `voltage_V` and a reference `soc`; "fit" runs tune, "check" judge.
        out: the folder.
        count: tunings to try.
        tuning_path: a `tuning.json` of before: nothing is tuned.
        pictures: False writes neither pictures nor a page.

    Raises:
        UserError: the case cannot be used.
    """
    began = time.perf_counter()
    case = read_case(path)
    fit, check = ([run for run in case.runs if run.split == split] for split in ("fit", "check"))
    if case.kind != "cell" or not fit or not check:
        raise MeasurementError(f"{path}: estimate needs a case of kind cell with runs of both splits, fit and check.")
    model = case_model(case)
    start(out)
    with terminal.told("estimate") as progress:
        tunings = _read(tuning_path) if tuning_path else _tuned(model, fit, count, progress)
        (out / "tuning.json").write_text(json.dumps(tunings, indent=2) + "\n", encoding="utf-8")
        chosen = {name: Tuning(**values) for name, values in tunings.items()}
        cheap = {
            name: tuned_cheap(lambda blend, d=degC: cheap_of(model, np.array(d), blend), entries(fit, aware=aware))
            for name, degC, aware in ((CHEAP, CHEAP_DEGC, True), (CHEAP_UNAWARE, (UNAWARE_DEGC,), False))
        }
        rows, drawn = _judged(model, check, chosen, cheap, progress)
        progress("timing")
        cost = cost_per_step(model, chosen[AWARE], cheap[CHEAP], entries(check[:1], aware=True)[0].measured)
    table = pd.DataFrame(rows)
    table.to_csv(out / "errors.csv", index=False, float_format="%.5g")
    sections = [_error_section(table, drawn), _consistency_section(table), _how_section(case, chosen, cheap, cost)]
    lines = _findings(table, cost)
    write_article(
        out,
        f"State of charge: {case.title}",
        f"Tuned on {len(fit)} runs, judged on {len(check)} others; made in {time.perf_counter() - began:.0f} s",
        lines,
        sections,
        case.files,
        pictures=pictures,
    )
    shown = next(part for part in sections[0].parts if isinstance(part, Table))
    terminal.table("RMS error after convergence [%]", shown.head, shown.rows, right=range(1, len(shown.head)))
    for line in lines:
        terminal.say(f"- {line}")
    terminal.say(f"{'report.html, ' if pictures else ''}tuning.json and errors.csv are in {out}.")


def _read(path: Path) -> dict[str, dict[str, float]]:
    """Return the tunings of a run before.

    Raises:
        MeasurementError: the file is not there, or not one of these.
    """
    text = read_utf8(path)
    try:
        found = json.loads(text)
        fields = {field.name for field in dataclasses.fields(Tuning)}
        whole = found.keys() == {AWARE, UNAWARE} and all(found[name].keys() == fields for name in found)
    except (json.JSONDecodeError, AttributeError):
        whole = False
    if not whole:
        raise MeasurementError(f"{file_label(path)} is no tuning.json of `jaxmodel estimate`; name one that it wrote.")
    return found


def _tuned(model: Model, fit, count: int, progress) -> dict[str, dict[str, float]]:
    found = {}
    for name, aware in ((AWARE, True), (UNAWARE, False)):
        tuning, _ = tuned(model, entries(fit, aware=aware), count, lambda run, n=name: progress(f"tuning: {n}, {run}"))
        found[name] = {field: float(value) for field, value in vars(tuning).items()}
    return found


def _judged(
    model: Model, check, chosen: Mapping[str, Tuning], cheap: Mapping[str, Cheap], progress
) -> tuple[list[dict[str, Any]], dict[str, dict[str, np.ndarray]]]:
    """Return a row for each run, start and estimator, and what is drawn: each run from 20 % too low."""
    rows: list[dict[str, Any]] = []
    drawn: dict[str, dict[str, np.ndarray]] = {}
    for aware, names in ((True, (AWARE, CHEAP, COUNTED)), (False, (UNAWARE, CHEAP_UNAWARE))):
        for entry in entries(check, aware=aware):
            progress(f"judging: {'with' if aware else 'without'} the temperature, {entry.name}")
            for name in names:
                told: dict[str, np.ndarray] = {}
                if name in chosen:
                    one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], chosen[name])
                    track = jax.tree.map(
                        lambda x: np.asarray(x)[0], filters(model, one, entry.measured, entry.starts, entry.pairs_sd_V)
                    )
                    soc, told = track.soc, {"nis": track.nis, "sd": track.sd, "scale": track.scale}
                elif name in cheap:
                    soc = np.asarray(cheap_ones(cheap[name], entry.measured, entry.starts))
                else:
                    soc = entry.soc + np.array(entry.offsets)[:, None]
                rows += [_row(entry, name, place, soc, told) for place in range(len(entry.offsets))]
                if entry.rested:
                    label = drawn.setdefault(entry.name, {"time_s": entry.time_s, "soc": entry.soc})
                    label[name] = soc[1][: entry.soc.size]
    return rows, drawn


def _row(entry: Entry, name: str, place: int, soc: np.ndarray, told: Mapping[str, np.ndarray]) -> dict[str, Any]:
    off = np.abs(entry.late(soc[place]) - entry.late(entry.soc))
    return {
        "run": entry.name,
        "from": "start" if entry.rested else f"{entry.soc[0]:.1f}",
        "offset": entry.offsets[place],
        "estimator": name,
        "rms": float(entry.errors(soc[place])),
        "largest": float(off.max()),
        "to_5_percent_s": entry.convergence_s(soc[place]),
        "nis": float(np.nanmean(entry.late(told["nis"][place]))) if told else np.nan,
        "within_2_sd": float(np.mean(off < 2.0 * entry.late(told["sd"][place]))) if told else np.nan,
        "scale": float(np.median(entry.late(told["scale"][place]))) if told else np.nan,
    }


def cost_per_step(model: Model, tuning: Tuning, cheap: Cheap, measured: Measured) -> dict[str, float]:
    """Return seconds per step and estimator, alone and in a batch, compiled beforehand."""
    part = jax.tree.map(lambda x: x[:BATCH_ROWS], measured)
    one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], tuning)
    many = jnp.linspace(0.5, 1.0, BATCH)
    alone, rested = jnp.asarray([1.0]), jnp.zeros(())
    found = {}
    for name, call, lanes, rows in (
        ("filter, alone", lambda: filters(model, one, measured, alone, rested), 1, measured.time_s.size),
        ("filter, batch", lambda: filters(model, one, part, many, rested), BATCH, BATCH_ROWS),
        ("cheap, alone", lambda: cheap_ones(cheap, measured, alone), 1, measured.time_s.size),
        ("cheap, batch", lambda: cheap_ones(cheap, part, many), BATCH, BATCH_ROWS),
    ):
        jax.block_until_ready(call())
        began = time.perf_counter()
        jax.block_until_ready(call())
        found[name] = (time.perf_counter() - began) / (lanes * rows)
    return found


def _percent(value: float) -> str:
    return f"{100.0 * value:.2f}"


def _worst(table: pd.DataFrame, run: str, estimator: str, of: str) -> float:
    there = (table["from"] == "start") == (of == "start")
    picked = table[(table.run == run) & (table.estimator == estimator) & there]
    return float(picked.rms.max()) if len(picked) else float("nan")


def _error_section(table: pd.DataFrame, drawn: Mapping[str, Mapping[str, np.ndarray]]) -> Section:
    runs = list(dict.fromkeys(table.run))
    rows = []
    for run in runs:
        rows.append(
            (
                run,
                *(_percent(_worst(table, run, name, "start")) for name in ESTIMATORS),
                *(_percent(_worst(table, run, name, "under way")) for name in (AWARE, UNAWARE)),
            )
        )
    head = ("run held out", *ESTIMATORS, f"under way: {AWARE}", f"under way: {UNAWARE}")
    errors = {name: np.array([_worst(table, run, name, "start") for run in runs]) for name in ESTIMATORS}
    return Section(
        "Errors on runs that tuned nothing",
        [
            f"RMS error of the state of charge in percent, after the first {CONVERGED_S / 60:.0f} minutes; the worse "
            "of a right start and one 20 % too low. Under way: entered at 80 and 60 % charge, in the midst of driving, "
            "20 % too low and too high, the worst of these.",
            Table("errors-by-run", head, rows),
            Picture(
                "errors", png(estimate_errors(runs, errors, TARGET)), "RMS errors, entered at the start of the run."
            ),
            Picture(
                "courses",
                png(
                    estimates(
                        {
                            run: {name: values for name, values in columns.items() if name != COUNTED}
                            for run, columns in list(drawn.items())[:MOST_DRAWN]
                        }
                    )
                ),
                "Charge as counted by the tester, and estimates told 20 % too little at the start.",
            ),
        ],
    )


def _consistency_section(table: pd.DataFrame) -> Section:
    rows = []
    for run in dict.fromkeys(table.run):
        row = [run]
        for name in (AWARE, UNAWARE):
            picked = table[(table.run == run) & (table.estimator == name)]
            off = picked[(picked.offset != 0.0) & (picked["from"] == "start")]
            seconds = float(np.max(np.asarray(off["to_5_percent_s"])))
            row += [
                f"{picked.nis.mean():.2f}",
                f"{100 * picked.within_2_sd.mean():.0f}",
                f"{seconds:.0f}" if np.isfinite(seconds) else "never",
                f"{picked.scale.median():.2f}",
            ]
        rows.append(row)
    short = {AWARE: "with temperature", UNAWARE: "25 °C"}
    head = ["run held out"]
    for name in (AWARE, UNAWARE):
        head += [f"{what}, {short[name]}" for what in ("NIS", "within 2 sd [%]", "to 5 % [s]", "scale of R")]
    return Section(
        "Consistency and convergence",
        [
            "NIS: innovation squared by the variance that the filter gave it; 1 on average if it believes the right "
            "thing of a reading, below 1 if it is too careful. Within 2 sd: how often the reference lies there, 95 % "
            "if it believes the right thing of the charge. The scale of resistance is what the filter came to believe.",
            Table("consistency", head, rows),
        ],
    )


def _how_section(
    case: Case, chosen: Mapping[str, Tuning], cheap: Mapping[str, Cheap], cost: Mapping[str, float]
) -> Section:
    fields = list(vars(Tuning()))
    rows = [(name, *(f"{float(getattr(tuning, field)):.3g}" for field in fields)) for name, tuning in chosen.items()]
    polynomial = cheap[CHEAP]
    return Section(
        "How",
        [
            "The filter's states are the charge, two RC voltages, the logarithm of a scale on all resistances and an "
            "offset of the open-circuit voltage; its process and reading are the model's own step, its Jacobians "
            "jax.jacfwd of them. It was tuned on the runs called fit, by the least RMS error over all entries of "
            "each, and on nothing else; for the filter that knows no temperature anew, in the same way. Fit: "
            + ", ".join(run.name for run in case.runs if run.split == "fit") + ".",
            Table("tuning", ("filter", *fields), rows),
            f"The cheap estimator: a polynomial of order {len(polynomial.soc_of_volts) - 1} from open-circuit voltage "
            f"to charge (off by up to {100 * polynomial.worst_fit:.1f} % by itself), a resistance by temperature, one "
            f"lag of {polynomial.lag_s:.0f} s, blended with the count over {polynomial.blend_s:.0f} s "
            f"({cheap[CHEAP_UNAWARE].blend_s:.0f} s without the temperature).",
            Table(
                "cost",
                ("cost of a step", "µs"),
                [(name, f"{1e6 * seconds:.3f}") for name, seconds in cost.items()],
            ),
            f"A batch is {BATCH} estimators at once.",
        ],
    )  # fmt: skip


def _findings(table: pd.DataFrame, cost: Mapping[str, float]) -> list[str]:
    lines = []
    for name in ESTIMATORS:
        start_runs = table[(table.estimator == name) & (table["from"] == "start")].groupby("run").rms.max()
        within = int((start_runs <= TARGET).sum())
        lines.append(
            f"{name}: {within} of {len(start_runs)} runs within {100 * TARGET:g} %, worst "
            f"{100 * start_runs.max():.1f} % ({start_runs.idxmax()}), all together "
            f"{100 * rms(start_runs.to_numpy()):.1f} %."
        )
    lines.append(
        f"A step of the filter costs {1e6 * cost['filter, alone']:.0f} µs alone and {1e6 * cost['filter, batch']:.2f} "
        f"µs in a batch of {BATCH}; of the cheap one {1e6 * cost['cheap, alone']:.2f} and "
        f"{1e6 * cost['cheap, batch']:.4f} µs."
    )
    return lines


__all__: Sequence[str] = ("cost_per_step", "estimate")
