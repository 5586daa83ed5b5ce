"""`jaxmodel estimate`: filters for the state of charge, tuned on a case's fit runs and scored on its check runs."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.app import terminal
from jaxmodel.app.article import Picture, Section, Table, write_article
from jaxmodel.app.commands.start import start
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.operation.evaluation import CONVERGED_S, rms
from jaxmodel.operation.kalman import Tuning
from jaxmodel.operation.state_of_charge import (
    BATCH,
    ESTIMATORS,
    FILTER,
    FILTER_FIXED,
    POLYNOMIAL,
    POLYNOMIAL_FIXED,
    Evaluation,
    cost_per_step,
    evaluate_estimators,
    read_tunings,
)
from jaxmodel.plots.operation import estimate_errors, estimates
from jaxmodel.plots.style import png

TARGET = 0.02


def estimate(path: Path, out: Path, count: int, tuning_path: Path | None, *, pictures: bool = True) -> None:
    """Write `report.html`, `tuning.json`, `errors.csv` and pictures to `out`.

    Args:
        path: a case of kind "cell" whose runs have `voltage_V` and a reference `soc`; estimators are tuned on the runs
            of split "fit" and scored on those of split "check".
        out: the folder.
        count: tunings to try.
        tuning_path: a `tuning.json` of an earlier evaluation: nothing is tuned.
        pictures: False writes neither pictures nor a page.

    Raises:
        UserError: the case cannot be used.
    """
    began = time.perf_counter()
    case = read_case(path)
    tunings = read_tunings(tuning_path) if tuning_path else None
    start(out)
    with terminal.stages("estimate") as progress:
        found = evaluate_estimators(case, count=count, tunings=tunings, progress=progress)
        found.write_tunings(out / "tuning.json")
        progress("timing")
        cost = cost_per_step(case, found)
    table = found.errors
    write_whole(out / "errors.csv", table.to_csv(index=False, float_format="%.5g"))
    sections = [_error_section(found), _consistency_section(table), _how_section(case, found, cost)]
    splits = [run.split for run in case.runs]
    lines = _findings(found, cost)
    write_article(
        out,
        f"State of charge: {case.title}",
        f"Tuned on {splits.count('fit')} runs, scored on {splits.count('check')} others; "
        f"made in {time.perf_counter() - began:.0f} s",
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


def _percent(value: float) -> str:
    return f"{100.0 * value:.2f}"


def _error_section(found: Evaluation) -> Section:
    from_start, under_load = found.worst_errors(), found.worst_errors(from_start=False)
    rows = [
        (
            str(run),
            *(_percent(from_start.loc[run, name]) for name in ESTIMATORS),
            *(_percent(under_load.loc[run, name]) for name in (FILTER, FILTER_FIXED)),
        )
        for run in from_start.index
    ]
    head = ("check run", *ESTIMATORS, f"under load: {FILTER}", f"under load: {FILTER_FIXED}")
    return Section(
        "Errors on runs that tuned nothing",
        [
            f"RMS error of the state of charge in percent, after the first {CONVERGED_S / 60:.0f} minutes; the worse "
            "of a correct start and one 20 % too low. Under load: started at 80 and 60 % charge while driving, "
            "20 % too low and too high, the worst of these.",
            Table("errors-by-run", head, rows),
            Picture("errors", png(estimate_errors(found, TARGET)), "RMS errors, started with the run."),
            Picture(
                "estimates",
                png(estimates(found)),
                "State of charge as counted by the tester, and estimates from a start 20 % too low.",
            ),
        ],
    )


def _consistency_section(table: pd.DataFrame) -> Section:
    rows = []
    for run in dict.fromkeys(table.run):
        row = [run]
        for name in (FILTER, FILTER_FIXED):
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
    short = {FILTER: "with temperature", FILTER_FIXED: "25 °C"}
    head = ["check run"]
    for name in (FILTER, FILTER_FIXED):
        head += [f"{what}, {short[name]}" for what in ("NIS", "within 2 sd [%]", "to 5 % [s]", "scale of R")]
    return Section(
        "Consistency and convergence",
        [
            "NIS: the innovation squared by its variance in the filter; 1 on average if the filter's variance of a "
            "reading is right, below 1 if it is too large. Within 2 sd: how often the reference lies within two of the "
            "filter's standard deviations, 95 % if its variance of the state of charge is right. The scale of "
            "resistance is the filter's estimate.",
            Table("consistency", head, rows),
        ],
    )


def _how_section(case: Case, found: Evaluation, cost: Mapping[str, float]) -> Section:
    fields = list(vars(Tuning()))
    rows = [(name, *(f"{float(getattr(one, field)):.3g}" for field in fields)) for name, one in found.tunings.items()]
    polynomial = found.polynomials[POLYNOMIAL]
    return Section(
        "How",
        [
            "The filter's states are the charge, two RC voltages, the logarithm of a scale on all resistances and an "
            "offset of the open-circuit voltage; its process and reading are the model's own step, its Jacobians "
            "jax.jacfwd of them. It was tuned on the runs of split fit alone, by the least RMS error over all their "
            "trials; the filter without the temperature was tuned in the same way. Fit: "
            + ", ".join(run.name for run in case.runs if run.split == "fit") + ".",
            Table("tuning", ("filter", *fields), rows),
            f"The polynomial estimator: order {len(polynomial.soc_of_volts) - 1} from open-circuit voltage "
            f"to state of charge (largest error {100 * polynomial.worst_fit:.1f} %), a resistance by temperature, one "
            f"lag of {polynomial.lag_s:.0f} s, blended with the count over {polynomial.blend_s:.0f} s "
            f"({found.polynomials[POLYNOMIAL_FIXED].blend_s:.0f} s without the temperature).",
            Table(
                "cost",
                ("cost of a step", "µs"),
                [(name, f"{1e6 * seconds:.3f}") for name, seconds in cost.items()],
            ),
            f"A batch is {BATCH} estimators at once.",
        ],
    )  # fmt: skip


def _findings(found: Evaluation, cost: Mapping[str, float]) -> list[str]:
    lines = []
    for name, errors in found.worst_errors().items():
        within = int((errors <= TARGET).sum())
        lines.append(
            f"{name}: {within} of {len(errors)} runs within {100 * TARGET:g} %, worst "
            f"{100 * errors.max():.1f} % ({errors.idxmax()}), all runs {100 * rms(errors.to_numpy()):.1f} % RMS."
        )
    lines.append(
        f"A step of the filter costs {1e6 * cost['filter, alone']:.0f} µs alone and {1e6 * cost['filter, batch']:.2f} "
        f"µs in a batch of {BATCH}; of the polynomial {1e6 * cost['polynomial, alone']:.2f} and "
        f"{1e6 * cost['polynomial, batch']:.4f} µs."
    )
    return lines
