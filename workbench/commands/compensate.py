"""`jaxmodel compensate`: the duty that holds the pace of the charge whatever temperature and torque."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

# First of ours: sweeps gives JAX every core, which must happen before the first array.
from operation.compensation import Compensation, Reference, compensate, steady  # isort: skip
from jaxmodel.build import case_model, preset_model
from jaxmodel.cases import read_case
from jaxmodel.errors import MeasurementError
from jaxmodel.model import Model
from operation.header import header, looked_up
from operation.mission import LIMITS, Endurance, MissionForm, course, endurance, read_mission
from plots.operation import gains, maps
from plots.style import png
from workbench import terminal
from workbench.article import Picture, Section, Table, percent, write_article
from workbench.commands.start import robots_of, start

# Abstract and end of section 3: "15.7 percent per 20 degC deviation", "14.7 percent" per 50 mN m.
SHARE_PER_20_K, SHARE_PER_50_MNM = 0.157, 0.147
EXAMPLES = Path(__file__).parents[2] / "examples"
RECORDED = EXAMPLES / "paper_table1" / "recorded"
MISSION = EXAMPLES / "missions" / "house_search.toml"
PRINTED = "equations as printed"
_RECORDED = "Table 1 by "
AMBIENT_DEGC = np.arange(-20.0, 60.1, 5.0)
TORQUE_NM = np.round(np.arange(0.1, 0.3501, 0.0125), 4)
MISSION_DEGC = np.arange(-20.0, 60.1, 10.0)
LONGEST_H = 8.0


def compensate_models(out: Path, cases: Sequence[Path], mission_path: Path | None, *, pictures: bool = True) -> None:
    """Write maps (CSV, C headers), gains over a mission and `report.html` to `out`.

    Args:
        out: the folder.
        cases: models of robots beside the printed equations; without any, the two that Table 1 was extended to.
        mission_path: a mission file; without it, the example's.
        pictures: False writes neither pictures nor a page.

    Raises:
        UserError: a case or mission cannot be used.
    """
    began = time.perf_counter()
    mission_path = mission_path or MISSION
    paths = list(cases) or _recorded()
    own = robots_of(cases) if cases else {_recorded_name(path): case_model(read_case(path)) for path in paths}
    models = {PRINTED: preset_model("paper", "robot")} | own
    mission = read_mission(mission_path)
    start(out)
    found: dict[str, Compensation] = {}
    over: dict[str, tuple[list[Endurance], list[Endurance]]] = {}
    rules: dict[str, float] = {}
    with terminal.told("compensate") as progress:
        for name, model in models.items():
            progress(f"solving the map: {name}")
            found[name] = compensate(model, AMBIENT_DEGC, TORQUE_NM)
            if not (np.isfinite(found[name].duty) & found[name].drives).any():
                raise MeasurementError(
                    f"{name}: this robot does not drive at any place of the map, {TORQUE_NM[0]:g} to "
                    f"{TORQUE_NM[-1]:g} N m at a reference duty of {found[name].reference.duty:g}; check its motors."
                )
        for name, model in models.items():
            progress(f"checking between its places and by the paper's rule: {name}")
            rules[name] = paper_rule_error(model, found[name])
            _write(out, name, model, found[name])
            progress(f"missions: {name}")
            over[name] = mission_gain(model, mission, found[name])
    sections = [_map_section(found), _check_section(models, found, rules), _mission_section(mission, over)]
    lines = _findings(found, over)
    write_article(
        out,
        "Compensation of temperature and torque",
        f"The duty that holds the pace of the charge; made in {time.perf_counter() - began:.0f} s",
        lines,
        sections,
        [*(path / "case.toml" if path.is_dir() else path for path in paths), mission_path],
        pictures=pictures,
    )
    for section in sections:
        for table in (part for part in section.parts if isinstance(part, Table)):
            terminal.table(table.name, table.head, table.rows, right=range(table.words, len(table.head)))
    for line in lines:
        terminal.say(f"- {line}")
    terminal.say(f"Maps and headers{', and report.html,' if pictures else ''} are in {out}.")


def _recorded() -> list[Path]:
    paths = [RECORDED / "extended.toml", RECORDED / "capacity.toml"]
    if not all(path.is_file() for path in paths):
        raise MeasurementError(
            "compensate needs the folder examples/ that lies beside the packages, or models of yours: --model CASE."
        )
    return paths


def _recorded_name(path: Path) -> str:
    return _RECORDED + " and ".join(read_case(path).effects)


def _write(out: Path, name: str, model: Model, map_: Compensation) -> None:
    """Write a map as CSV and as two headers."""
    label = "printed" if name == PRINTED else re.sub(r"\W+", "-", name.removeprefix(_RECORDED))
    rows = [
        (t, m, map_.duty[i, j], map_.share[i, j], map_.before.soc_gradient[i, j], map_.after.soc_gradient[i, j],
         map_.after.speed_rad_s[i, j])
        for i, t in enumerate(map_.ambient_degC)
        for j, m in enumerate(map_.load_torque_Nm)
    ]  # fmt: skip
    head = "ambient_degC load_torque_Nm duty duty_share slope_before_per_s slope_after_per_s speed_after_rad_s".split()
    pd.DataFrame(rows, columns=head).to_csv(out / f"map-{label}.csv", index=False, float_format="%.8g")
    for integers, kind in ((True, "q15"), (False, "float")):
        error, _ = between(model, map_, integers=integers)
        text = header(map_, name, error, integers=integers, name=f"duty_{kind}")
        (out / f"duty_{kind}_{label}.h").write_text(text, encoding="utf-8")


def between(model: Model, map_: Compensation, *, integers: bool) -> tuple[float, float]:
    """Return the largest error of the header's look-up in the middles between places: of duty, and of the slope.

    The duty there is solved for, the slope simulated with what the header says; where the robot drives, NaN if nowhere.
    """
    ambient = map_.ambient_degC[:-1] + 0.5 * np.diff(map_.ambient_degC)
    torque = map_.load_torque_Nm[:-1] + 0.5 * np.diff(map_.load_torque_Nm)
    t, m = (grid.ravel() for grid in np.meshgrid(ambient, torque, indexing="ij"))
    true = compensate(model, ambient, torque, map_.reference).duty.ravel()
    said = looked_up(map_, t, m, integers=integers)
    there = np.isfinite(true) & np.isfinite(said)
    if not there.any():
        return np.nan, np.nan
    slope = steady(model, t[there], m[there], said[there]).soc_gradient
    return float(np.abs(said - true)[there].max()), float(np.abs(slope / map_.slope - 1.0).max())


def paper_rule_error(model: Model, map_: Compensation) -> float:
    """Return the RMS relative error of the slope under the paper's rule, over the map's places that can be held.

    The rule: 15.7 % less for each 20 K colder and 14.7 % less for each 50 mN m more than the reference.
    """
    r = map_.reference
    t, m = (grid.ravel() for grid in np.meshgrid(map_.ambient_degC, map_.load_torque_Nm, indexing="ij"))
    colder, more = (r.ambient_degC - t) / 20.0, (m - r.load_torque_Nm) / 0.05
    duty = np.clip(r.duty * (1.0 - SHARE_PER_20_K * colder) * (1.0 - SHARE_PER_50_MNM * more), 1e-3, 1.0)
    off = steady(model, t, m, duty).soc_gradient / map_.slope - 1.0
    return float(np.sqrt(np.mean(off[np.isfinite(map_.duty).ravel()] ** 2)))


def mission_gain(model: Model, mission: MissionForm, map_: Compensation) -> tuple[list[Endurance], list[Endurance]]:
    """Return endurances over the ambients, as driven and with the duty held down to the map's."""
    rounds = int(np.ceil(LONGEST_H * 3600.0 / sum(segment.duration_s for segment in mission.segment)))
    plain, held = [], []
    for ambient in MISSION_DEGC:
        lane = {"ambient_degC": np.array([ambient])}

        def slower(torque, duty, ambient=ambient):
            most = map_.interpolated(np.full_like(torque, ambient), torque)
            return np.where(np.isfinite(most), np.minimum(duty, most), duty)

        plain.append(endurance(model, course(mission, model, rounds), lane))
        held.append(endurance(model, course(mission, model, rounds, slower), lane))
    return plain, held


