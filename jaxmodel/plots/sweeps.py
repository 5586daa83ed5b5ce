"""Pictures of a sweep: a stored column over time, a metric over one or two axes, and the paper's tables beside ours.

Each takes the data set of `jaxmodel.sweeps.run`. What is not named is chosen: the first metric, the axes along which
its mean varies most; axes that are not drawn are held at their middle value, which the title states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from jaxmodel.base.errors import SweepError
from jaxmodel.base.units import split_unit
from jaxmodel.model.simulation import Status
from jaxmodel.plots.style import (
    BLUE,
    ORANGE,
    PAGE_CM,
    SEQUENCE,
    axis_label,
    minutes_or_seconds,
    new_figure,
    one_axes,
    power_of_ten,
    styled,
)
from jaxmodel.sweeps.results import NO_METRICS
from jaxmodel.sweeps.study import LANE

MOST_CURVES = 18  # as many as have room for their names at their ends
_SAME = 1e-12  # share of a metric's size by which rounding changes it


def label_of(dataset: xr.Dataset, name: str, power: str = "") -> str:
    """Return the label of an axis or variable of a sweep: its words and its unit, times a power of ten."""
    quantity, unit = split_unit(name)
    stated = dataset[name].attrs.get("units", "")
    unit = unit or {"degC": "°C"}.get(stated, stated)
    return axis_label(quantity, "" if unit and quantity.endswith(unit) else f"{power}{unit}".strip())


def metrics_in(dataset: xr.Dataset) -> list[str]:
    """Return the metrics of a sweep that have a value in any lane."""
    names = [str(n) for n, values in dataset.data_vars.items() if n not in NO_METRICS and "time_s" not in values.dims]
    return [name for name in names if np.isfinite(dataset[name]).any()]


def stored_in(dataset: xr.Dataset) -> list[str]:
    """Return the columns of a sweep that are stored over time."""
    return [str(name) for name, values in dataset.data_vars.items() if "time_s" in values.dims]


def axes_by_influence(dataset: xr.Dataset, name: str) -> list[str]:
    """Return the axes of a variable with two values or more, those along which its mean varies most first."""
    values = dataset[name]
    axes = [str(axis) for axis in values.dims if axis != "time_s" and values.sizes[axis] > 1]

    def spread(axis: str) -> float:
        means = values.mean([other for other in values.dims if other != axis])
        return float(means.max() - means.min())

    return sorted(axes, key=spread, reverse=True)


def that_nothing_changes(dataset: xr.Dataset, name: str) -> str:
    """Return in words along which axes a variable is the same in all lanes; "" where each axis changes it."""
    values = dataset[name]
    same = []
    for axis in axes_by_influence(dataset, name):
        extremes = values.max(axis), values.min(axis)
        scale = float(abs(values).max())
        if axis != LANE and bool(np.all((extremes[0] - extremes[1]).fillna(0.0) <= _SAME * scale)):
            same.append(axis)
    return f"{' and '.join(same)} {'change' if len(same) > 1 else 'changes'} nothing here" if same else ""


def outside_range(dataset: xr.Dataset, name: str) -> xr.DataArray:
    """Return where lanes left the range of the equations, or went where nothing can be."""
    outside = xr.zeros_like(dataset[name], dtype=bool)
    if "valid_share" in dataset:
        outside = outside | (dataset["valid_share"] < 1.0)
    if "status" in dataset:
        outside = outside | (dataset["status"] == Status.IMPOSSIBLE)
    return outside


def held_at_middle(dataset: xr.Dataset, drawn: Sequence[str]) -> tuple[xr.Dataset, str]:
    """Return a sweep at the middle value of every axis that is not drawn, and a title that states these values."""
    places = {str(axis): size // 2 for axis, size in dataset.sizes.items() if axis not in (*drawn, "time_s")}
    values = {axis: float(dataset[axis][place]) for axis, place in places.items() if axis in dataset.coords}
    return dataset.isel(places), ", ".join(f"{label_of(dataset, axis)} = {at:g}" for axis, at in values.items())


def first_metric(dataset: xr.Dataset) -> str:
    """Return the first metric of a sweep.

    Raises:
        SweepError: it has none, or none has a value.
    """
    if not (names := metrics_in(dataset)):
        raise SweepError("metric: no metric of this result has a value; look at its status.")
    return names[0]


def chosen_axes(dataset: xr.Dataset, name: str, given: Sequence[str | None]) -> list[str]:
    """Return the axes to draw over: those given, and the most influential of the others for each None.

    Raises:
        SweepError: too few axes vary.
    """
    others = [axis for axis in axes_by_influence(dataset, name) if axis not in given and axis != LANE]
    if len(others) < sum(axis is None for axis in given):
        varying = ", ".join(axis for axis in axes_by_influence(dataset, name)) or "nothing"
        raise SweepError(f"{name}: this picture takes {len(given)} axes, and the result varies along {varying}.")
    return [axis if axis is not None else others.pop(0) for axis in given]


@styled
def family(
    dataset: xr.Dataset,
    column: str | None = None,
    by: str | None = None,
    title: str | None = None,
    stated_slopes: Mapping[float, float] | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a stored column over time, one line for each value of an axis, or for some evenly picked values of many.

    Args:
        dataset: of `jaxmodel.sweeps.run`, from a study that stores columns.
        column: what is drawn; the first that is stored if not given.
        by: the axis; its values are distinguished by a colour from dark to light, and named at the lines' ends.
        title: states what is held fixed, if not given.
        stated_slopes: by value of the axis, the slope [1/s] that the paper prints, drawn dashed from the same start.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "current_A": [1.0, 2.0, 3.0]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> dataset = sweeps.run(study, progress=False)
        >>> plots.family(dataset, "voltage_V").axes[0].get_ylabel()
        'voltage [V]'
    """
    if column is None and not (stored := stored_in(dataset)):
        raise SweepError('column: this result has no column over time; name some in the study, as in store = ["soc"].')
    column = column if column is not None else stored[0]
    if by is None:
        by = LANE if LANE in dataset[column].dims else chosen_axes(dataset, column, [None])[0]
    dataset, held = held_at_middle(dataset, [by])
    dataset = _some_of(dataset, by)
    time_s = dataset["time_s"].to_numpy()
    factor, unit = minutes_or_seconds(time_s)
    time = (time_s - time_s[0]) * factor
    values = dataset[by].to_numpy()
    figure, axes = one_axes(ax, PAGE_CM, 9.0)
    colours = _colours(values.size)
    ends, stated_ends = [], []
    for place, (value, colour) in enumerate(zip(values, colours, strict=True)):
        line = dataset[column].isel({by: place}).to_numpy()
        axes.plot(time, line, color=colour, lw=1.8)
        ends.append(line[np.isfinite(line)][-1] if np.isfinite(line).any() else np.nan)
        slope = (stated_slopes or {}).get(float(value), np.nan)
        stated_ends.append(line[0] + slope * (time_s[-1] - time_s[0]))
        axes.plot([time[0], time[-1]], [line[0], stated_ends[-1]], color=colour, lw=1.1, ls=(0, (5, 2)))
    _name_ends(axes, np.tile(values, 2), np.array(ends + stated_ends), np.tile(colours, (2, 1)))
    if stated_slopes:
        axes.plot([], [], color="black", lw=1.8, label="this model")
        axes.plot([], [], color="black", lw=1.1, ls=(0, (5, 2)), label="slopes that the paper prints")
        axes.legend(loc="lower left")
    axes.set_xlim(0.0, time[-1])
    axes.set_xlabel(f"time [{unit}]")
    axes.set_ylabel(label_of(dataset, column))
    _head(axes, held if title is None else title, label_of(dataset, by))
    return figure


