"""One run: what was measured, what the models predict, and what is left."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.cases import Run
from workbench.pictures.style import (
    BASE,
    BLACK,
    FINAL,
    FLOOR,
    GREY,
    LINES,
    MEASURED,
    PAGE_CM,
    axis_label,
    column_label,
    difference_unit,
    minutes_or_seconds,
    new_figure,
    readable,
    residual_scale,
    split_unit,
    styled,
)

Predictions = Mapping[str, np.ndarray]
_SIDE_BY_SIDE = 3  # channels on a page
_LEFT_CM, _LABEL_CM = 2.0, 1.25  # of a panel: room for its labels, and from its edge to the middle of its label
_WHITE_EDGE: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.5}


def channels_read(run: Run, names: Iterable[str]) -> list[str]:
    """Return those channels of which a run has a reading."""
    return [name for name in names if np.any(np.isfinite(run.measured.outputs.get(name, np.nan)))]


@styled
def fit_and_residuals(
    run: Run, models: Mapping[str, Predictions], noise_sd: Mapping[str, float], valid: np.ndarray | None = None
) -> Figure:
    """Draw measurement, models and residuals of one run, a column for each measured channel.

    Args:
        run: the run, with readings of one channel at least.
        models: predictions by channel of one or two models, by the name in the legend; the better one last.
        noise_sd: the noise floor of each channel to draw, in the channel's unit.
        valid: by row, False where the equations leave the range in which they make sense; those spans are shaded.
    """
    channels = channels_read(run, noise_sd)
    factor, unit = minutes_or_seconds(run.measured.time_s)
    time = (run.measured.time_s - run.measured.time_s[0]) * factor
    columns = _SIDE_BY_SIDE if len(channels) > _SIDE_BY_SIDE else len(channels)
    blocks = -(-len(channels) // columns)
    figure = new_figure(PAGE_CM, 2.0 + (7.5 if blocks == 1 else 6.2) * blocks)
    grid = figure.subplots(
        2 * blocks, columns, sharex=True, squeeze=False, gridspec_kw={"height_ratios": (3, 2) * blocks}
    )
    for place, channel in enumerate(channels):
        block, column = divmod(place, columns)
        above, below = grid[2 * block : 2 * block + 2, column]
        measured = run.measured.outputs[channel]
        above.plot(time, measured, ".", color=MEASURED, markersize=2.5, label="measured", rasterized=True)
        for colour, (name, predictions) in zip(_model_colours(len(models)), models.items(), strict=True):
            above.plot(time, predictions[channel], color=colour, label=name)
        above.set_ylabel(_in_two_lines(channel) if blocks > 1 else column_label(channel))
        residuals = {name: measured - predictions[channel] for name, predictions in models.items()}
        draw_residuals(below, time, residuals, noise_sd[channel], split_unit(channel)[1])
        for axes in (above, below):
            _shade(axes, time, np.zeros(time.size, dtype=bool) if valid is None else ~valid)
        if blocks > 1:
            below.set_ylabel(below.get_ylabel().replace(" ", "\n", 1))
        if place + columns >= len(channels):
            below.set_xlabel(f"time [{unit}]")
            below.tick_params(labelbottom=True)
    for axes in grid[-2:, len(channels) - (blocks - 1) * columns :].flat:
        axes.set_visible(False)
    figure.align_ylabels()
    legend = dict(zip(*reversed(grid[0, 0].get_legend_handles_labels()), strict=True))
    legend |= dict(zip(*reversed(grid[1, 0].get_legend_handles_labels()), strict=True))
    figure.legend(
        legend.values(), legend.keys(), loc="outside lower center", ncols=_legend_columns(legend), markerscale=2
    )
    return figure


def _in_two_lines(column: str) -> str:
    return column_label(column).replace(" [", "\n[")


def draw_residuals(axes: Axes, x: np.ndarray, residuals: Mapping[str, np.ndarray], noise_sd: float, unit: str) -> None:
    """Draw residuals of some models over x, with the band in which noise alone would leave them."""
    everything = np.concatenate(list(residuals.values()))
    scale, shown_unit = readable(everything, difference_unit(unit))
    axes.axhspan(-2 * noise_sd * scale, 2 * noise_sd * scale, color=FLOOR, alpha=0.25, lw=0, label="noise, ±2 sd")
    axes.axhline(0.0, color=GREY, lw=0.7)
    for colour, values in zip(_model_colours(len(residuals)), residuals.values(), strict=True):
        axes.plot(x, values * scale, ".", color=colour, markersize=2.0, rasterized=True)
    residual_scale(axes, [values * scale for values in residuals.values()], noise_sd * scale)
    axes.set_ylabel(axis_label("residual", shown_unit))


def _model_colours(count: int) -> tuple[str, ...]:
    return (BASE, FINAL, *LINES[2:])[:count]


@styled
def residuals_by_condition(
    residuals: Mapping[str, Mapping[str, np.ndarray]],
    conditions: Mapping[str, np.ndarray],
    noise_sd: Mapping[str, float],
) -> Figure:
    """Draw residuals against the conditions under which they arose, with the mean in each of twelve equal parts.

    Args:
        residuals: by model, then by channel, all runs one after the other, shape (n,); NaN where nothing was read.
        conditions: by column name (state of charge, current, temperature), each of shape (n,).
        noise_sd: the noise floor of each channel to draw.
    """
    channels = [name for name in noise_sd if any(np.any(np.isfinite(r[name])) for r in residuals.values())]
    crowded = len(channels) > _SIDE_BY_SIDE
    figure = new_figure(PAGE_CM, 2.0 + (3.6 if crowded else 5.2) * len(channels))
    grid = figure.subplots(len(channels), len(conditions), sharex="col", sharey="row", squeeze=False)
    for row, channel in enumerate(channels):
        unit = difference_unit(split_unit(channel)[1])
        everything = np.concatenate([by_channel[channel] for by_channel in residuals.values()])
        scale, shown_unit = readable(everything, unit)
        floor = noise_sd[channel] * scale
        for column, (condition, x) in enumerate(conditions.items()):
            axes = grid[row, column]
            axes.axhspan(-2 * floor, 2 * floor, color=FLOOR, alpha=0.25, lw=0, label="noise, ±2 sd")
            for colour, (name, by_channel) in zip(_model_colours(len(residuals)), residuals.items(), strict=True):
                y = by_channel[channel] * scale
                axes.plot(x, y, ".", color=colour, markersize=1.3, alpha=0.18, rasterized=True)
                axes.plot(*_means(x, y), "o-", color=colour, markersize=4.0, lw=1.3, label=name, **_WHITE_EDGE)
            axes.axhline(0.0, color=GREY, lw=0.7)
            if row == len(channels) - 1:
                axes.set_xlabel(_in_two_lines(condition))
        residual_scale(grid[row, 0], [by_channel[channel] * scale for by_channel in residuals.values()], floor)
        quantity = split_unit(channel)[0].replace(" ", "\n" if crowded else " ")
        grid[row, 0].set_ylabel(
            axis_label(f"{quantity} residual", shown_unit).replace(" [", "\n[" if crowded else " [")
        )
    figure.align_ylabels()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=_legend_columns(labels))
    return figure


def _legend_columns(labels: Collection[str]) -> int:
    """Return how many entries of a legend stand side by side on a page."""
    return len(labels) if sum(len(label) + 6 for label in labels) < 90 else 2


def _means(x: np.ndarray, y: np.ndarray, parts: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of x and of y in parts of equal count; values of x that repeat stay in one part."""
    read = np.isfinite(x) & np.isfinite(y)
    x, y = x[read], y[read]
    if x.size == 0:
        return x, y
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, parts + 1)))
    part = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(edges.size - 2, 0))
    groups = [part == number for number in np.unique(part)]
    return np.array([x[g].mean() for g in groups]), np.array([y[g].mean() for g in groups])


