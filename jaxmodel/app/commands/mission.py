"""`jaxmodel mission`: how long a robot can repeat a mission, by temperature and age of its pack, and what ends it."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from jaxmodel import operation
from jaxmodel.app import terminal
from jaxmodel.app.article import Picture, Section, Table, write_article
from jaxmodel.app.commands.compensate import LONGEST_H, MISSION, PRINTED, RECORDED
from jaxmodel.app.commands.start import start
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import SweepError
from jaxmodel.case.build import case_model, preset_model
from jaxmodel.case.reading import read_case
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.mission import LIMITS, drive
from jaxmodel.plots.operation import endurance as endurance_picture
from jaxmodel.plots.operation import mission_round
from jaxmodel.plots.style import png

AMBIENT_DEGC = np.arange(-20.0, 60.1, 5.0)
# Months of storage and charging cycles.
AGES = {"new": (0.0, 0.0), "18 months, 25 cycles": (18.0, 25.0), "36 months, 200 cycles": (36.0, 200.0)}
REAL_CELLS = "LG MJ1 cells (measured at 20 and 40 °C), 6 in series, 2 in parallel"
BY_CAPACITY = "paper's pack, capacity as in Table 1"


def mission(path: Path | None, out: Path, cases: Sequence[Path], ages: Sequence[str], *, pictures: bool = True) -> None:
    """Write `report.html`, `endurance.csv` and pictures to `out`.

    Args:
        path: a mission file; without it, the example's.
        out: the folder.
        cases: models of robots; without any, the paper's, that extended by Table 1, and one with real cells.
        ages: "MONTHS,CYCLES" each; without any, three.
        pictures: False writes neither pictures nor a page.

    Raises:
        UserError: a file or an age cannot be used.
    """
    began = time.perf_counter()
    path = path or MISSION
    plan = operation.read_mission(path)
    models = operation.read_robots(cases) or usual_models()
    of_age = dict(_age(text) for text in ages) or AGES
    limits = operation.Limits()
    start(out)
    found: dict[str, xr.Dataset] = {}
    with terminal.stages("mission") as progress:
        for name, model in models.items():
            progress(name)
            found[name] = operation.endurance(model, plan, AMBIENT_DEGC, of_age, limits, longest_h=LONGEST_H)
        progress("pictures and report")
        first = next(iter(models.values()))
        sections = [_round_section(plan, first), *(_model_section(name, result) for name, result in found.items())]
    write_whole(out / "endurance.csv", _table(found).to_csv(index=False, float_format="%.6g"))
    lines = [_finding(name, result) for name, result in found.items()]
    write_article(
        out,
        f"How long can I stay out? {plan.title}",
        f"Ended by the first of: {100 * limits.soc:g} % charge, {limits.cell_V:g} V of a cell, "
        f"{limits.winding_degC:g} °C of a winding; made in {time.perf_counter() - began:.0f} s",
        lines,
        sections,
        [path],
        pictures=pictures,
    )
    for section in sections[1:]:
        for table in (part for part in section.parts if isinstance(part, Table)):
            terminal.table(section.title, table.head, table.rows, right=range(1, len(table.head)))
    for line in lines:
        terminal.say(f"- {line}")
    terminal.say(f"{'report.html and endurance.csv are' if pictures else 'endurance.csv is'} in {out}.")


def usual_models() -> dict[str, Model]:
    """Return the paper's robot, that with a capacity by temperature as Table 1 would have it, and one on real cells."""
    return {
        PRINTED: preset_model("paper", "robot"),
        BY_CAPACITY: case_model(read_case(RECORDED / "capacity.toml")),
        REAL_CELLS: operation.cells_in_parallel(preset_model("lg_mj1", "robot"), 2.0),
    }


def _age(text: str) -> tuple[str, tuple[float, float]]:
    try:
        months, cycles = map(float, text.split(","))
    except ValueError as error:
        raise SweepError(f"--age {text}: write months of storage and cycles, as in --age 18,25.") from error
    return f"{months:g} months, {cycles:g} cycles", (months, cycles)


def _why(ended_by: str) -> str:
    return "not ended" if ended_by == "nothing" else ended_by


def _table(found: Mapping[str, xr.Dataset]) -> pd.DataFrame:
    tables = []
    for name, result in found.items():
        table = result.to_dataframe().reset_index()
        minutes = {f"{limit}_minutes": table[f"until_{limit}_s"] / 60.0 for limit in LIMITS}
        columns = {
            "model": name,
            "ambient_degC": table["ambient_degC"],
            "age": table["age"],
            "minutes": table["time_s"] / 60.0,
            "ended_by": table["ended_by"].map(_why),
            "distance_m": table["distance_m"],
        }
        tables.append(pd.DataFrame(columns | minutes))
    return pd.concat(tables)


def _round_section(plan: operation.Mission, model: Model) -> Section:
    rows = []
    for segment in plan.segment:
        torque, duty = drive(segment, model)
        moving = segment.speed_m_s > 0.0
        rows.append(
            (segment.what, f"{segment.duration_s:g}", f"{segment.speed_m_s:g}", segment.surface if moving else "-",
             f"{segment.incline_deg:g}" if moving else "-", f"{1e3 * torque:.0f}", f"{duty:.2f}",
             f"{segment.flipper_load_kg:g}" if segment.flipper_load_kg else "-")
        )  # fmt: skip
    head = (
        "segment", "time [s]", "speed [m/s]", "ground", "slope [°]", "torque of a motor [mN m]", "duty",
        "flippers lift [kg]",
    )  # fmt: skip
    return Section(
        "One round",
        [
            "Torque by eq. 18 with the friction of the ground, the duty that holds the speed by eqs. 11 to 14, "
            "flippers by eq. 19. Friction of rubber on asphalt is the paper's 0.7; other grounds, flippers and speeds "
            "are assumed.",
            Table("round", head, rows),
            Picture("round", png(mission_round(model, plan)), "One round at 20 °C with a full pack."),
        ],
    )


def _model_section(name: str, result: xr.Dataset) -> Section:
    ages = list(map(str, result["age"].to_numpy()))
    minutes, ended_by = result["time_s"].to_numpy() / 60.0, result["ended_by"].to_numpy()
    rows = [
        (f"{ambient:g}", *(f"{minutes[i, j]:.0f} ({_why(ended_by[i, j])})" for j in range(len(ages))))
        for i, ambient in enumerate(result["ambient_degC"].to_numpy())
        if ambient % 10.0 == 0.0
    ]
    slug = "".join(c if c.isalnum() else "-" for c in name.lower()).strip("-")
    return Section(
        name,
        [
            Picture(
                f"endurance-{slug}",
                png(endurance_picture(result, name)),
                "How long the mission lasts over the ambient, by age of the pack; the marks say what ends it.",
            ),
            "The mission ends in the segment that asks the most of the pack, so times come in steps of a round.",
            Table(f"endurance-{slug}", ("ambient [°C]", *(f"{age} [min]" for age in ages)), rows),
        ],
    )


def _finding(name: str, result: xr.Dataset) -> str:
    said = []
    for age in map(str, result["age"].to_numpy()):
        cold, mild = (result.sel(age=age, ambient_degC=at) for at in (-20.0, 20.0))
        said.append(
            f"{age}: {float(cold['time_s']) / 60:.0f} min at -20 °C ({_why(cold['ended_by'].item())}), "
            f"{float(mild['time_s']) / 60:.0f} at 20 °C ({_why(mild['ended_by'].item())})"
        )
    return f"{name}. " + "; ".join(said) + "."
