"""Pictures of many lanes of a sweep: as lines through all that lanes differ in, as points, or as panels of maps."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib
import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from jaxmodel.plots.style import (
    PAGE_CM,
    SEQUENCE,
    new_figure,
    one_axes,
    power_of_ten,
    styled,
)
from jaxmodel.plots.sweeps import (
    axes_by_influence,
    chosen_axes,
    first_metric,
    held_at_middle,
    label_of,
    metrics_in,
    outside_range,
    that_nothing_changes,
)

MOST_LINES = 1500
MOST_METRICS = 4
MOST_PANELS = (4, 3)


def varied_in(dataset: xr.Dataset) -> list[str]:
    """Return the names in which lanes differ: axes of two values or more, and what was drawn."""
    return [str(name) for name, values in dataset.coords.items() if name not in ("time_s", "lane") and values.size > 1]


def table_of(dataset: xr.Dataset, names: Sequence[str], most: int) -> pd.DataFrame:
    """Return one line per lane with some names, of at most so many lanes, evenly picked."""
    per_lane = dataset.drop_dims("time_s", errors="ignore")
    columns = xr.broadcast(*(per_lane[name] for name in names), per_lane["status"])[:-1]
    flat = {name: values.to_numpy().ravel() for name, values in zip(names, columns, strict=True)}
    table = pd.DataFrame(flat).dropna()
    return table.iloc[np.unique(np.linspace(0, len(table) - 1, min(most, len(table))).astype(int))]


@styled
def parallel(
    dataset: xr.Dataset,
    varied: Sequence[str] | None = None,
    metrics: Sequence[str] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw lanes as lines through what they differ in and the first few metrics, coloured by the first metric.

    Args:
        dataset: of `jaxmodel.sweeps.run`; of many lanes some, evenly picked, are drawn.
        varied: names in which lanes differ; all if not given.
        metrics: those with a value if not given.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    varied = varied_in(dataset) if varied is None else varied
    metrics = list((metrics_in(dataset) if metrics is None else metrics)[:MOST_METRICS])
    names = [*varied, *metrics]
    table = table_of(dataset, names, MOST_LINES)
    low, high = table.min().to_numpy(), table.max().to_numpy()
    shares = (table.to_numpy() - low) / np.where(high > low, high - low, 1.0)
    places = np.arange(len(names))
    order = np.argsort(np.abs(shares[:, len(varied)] - 0.5))  # the extremes on top
    lines = np.stack([np.broadcast_to(places, shares.shape), shares], axis=-1)[order]
    figure, axes = one_axes(ax, PAGE_CM, 9.5)
    colours = matplotlib.colormaps[SEQUENCE](0.9 * shares[order, len(varied)])
    axes.add_collection(LineCollection(list(lines), colors=list(colours), lw=0.7, alpha=0.6))
    for number, (least, most) in enumerate(zip(low, high, strict=True)):
        place = float(number)
        axes.plot([place, place], [0.0, 1.0], color="black", lw=0.8)
        axes.text(place, -0.03, f"{least:.4g}", ha="center", va="top", fontsize=7.5)
        axes.text(place, 1.03, f"{most:.4g}", ha="center", va="bottom", fontsize=7.5)
    axes.set_xlim(-0.3, len(names) - 0.7)
    axes.set_ylim(-0.1, 1.1)
    axes.set_yticks([])
    labels = [label_of(dataset, name).replace(" [", "\n[") for name in names]
    axes.set_xticks(places, labels, rotation=25, ha="right", fontsize=7.5)
    axes.grid(visible=False)
    axes.set_title(
        f"colour: {label_of(dataset, metrics[0])}; {len(table):,} lanes",
        fontweight="normal", fontsize=8.5, color="#555555",
    )  # fmt: skip
    return figure


@styled
def points(
    dataset: xr.Dataset, metric: str | None = None, varied: Sequence[str] | None = None, ax: Axes | None = None
) -> Figure:
    """Draw a metric of sampled lanes over the name with the largest rank correlation, coloured by the next.

    Args:
        dataset: of `jaxmodel.sweeps.run`; of many lanes some, evenly picked, are drawn.
        metric: what is drawn; the first if not given.
        varied: names in which lanes differ; all if not given.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    metric = metric if metric is not None else first_metric(dataset)
    varied = varied_in(dataset) if varied is None else varied
    table = table_of(dataset, [*varied, metric], 5 * MOST_LINES)
    ranks = table.rank().to_numpy()
    spread = ranks.std(axis=0)
    covariance = ((ranks - ranks.mean(axis=0)) * (ranks[:, -1:] - ranks[:, -1].mean())).mean(axis=0)
    strength = np.abs(covariance[:-1]) / np.where(spread[:-1] > 0.0, spread[:-1], np.inf)
    names = [str(varied[place]) for place in np.argsort(-strength)]
    first, others = names[0], names[1:]
    figure, axes = one_axes(ax, PAGE_CM, 9.0)
    factor, power = power_of_ten(table[metric].to_numpy())
    colours = table[others[0]].to_numpy() if others else None
    drawn = axes.scatter(table[first], table[metric] * factor, c=colours, cmap=SEQUENCE, s=5.0, lw=0.0)
    axes.set_xlabel(label_of(dataset, first))
    axes.set_ylabel(label_of(dataset, metric, power))
    if others:
        figure.colorbar(drawn, ax=axes, label=label_of(dataset, others[0]), pad=0.02)
    return figure


