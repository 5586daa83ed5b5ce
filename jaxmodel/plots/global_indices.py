"""Pictures of global indices: bars with intervals, pairs as colours, Morris' plane, and their convergence."""

from __future__ import annotations

import itertools

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.base.units import difference_unit, split_unit
from jaxmodel.plots.sensitivities import first_of
from jaxmodel.plots.style import (
    BLUE,
    GREY,
    LINES,
    ORANGE,
    PAGE_CM,
    axis_label,
    legend,
    one_axes,
    power_of_ten,
    styled,
)

MAIN_INDEX = {"sobol": "total", "morris": "mu_star", "dgsm": "dgsm"}
_NAMES = {
    "first": "first order",
    "total": "total",
    "mu_star": "mean size of the effect",
    "dgsm": "derivative-based measure, an upper bound of the total index",
}
_ERROR = {"ecolor": "#333333", "elinewidth": 1.0, "capsize": 2.5}


def metrics_that_vary(data: xr.Dataset) -> list[str]:
    """Return the metrics of a data set of `global_indices` whose indices are not all zero or missing."""
    largest = data[MAIN_INDEX[data.attrs["method"]]].fillna(0.0).max("factor")
    return [str(metric) for metric in data["metric"].to_numpy() if float(largest.sel(metric=metric)) > 0.0]


def _selected(data: xr.Dataset, metric: str | None) -> tuple[xr.Dataset, str]:
    """Return the data of one metric, the first if not given, and its name."""
    metric = metric if metric is not None else first_of(data, "metric")
    return data.sel(metric=metric), metric


def _ordered(one: xr.Dataset, most: int = 16) -> xr.Dataset:
    size = np.nan_to_num(one[MAIN_INDEX[one.attrs["method"]]].to_numpy())
    return one.isel(factor=np.argsort(-size)[:most])