def reduction(map_: Compensation, start: tuple[float, float], end: tuple[float, float]) -> float:
    """Return by what share the duty falls from one place (degC, N m) to another."""
    places = np.array([start, end])
    first, last = map_.interpolated(places[:, 0], places[:, 1])
    return float(1.0 - last / first)


_STEPS = {
    "20 K colder, from 20 °C at 175 mN m": ((20.0, 0.175), (0.0, 0.175)),
    "20 K colder, from 0 °C": ((0.0, 0.175), (-20.0, 0.175)),
    "50 mN m more, from 175 mN m at 20 °C": ((20.0, 0.175), (20.0, 0.225)),
    "50 mN m more, from 250 mN m": ((20.0, 0.25), (20.0, 0.3)),
    "50 mN m more, from 300 mN m": ((20.0, 0.3), (20.0, 0.35)),
}


def _map_section(found: Mapping[str, Compensation]) -> Section:
    first = next(iter(found.values()))
    rows = [
        (what, "15.7 %" if "K" in what else "14.7 %", *(percent(reduction(m, *step)) for m in found.values()))
        for what, step in _STEPS.items()
    ]
    return Section(
        "The map",
        [
            "At a given torque eq. 12 fixes the motor's current; what can be lowered is the duty, and with it the "
            "current that a motor draws from the pack (eq. 14), and its speed. Each place of the map is the root of "
            "slope(duty) = slope at the reference "
            f"({first.reference.ambient_degC:g} °C, {1e3 * first.reference.load_torque_Nm:g} mN m, duty "
            f"{first.reference.duty:g}), over half an hour of the engine.",
            Table("reductions", ("reduction of the motors' draw for", "paper", *found), rows),
            Picture(
                "maps",
                png(
                    maps(
                        first.ambient_degC,
                        first.load_torque_Nm,
                        {name: m.share for name, m in found.items()},
                        {name: m.drives for name, m in found.items()},
                    )
                ),
                "Duty by the reference's that holds the pace; hatched: the motors would no longer turn forwards.",
            ),
            "The printed equations ask for no compensation of temperature: with them the draw does not know it. What "
            "Table 1 was extended with does, and by more than the paper's 15.7 %: its share was of the slope, and by "
            "seven rows. Where one of these extensions is the wrong one (the table cannot tell them apart, jaxmodel "
            f"paper), the duty is wrong by {_disagreement(found)}.",
        ],
    )


