"""`jaxmodel estimate`: filters for the state of charge, tuned on a case's fit runs and scored on its check runs."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jaxmodel.app import terminal
from jaxmodel.app.article import Picture, Section, Table, write_article
from jaxmodel.app.commands.start import start
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.specimens import in_words
from jaxmodel.operation.evaluation import CONVERGED_S, rms
from jaxmodel.operation.kalman import Tuning
from jaxmodel.operation.pack import cells_of_pack
from jaxmodel.operation.state_of_charge import (
    BATCH,
    ESTIMATORS,
    FILTER,
    FILTER_FIXED,
    POLYNOMIAL,
    POLYNOMIAL_FIXED,
    SIGMA_POINTS,
    TARGET,
    Evaluation,
    cost_per_step,
    evaluate_estimators,
    read_tunings,
)
from jaxmodel.plots.operation import estimate_errors, estimates
from jaxmodel.plots.style import png


def estimate(path: Path, out: Path, count: int, tuning_path: Path | None, *, pictures: bool = True) -> None:
    """Write `report.html`, `tuning.json`, `errors.csv` and pictures to `out`; of cells of a pack, `cells.csv`.

    Args:
        path: a case of kind "cell" whose runs have `voltage_V` and a reference `soc`; estimators are tuned on the runs
            of split "fit" and scored on those of split "check". Or one whose runs are of several cells, without `soc`:
            then the charge of each is estimated.
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
    if len(case.specimens) > 1 and not any("soc" in run.measured.outputs for run in case.runs):
        _write_cells(case, tunings, out, pictures=pictures)
        return
    with terminal.stages("estimate") as progress:
        found = evaluate_estimators(case, count=count, tunings=tunings, progress=progress)
        found.write_tunings(out / "tuning.json")
        progress("timing")
        cost = cost_per_step(case, found)
    table = found.errors
    write_whole(out / "errors.csv", table.to_csv(index=False, float_format="%.5g"))
    sections = [_error_section(found), _consistency_section(found), _how_section(case, found, cost)]
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


def _write_cells(case: Case, tunings: Mapping[str, Tuning] | None, out: Path, *, pictures: bool) -> None:
    """Write the charge of each cell of a pack, and say which is the weakest."""
    found = cells_of_pack(case, tunings[FILTER] if tunings else None)
    write_whole(out / "cells.csv", found.to_dataframe().to_csv(index=False, float_format="%.5g"))
    rows = [
        (
            in_words("cell", cell.specimen),
            f"{cell.left_Ah:.3g} ± {cell.left_sd_Ah:.2g}",
            f"{100 * cell.soc:.1f} ± {100 * cell.sd:.1f}",
            f"{cell.capacity:.2f} ± {cell.capacity_sd:.2f}",
            cell.run,
        )
        for cell in found.cells
    ]
    head = ("cell", "charge left [A h]", "state of charge [%]", "capacity, of the stated", "at the end of")
    lines = [found.summary()]
    if not tunings:
        lines.append(
            "The bands are those of an untuned filter; --tuning takes the tuning.json of a cell of this kind whose "
            "charge was measured."
        )
    words = [
        "Cells in series lose the same charge: the pack is empty with the cell that has the least left. ± is one sd. A "
        "cell with more resistance has less voltage under load, and is not weaker for that."
    ]
    sections = [Section("Charge of each cell", [*words, Table("cells", head, rows)])]
    title = f"State of charge: {case.title}"
    write_article(out, title, f"{len(rows)} cells", lines, sections, case.files, pictures=pictures)
    terminal.table("Charge of each cell", head, rows, right=range(1, 4))
    for line in lines:
        terminal.say(f"- {line}")
    terminal.say(f"{'report.html and cells.csv are' if pictures else 'cells.csv is'} in {out}.")


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
            "of a correct start and one 30 % too low. Under load: started at 80 and 60 % charge while driving, "
            "30 % too low and too high (full at most), the worst of these.",
            Table("errors-by-run", head, rows),
            Picture("errors", png(estimate_errors(found, TARGET)), "RMS errors, started with the run."),
            Picture(
                "estimates",
                png(estimates(found)),
                "State of charge as counted by the tester, and estimates from a start 30 % too low. Shaded: two "
                "standard deviations of the filter.",
            ),
        ],
    )


