"""One run: measurements, predictions and residuals."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.case.records import Run
from jaxmodel.plots.panels import Row, legend_cm, panels
from jaxmodel.plots.style import (
    BASE,
    BLACK,
    FINAL,
    FLOOR,
    GREY,
    LINES,
    MEASURED,
    axis_label,
    column_label,
    drawn_rows,
    minutes_or_seconds,
    residual_scale,
    styled,
)

Predictions = Mapping[str, np.ndarray]
_SIDE_BY_SIDE = 3  # channels on a page
# Space left of a panel, from its edge to the bottom of its label, and below the last for times.
_LEFT_CM, _LABEL_CM, _TIME_CM = 2.0, 1.1, 1.05
_NOISE, _INVALID = "noise, ±2 sd", "equations out of range"
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
        valid: by row, False where the equations are outside their valid range; those spans are shaded.

    Example:
        >>> from jaxmodel import plots, read_case, simulate_case
        >>> one = simulate_case(read_case("examples/samsung_30q"), progress=False)[0]
        >>> model = {"voltage_V": one.table["voltage_V"].to_numpy()}
        >>> len(plots.fit_and_residuals(one.run, {"as stated": model}, {"voltage_V": 0.001}).axes)
        2
    """
    channels = channels_read(run, noise_sd)
    factor, unit = minutes_or_seconds(run.measured.time_s)
    time = (run.measured.time_s - run.measured.time_s[0]) * factor
    columns = _SIDE_BY_SIDE if len(channels) > _SIDE_BY_SIDE else len(channels)
    blocks = -(-len(channels) // columns)
    invalid = np.zeros(time.size, dtype=bool) if valid is None else ~valid
    legend = ["measured", *models, _NOISE, *([_INVALID] if invalid.any() else [])]
    drawn = panels(
        _pairs_of_rows(blocks, full=len(channels) == blocks * columns),
        columns,
        left_cm=_LEFT_CM,
        between_cm=_LEFT_CM,
        top_cm=0.3,
        bottom_cm=_TIME_CM + legend_cm(legend),
    )
    handles: dict[str, Any] = {}
    for place, channel in enumerate(channels):
        block, column = divmod(place, columns)
        above, below = drawn.grid[2 * block : 2 * block + 2, column]
        measured = run.measured.outputs[channel]
        rows = drawn_rows([measured, *(measured - predictions[channel] for predictions in models.values())])
        at, measured = time[rows], measured[rows]
        above.plot(at, measured, ".", color=MEASURED, markersize=2.5, label="measured", rasterized=True)
        for colour, (name, predictions) in zip(model_colours(len(models)), models.items(), strict=True):
            above.plot(at, predictions[channel][rows], color=colour, label=name)
        drawn.label_y(above, _in_two_lines(channel) if blocks > 1 else column_label(channel), _LABEL_CM)
        residuals = {name: measured - predictions[channel][rows] for name, predictions in models.items()}
        shown_unit = draw_residuals(below, at, residuals, noise_sd[channel], split_unit(channel)[1])
        label = axis_label("residual", shown_unit)
        drawn.label_y(below, label.replace(" ", "\n", 1) if blocks > 1 else label, _LABEL_CM)
        for axes in (above, below):
            _shade(axes, at, invalid[rows])
            for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(name, handle)
        if place + columns >= len(channels):
            below.set_xlabel(f"time [{unit}]")
            below.tick_params(labelbottom=True)
    for axes in drawn.grid[-2:, len(channels) - (blocks - 1) * columns :].flat:
        axes.set_visible(False)
    drawn.legend([handles[name] for name in legend], legend, markerscale=2.0)
    return drawn.figure


def _pairs_of_rows(blocks: int, full: bool) -> list[Row]:
    """Return rows of readings, with their residuals below; where a block is not full, times stand above its gap too."""
    above, below = (4.4, 2.9) if blocks == 1 else (3.2, 2.1)
    rows = [Row(above), Row(below, 0.55)] * blocks
    if not full:
        rows[-3] = Row(below, 0.3 + _TIME_CM)
    return rows


def _in_two_lines(column: str) -> str:
    return column_label(column).replace(" [", "\n[")


def draw_residuals(axes: Axes, x: np.ndarray, residuals: Mapping[str, np.ndarray], noise_sd: float, unit: str) -> str:
    """Draw residuals of some models over x, with the band of the noise; return the unit."""
    everything = np.concatenate(list(residuals.values()))
    scale, shown_unit = readable(everything, difference_unit(unit))
    axes.axhspan(-2 * noise_sd * scale, 2 * noise_sd * scale, color=FLOOR, alpha=0.25, lw=0, label=_NOISE)
    axes.axhline(0.0, color=GREY, lw=0.7)
    for colour, values in zip(model_colours(len(residuals)), residuals.values(), strict=True):
        axes.plot(x, values * scale, ".", color=colour, markersize=2.0, rasterized=True)
    residual_scale(axes, [values * scale for values in residuals.values()], noise_sd * scale)
    return shown_unit


def model_colours(count: int) -> tuple[str, ...]:
    """Return the colours of some models, the better one last."""
    return (BASE, FINAL, *LINES[2:])[:count]


@styled
def residuals_by_condition(
    residuals: Mapping[str, Mapping[str, np.ndarray]],
    conditions: Mapping[str, np.ndarray],
    noise_sd: Mapping[str, float],
) -> Figure:
    """Draw residuals over the conditions of the readings, with the mean in each of twelve equal parts.

    Args:
        residuals: by model, then by channel, all runs one after the other, shape (n,); NaN where nothing was read.
        conditions: by column name (state of charge, current, temperature), each of shape (n,).
        noise_sd: the noise floor of each channel to draw.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import plots
        >>> soc = np.linspace(0.0, 1.0, 200)
        >>> residuals = {"as stated": {"voltage_V": 0.01 * np.sin(6.0 * soc)}}
        >>> len(plots.residuals_by_condition(residuals, {"soc": soc}, {"voltage_V": 0.001}).axes)
        1
    """
    channels = [name for name in noise_sd if any(np.any(np.isfinite(r[name])) for r in residuals.values())]
    crowded = len(channels) > _SIDE_BY_SIDE
    legend = [_NOISE, *residuals]
    drawn = panels(
        [Row(3.4 if crowded else 4.6)] * len(channels),
        len(conditions),
        left_cm=_LEFT_CM + (0.5 if crowded else 0.0),
        between_cm=0.6,
        top_cm=0.3,
        bottom_cm=0.4 + _TIME_CM + legend_cm(legend),
        share_y="row",
    )
    for row, channel in enumerate(channels):
        unit = difference_unit(split_unit(channel)[1])
        everything = np.concatenate([by_channel[channel] for by_channel in residuals.values()])
        scale, shown_unit = readable(everything, unit)
        floor = noise_sd[channel] * scale
        for column, (condition, x) in enumerate(conditions.items()):
            axes = drawn.grid[row, column]
            axes.axhspan(-2 * floor, 2 * floor, color=FLOOR, alpha=0.25, lw=0, label=_NOISE)
            for colour, (name, by_channel) in zip(model_colours(len(residuals)), residuals.items(), strict=True):
                y = by_channel[channel] * scale
                axes.plot(x, y, ".", color=colour, markersize=1.3, alpha=0.18, rasterized=True)
                axes.plot(*_means(x, y), "o-", color=colour, markersize=4.0, lw=1.3, label=name, **_WHITE_EDGE)
            axes.axhline(0.0, color=GREY, lw=0.7)
            if row == len(channels) - 1:
                axes.set_xlabel(_in_two_lines(condition))
        residual_scale(drawn.grid[row, 0], [by_channel[channel] * scale for by_channel in residuals.values()], floor)
        quantity = split_unit(channel)[0].replace(" ", "\n" if crowded else " ")
        label = axis_label(f"{quantity} residual", shown_unit).replace(" [", "\n[" if crowded else " [")
        drawn.label_y(drawn.grid[row, 0], label, _LABEL_CM + (0.15 if crowded else 0.0))
    drawn.legend(*drawn.grid[0, 0].get_legend_handles_labels())
    return drawn.figure


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

    Example:
        >>> from jaxmodel import plots, read_case, simulate_case
        >>> one = simulate_case(read_case("examples/samsung_30q"), progress=False)[0]
        >>> len(plots.simulation("1C", one.table, one.run).axes)
        5
    """
    inputs = run.measured.inputs
    if shown_inputs is None:
        shown_inputs = [n for n, values in inputs.items() if np.ptp(values) > 0.0] or list(inputs)[:1]
    readings = [n for n in table.columns if n not in ("time_s", "valid")]
    time_s = table["time_s"].to_numpy()
    factor, unit = minutes_or_seconds(time_s)
    time = (time_s - time_s[0]) * factor
    shown = [*shown_inputs, *readings]
    columns = 2 if len(shown) > 6 else 1
    rows = -(-len(shown) // columns)
    drawn = panels([Row(3.0)] * rows, columns, left_cm=_LEFT_CM, between_cm=_LEFT_CM, top_cm=1.0, bottom_cm=_TIME_CM)
    grid = drawn.grid
    legend_shown = False
    for axes, panel in zip(grid.T.flat, shown, strict=False):
        measured = run.measured.outputs.get(panel)
        if panel in shown_inputs:
            seen = drawn_rows([inputs[panel]])
            axes.step(time[seen], inputs[panel][seen], where="pre", color=BLACK, lw=1.0)
        else:
            model = table[panel].to_numpy()
            seen = drawn_rows([model] if measured is None else [model, measured])
            axes.plot(time[seen], model[seen], color=BASE, label="model")
            if measured is not None and np.any(np.isfinite(measured)):
                axes.plot(time[seen], measured[seen], ".", color=MEASURED, markersize=2.5, zorder=1.5, label="measured")
        axes.locator_params(nbins=5)
        drawn.label_y(axes, _in_two_lines(panel), _LABEL_CM)
        _shade(axes, time[seen], ~table["valid"].to_numpy(dtype=bool)[seen])
        if not legend_shown and len(axes.get_legend_handles_labels()[1]) > 1:
            axes.legend(loc="best", markerscale=3)
            legend_shown = True
    for axes in grid.T.flat[len(shown) :]:
        axes.set_visible(False)
    for column in range(columns):
        last = grid[min(rows, len(shown) - column * rows) - 1, column]
        last.tick_params(labelbottom=True)
        last.set_xlabel(f"time [{unit}]")
    drawn.figure.suptitle(f"{name}: {run.label}" if run.label else name, fontsize=10.5, x=0.01, ha="left")
    return drawn.figure


def _shade(axes: Axes, time: np.ndarray, invalid: np.ndarray) -> None:
    """Shade the rows in which the equations are outside their valid range."""
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
            label=_INVALID if first == edges[0] else None,
        )