def _some_of(dataset: xr.Dataset, axis: str) -> xr.Dataset:
    """Return the data set with at most `MOST_CURVES` values of an axis, evenly picked."""
    size = dataset.sizes[axis]
    return dataset.isel({axis: np.unique(np.linspace(0, size - 1, min(MOST_CURVES, size)).astype(int))})


def _colours(count: int) -> np.ndarray:
    return matplotlib.colormaps[SEQUENCE](np.linspace(0.0, 0.82, count))


def _head(axes: Axes, title: str, right: str = "") -> None:
    """Write what is held fixed above the left end of an axis, and what the lines differ in above the right."""
    if title:
        axes.set_title(title, fontweight="normal", fontsize=8.5, color="#555555")
    if right:
        axes.set_title(right, loc="right", fontweight="normal", fontsize=8.5)


def _name_ends(axes: Axes, values: np.ndarray, ends: np.ndarray, colours: np.ndarray) -> None:
    """Write the values at the ends of the lines: one label for lines that end together, others moved apart."""
    low, high = axes.get_ylim()
    groups: list[list[int]] = []
    for number in np.argsort(ends):
        if not np.isfinite(ends[number]):
            continue
        if groups and ends[number] - ends[groups[-1][-1]] < 0.006 * (high - low):
            groups[-1].append(int(number))
        else:
            groups.append([int(number)])
    if not groups:
        return
    true_places = np.array([ends[group].mean() for group in groups])
    places = true_places.copy()
    for number in range(1, places.size):
        places[number] = max(places[number], places[number - 1] + 0.048 * (high - low))
    places -= (places - true_places).mean()
    for place, group in zip(places, groups, strict=True):
        named = np.unique(values[group])
        text = ", ".join(f"{v:g}" for v in named) if named.size <= 2 else f"{named[0]:g} to {named[-1]:g}"
        axes.annotate(
            text,
            (1.0, place),
            xytext=(5, 0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="center",
            fontsize=8.5,
            color=colours[group[len(group) // 2]],
            fontweight="bold",
        )


@styled
def heat_map(
    dataset: xr.Dataset,
    metric: str | None = None,
    x: str | None = None,
    y: str | None = None,
    title: str | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a metric over two axes; cells where the model left its range, or a run failed, are hatched.

    Args:
        dataset: of `jaxmodel.sweeps.run`, with two axes or more.
        metric: what is drawn; the first if not given.
        x: the horizontal axis.
        y: the vertical axis.
        title: states what is held fixed, if not given.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "current_A": [1.0, 2.0, 3.0]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> dataset = sweeps.run(study, progress=False)
        >>> plots.heat_map(dataset, "final_soc").axes[0].get_xlabel()
        'current [A]'
    """
    metric = metric if metric is not None else first_metric(dataset)
    x, y = chosen_axes(dataset, metric, [x, y])
    idle = that_nothing_changes(dataset, metric)
    dataset, held = held_at_middle(dataset, [x, y])
    table = dataset[metric].transpose(y, x).to_numpy()
    factor, power = power_of_ten(table)
    table = table * factor
    figure, axes = one_axes(ax, PAGE_CM, 10.0)
    finite = table[np.isfinite(table)]
    norm = Normalize(finite.min(), finite.max()) if finite.size else Normalize(0.0, 1.0)
    mesh = axes.pcolormesh(
        np.arange(table.shape[1] + 1), np.arange(table.shape[0] + 1), table, cmap=SEQUENCE, norm=norm
    )
    outside = outside_range(dataset, metric).transpose(y, x).to_numpy()
    for row, column in np.argwhere(outside):
        axes.add_patch(Rectangle((column, row), 1, 1, fill=False, hatch="////", lw=0.0, edgecolor="#ffffff60"))
    if table.size <= 120:
        for (row, column), number in np.ndenumerate(table):
            if np.isfinite(number):
                colour = "white" if norm(number) < 0.55 else "black"
                axes.text(
                    column + 0.5, row + 0.5, f"{number:.3g}", ha="center", va="center", fontsize=7.5, color=colour
                )
    _name_cells(axes.xaxis, dataset[x].to_numpy())
    _name_cells(axes.yaxis, dataset[y].to_numpy())
    note = "\nhatched: for some of the time outside the range of the equations" if outside.any() else ""
    axes.set_xlabel(label_of(dataset, x) + note)
    axes.set_ylabel(label_of(dataset, y))
    axes.grid(visible=False)
    figure.colorbar(mesh, ax=axes, label=label_of(dataset, metric, power), pad=0.02)
    _head(axes, held if title is None else title, idle)
    return figure


def _name_cells(axis, values: np.ndarray) -> None:
    every = max(1, -(-values.size // 12))
    places = np.arange(0, values.size, every)
    axis.set_ticks(places + 0.5, [f"{values[place]:.4g}" for place in places])


@styled
def metric_curves(
    dataset: xr.Dataset,
    metric: str | None = None,
    x: str | None = None,
    by: str | None = None,
    title: str | None = None,
    ax: Axes | None = None,
) -> Figure:
    """Draw a metric over one axis, one line for each value of another, of many for some evenly picked ones.

    Args:
        dataset: of `jaxmodel.sweeps.run`, with one axis or more.
        metric: what is drawn; the first if not given.
        x: the horizontal axis.
        by: the axis that the lines differ in; where x is given and this is not, there is one line.
        title: states what is held fixed, if not given.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "current_A": [1.0, 2.0, 3.0]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> dataset = sweeps.run(study, progress=False)
        >>> len(plots.metric_curves(dataset, "final_soc").axes[0].lines)
        2
    """
    metric = metric if metric is not None else first_metric(dataset)
    if x is None:
        x, *others = chosen_axes(dataset, metric, [None] * min(2, len(axes_by_influence(dataset, metric)) or 1))
        by = by if by is not None else next(iter(others), None)
    dataset, held = held_at_middle(dataset, [x] if by is None else [x, by])
    dataset = dataset if by is None else _some_of(dataset, by)
    figure, axes = one_axes(ax, PAGE_CM, 9.0)
    along = dataset[x].to_numpy()
    factor, power = power_of_ten(dataset[metric].to_numpy())
    if by is None:
        axes.plot(along, dataset[metric].to_numpy() * factor, "o-", color=BLUE, markersize=4.0)
    else:
        values = dataset[by].to_numpy()
        lines = [dataset[metric].sel({by: value}).to_numpy() * factor for value in values]
        for line, colour in zip(lines, _colours(values.size), strict=True):
            axes.plot(along, line, "o-", color=colour, markersize=3.5)
        _name_ends(axes, values, np.array([line[-1] for line in lines]), _colours(values.size))
    axes.set_xlabel(label_of(dataset, x))
    axes.set_ylabel(label_of(dataset, metric, power))
    _head(axes, held if title is None else title, label_of(dataset, by) if by else "")
    return figure


@styled
def against_paper(panels: Sequence[tuple[str, Mapping[float, float], Mapping[float, float]]]) -> Figure:
    """Draw discharge rates of the model beside those that the paper prints.

    Args:
        panels: for each the label of the horizontal axis, our rates and the paper's rates [1/s], by its values.

    Example:
        >>> from jaxmodel import plots
        >>> panels = [("SOC gradient", {0.0: 1.0, 20.0: 0.8}, {0.0: 1.1, 20.0: 0.8})]
        >>> figure = plots.against_paper(panels)
        >>> len(figure.axes)
        1
    """
    figure = new_figure(PAGE_CM, 8.0)
    grid = figure.subplots(1, len(panels), squeeze=False, sharey=True)
    for axes, (label, ours, printed) in zip(grid.flat, panels, strict=True):
        axes.plot(list(ours), [1e4 * v for v in ours.values()], "o-", color=BLUE, label="this model, eqs. 1 to 22")
        axes.plot(
            list(printed),
            [1e4 * v for v in printed.values()],
            "s--",
            color=ORANGE,
            markerfacecolor="white",
            label="as the paper prints it",
        )
        axes.set_xlabel(label)
    grid[0, 0].set_ylabel("change of the state of charge [10⁻⁴ / s]")
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure
