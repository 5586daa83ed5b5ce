"""Extractions drawn on the readings that they were made from, and the tables of a parameterised cell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.case.records import Case
from jaxmodel.parameterisation.plotting import RUN_BY_RUN, TABLES, kind_of
from jaxmodel.plots.style import (
    FINAL,
    LINES,
    MEASURED,
    PAGE_CM,
    SEQUENCE,
    axis_label,
    minutes_or_seconds,
    new_figure,
    one_axes,
    plain_log,
    styled,
)

# Of a motor the rise over the ambient is fitted.
_THERMOMETER = {"cell": ("temperature", "°C"), "motor": ("rise", "K"), "robot": ("temperature or rise", "°C, K")}
_VOLTAGE = ("voltage_V", "fit_V", "voltage", "V")
_MOST_RUNS = 8
_MOST_LINES = 5


@styled
def extraction(found: Any, name: str, run: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw the points of one extraction of a parameterisation: readings in grey, what was fitted in colour.

    Args:
        found: the parameterisation.
        name: of the extraction, a key of its points.
        run: of an extraction over time, the one to draw; by default all, each on axes of its own.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    table = found.points[name]
    kind = kind_of(name)
    if kind in RUN_BY_RUN:
        names = ("degC", "fit_degC", *_THERMOMETER[found.case.kind]) if kind == "thermal" else _VOLTAGE
        return _over_time(table if run is None else table.loc[table["run"] == run], *names, ax)
    draw = {
        "slow": lambda: _against_soc(table, "voltage_V", "slow discharge and charge [V]", "run", ax),
        "rests": lambda: _against_soc(table, "voltage_V", "voltage at the end of rests [V]", "run", ax),
        "resistance": lambda: _against_soc(
            table.assign(mohm=1e3 * table["ohm"]), "mohm", "first sample [mΩ]", "degC", ax
        ),
        "relaxation": lambda: _relaxation(table, ax),
        "friction": lambda: _friction(table, ax),
    }
    return draw[kind]()


def _against_soc(table: pd.DataFrame, column: str, label: str, by: str, ax: Axes | None) -> Figure:
    figure, axes = one_axes(ax, PAGE_CM, 8.5)
    groups = table["run"] if by == "run" else (table["degC"] / 5.0).round() * 5.0
    for colour, (key, part) in zip(_colours(), table.groupby(groups), strict=False):
        text = str(key) if by == "run" else f"{key:.0f} °C"
        axes.plot(part["soc"], part[column], ".", color=colour, markersize=3.5, label=text, rasterized=True)
    axes.set_xlabel("state of charge")
    axes.set_ylabel(label)
    if column == "mohm":
        axes.set_ylim(0.0, 1.3 * float(np.percentile(table[column], 95)))
    axes.legend(ncols=2)
    return figure


def _colours():
    while True:
        yield from LINES


def _relaxation(table: pd.DataFrame, ax: Axes | None) -> Figure:
    figure, axes = one_axes(ax, PAGE_CM, 8.5)
    for colour, name, text in ((LINES[0], "tau_1", "short"), (LINES[1], "tau_2", "long")):
        axes.plot(table["soc"], table[name], "o", color=colour, markersize=4.0, label=f"{text} time constant of a rest")
    axes.set_yscale("log")
    plain_log(axes.yaxis)
    axes.set_xlabel("state of charge")
    axes.set_ylabel("time constant [s]")
    axes.legend()
    return figure


def _over_time(table: pd.DataFrame, column: str, fitted: str, quantity: str, unit: str, ax: Axes | None) -> Figure:
    """Draw each run over time: readings and fit, and in its title the RMS of what is left."""
    runs = list(dict.fromkeys(table["run"]))[:_MOST_RUNS]
    figure, grid = _grid(len(runs), 5.5, ax)
    for axes, run in zip(grid.flat, runs, strict=False):
        part = table.loc[table["run"] == run]
        factor, unit_of_time = minutes_or_seconds(part["time_s"].to_numpy())
        time = factor * part["time_s"]
        axes.plot(time, part[column], ".", color=MEASURED, markersize=2.5, label="measured", rasterized=True)
        axes.plot(time, part[fitted], color=FINAL, lw=0.9, label="fitted", rasterized=True)
        rms = float(np.sqrt(np.mean((part[column] - part[fitted]) ** 2)))
        axes.set_title(f"{run}\nRMS {rms:.2g} {unit.replace('°C', 'K').removesuffix(', K')}", fontsize=8.5)
        axes.set_xlabel(f"time [{unit_of_time}]")
        axes.set_ylabel(axis_label(quantity, unit))
    grid[0, 0].legend()
    return figure


def _grid(count: int, height_cm: float, ax: Axes | None) -> tuple[Figure, np.ndarray]:
    """Return so many axes, two in a row, in a new figure; those of the caller where there are such."""
    if ax is not None:
        return one_axes(ax, PAGE_CM, height_cm)[0], np.array([[ax]])
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = new_figure(PAGE_CM, 1.5 + height_cm * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat[count:]:
        axes.set_visible(False)
    return figure, grid


def _friction(table: pd.DataFrame, ax: Axes | None) -> Figure:
    figure, axes = one_axes(ax, PAGE_CM, 8.5)
    axes.plot(
        table["speed_rad_s"],
        table["torque_Nm"],
        ".",
        color=MEASURED,
        markersize=3.0,
        label="k i less the load",
        rasterized=True,
    )
    axes.plot(table["speed_rad_s"], table["fit_Nm"], ".", color=FINAL, markersize=2.0, label="fitted", rasterized=True)
    axes.set_xlabel("speed [rad/s]")
    axes.set_ylabel("torque [N m]")
    axes.legend()
    return figure


@styled
def curves(case: Case, table: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw the tables of a cell over state of charge, a line for each of at most five temperatures.

    Args:
        case: with tables.
        table: the one to draw, such as "ocv"; by default all, each on axes of its own.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    names = [name for name in TABLES if name in case.tables]
    figure, grid = _grid(len(names) if table is None else 1, 5.0, ax)
    known = [degC for name in names if (degC := case.tables[name].temperature_degC) is not None]
    everywhere = np.concatenate([*known, np.zeros(0)])
    palette = colormaps[SEQUENCE]
    for axes, name in zip(grid.flat, names if table is None else [table], strict=False):
        drawn, unit = case.tables[name], TABLES[name]
        values = np.atleast_2d(drawn.values) * (1e3 if unit == "mΩ" else 1.0)
        degC = [None] if drawn.temperature_degC is None else list(drawn.temperature_degC)
        for row in np.unique(np.linspace(0, len(degC) - 1, min(len(degC), _MOST_LINES)).round().astype(int)):
            T, curve = degC[row], values[row]
            share = 0.5 if T is None else (T - everywhere.min()) / max(float(np.ptp(everywhere)), 1.0)
            # A pair of no resistance has a capacitance without meaning.
            shown = np.where(_exists(case, name, int(row)), curve, np.nan)
            axes.plot(drawn.soc, shown, color=palette(0.9 * share), label="" if T is None else f"{T:g} °C")
        if name != "ocv":
            axes.set_yscale("log")
            plain_log(axes.yaxis)
        axes.set_xlabel("state of charge")
        axes.set_ylabel(f"{name} [{unit}]")
        # The resistances and capacitances have the temperatures of the first of them.
        first = next((other for other in names if other != "ocv"), "")
        if degC[0] is not None and (name in ("ocv", first) or table is not None):
            axes.legend(fontsize=7, loc="lower right" if name == "ocv" else "upper right")
    return figure


def _exists(case: Case, name: str, row: int) -> np.ndarray | np.bool:
    """Return where an RC pair has a resistance worth drawing; True everywhere for other tables."""
    resistance = case.tables.get({"C_TS": "R_TS", "C_TL": "R_TL"}.get(name, name))
    if name == "ocv" or name == "R_ints" or resistance is None:
        return np.True_
    values = np.atleast_2d(resistance.values)
    own = values[min(row, len(values) - 1)]
    if own.shape != np.atleast_2d(case.tables[name].values)[row].shape:
        return np.True_
    return own > 5e-3 * np.median(values)
