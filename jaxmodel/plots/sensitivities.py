"""Pictures of how a run depends on its parameters: derivatives beside the paper's doubling, over time, by pairs.

Where no metric or reading is named, the first of the data set is drawn.
"""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure

from jaxmodel.base.errors import SweepError
from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.plots.style import (
    BLUE,
    GREY,
    ORANGE,
    PAGE_CM,
    axis_label,
    column_label,
    legend,
    minutes_or_seconds,
    new_figure,
    one_axes,
    power_of_ten,
    styled,
)


def first_of(data: xr.Dataset, dimension: str) -> str:
    """Return the first metric or output of a data set.

    Raises:
        SweepError: it has none.
    """
    if not data.sizes.get(dimension):
        raise SweepError(f"{dimension}: this result has none to draw; name some in the study.")
    return str(data[dimension].to_numpy()[0])


_SEEN = 1e-3  # of the largest change: what is smaller is not drawn
_DIAMOND: dict[str, Any] = {"color": "white", "markeredgecolor": "black", "markersize": 4.5, "ls": "none"}


@styled
def doubling_beside_gradient(
    data: xr.Dataset, metric: str | None = None, most: int = 16, ax: Axes | None = None
) -> Figure:
    """Draw the change of a metric when each parameter is doubled, beside what its derivative alone predicts.

    A metric that has no proportional change, a temperature, is drawn in its own unit.

    Args:
        data: as `jaxmodel.sensitivity.local` returns it, with the doubling test.
        metric: one of its metrics.
        most: parameters to draw, those with the largest changes; those that change nothing are left out.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> figure = plots.doubling_beside_gradient(sensitivity.local(study, progress=False), "final_soc")
        >>> figure.axes[0].get_xlabel()
        'change of final soc [%]'
    """
    metric = metric if metric is not None else first_of(data, "metric")
    chosen = data.sel(metric=metric)
    proportional = bool(np.isfinite(chosen["linear"]).any())
    if proportional:
        by_gradient, simulated, power_law = (100.0 * chosen[name] for name in ("linear", "effect", "power_law"))
        unit = "%"
    else:
        by_gradient, simulated = chosen["linear_change"], chosen["metric_moved"] - chosen["metric_value"]
        power_law, unit = xr.full_like(by_gradient, np.nan), difference_unit(str(chosen["metric_unit"].item()))
    size = np.nan_to_num(np.fmax(abs(by_gradient.to_numpy()), abs(simulated.to_numpy())))
    order = [place for place in np.argsort(-size)[:most] if size[place] > _SEEN * size.max()]
    names = [_with_step(chosen.isel(parameter=place)) for place in order]
    places = np.arange(len(order))
    figure, axes = one_axes(ax, PAGE_CM, 3.0 + 0.8 * len(order))
    axes.barh(places - 0.2, by_gradient[order], height=0.36, color=BLUE, label="predicted by the gradient")
    axes.barh(places + 0.2, simulated[order], height=0.36, color=ORANGE, label="simulated, the parameter doubled")
    if proportional:
        axes.plot(
            power_law[order], places + 0.2, "D", label="predicted by the power law 2ᵉ - 1, e the elasticity", **_DIAMOND
        )
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(axis_label(f"change of {split_unit(metric)[0]}", unit))
    legend(ax, axes, "outside lower center", 2)
    return figure


def _with_step(one: xr.Dataset) -> str:
    """Return a parameter's name, with its step where that is no doubling."""
    name = str(one["parameter"].item())
    if bool(one["doubles"]):
        return name
    unit = difference_unit(str(one["unit"].item()))
    return f"{name} ({float(one['step']):+g}{' ' if unit else ''}{unit})"