def _consistency_section(found: Evaluation) -> Section:
    table, bands = found.errors, found.bands().set_index(["run", "estimator"])
    rows = []
    for run in dict.fromkeys(table.run):
        row = [str(run)]
        for name in (FILTER, SIGMA_POINTS, FILTER_FIXED):
            picked = table[(table.run == run) & (table.estimator == name)]
            off = picked[(picked.offset != 0.0) & (picked["from"] == "start")]
            seconds, band = float(np.max(np.asarray(off["to_5_percent_s"]))), bands.loc[(run, name)]
            row += [
                _percent(float(band["sd"])),
                f"{100 * picked.within_2_sd.mean():.0f}",
                f"{picked.nis.mean():.2f}, {band['verdict']}",
                f"{seconds:.0f}" if np.isfinite(seconds) else "never",
                f"{picked.capacity.median():.2f}",
                "yes" if band["honest"] else "no",
            ]
        rows.append(row)
    short = {FILTER: "filter", SIGMA_POINTS: "sigma points", FILTER_FIXED: "25 °C"}
    whats = ("sd [%]", "within 2 sd [%]", "NIS", "to 5 % [s]", "capacity", "band says so")
    head = ["check run", *(f"{what}, {name}" for name in short.values() for what in whats)]
    return Section(
        "Consistency and convergence",
        [
            "sd: the band of the filter (RMS). Within 2 sd: how often the reference lies within two of these, 95 % "
            "if the band is right. NIS: the innovation squared by its variance in the filter; 1 on average if the "
            "filter's variance of a reading is right. A filter is overconfident, consistent or cautious where the "
            "mean is above, in or below the interval that holds it in 95 % of runs if the variance is right. "
            "Capacity: the filter's scale of it at the end. The band says so: from the start of the run the error "
            "is within 2 %, or the reference is within two sd in 95 % of the time.",
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
            "The filter's states are those of the model (charge, two RC voltages, hysteresis where it has one), the"
            " logarithm of a scale on all resistances, three errors of the voltage (of the run, of a part of the "
            "charge, passing), the scale of the capacity and an offset of the current; its process and reading are "
            "the model's own step, its Jacobians jax.jacfwd of them. It was tuned on the runs of split fit alone, "
            "by the logarithmic score of charge and band over all their trials; the filter without the temperature "
            "was tuned in the same way. The sigma-point filter (cubature, square root) has the tuning of the first."
            " Fit: "
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
    for name, bands in found.bands().groupby("estimator", sort=False):
        lines.append(f"{name}: in {int(bands.honest.sum())} of {len(bands)} runs within 2 %, or the band says so.")
    lines.append(
        f"A step of the filter costs {1e6 * cost['filter, alone']:.0f} µs alone and {1e6 * cost['filter, batch']:.2f} "
        f"µs in a batch of {BATCH}, of the sigma-point filter {1e6 * cost['sigma points, alone']:.0f} µs alone; of the "
        f"polynomial {1e6 * cost['polynomial, alone']:.2f} and {1e6 * cost['polynomial, batch']:.4f} µs."
    )
    if (single := found.single_precision) is not None:
        lines.append(
            f"In float32 the charge differs by at most {single.soc_error:.1g} from float64 (rounding of a count alone: "
            f"at most {single.count_bound:.1g}); a step takes {single.operations:,.0f} operations, "
            f"{single.state_bytes:,} bytes of state, {single.working_bytes:,} of working memory and "
            f"{single.table_bytes:,} of tables."
        )
    return lines