@styled
def bars(data: xr.Dataset, metric: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw the indices of one metric with their intervals of 95 %, largest first.

    Args:
        data: as `jaxmodel.sensitivity.global_indices` returns it.
        metric: one of its metrics; the first if not given.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    one, metric = _selected(data, metric)
    one = _ordered(one)
    shown = [name for name in ("first", "total", "dgsm") if name in one]
    places, height = np.arange(one.sizes["factor"]), 0.72 / len(shown)
    figure, axes = one_axes(ax, PAGE_CM, 3.0 + (0.55 + 0.35 * len(shown)) * len(places))
    for number, (name, colour) in enumerate(zip(shown, (BLUE, ORANGE), strict=False)):
        where = places + (number - 0.5 * (len(shown) - 1)) * height
        axes.barh(
            where,
            one[name],
            height=0.92 * height,
            xerr=one[f"{name}_error"],
            color=colour,
            label=_NAMES[name],
            error_kw=_ERROR,
        )
    axes.set_yticks(places, one["factor"].to_numpy())
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(f"share of the variance of {split_unit(metric)[0]}, with intervals of 95 %")
    legend(ax, axes, "outside lower center", 2)
    return figure


@styled
def effects_plane(data: xr.Dataset, metric: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw Morris' plane: how large the effect of each factor is, and how much it depends on the values of the others.

    Args:
        data: as `jaxmodel.sensitivity.global_indices` returns it.
        metric: one of its metrics; the first if not given.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    one, metric = _selected(data, metric)
    one = _ordered(one)
    size, spread = one["mu_star"].to_numpy(), np.nan_to_num(one["sigma"].to_numpy())
    extra, power = power_of_ten(np.concatenate([size, spread]))
    unit = f"{power}{difference_unit(str(one['metric_unit'].item()))}".strip()
    figure, axes = one_axes(ax, 0.85 * PAGE_CM, 9.0)
    for i, (name, colour) in enumerate(zip(one["factor"].to_numpy(), itertools.cycle(LINES), strict=False)):
        error = float(one["mu_star_error"][i]) * extra
        # Of a group only the size is known: its members do not move alone.
        known = np.isfinite(one["sigma"].to_numpy()[i])
        axes.errorbar(
            size[i] * extra,
            spread[i] * extra,
            xerr=error,
            fmt="o" if known else "|",
            color=colour,
            capsize=2.5,
            lw=1.0,
            label=str(name) if known else f"{name} (size alone)",
        )
    reach = 1.12 * extra * float(np.max(size))
    axes.plot([0.0, reach], [0.0, reach], color=GREY, lw=0.8, ls=":")
    axes.set_xlim(0.0, reach)
    top = max(1.15 * extra * float(np.max(spread)), 0.25 * reach)
    axes.set_ylim(0.0, top)
    at = 0.9 * min(top, reach)
    axes.annotate("  sd = mean size", (at, at), color=GREY, fontsize=7.5, ha="left", va="center")
    axes.set_xlabel(axis_label(f"mean size of the effect on {split_unit(metric)[0]}\nover the whole range", unit))
    axes.set_ylabel(axis_label("its standard deviation", unit))
    legend(ax, axes, "outside right upper", 1)
    return figure


@styled
def pairs(data: xr.Dataset, metric: str | None = None, ax: Axes | None = None) -> Figure:
    """Draw the second-order indices of pairs of factors, first orders on the diagonal.

    Args:
        data: as `jaxmodel.sensitivity.global_indices` returns it.
        metric: one of its metrics; the first if not given.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    one, metric = _selected(data, metric)
    factors = _ordered(one, 12)["factor"].to_numpy()
    table = one["second"].sel(factor=factors, other=factors).to_numpy().copy()
    error = one["second_error"].sel(factor=factors, other=factors).to_numpy()
    count = len(factors)
    np.fill_diagonal(table, one["first"].sel(factor=factors))
    figure, axes = one_axes(ax, min(PAGE_CM, 7.0 + 1.1 * count), 4.6 + 0.75 * count)
    shown = np.where(np.tril(np.ones_like(table), -1) > 0, np.nan, table)
    axes.pcolormesh(shown, cmap="Blues", vmin=0.0, vmax=1.0, edgecolor="white", lw=1.0)
    for (row, column), number in np.ndenumerate(shown):
        if np.isfinite(number):
            sure = row == column or abs(number) > error[row, column]
            colour = "white" if number > 0.55 else "black" if sure else GREY
            axes.text(
                column + 0.5,
                row + 0.5,
                f"{round(number, 2) + 0.0:.2f}",
                ha="center",
                va="center",
                fontsize=7.5,
                color=colour,
            )
    axes.set_xticks(np.arange(count) + 0.5, factors, rotation=35, ha="right")
    axes.set_yticks(np.arange(count) + 0.5, factors)
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.tick_params(length=0)
    title = f"{split_unit(metric)[0]}: first orders on the diagonal,\npairs off it; grey: zero within the interval"
    axes.set_title(title, fontweight="normal", fontsize=8.5, color="#555555")
    return figure


@styled
def convergence(data: xr.Dataset, metric: str | None = None, most: int = 6, ax: Axes | None = None) -> Figure:
    """Draw the main index of each factor as it settles with more base points, with its interval of 95 %.

    Args:
        data: as `jaxmodel.sensitivity.global_indices` returns it.
        metric: one of its metrics; the first if not given.
        most: factors to draw.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    one, metric = _selected(data, metric)
    name = MAIN_INDEX[one.attrs["method"]]
    one = _ordered(one.isel(blocks=np.flatnonzero(np.isfinite(one[f"{name}_converging"].to_numpy()).any(axis=1))), most)
    blocks = one["blocks"].to_numpy()
    extra, unit = 1.0, ""
    if name == "mu_star":  # the others are shares
        extra, power = power_of_ten(one[name].to_numpy())
        unit = f"{power}{difference_unit(str(one['metric_unit'].item()))}".strip()
    figure, axes = one_axes(ax, PAGE_CM, 8.0)
    for i, colour in zip(range(one.sizes["factor"]), itertools.cycle(LINES), strict=False):
        value, error = (extra * one[f"{name}_converging{end}"].isel(factor=i).to_numpy() for end in ("", "_error"))
        axes.fill_between(blocks, value - error, value + error, color=colour, alpha=0.18, lw=0.0)
        axes.plot(blocks, value, "o-", color=colour, markersize=3.5, label=str(one["factor"].to_numpy()[i]))
    axes.set_xscale("log", base=2)
    axes.set_xticks(blocks, [f"{n:,}" for n in blocks])
    axes.minorticks_off()
    # The intervals of the first few points would hide all that comes after.
    last = one.isel(blocks=-min(3, len(blocks)))
    high = extra * (last[f"{name}_converging"] + last[f"{name}_converging_error"])
    axes.set_ylim(min(0.0, -0.1 * float(high.max())), 1.3 * float(high.max()))
    axes.axhline(0.0, color=GREY, lw=0.7)
    axes.set_xlabel("base points")
    of = "on" if name == "mu_star" else "of"
    axes.set_ylabel(axis_label(f"{_NAMES[name].split(',')[0]}\n{of} {split_unit(metric)[0]}", unit))
    legend(ax, axes, "outside right upper", 1)
    return figure