@styled
def panels(
    dataset: xr.Dataset,
    metric: str | None = None,
    over: Sequence[str] | None = None,
    by: Sequence[str] | None = None,
    title: str | None = None,
) -> Figure:
    """Draw heat maps of a metric over two axes, side by side for values of a third, below each other for a fourth.

    Args:
        dataset: of `jaxmodel.sweeps.run`, with three axes or more.
        metric: what is drawn, the first if not given; one scale of colours serves all panels.
        over: the horizontal and the vertical axis of each panel.
        by: the axis across the panels and, if there is a fourth, the one down; of many values a few evenly picked.
        title: states what is held fixed, if not given.
    """
    metric = metric if metric is not None else first_metric(dataset)
    over = chosen_axes(dataset, metric, [None, None]) if over is None else over
    if by is None:
        left = [axis for axis in axes_by_influence(dataset, metric) if axis not in over]
        by = left[:2] or chosen_axes(dataset, metric, [*over, None])[2:]
    idle = that_nothing_changes(dataset, metric)
    dataset, held = held_at_middle(dataset, [*over, *by])
    title = "; ".join(part for part in (held if title is None else title, idle) if part)
    picked = [
        np.unique(np.linspace(0, dataset.sizes[axis] - 1, min(most, dataset.sizes[axis])).astype(int))
        for axis, most in zip(by, MOST_PANELS, strict=False)
    ]
    rows = picked[1] if len(by) > 1 else np.zeros(1, dtype=int)
    values = dataset[metric].transpose(*reversed(over), *by)
    factor, power = power_of_ten(values.to_numpy())
    finite = values.to_numpy()[np.isfinite(values.to_numpy())] * factor
    norm = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0.0, 1.0)
    outside = outside_range(dataset, metric).transpose(*reversed(over), *by)
    figure = new_figure(PAGE_CM, 3.0 + 4.0 * rows.size)
    grid = figure.subplots(rows.size, picked[0].size, squeeze=False, sharex=True, sharey=True)
    x, y = (dataset[axis].to_numpy() for axis in over)
    for (row, column), axes in np.ndenumerate(grid):
        at = {by[0]: picked[0][column]} | ({by[1]: rows[row]} if len(by) > 1 else {})
        axes.pcolormesh(values.isel(at).to_numpy() * factor, cmap=SEQUENCE, norm=norm)
        invalid = outside.isel(at).to_numpy()
        if invalid.any():
            axes.pcolor(np.ma.masked_where(~invalid, invalid), hatch="////", alpha=0.0)
        said = [f"{label_of(dataset, axis)} = {float(dataset[axis][place]):.4g}" for axis, place in at.items()]
        axes.set_title("\n".join(said), fontweight="normal", fontsize=6.5)
        for axis, numbers in ((axes.xaxis, x), (axes.yaxis, y)):
            places = np.unique(np.linspace(0, numbers.size - 1, min(4, numbers.size)).astype(int))
            axis.set_ticks(places + 0.5, [f"{numbers[place]:.4g}" for place in places], fontsize=6.5)
        axes.grid(visible=False)
    note = "\nhatched: for some of the time outside the range of the cell's equations" if bool(outside.any()) else ""
    figure.supxlabel(label_of(dataset, over[0]) + note, fontsize=8.5)
    figure.supylabel(label_of(dataset, over[1]), fontsize=8.5)
    if title:
        figure.suptitle(title, fontsize=8.5, color="#555555")
    figure.colorbar(ScalarMappable(norm, SEQUENCE), ax=grid, label=label_of(dataset, metric, power), pad=0.02)
    return figure