def _disagreement(found: Mapping[str, Compensation]) -> str:
    """Return how far the maps of the extended models are from each other, in words."""
    extended = [map_.duty for name, map_ in found.items() if name != PRINTED]
    if len(extended) < 2:
        return "nothing that one model alone could tell"
    off = np.abs(extended[1] / extended[0] - 1.0)
    return f"up to {100 * np.nanmax(off):.0f} % (median {100 * np.nanmedian(off):.1f} %)"


def _check_section(
    models: Mapping[str, Model], found: Mapping[str, Compensation], rules: Mapping[str, float]
) -> Section:
    rows = []
    for name, map_ in found.items():
        spread = np.abs(map_.before.soc_gradient / map_.slope - 1.0)
        q15, by_slope = between(models[name], map_, integers=True)
        rows.append(
            (
                name,
                f"{1e4 * map_.slope:.3f}",
                f"{100 * np.nanmax(spread):.0f} %",
                f"{map_.error:.0e}",
                f"{int(np.sum(~np.isfinite(map_.duty)))} / {int(np.sum(~map_.drives & np.isfinite(map_.duty)))}",
                f"{q15:.1e}",
                f"{100 * by_slope:.2f} %",
                f"{100 * rules[name]:.0f} %",
            )
        )
    head = (
        "model", "slope held [1e-4 /s]", "off by at most, uncompensated", "compensated, simulated at 1 s",
        "places without root / standing", "Q15 look-up at mid-places [duty]", "slope there", "by the paper's rule, RMS",
    )  # fmt: skip
    return Section(
        "Verified in simulation",
        [
            "Every place was run again at steps of 1 s with the duty found. In the middles between places the duty was "
            "solved for anew and compared with what the header's integer look-up returns.",
            Table("checks", head, rows),
        ],
    )


