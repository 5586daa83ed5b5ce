"""Pictures of `jaxmodel.operation`: maps of a compensation, estimated states of charge, how long missions last."""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator

from jaxmodel.model.electrothermal import Model
from jaxmodel.model.simulation import simulate
from jaxmodel.operation.compensation import Compensation
from jaxmodel.operation.mission import Mission, mission_profile
from jaxmodel.operation.state_of_charge import COUNTED, ESTIMATORS, FILTER, Evaluation
from jaxmodel.plots.style import (
    BLACK,
    BLUE,
    GREY,
    LINES,
    PAGE_CM,
    SEQUENCE,
    legend,
    new_figure,
    one_axes,
    styled,
)

MARKERS = {"charge": "o", "voltage": "v", "winding": "^", "nothing": "s"}


@styled
def compensation_maps(maps: Compensation | Mapping[str, Compensation]) -> Figure:
    """Draw duties as shares of the reference's over ambient and torque, one map for each model.

    Args:
        maps: of `jaxmodel.operation.compensate`; of one model, or of several by name over the same grid. Hatched: the
            motors would no longer turn forwards.
    """
    named = {"": maps} if isinstance(maps, Compensation) else maps
    figure = new_figure(PAGE_CM, 8.0)
    grid = figure.subplots(1, len(named), squeeze=False, sharey=True)
    low = min(float(np.nanmin(map_.share)) for map_ in named.values())
    norm = Normalize(low, min(2.0, max(float(np.nanmax(map_.share)) for map_ in named.values())))
    for axes, (name, map_) in zip(grid.flat, named.items(), strict=True):
        torque, share = 1e3 * map_.load_torque_Nm, map_.share
        mesh = axes.pcolormesh(torque, map_.ambient_degC, share, cmap=SEQUENCE, norm=norm, shading="nearest")
        levels = [level for level in (0.4, 0.6, 0.8, 1.0, 1.2, 1.5) if np.nanmin(share) < level < np.nanmax(share)]
        if levels:
            lines = axes.contour(torque, map_.ambient_degC, share, levels, colors="white", linewidths=1.0)
            axes.clabel(lines, fmt="%g", fontsize=7.5)
        standing = ~map_.drives & np.isfinite(share)
        if standing.any():
            axes.pcolor(torque, map_.ambient_degC, np.ma.masked_where(~standing, standing), hatch="////", alpha=0.0)
        axes.set_title(_broken(name), fontsize=8.0, fontweight="normal")
        axes.set_xlabel("torque [mN m]")
        axes.grid(visible=False)
    grid[0, 0].set_ylabel("ambient [°C]")
    figure.colorbar(mesh, ax=list(grid.flat), label="duty / duty of the reference", pad=0.02, extend="max")
    return figure


def _broken(name: str) -> str:
    """Break a long name of a model at the last of its words."""
    return "\n".join(name.rsplit(" ", 1)) if len(name) > 20 else name


@styled
def compensation_gains(plain: Mapping[str, xr.Dataset], compensated: Mapping[str, xr.Dataset]) -> Figure:
    """Draw time and range of a mission with and without compensation over the ambient, one column for each model.

    Args:
        plain: of `jaxmodel.operation.endurance` without a compensation, by model; the first age is drawn.
        compensated: the same with one.
    """
    figure = new_figure(PAGE_CM, 9.0)
    grid = figure.subplots(2, len(plain), squeeze=False, sharex=True, sharey="row")
    for column, name in enumerate(plain):
        for row, (variable, factor, label) in enumerate(
            (("time_s", 1.0 / 60.0, "time [min]"), ("distance_m", 1.0, "range [m]"))
        ):
            axes = grid[row, column]
            for data, colour, how in ((plain[name], GREY, "as driven"), (compensated[name], BLUE, "compensated")):
                values = factor * data[variable].isel(age=0)
                axes.plot(data["ambient_degC"], values, "o-", color=colour, markersize=3.5, label=how)
            if column == 0:
                axes.set_ylabel(label)
        grid[0, column].set_title(_broken(name), fontsize=8.0, fontweight="normal")
        grid[1, column].set_xlabel("ambient [°C]")
    for axes in grid[:, 0]:
        axes.set_ylim(bottom=0.0)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@styled
