"""Where a calibrated model fails: the excess error by condition, over two conditions, and what each run would have."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from discrepancy.failure import Failure, Shift
from discrepancy.where import Cell, MapCell
from workbench.pictures.style import (
    BASE,
    BLACK,
    GREY,
    ORANGE,
    PAGE_CM,
    column_label,
    new_figure,
    split_unit,
    styled,
)

_CONDITIONS, _MAPS, _CHANNELS = 4, 3, 3  # on a page
_LABEL_WIDTH = 18  # letters of the largest label that stands beside a map without reaching into the next
_LEAST_FULL_COLOUR = 2.0  # sd of the noise: a map is no darker for less


def failing_channels(found: Failure) -> list[str]:
    """Return the channels that fail by more than noise explains, worst first."""
    failing = [name for name, floor in found.floor.items() if not floor.is_at_floor]
    return sorted(failing, key=lambda name: -found.floor[name].ratio)[:_CHANNELS]


@styled
def excess_by_condition(found: Failure, runs: Sequence[str]) -> Figure:
    """Draw what share of each failing channel's excess error is in each range of the conditions that tell most.

    Args:
        found: where the model fails.
        runs: names of the case's runs, in order.
    """
    channels = failing_channels(found)
    figure = new_figure(PAGE_CM, 1.6 + 4.6 * len(channels))
    grid = figure.subplots(len(channels), _CONDITIONS, squeeze=False)
    for row, channel in zip(grid, channels, strict=True):
        by_condition: dict[str, list[Cell]] = {}
        for cell in found.cells[channel]:
            by_condition.setdefault(cell.regressor, []).append(cell)
        telling = sorted(
            (name for name, cells in by_condition.items() if len(cells) > 1), key=lambda n: -_contrast(by_condition[n])
        )
        for axes, condition in zip(row, telling, strict=False):
            _shares(axes, by_condition[condition], runs)
            axes.set_xlabel(column_label(condition).replace(" [", "\n["))
        for axes in row[len(telling) :]:
            axes.set_visible(False)
        row[0].set_ylabel("share [%]")
        row[0].set_title(split_unit(channel)[0])
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


def _contrast(cells: Sequence[Cell]) -> float:
    """Return the greatest share of the excess error beyond the share of the readings, in one range of a condition."""
    count = sum(cell.count for cell in cells)
    return max(cell.share - cell.count / count for cell in cells)


def _shares(axes: Axes, cells: Sequence[Cell], runs: Sequence[str]) -> None:
    count = sum(cell.count for cell in cells)
    place = np.arange(len(cells))
    axes.bar(place, [100.0 * cell.share for cell in cells], color=BASE, width=0.8, label="of the excess error")
    expected = [100.0 * cell.count / count for cell in cells]
    axes.plot(place, expected, "_", color=ORANGE, markersize=14, markeredgewidth=2.2, label="of the readings")
    axes.axhline(0.0, color=GREY, lw=0.7)
    if cells[0].regressor == "run":
        names = [runs[int(cell.lower)] for cell in cells]
    else:
        names = _ranges([(cell.lower, cell.upper) for cell in cells])
    axes.set_xticks(place, names, rotation=50, ha="right", rotation_mode="anchor", fontsize=6.5)
    axes.grid(visible=False, axis="x")


def _ranges(bounds: Sequence[tuple[float, float]]) -> list[str]:
    """Return ranges as labels, in as few digits as tell them apart."""
    names: list[str] = []
    for digits in range(3, 8):
        names = [_range(*bound, digits) for bound in bounds]
        if len(set(names)) == len(names):
            break
    return names


def _range(lower: float, upper: float, digits: int) -> str:
    low, high = (f"{x:.0f}" if abs(x) >= 10.0 ** (digits - 1) else f"{x:.{digits}g}" for x in (lower, upper))
    return low if low == high else f"{low} … {high}"


def mapped_channels(found: Failure) -> list[str]:
    """Return the failing channels that were read under two conditions at least."""
    return [name for name in failing_channels(found) if any(found.maps[name].values())]


@styled
def maps(found: Failure) -> Figure:
    """Draw the mean residual of each failing channel over the pairs of conditions that tell most, in noise sd.

    Dots mark what is beyond chance (false discovery rate 5 % over a map).
    """
    channels = mapped_channels(found)
    figure = new_figure(PAGE_CM, 1.0 + 5.6 * len(channels))
    grid = figure.subplots(len(channels), _MAPS, squeeze=False)
    for row, channel in zip(grid, channels, strict=True):
        full = [(names, cells) for names, cells in found.maps[channel].items() if cells]
        pairs = sorted(full, key=lambda item: -_spread(item[1]))[:_MAPS]
        sizes = [abs(cell.bias) for _, cells in pairs for cell in cells]
        most = max(_LEAST_FULL_COLOUR, float(np.quantile(sizes, 0.9)) if sizes else 0.0)
        for axes, ((x, y), cells) in zip(row, pairs, strict=False):
            drawn = _map(axes, cells, most)
            axes.set_xlabel(column_label(x))
            axes.set_ylabel(textwrap.fill(column_label(y), _LABEL_WIDTH))
            axes.set_title(split_unit(channel)[0], fontsize=8.5)
        for axes in row[len(pairs) :]:
            axes.set_visible(False)
        if pairs:
            bar = figure.colorbar(drawn, ax=list(row[: len(pairs)]), aspect=18, pad=0.02, extend="both")
            bar.set_label("mean residual [noise sd]")
    return figure


def _spread(cells: Sequence[MapCell]) -> float:
    """Return how much of the error's square the means over a map's cells carry."""
    return (
        sum(cell.count * cell.bias**2 for cell in cells)
        / max(1, sum(cell.count for cell in cells))
        * len(cells) ** -0.5
    )


def _map(axes: Axes, cells: Sequence[MapCell], most: float):
    columns, rows = sorted({cell.x for cell in cells}), sorted({cell.y for cell in cells})
    values = np.full((len(rows), len(columns)), np.nan)
    for cell in cells:
        place = columns.index(cell.x), rows.index(cell.y)
        values[place[1], place[0]] = cell.bias
        if cell.is_biased:
            axes.plot(*place, "o", color=BLACK, markersize=2.2)
    drawn = axes.imshow(values, origin="lower", aspect="auto", cmap="RdBu_r", vmin=-most, vmax=most)
    axes.add_patch(Rectangle((-0.5, -0.5), len(columns), len(rows), fill=False, edgecolor=GREY, lw=0.7))
    axes.set_xticks(
        range(len(columns)),
        _ranges(columns),
        rotation=50,
        ha="right",
        rotation_mode="anchor",
        fontsize=6.5,
    )
    axes.set_yticks(range(len(rows)), _ranges(rows), fontsize=6.5)
    axes.grid(visible=False)
    return drawn


@styled
def run_shifts(found: Failure) -> Figure:
    """Draw what each fit run would have each parameter be, against the value calibrated to all, with one sd."""
    shifts = found.shifts[:6]
    figure = new_figure(PAGE_CM, 2.2 + 0.55 * len(shifts[0].wanted) * (1 + (len(shifts) > 3)))
    columns = min(3, len(shifts))
    grid = figure.subplots(-(-len(shifts) // columns), columns, sharey=True, squeeze=False)
    for axes, shift in zip(grid.flat, shifts, strict=False):
        _one_shift(axes, shift)
    for axes in grid.flat[len(shifts) :]:
        axes.set_visible(False)
    return figure


def _one_shift(axes: Axes, shift: Shift) -> None:
    runs = list(shift.wanted)
    place = np.arange(len(runs))[::-1]
    values, sd = np.array(list(shift.wanted.values())), np.array(list(shift.sd.values()))
    axes.axvline(shift.calibrated, color=GREY, lw=1.0)
    axes.errorbar(values, place, xerr=sd, fmt="o", color=BASE, markersize=4.0, lw=1.2)
    axes.set_yticks(place, runs)
    axes.margins(x=0.15, y=0.2)
    axes.locator_params(axis="x", nbins=4)
    axes.set_title(shift.parameter, fontsize=8.5)