@styled
def simulation(name: str, table: pd.DataFrame, run: Run, shown_inputs: Sequence[str] | None = None) -> Figure:
    """Draw a simulated run: its inputs, then every reading, with the measured values where there are any.

    Args:
        name: for the title.
        table: time_s, readings and `valid`.
        run: the run that was simulated.
        shown_inputs: inputs to draw; None takes all that change, or the first where none does.
    """
    inputs = run.measured.inputs
    if shown_inputs is None:
        shown_inputs = [n for n, values in inputs.items() if np.ptp(values) > 0.0] or list(inputs)[:1]
    readings = [n for n in table.columns if n not in ("time_s", "valid")]
    time_s = table["time_s"].to_numpy()
    factor, unit = minutes_or_seconds(time_s)
    time = (time_s - time_s[0]) * factor
    panels = [*shown_inputs, *readings]
    columns = 2 if len(panels) > 6 else 1
    rows = -(-len(panels) // columns)
    grid = _stack(rows, columns)
    figure = grid[0, 0].figure
    legend_shown = False
    for axes, panel in zip(grid.T.flat, panels, strict=False):
        if panel in shown_inputs:
            axes.step(time, inputs[panel], where="pre", color=BLACK, lw=1.0)
        else:
            axes.plot(time, table[panel], color=BASE, label="model")
            measured = run.measured.outputs.get(panel)
            if measured is not None and np.any(np.isfinite(measured)):
                axes.plot(time, measured, ".", color=MEASURED, markersize=2.5, zorder=1.5, label="measured")
        axes.set_ylabel(_in_two_lines(panel), fontsize=8.0)
        axes.yaxis.set_label_coords(-_LABEL_CM / _panel_width_cm(columns), 0.5)
        _shade(axes, time, ~table["valid"].to_numpy(dtype=bool))
        if not legend_shown and len(axes.get_legend_handles_labels()[1]) > 1:
            axes.legend(loc="best", markerscale=3)
            legend_shown = True
    for axes in grid.T.flat[len(panels) :]:
        axes.set_visible(False)
    for column in range(columns):
        last = grid[min(rows, len(panels) - column * rows) - 1, column]
        last.tick_params(labelbottom=True)
        last.set_xlabel(f"time [{unit}]")
    figure.suptitle(f"{name}: {run.label}" if run.label else name, fontsize=10.5, x=0.01, ha="left")
    return figure


def _panel_width_cm(columns: int) -> float:
    return PAGE_CM / columns - _LEFT_CM - 0.3


def _stack(rows: int, columns: int) -> np.ndarray:
    """Return panels above each other at places set by hand: an engine that measures every label takes twice as long."""
    height = 2.2 + 3.1 * rows
    figure = new_figure(PAGE_CM, height, layout="none")
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    figure.subplots_adjust(
        left=_LEFT_CM / PAGE_CM,
        right=1.0 - 0.3 / PAGE_CM,
        wspace=(_LEFT_CM + 0.3) / _panel_width_cm(columns),
        bottom=1.2 / height,
        top=1.0 - 1.0 / height,
        hspace=0.12,
    )
    for axes in grid.flat:
        axes.locator_params(nbins=5)
    return grid


def _shade(axes: Axes, time: np.ndarray, invalid: np.ndarray) -> None:
    """Shade the rows in which the equations left the range in which they make sense."""
    if not invalid.any():
        return
    edges = np.flatnonzero(np.diff(np.concatenate([[0], invalid.astype(int), [0]])))
    for first, after in edges.reshape(-1, 2):
        axes.axvspan(
            float(time[first]),
            float(time[min(after, time.size - 1)]),
            color=LINES[3],
            alpha=0.15,
            lw=0,
            label="equations out of range" if first == edges[0] else None,
        )