def endurance(data: xr.Dataset, title: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw how long a mission lasts over the ambient, a line for each age, with a mark for what ends it.

    Args:
        data: of `jaxmodel.operation.endurance`.
        title: that of the mission if not given.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    figure, axes = one_axes(ax, PAGE_CM, 9.5)
    ambient, minutes, ended_by = data["ambient_degC"].to_numpy(), data["time_s"] / 60.0, data["ended_by"]
    colours = matplotlib.colormaps[SEQUENCE](np.linspace(0.0, 0.82, data.sizes["age"]))
    for age, colour in zip(map(str, data["age"].to_numpy()), colours, strict=True):
        line = minutes.sel(age=age).to_numpy()
        axes.plot(ambient, line, color=colour, lw=1.8, label=age)
        for name, marker in MARKERS.items():
            here = ended_by.sel(age=age).to_numpy() == name
            axes.plot(ambient[here], line[here], marker, color=colour, markersize=6)
    ended = [
        Line2D([], [], color=BLACK, marker=marker, lw=0, label="not ended" if name == "nothing" else f"ended by {name}")
        for name, marker in MARKERS.items()
        if bool((ended_by == name).any())
    ]
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("ambient [°C]")
    axes.set_ylabel("time until the mission ends [min]")
    shown = str(data.attrs.get("title", "")) if title is None else title
    axes.set_title(shown, fontweight="normal", fontsize=8.5, color="#555555")
    handles, _ = axes.get_legend_handles_labels()
    legend(ax, axes, "outside lower center", 3, [*handles, *ended])
    return figure


@styled
def mission_round(model: Model, mission: Mission) -> Figure:
    """Draw one round of a mission at 20 degC: duty, torque, current, voltage and temperature, the segments named.

    Args:
        model: of a robot; the round is simulated.
        mission: from `jaxmodel.operation.read_mission`.
    """
    profile = mission_profile(mission, model)
    readings = simulate(model, profile).readings
    columns = {
        "duty": profile.inputs["duty"],
        "torque [mN m]": 1e3 * profile.inputs["load_torque_Nm"],
        "pack current [A]": np.asarray(readings["pack_current_A"]),
        "cell [V]": np.asarray(readings["pack_voltage_V"]) / float(model.parameters.n_series),
        "winding [°C]": np.asarray(readings["winding_temperature_degC"]),
    }
    minutes = profile.time_s / 60.0
    starts = np.cumsum([0.0, *(segment.duration_s for segment in mission.segment)])[:-1] / 60.0
    figure = new_figure(PAGE_CM, 2.0 + 3.0 * len(columns))
    grid = figure.subplots(len(columns), 1, squeeze=False, sharex=True)
    for axes, (label, values), colour in zip(grid.flat, columns.items(), LINES, strict=False):
        axes.plot(minutes, values, color=colour, drawstyle="steps-post")
        axes.set_ylabel(label, fontsize=8.0)
        for start in starts:
            axes.axvline(start, color=GREY, lw=0.6, ls=":")
    together: list[tuple[float, str]] = []
    for start, segment in zip(starts, mission.segment, strict=True):
        if together and start - together[-1][0] < 0.04 * minutes[-1]:
            together[-1] = (together[-1][0], f"{together[-1][1]}, {segment.what}")
        else:
            together.append((float(start), segment.what))
    for start, name in together:
        grid[0, 0].annotate(
            name, (start, 1.0), xycoords=("data", "axes fraction"), xytext=(2, 3), textcoords="offset points",
            rotation=30, fontsize=7.0,
        )  # fmt: skip
    grid[-1, 0].set_xlabel("time [min]")
    return figure


@styled
def estimates(evaluation: Evaluation, most: int = 8) -> Figure:
    """Draw, for each check run, the measured state of charge and the estimates from a start 30 % too low.

    The shade is the filter's band of two standard deviations.

    Args:
        evaluation: of `jaxmodel.operation.evaluate_estimators`.
        most: runs to draw, the first ones.
    """
    runs = dict(list(evaluation.estimates.items())[:most])
    figure = new_figure(PAGE_CM, 3.0 + 4.2 * ((len(runs) + 1) // 2))
    grid = figure.subplots((len(runs) + 1) // 2, 2, squeeze=False, sharey=True)
    for axes in list(grid.flat)[len(runs) :]:
        axes.set_visible(False)
    for axes, (label, columns) in zip(grid.flat, runs.items(), strict=False):
        minutes = columns["time_s"] / 60.0
        axes.plot(minutes, columns["soc"], color=BLACK, lw=2.2, label="reference")
        if f"{FILTER}, sd" in columns:
            low, high = (columns[FILTER] + by * columns[f"{FILTER}, sd"] for by in (-2.0, 2.0))
            axes.fill_between(minutes, low, high, color=LINES[0], alpha=0.2, lw=0.0)
        drawn = [name for name in ESTIMATORS if name in columns and name != COUNTED]
        for name, colour in zip(drawn, LINES, strict=False):
            axes.plot(minutes, columns[name], color=colour, lw=1.1, label=name)
        axes.set_title(label, fontsize=8.0, fontweight="normal")
    for axes in grid[-1]:
        axes.set_xlabel("time [min]")
    for axes in grid[:, 0]:
        axes.set_ylabel("state of charge")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


@styled
def estimate_errors(evaluation: Evaluation, target: float = 0.02, ax: Axes | None = None) -> Figure:
    """Draw the RMS error of each estimator on each check run, the worse of both starts, logarithmic.

    Args:
        evaluation: of `jaxmodel.operation.evaluate_estimators`; trials from the start of a run are drawn.
        target: drawn as a line.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    errors = evaluation.worst_errors()
    labels = [str(run) for run in errors.index]
    figure, axes = one_axes(ax, PAGE_CM, 4.0 + 0.75 * len(labels))
    places = np.arange(len(labels))[::-1]
    for name, colour, marker in zip(errors.columns, LINES, "osPv^D", strict=False):
        axes.plot(100.0 * errors[name], places, marker, color=colour, label=name, markersize=5)
    axes.axvline(100.0 * target, color=BLACK, lw=1.0, ls="--", label=f"target {100 * target:g} %")
    axes.set_xscale("log")
    axes.set_xlim(max(min(0.3, 80.0 * float(np.nanmin(errors.to_numpy()))), 0.01), 100.0)
    axes.minorticks_off()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_yticks(places, labels)
    axes.set_xlabel("RMS error of the state of charge after convergence [%]")
    legend(ax, axes, "outside lower center", 3)
    return figure