@styled
def elasticities(local: xr.Dataset, most: int = 14, ax: Axes | None = None) -> Figure:
    """Draw the elasticity of every metric by every parameter as a table of colours.

    Args:
        local: as `jaxmodel.sensitivity.local` returns it.
        most: parameters to draw, those that matter most to any metric.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> figure = plots.elasticities(sensitivity.local(study, progress=False))
        >>> len(figure.axes)
        1
    """
    table = local["elasticity"].transpose("parameter", "metric").dropna("metric", how="all")
    size = abs(table).max("metric").fillna(0.0).to_numpy()
    order = [place for place in np.argsort(-size)[:most] if size[place] > 0.0]
    numbers = table.isel(parameter=order).to_numpy()
    figure, axes = one_axes(ax, PAGE_CM, 4.2 + 0.66 * len(order))
    limit = float(np.nanmax(np.abs(numbers))) if numbers.size else 1.0
    # Signed square roots: an elasticity of 0.05 is still seen beside one of 2.
    mesh = axes.pcolormesh(np.sign(numbers) * np.sqrt(np.abs(numbers) / limit), cmap=_diverging(), vmin=-1.0, vmax=1.0)
    mesh.set_edgecolor("white")
    for (row, column), number in np.ndenumerate(numbers):
        if np.isfinite(number):
            strong = abs(number) > 0.45 * limit
            shown = f"{number:.2f}" if abs(number) >= 0.005 else "0"
            axes.text(
                column + 0.5,
                row + 0.5,
                shown,
                ha="center",
                va="center",
                fontsize=7.5,
                color="white" if strong else "black",
            )
    axes.set_xticks(
        np.arange(numbers.shape[1]) + 0.5,
        [m.replace("_", " ") for m in table["metric"].to_numpy()],
        rotation=28 if numbers.shape[1] > 4 else 0,
        ha="right" if numbers.shape[1] > 4 else "center",
    )
    axes.set_yticks(np.arange(len(order)) + 0.5, table["parameter"].to_numpy()[order])
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.set_title(
        "elasticity: change in % for 1 % of the parameter", fontweight="normal", fontsize=8.5, color="#555555"
    )
    return figure


def _diverging() -> Colormap:
    return LinearSegmentedColormap.from_list("elasticity", [BLUE, "#ffffff", ORANGE])


