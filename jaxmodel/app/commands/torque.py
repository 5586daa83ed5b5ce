"""`jaxmodel torque`: what a load asked of a motor that nobody measured, by run, ground and side."""

from __future__ import annotations

import dataclasses
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jaxmodel.app import terminal
from jaxmodel.app.article import Picture, Section, Table, print_tables, write_article
from jaxmodel.app.commands.start import start
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import FitError
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.operation.load import LoadEstimate, estimate_load, pooled, sides
from jaxmodel.operation.wear import WHAT, Wear, trend
from jaxmodel.plots.load import load_by_group, load_of_run
from jaxmodel.plots.style import png

# A ratio of two motors is told as a difference from so many sd.
TOLD_SD = 3.0
_HOW = (
    "The torque is what is left of eq. 13: torque constant times current, less the motor's own friction and what its "
    "inertia takes. It counts at the motor's shaft, positive where it resists. The band of a row holds the noise of "
    "current and speed; all rows share the uncertainty of the torque constant."
)


def torque(paths: Sequence[Path], out: Path, *, pictures: bool = True) -> None:
    """Write a CSV of each motor's torque, `report.html` and pictures to `out`.

    Args:
        paths: cases with current and speed, one for each motor, or one of several.
        out: the folder.
        pictures: False writes neither pictures nor a page.

    Raises:
        UserError: a case cannot be used.
    """
    began = time.perf_counter()
    cases = [of_motor for path in paths for of_motor in _of_motors(read_case(path), alone=len(paths) == 1)]
    start(out)
    found: list[LoadEstimate] = []
    worn: list[Wear] = []
    with terminal.stages("torque") as progress:
        for case in cases:
            progress(f"torque of {case.name}")
            found.append(estimate_load(case))
            progress(f"wear of {case.name}")
            worn += _wear(case)
    for name, one in zip(_names(found), found, strict=True):
        write_whole(out / f"torque-{name}.csv", one.to_dataframe().to_csv(index=False, float_format="%.6g"))
    sections = [_groups(found), *([_sides(found)] if len(found) > 1 else [])]
    if worn:
        sections.append(_over_the_runs(worn))
    if pictures:
        sections.append(_runs(found))
    findings = _findings(found) + [f"{one.name}: {line}" for one in worn for line in one.summary().splitlines()]
    write_article(
        out,
        "Torque of the load",
        f"From current and speed; made in {time.perf_counter() - began:.0f} s",
        findings,
        sections,
        [path / "case.toml" if path.is_dir() else path for path in paths],
        pictures=pictures,
    )
    print_tables(sections)
    for line in findings:
        terminal.say(f"- {line}")
    terminal.say(f"torque-*.csv{', and report.html,' if pictures else ''} are in {out}.")


def _of_motors(case: Case, alone: bool) -> list[Case]:
    """Return a case for each motor, with the name of its case too where there are several."""
    parts = case.of_specimens()
    return [
        one if alone or one is case else dataclasses.replace(one, name=f"{case.name} {name}")
        for name, one in parts.items()
    ]


def _names(found: Sequence[LoadEstimate]) -> list[str]:
    return [re.sub(r"\W+", "-", one.name) or f"motor-{number}" for number, one in enumerate(found, start=1)]


def _number(value: float) -> str:
    return f"{value:.3g}" if np.isfinite(value) else "-"


def _groups(found: Sequence[LoadEstimate]) -> Section:
    head = (
        "motor",
        "runs",
        "count",
        "torque [N m]",
        "sd",
        "varies by",
        "speed [rad/s]",
        "work [W]",
        "drawn [W]",
        "J/m",
    )
    columns = ("torque_Nm", "sd_Nm", "spread_Nm", "speed_rad_s", "work_W", "drawn_W", "J_per_m")
    rows = [
        (one.name, str(group), f"{int(row['runs'])}", *(_number(float(row[name])) for name in columns))
        for one in found
        for group, row in one.by_group().iterrows()
    ]
    picture = Picture("torque-by-group", png(load_by_group(found)), "Mean torque against the motion, with two sd.")
    return Section("By ground", [_HOW, Table("torque", head, rows, words=2), picture])


def _sides(found: Sequence[LoadEstimate]) -> Section:
    table = sides(found)
    rows = [
        (
            str(row["group"]),
            f"{row['motor']} / {found[0].name}",
            _number(float(row["ratio"])),
            _number(float(row["sd"])),
        )
        for _, row in table.iterrows()
    ]
    return Section(
        "One side against the other",
        [
            "Ratios of mean torques. The motors are taken as alike: a torque constant that is wrong for both is not in "
            "the sd, one that is wrong for one of them looks like a load.",
            Table("sides", ("runs", "of", "ratio", "sd"), rows, words=2),
        ],
    )


def _wear(case: Case) -> list[Wear]:
    """Return what the runs of a case tell of its wear; nothing where they are too few, or give no number."""
    try:
        return [trend(case)]
    except FitError:
        return []


def _over_the_runs(worn: Sequence[Wear]) -> Section:
    head = ("motor", "number", "runs", "mean", "change [%]", "sd", "chance")
    rows = []
    for one in worn:
        for line in one.trends:
            change = [_number(100.0 * size) for size in line.change]
            number = f"{WHAT[line.name]} [{line.unit}]"
            rows.append((one.name, number, str(len(line.points)), _number(line.mean), *change, f"{line.chance:.2g}"))
    return Section(
        "Over the runs",
        [
            "Each run alone gives the numbers of the motor; a straight line goes through them, over their cycles or "
            "order. Change is from the first run to the last; chance is how probable so large a one is without.",
            Table("wear", head, rows, words=2),
        ],
    )


def _runs(found: Sequence[LoadEstimate]) -> Section:
    parts: list[Picture] = []
    for name, one in zip(_names(found), found, strict=True):
        for of_run in one.runs[:6]:
            picture = png(load_of_run(one, of_run.run))
            parts.append(Picture(f"torque-{name}-{of_run.run}", picture, f"{one.name}, {of_run.run}."))
    return Section("Along the runs", parts)


def _findings(found: Sequence[LoadEstimate]) -> list[str]:
    lines = []
    for one in found:
        table = one.by_group().sort_values("torque_Nm", ascending=False)
        first = table.iloc[0]
        common = f"{100.0 * max(of_run.common for of_run in one.runs):.2g} %"
        if len(table) > 1:
            last = table.iloc[-1]
            apart = float(np.hypot(first["sd_of_blocks_Nm"], last["sd_of_blocks_Nm"]))
            told = first["torque_Nm"] - last["torque_Nm"] > TOLD_SD * apart
            verb = "asks for most" if told else "asks for no more than the others beyond 3 sd; it has"
            lines.append(
                f"{one.name}: {table.index[0]} {verb}, {first['torque_Nm']:.3g} N m in the mean; "
                f"{table.index[-1]} {last['torque_Nm']:.3g} N m. All share an sd of {common}."
            )
        else:
            lines.append(
                f"{one.name}: {first['torque_Nm']:.3g} ± {first['sd_Nm']:.2g} N m in the mean over {table.index[0]}, "
                f"of which {common} are the torque constant's."
            )
    if len(found) > 1:
        table = sides(found)
        for motor, of_motor in table.groupby("motor"):
            mean, sd = pooled(of_motor)
            differs = "asks for" if abs(mean - 1.0) > TOLD_SD * sd else "does not differ beyond 3 sd:"
            lines.append(f"{motor} {differs} {mean:.3g} ± {sd:.2g} times the torque of {found[0].name}.")
    return lines
