"""Pictures of the model at work: the map of a compensation, estimates of the charge, how long missions last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator

from plots.style import BLACK, BLUE, GREY, LINES, PAGE_CM, SEQUENCE, new_figure, styled

MARKERS = {"charge": "o", "voltage": "v", "winding": "^", "none": "s"}


@styled
def maps(
    ambient_degC: np.ndarray,
    load_torque_Nm: np.ndarray,
    shares: Mapping[str, np.ndarray],
    drives: Mapping[str, np.ndarray],
) -> Figure:
    """Draw the duty by the reference's over ambient and torque, one map for each model.

    Args:
        ambient_degC: of the rows.
        load_torque_Nm: of the columns.
        shares: by model, shape (ambients, torques).
        drives: by model, False where the robot would stand.
    """
    figure = new_figure(PAGE_CM, 8.0)
    grid = figure.subplots(1, len(shares), squeeze=False, sharey=True)
    low = min(float(np.nanmin(share)) for share in shares.values())
    norm = Normalize(low, min(2.0, max(float(np.nanmax(share)) for share in shares.values())))
    torque = 1e3 * load_torque_Nm
    for axes, (name, share) in zip(grid.flat, shares.items(), strict=True):
        mesh = axes.pcolormesh(torque, ambient_degC, share, cmap=SEQUENCE, norm=norm, shading="nearest")
        levels = [level for level in (0.4, 0.6, 0.8, 1.0, 1.2, 1.5) if np.nanmin(share) < level < np.nanmax(share)]
        if levels:
            lines = axes.contour(torque, ambient_degC, share, levels, colors="white", linewidths=1.0)
            axes.clabel(lines, fmt="%g", fontsize=7.5)
        standing = ~drives[name] & np.isfinite(share)
        if standing.any():
            axes.pcolor(torque, ambient_degC, np.ma.masked_where(~standing, standing), hatch="////", alpha=0.0)
        axes.set_title(_broken(name), fontsize=8.0, fontweight="normal")
        axes.set_xlabel("torque [mN m]")
        axes.grid(visible=False)
    grid[0, 0].set_ylabel("ambient [°C]")
    figure.colorbar(mesh, ax=list(grid.flat), label="duty by the reference's", pad=0.02, extend="max")
    return figure


def _broken(name: str) -> str:
    """Break a long name of a model at the last of its words."""
    return "\n".join(name.rsplit(" ", 1)) if len(name) > 20 else name


@styled
def gains(
    names: Sequence[str], minutes: Mapping[str, np.ndarray], metres: Mapping[str, np.ndarray], at: np.ndarray
) -> Figure:
    """Draw time and range of a mission with and without compensation over the ambient.

    Args:
        names: of the models, one column each.
        minutes: by "model, plain" and "model, compensated", shape (ambients,).
        metres: the same.
        at: ambient, degC.
    """
    figure = new_figure(PAGE_CM, 9.0)
    grid = figure.subplots(2, len(names), squeeze=False, sharex=True, sharey="row")
    for column, name in enumerate(names):
        for row, (values, label) in enumerate(((minutes, "time [min]"), (metres, "range [m]"))):
            axes = grid[row, column]
            axes.plot(at, values[f"{name}, plain"], "o-", color=GREY, markersize=3.5, label="as driven")
            axes.plot(at, values[f"{name}, compensated"], "o-", color=BLUE, markersize=3.5, label="compensated")
            if column == 0:
                axes.set_ylabel(label)
        grid[0, column].set_title(_broken(name), fontsize=8.0, fontweight="normal")
        grid[1, column].set_xlabel("ambient [°C]")
    for axes in grid[:, 0]:
        axes.set_ylim(bottom=0.0)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@styled
def lasting(
    ambient_degC: np.ndarray,
    ages: Sequence[str],
    minutes: np.ndarray,
    limits: np.ndarray,
    names: Sequence[str],
    title: str,
) -> Figure:
    """Draw how long a mission lasts over the ambient, a line for each age, with what ends it.

    Args:
        ambient_degC: shape (ambients,).
        ages: names of the lines.
        minutes: shape (ambients, ages).
        limits: index in `names`, or beyond it where nothing ended the mission; same shape.
        names: of what may end it.
        title: what is held fixed.
    """
    figure = new_figure(PAGE_CM, 9.5)
    axes = figure.subplots()
    colours = matplotlib.colormaps[SEQUENCE](np.linspace(0.0, 0.82, len(ages)))
    kinds = [*names, "none"]
    for column, (age, colour) in enumerate(zip(ages, colours, strict=True)):
        axes.plot(ambient_degC, minutes[:, column], color=colour, lw=1.8, label=age)
        for kind, name in enumerate(kinds):
            here = np.minimum(limits[:, column], len(names)) == kind
            axes.plot(ambient_degC[here], minutes[here, column], MARKERS[name], color=colour, markersize=6)
    said = {name: "not ended" if name == "none" else f"ended by {name}" for name in kinds}
    ended = [
        Line2D([], [], color=BLACK, marker=MARKERS[name], lw=0, label=said[name])
        for kind, name in enumerate(kinds)
        if np.any(np.minimum(limits, len(names)) == kind)
    ]
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("ambient [°C]")
    axes.set_ylabel("time until the mission ends [min]")
    axes.set_title(title, fontweight="normal", fontsize=8.5, color="#555555")
    handles, _ = axes.get_legend_handles_labels()
    figure.legend(handles=[*handles, *ended], loc="outside lower center", ncols=3)
    return figure


@styled
def mission_course(time_s: np.ndarray, columns: Mapping[str, np.ndarray], marks: Sequence[tuple[float, str]]) -> Figure:
    """Draw one round of a mission: columns over time, the segments named.

    Args:
        time_s: of the rows.
        columns: by axis label.
        marks: start [s] and name of each segment.
    """
    figure = new_figure(PAGE_CM, 2.0 + 3.0 * len(columns))
    grid = figure.subplots(len(columns), 1, squeeze=False, sharex=True)
    for axes, (label, values), colour in zip(grid.flat, columns.items(), LINES, strict=False):
        axes.plot(time_s / 60.0, values, color=colour, drawstyle="steps-post")
        axes.set_ylabel(label, fontsize=8.0)
        for start, _ in marks:
            axes.axvline(start / 60.0, color=GREY, lw=0.6, ls=":")
    together: list[tuple[float, str]] = []
    for start, name in marks:
        if together and start - together[-1][0] < 0.04 * (time_s[-1] - time_s[0]):
            together[-1] = (together[-1][0], f"{together[-1][1]}, {name}")
        else:
            together.append((start, name))
    for start, name in together:
        grid[0, 0].annotate(
            name, (start / 60.0, 1.0), xycoords=("data", "axes fraction"), xytext=(2, 3), textcoords="offset points",
            rotation=30, fontsize=7.0,
        )  # fmt: skip
    grid[-1, 0].set_xlabel("time [min]")
    return figure


@styled
def estimates(runs: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Draw, for each run, the measured charge and the estimates from a wrong start.

    Args:
        runs: by label: `time_s`, `soc`, and by name of the estimator its estimate; all of shape (rows,).
    """
    figure = new_figure(PAGE_CM, 3.0 + 4.2 * ((len(runs) + 1) // 2))
    grid = figure.subplots((len(runs) + 1) // 2, 2, squeeze=False, sharey=True)
    for axes in list(grid.flat)[len(runs) :]:
        axes.set_visible(False)
    for axes, (label, columns) in zip(grid.flat, runs.items(), strict=False):
        minutes = columns["time_s"] / 60.0
        axes.plot(minutes, columns["soc"], color=BLACK, lw=2.2, label="counted by the tester")
        drawn = [name for name in columns if name not in ("time_s", "soc")]
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
def estimate_errors(labels: Sequence[str], errors: Mapping[str, np.ndarray], target: float) -> Figure:
    """Draw the RMS error of each estimator on each run, logarithmic.

    Args:
        labels: of the runs.
        errors: by estimator, shape (runs,).
        target: drawn as a line.
    """
    figure = new_figure(PAGE_CM, 4.0 + 0.75 * len(labels))
    axes = figure.subplots()
    places = np.arange(len(labels))[::-1]
    for (name, values), colour, marker in zip(errors.items(), LINES, "osv^D", strict=False):
        axes.plot(100.0 * values, places, marker, color=colour, label=name, markersize=5)
    axes.axvline(100.0 * target, color=BLACK, lw=1.0, ls="--", label=f"target {100 * target:g} %")
    axes.set_xscale("log")
    least = min(0.3, 80.0 * float(np.nanmin([np.nanmin(values) for values in errors.values()])))
    axes.set_xlim(max(least, 0.01), 100.0)
    axes.minorticks_off()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_yticks(places, labels)
    axes.set_xlabel("RMS error of the state of charge after convergence [%]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