@styled
def interaction_matrix(data: xr.Dataset, metric: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw the interaction of pairs of parameters: second derivatives times both steps, as shares of the metric.

    Args:
        data: as `jaxmodel.sensitivity.interactions` returns it.
        metric: one of its metrics; one without proportional changes is drawn in its own unit.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> pairs = sensitivity.interactions(study, ["capacity_Ah", "current_A"], progress=False)
        >>> len(plots.interaction_matrix(pairs).axes) > 0
        True
    """
    metric = metric if metric is not None else first_of(data, "metric")
    one, names = data.sel(metric=metric), list(map(str, data["parameter"].to_numpy()))
    share = bool(np.isfinite(one["interaction"]).any())
    numbers = np.full((len(names), len(names)), np.nan)
    for place in range(one.sizes["pair"]):
        pair = one.isel(pair=place)
        corner = sorted(names.index(str(pair[end].item())) for end in ("first", "second"))
        numbers[tuple(corner)] = float(pair["interaction" if share else "predicted_joint"])
    limit = float(np.nanmax(np.abs(numbers))) or 1.0
    figure, axes = one_axes(ax, min(PAGE_CM, 8.0 + 1.5 * len(names)), 4.4 + 0.8 * len(names))
    axes.pcolormesh(numbers, cmap=_diverging(), vmin=-limit, vmax=limit, edgecolor="white", lw=1.0)
    for (row, column), number in np.ndenumerate(numbers):
        if np.isfinite(number):
            colour = "white" if abs(number) > 0.6 * limit else "black"
            shown = f"{number:.2g}" if abs(number) >= 0.005 * limit else "0"
            axes.text(column + 0.5, row + 0.5, shown, ha="center", va="center", fontsize=7.5, color=colour)
    labels = [_with_step(data.sel(parameter=name)) for name in names]
    axes.set_xticks(np.arange(len(names)) + 0.5, labels, rotation=30, ha="right")
    axes.set_yticks(np.arange(len(names)) + 0.5, labels)
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.tick_params(length=0)
    what = "as a share" if share else f"in {difference_unit(str(one['metric_unit'].item()))}"
    axes.set_title(
        f"{split_unit(metric)[0]}: second derivative by two steps, {what}",
        fontweight="normal",
        fontsize=8.5,
        color="#555555",
    )
    return figure


@styled
def over_time(local: xr.Dataset, output: str | None = None, most: int = 12) -> Figure:
    """Draw by how much one percent of each parameter moves a reading over the run: a ribbon each, to its own scale.

    Args:
        local: as `jaxmodel.sensitivity.local` returns it.
        output: the reading.
        most: parameters to draw, those that move it most at any time; only those that have a proportional change.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> figure = plots.over_time(sensitivity.local(study, progress=False), "voltage_V", most=3)
        >>> len(figure.axes)
        3
    """
    output = output if output is not None else first_of(local, "output")
    change = 0.01 * local["output_change"].sel(output=output)
    change = change.isel(parameter=np.flatnonzero(local["doubles"].to_numpy()))
    size = abs(change).max("time_s").to_numpy()
    order = [place for place in np.argsort(-size)[:most] if size[place] > _SEEN**2 * size.max()]
    time_s = local["time_s"].to_numpy()
    factor, time_unit = minutes_or_seconds(time_s)
    quantity, own_unit = split_unit(output)
    figure = new_figure(PAGE_CM, 2.6 + 1.25 * len(order))
    rows = np.atleast_1d(figure.subplots(len(order), 1, sharex=True))
    for axes, place, colour in zip(rows, order, itertools.cycle((BLUE, ORANGE)), strict=False):
        line = change.isel(parameter=place).to_numpy()
        axes.fill_between((time_s - time_s[0]) * factor, 0.0, line, color=colour, alpha=0.75, lw=0.6)
        axes.axhline(0.0, color=GREY, lw=0.7)
        reach = 1.15 * size[place]
        axes.set_ylim(-reach if line.min() < -_SEEN * reach else 0.0, reach if line.max() > _SEEN * reach else 0.0)
        name = str(change["parameter"].to_numpy()[place])
        axes.set_ylabel(name, rotation=0, ha="right", va="center")
        axes.set_yticks([])
        axes.grid(visible=False)
        axes.spines[["left", "bottom"]].set_visible(False)
        axes.tick_params(bottom=False)
        largest = line[np.argmax(np.abs(line))]
        scale, unit = readable([float(size[place])], difference_unit(own_unit))
        extra, power = power_of_ten(np.array([size[place] * scale]))
        axes.annotate(
            f" {largest * scale * extra:+.3g} {power}{unit}".rstrip(),
            (1.0, 0.5),
            xycoords="axes fraction",
            va="center",
            fontsize=8.5,
        )
    if order:
        rows[-1].spines["bottom"].set_visible(True)
        rows[-1].tick_params(bottom=True)
        rows[-1].set_xlim(0.0, (time_s[-1] - time_s[0]) * factor)
        rows[-1].set_xlabel(f"time [{time_unit}]")
    figure.suptitle(
        f"change of {quantity} for +1 % of the parameter, each to its own scale; right, the largest",
        fontsize=8.5,
        color="#555555",
    )
    return figure


@styled
def elasticity_maps(data: xr.Dataset, metric: str | None = None, most: int = 6) -> Figure:
    """Draw the elasticity of a metric over two axes of a study, one map for each parameter that matters most.

    Args:
        data: as `jaxmodel.sensitivity.elasticity_map` returns it; further axes are at their first value.
        metric: one of its metrics.
        most: parameters to draw.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0], "ambient_degC": [0.0, 20.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> len(plots.elasticity_maps(sensitivity.elasticity_map(study, progress=False)).axes) > 1
        True
    """
    metric = metric if metric is not None else first_of(data, "metric")
    down, across = [str(dim) for dim in data["metric_value"].dims if dim != "metric"][:2]
    one = data["elasticity"].sel(metric=metric)
    one = one.isel({str(dim): 0 for dim in one.dims if dim not in (down, across, "parameter")})
    size = abs(one).max([down, across]).fillna(0.0).to_numpy()
    order = [place for place in np.argsort(-size)[:most] if size[place] > 0.0]
    limit = float(size.max()) if size.size else 1.0
    columns = min(3, max(len(order), 1))
    rows = -(-len(order) // columns) or 1
    figure = new_figure(PAGE_CM, 1.8 + 4.6 * rows)
    grid = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True)).reshape(-1)
    mesh = None
    for axes, place in zip(grid, order, strict=False):
        numbers = one.isel(parameter=place).transpose(down, across).to_numpy()
        mesh = axes.pcolormesh(numbers, cmap=_diverging(), vmin=-limit, vmax=limit, edgecolor="white", lw=0.5)
        axes.set_title(str(one["parameter"].to_numpy()[place]), fontweight="normal")
        for values, ticks in ((one[across], axes.set_xticks), (one[down], axes.set_yticks)):
            every = max(1, values.size // 5)
            ticks(np.arange(0, values.size, every) + 0.5, [f"{v:g}" for v in values.to_numpy()[::every]])
        axes.grid(visible=False)
        axes.tick_params(length=0)
    for axes in grid[len(order) :]:
        axes.set_visible(False)
    figure.supxlabel(column_label(across), fontsize=9)
    figure.supylabel(column_label(down), fontsize=9)
    if mesh is not None:
        bar = figure.colorbar(mesh, ax=list(grid), shrink=0.8)
        bar.set_label(f"elasticity of {metric.replace('_', ' ')}")
    return figure
