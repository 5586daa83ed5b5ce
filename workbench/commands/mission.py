"""`jaxmodel mission`: how long a robot can stay out, at which temperature, with which pack, and what calls it back."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxmodel.build import case_model, preset_model
from jaxmodel.cases import read_case
from jaxmodel.cell import storage_factor
from jaxmodel.errors import SweepError
from jaxmodel.model import Model
from jaxmodel.names import with_values
from jaxmodel.parameters import TABLE
from jaxmodel.simulation import simulate

# First of ours: sweeps gives JAX every core, which must happen before the first array.
from operation.mission import (
    LIMITS,
    NOT_REACHED,
    Endurance,
    Limits,
    MissionForm,
    course,
    drive,
    endurance,
    read_mission,
)  # isort: skip
from plots.operation import lasting, mission_course
from plots.style import png
from workbench import terminal
from workbench.article import Picture, Section, Table, write_article
from workbench.commands.compensate import MISSION, PRINTED, RECORDED
from workbench.commands.start import robots_of, start

AMBIENT_DEGC = np.arange(-20.0, 60.1, 5.0)
# Months of storage and charging cycles.
AGES = {"new": (0.0, 0.0), "18 months, 25 cycles": (18.0, 25.0), "36 months, 200 cycles": (36.0, 200.0)}
LONGEST_H = 8.0
REAL_CELLS = "Panasonic cells, 6 in series, 2 abreast"
BY_CAPACITY = "paper's pack, capacity as in Table 1"
ABREAST = 2.0


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
    plan = read_mission(path)
    models = robots_of(cases) or usual_models()
    of_age = dict(_age(text) for text in ages) or AGES
    limits = Limits()
    start(out)
    found: dict[str, Endurance] = {}
    with terminal.told("mission") as progress:
        for name, model in models.items():
            progress(name)
            found[name] = over_ambient_and_age(model, plan, of_age, limits)
        progress("pictures and report")
        first = next(iter(models.values()))
        sections = [_round_section(plan, first), *(_model_section(n, e, list(of_age)) for n, e in found.items())]
    _table(found, list(of_age)).to_csv(out / "endurance.csv", index=False, float_format="%.6g")
    lines = [_finding(name, result, list(of_age)) for name, result in found.items()]
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
    models = {PRINTED: preset_model("paper", "robot")}
    capacity = RECORDED / "capacity.toml"
    if capacity.is_file():
        models[BY_CAPACITY] = case_model(read_case(capacity))
    cell = preset_model("panasonic_18650pf", "robot")
    p = cell.parameters
    # Cells abreast share the current: twice the capacity and capacitances, half the resistances.
    pack = {
        "capacity_Ah": ABREAST * p.capacity_Ah,
        "series_resistance_scale": p.series_resistance_scale / ABREAST,
        "rc_resistance_scale": p.rc_resistance_scale / ABREAST,
        "rc_capacitance_scale": p.rc_capacitance_scale * ABREAST,
    }
    return models | {REAL_CELLS: with_values(cell, pack)}


def over_ambient_and_age(
    model: Model, plan: MissionForm, ages: Mapping[str, tuple[float, float]], limits: Limits
) -> Endurance:
    """Return endurances of shape (ambients, ages): the mission again and again until its first limit."""
    rounds = int(np.ceil(LONGEST_H * 3600.0 / sum(segment.duration_s for segment in plan.segment)))
    ambient, months = np.meshgrid(AMBIENT_DEGC, [months for months, _ in ages.values()], indexing="ij")
    cycles = np.broadcast_to([cycles for _, cycles in ages.values()], ambient.shape)
    lanes = {"ambient_degC": ambient, "storage_months": months, "cycles": cycles}
    return endurance(model, course(plan, model, rounds), lanes, limits)


def _age(text: str) -> tuple[str, tuple[float, float]]:
    try:
        months, cycles = map(float, text.split(","))
    except ValueError as error:
        raise SweepError(f"--age {text}: write months of storage and cycles, as in --age 18,25.") from error
    for name, number in (("storage_months", months), ("cycles", cycles)):
        TABLE[name].check(number, f"--age {text}")
    degC = TABLE["storage_temperature_degC"].default
    if storage_factor(jnp.asarray(months), jnp.asarray(degC)) <= 0.0:
        raise SweepError(
            f"--age {text}: by eq. 8 no capacity is left after {months:g} months at {degC:g} degC; take fewer."
        )
    return f"{months:g} months, {cycles:g} cycles", (months, cycles)


def _why(limit: int) -> str:
    return LIMITS[limit] if limit < NOT_REACHED else "not ended"


def _table(found: Mapping[str, Endurance], ages: Sequence[str]) -> pd.DataFrame:
    rows = [
        {
            "model": name,
            "ambient_degC": ambient,
            "age": age,
            "minutes": result.time_s[i, j] / 60.0,
            "ended_by": _why(int(result.limit[i, j])),
            "distance_m": result.distance_m[i, j],
            **{f"{limit}_minutes": result.each_s[limit][i, j] / 60.0 for limit in LIMITS},
        }
        for name, result in found.items()
        for i, ambient in enumerate(AMBIENT_DEGC)
        for j, age in enumerate(ages)
    ]
    return pd.DataFrame(rows)


def _round_section(plan: MissionForm, model: Model) -> Section:
    profile = course(plan, model, 1)
    ran = simulate(model, profile)
    starts = np.cumsum([0.0, *(segment.duration_s for segment in plan.segment)])
    marks = [(float(at), segment.what) for at, segment in zip(starts[:-1], plan.segment, strict=True)]
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
    columns = {
        "duty": profile.inputs["duty"],
        "torque [mN m]": 1e3 * profile.inputs["load_torque_Nm"],
        "pack current [A]": np.asarray(ran.readings["pack_current_A"]),
        "cell [V]": np.asarray(ran.readings["pack_voltage_V"]) / float(model.parameters.n_series),
        "winding [°C]": np.asarray(ran.readings["winding_temperature_degC"]),
    }
    return Section(
        "One round",
        [
            "Torque by eq. 18 with the friction of the ground, the duty that holds the speed by eqs. 11 to 14, "
            "flippers by eq. 19. Friction of rubber on asphalt is the paper's 0.7; other grounds, flippers and speeds "
            "are assumed.",
            Table("round", head, rows),
            Picture(
                "round", png(mission_course(profile.time_s, columns, marks)), "One round at 20 °C with a full pack."
            ),
        ],
    )


def _model_section(name: str, result: Endurance, ages: Sequence[str]) -> Section:
    minutes = result.time_s / 60.0
    rows = [
        (f"{ambient:g}", *(f"{minutes[i, j]:.0f} ({_why(int(result.limit[i, j]))})" for j in range(len(ages))))
        for i, ambient in enumerate(AMBIENT_DEGC)
        if ambient % 10.0 == 0.0
    ]
    slug = "".join(c if c.isalnum() else "-" for c in name.lower()).strip("-")
    return Section(
        name,
        [
            Picture(
                f"endurance-{slug}",
                png(lasting(AMBIENT_DEGC, ages, minutes, result.limit, LIMITS, name)),
                "How long the mission lasts over the ambient, by age of the pack; the marks say what ends it.",
            ),
            "The mission ends in the segment that asks the most of the pack, so times come in steps of a round.",
            Table(f"endurance-{slug}", ("ambient [°C]", *(f"{age} [min]" for age in ages)), rows),
        ],
    )


def _finding(name: str, result: Endurance, ages: Sequence[str]) -> str:
    cold, mild = (list(AMBIENT_DEGC).index(at) for at in (-20.0, 20.0))
    said = [
        f"{age}: {result.time_s[cold, j] / 60:.0f} min at -20 °C ({_why(int(result.limit[cold, j]))}), "
        f"{result.time_s[mild, j] / 60:.0f} at 20 °C ({_why(int(result.limit[mild, j]))})"
        for j, age in enumerate(ages)
    ]
    return f"{name}. " + "; ".join(said) + "."
