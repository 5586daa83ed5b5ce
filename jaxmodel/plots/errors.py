"""Errors by run of the calibrated base model and the final model, with noise and tolerance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.plots.style import BASE, BLACK, FINAL, FLOOR, GREY, PAGE_CM, axis_label, new_figure, plain_log, styled

_Row = Mapping[Any, Any]
_MODELS = {"base": ("calibrated base model", BASE), "final": ("final model", FINAL)}
_MOST_RUNS = 40  # on a page: if there are more, those with the largest errors


@styled
def errors_by_run(errors: pd.DataFrame, assumed: tuple[str, ...] = ()) -> Figure:
    """Draw each channel's error in each run, of the base model and of the final one.

    Args:
        errors: rows with model, run, split, channel, rms, noise_sd and tolerance, as a diagnosis has them.
        assumed: channels with an assumed tolerance, which is not drawn.
    """
    every = errors.to_dict("records")
    channels = list(dict.fromkeys(row["channel"] for row in every))
    runs = _runs(every)
    columns = min(len(channels), 2)
    rows = -(-len(channels) // columns)
    figure = new_figure(PAGE_CM, 1.8 + rows * (1.7 + 0.5 * len(runs)))
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    handles = {}
    for axes, channel in zip(grid.flat, channels, strict=False):
        of_channel = [row for row in every if row["channel"] == channel]
        _one_channel(axes, of_channel, list(runs), channel, channel not in assumed)
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    for axes in grid.flat[len(channels) :]:
        axes.set_visible(False)
    grid[0, 0].set_ylim(len(runs) - 0.4, -0.6)
    grid[0, 0].set_yticks(range(len(runs)), [f"{run}{'' if s == 'fit' else ' (check)'}" for run, s in runs.items()])
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4)
    return figure


def _runs(rows: Sequence[_Row]) -> dict[str, str]:
    """Return the split of each run that is drawn, fit runs first."""
    splits: dict[str, str] = {row["run"]: row["split"] for row in rows}
    if len(splits) > _MOST_RUNS:
        largest: dict[str, float] = {}
        for row in rows:
            largest[row["channel"]] = max(largest.get(row["channel"], 0.0), row["rms"])
        size: dict[str, float] = dict.fromkeys(splits, 0.0)
        for row in rows:
            size[row["run"]] = max(size[row["run"]], row["rms"] / (largest[row["channel"]] or 1.0))
        worst = sorted(splits, key=lambda run: -size[run])[:_MOST_RUNS]
        splits = {run: split for run, split in splits.items() if run in worst}
    return dict(sorted(splits.items(), key=lambda item: item[1] != "fit"))


def _one_channel(axes: Axes, rows: Sequence[_Row], runs: list[str], channel: str, has_tolerance: bool) -> None:
    quantity, unit = split_unit(channel)
    scale, unit = readable([row["rms"] for row in rows], difference_unit(unit))
    models = [model for model in _MODELS if any(row["model"] == model for row in rows)]
    by_model = {model: scale * _of_runs(rows, model, "rms", runs) for model in models}
    places = np.arange(len(runs))
    if len(models) > 1:
        axes.hlines(places, by_model[models[0]], by_model[models[1]], color=GREY, lw=1.2)
    for model, values in by_model.items():
        label, colour = _MODELS[model]
        axes.plot(values, places, "o", color=colour, markersize=5.0, label=label)
    noise = float(rows[0]["noise_sd"]) * scale
    lines = [noise] if np.isfinite(noise) and noise > 0.0 else []
    if lines:
        axes.axvline(noise, color=FLOOR, lw=2.0, label="sensor noise")
    tolerance = scale * _of_runs(rows, models[0], "tolerance", runs)
    if has_tolerance and np.any(np.isfinite(tolerance)):
        lines += [value for value in tolerance if np.isfinite(value)]
        axes.vlines(
            tolerance, places - 0.5, places + 0.5, color=BLACK, lw=1.2, linestyles=(0, (4, 2)), label="tolerance"
        )
    axes.set_xscale("log")
    shown = [v for v in np.concatenate([*by_model.values(), lines]) if np.isfinite(v) and v > 0.0] or [1.0]
    low, high = min(shown), max(max(shown), 3.0 * min(shown))
    axes.set_xlim(low / 1.3, high * 1.3)
    plain_log(axes.xaxis)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel(axis_label(f"RMS error, {quantity}", unit))


def _of_runs(rows: Sequence[_Row], model: str, column: str, runs: Sequence[str]) -> np.ndarray:
    """Return a column of one model in the order of some runs; NaN for a run without a row."""
    found = {row["run"]: row[column] for row in rows if row["model"] == model}
    return np.array([found.get(run, np.nan) for run in runs], dtype=float)