def _mission_section(mission: MissionForm, over: Mapping[str, tuple[list[Endurance], list[Endurance]]]) -> Section:
    minutes, metres, rows = {}, {}, []
    for name, (plain, held) in over.items():
        for label, runs in (("plain", plain), ("compensated", held)):
            minutes[f"{name}, {label}"] = np.array([run.time_s[0] / 60.0 for run in runs])
            metres[f"{name}, {label}"] = np.array([run.distance_m[0] for run in runs])
        for place, ambient in enumerate(MISSION_DEGC):
            if ambient % 20.0:
                continue
            time_0, time_1 = minutes[f"{name}, plain"][place], minutes[f"{name}, compensated"][place]
            way_0, way_1 = metres[f"{name}, plain"][place], metres[f"{name}, compensated"][place]
            why = " / ".join(_why(runs[place]) for runs in (plain, held))
            rows.append(
                (name, f"{ambient:g}", why, f"{time_0:.0f}", f"{time_1:.0f}", percent(time_1 / time_0 - 1.0, 0),
                 f"{way_0:.0f}", f"{way_1:.0f}", percent(way_1 / way_0 - 1.0, 0))
            )  # fmt: skip
    head = (
        "model",
        "ambient [°C]",
        "ended by",
        "time [min]",
        "compensated",
        "gain",
        "range [m]",
        "compensated",
        "gain",
    )
    return Section(
        f"What it gains over a mission: {mission.title.lower()}",
        [
            "The mission is repeated until a tenth of the charge is left, a cell falls below 3 V or a winding passes "
            "125 °C; compensated, no segment is driven at a duty above the map's. What gains most is not the pace of "
            "the charge: at lower duties the pack is spared the currents that pull a cell below 3 V. Where "
            "charge ends the mission either way, the gain in time is paid "
            "for in speed, and little range is won or some lost.",
            Table("gains", head, rows, words=3),
            Picture(
                "gains",
                png(gains(list(over), minutes, metres, MISSION_DEGC)),
                "Time and range until the mission ends, as driven and compensated.",
            ),
        ],
    )


def _why(run: Endurance) -> str:
    return (*LIMITS, "nothing")[int(run.limit[0])]


def _findings(
    found: Mapping[str, Compensation], over: Mapping[str, tuple[list[Endurance], list[Endurance]]]
) -> list[str]:
    cold, steep = _STEPS["20 K colder, from 20 °C at 175 mN m"], _STEPS["50 mN m more, from 300 mN m"]
    lines = [
        f"{name}: {percent(-reduction(map_, *cold))} of the motors' draw for 20 K colder (paper 15.7 %), "
        f"{percent(-reduction(map_, *steep))} for 50 mN m more (paper 14.7 %); the pace is held within "
        f"{map_.error:.0e} of itself in simulation."
        for name, map_ in found.items()
    ]
    for name, (plain, held) in over.items():
        place = list(MISSION_DEGC).index(0.0)
        a, b = plain[place], held[place]
        lines.append(
            f"{name}, mission at 0 °C: {a.time_s[0] / 60:.0f} to {b.time_s[0] / 60:.0f} min, "
            f"{a.distance_m[0]:.0f} to {b.distance_m[0]:.0f} m."
        )
    return lines


__all__ = ["Reference", "compensate_models"]
