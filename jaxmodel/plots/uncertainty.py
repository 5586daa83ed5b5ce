"""Pictures of the spread of a run that comes of uncertain parameters: by the gradient, and by sampling."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.plots.sensitivities import first_of
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

_TWO_SIDED_95 = 1.96


@styled
def bands_over_time(data: xr.Dataset, output: str | None = None) -> Figure:
    """Draw a reading with its band of 95 %, and below it the band alone, by sampling and by the gradient.

    Args:
        data: as `jaxmodel.sensitivity.uncertainty` returns it.
        output: the reading; the first if not given.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> data = sensitivity.uncertainty(study, {"capacity_Ah": 0.05}, draws=64, progress=False)
        >>> plots.bands_over_time(data, "voltage_V").axes[0].get_ylabel()
        'voltage [V]'
    """
    output = output if output is not None else first_of(data, "output")
    one = data.sel(output=output)
    factor, time_unit = minutes_or_seconds(one["time_s"].to_numpy())
    time = (one["time_s"].to_numpy() - float(one["time_s"][0])) * factor
    value, reach = one["output_value"].to_numpy(), _TWO_SIDED_95 * one["output_sd_gradient"].to_numpy()
    low, middle, high = (one["output_quantile"].sel(quantile=q).to_numpy() for q in (0.025, 0.5, 0.975))
    quantity, unit = split_unit(output)
    scale, shown = readable(np.abs(np.concatenate([high - value, low - value, reach])), difference_unit(unit))
    extra, power = power_of_ten(np.concatenate([high - value, low - value, reach]) * scale)
    figure = new_figure(PAGE_CM, 10.5)
    above, below = figure.subplots(2, 1, sharex=True)
    for axes, base, size in ((above, value, 1.0), (below, np.zeros_like(value), scale * extra)):
        moved = value - base
        axes.fill_between(
            time, (low - moved) * size, (high - moved) * size, color=BLUE, alpha=0.3, lw=0.0, label="sampled, 95 %"
        )
        axes.plot(time, (middle - moved) * size, color=BLUE, lw=1.0, label="sampled, median")
        for sign, label in ((1.0, "by the gradient, 95 %"), (-1.0, None)):
            axes.plot(time, (base + sign * reach) * size, color=ORANGE, lw=1.3, ls="--", label=label)
        axes.plot(time, base * size, color="black", lw=0.9, label="the run itself")
    apart = ~one["output_agrees"].to_numpy()
    if apart.any():
        bottom = below.get_ylim()[0]
        below.plot(time[apart], np.full(apart.sum(), bottom), "|", color=GREY, markersize=7, label="the two disagree")
        below.set_ylim(bottom=bottom)
    above.set_ylabel(column_label(output))
    below.set_ylabel(axis_label(f"deviation, {quantity}", f"{power}{shown}".strip()))
    below.set_xlabel(f"time [{time_unit}]")
    below.set_xlim(0.0, time[-1])
    handles, labels = below.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


@styled
def metric_intervals(data: xr.Dataset, ax: Axes | None = None) -> Figure:
    """Draw for each metric the interval of 95 % and of 68 % by both ways, in sd of the gradient's.

    Args:
        data: as `jaxmodel.sensitivity.uncertainty` returns it.
        ax: axes of yours to draw on; by default those of a new figure.

    Example:
        >>> from jaxmodel import plots, sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> names = {"metrics": ["final_soc"], "store": ["voltage_V"]}
        >>> study = sweeps.Study(kind="cell", profile=profile, axes=axes, **names)
        >>> data = sensitivity.uncertainty(study, {"capacity_Ah": 0.05}, draws=64, progress=False)
        >>> len(plots.metric_intervals(data).axes)
        1
    """
    varying = data.isel(metric=np.flatnonzero(data["metric_sd_gradient"].to_numpy() > 0.0))
    count = varying.sizes["metric"]
    sd = varying["metric_sd_gradient"].to_numpy()
    figure, axes = one_axes(ax, PAGE_CM, 3.4 + 0.95 * count)
    places = np.arange(count)
    quantile = ((varying["metric_quantile"] - varying["metric_value"]) / varying["metric_sd_gradient"]).to_numpy()
    axes.hlines(places - 0.15, -_TWO_SIDED_95, _TWO_SIDED_95, color=ORANGE, lw=2.0)
    axes.hlines(places - 0.15, -1.0, 1.0, color=ORANGE, lw=5.0, label="by the gradient, 68 % and 95 %")
    axes.hlines(places + 0.15, quantile[:, 0], quantile[:, 4], color=BLUE, lw=2.0)
    axes.hlines(places + 0.15, quantile[:, 1], quantile[:, 3], color=BLUE, lw=5.0, label="sampled, 68 % and 95 %")
    axes.plot(quantile[:, 2], places + 0.15, "o", color="white", markeredgecolor=BLUE, markersize=4.5, label="median")
    names = []
    for i, name in enumerate(map(str, varying["metric"].to_numpy())):
        unit = str(varying["metric_unit"].to_numpy()[i])
        numbers = f"{float(varying['metric_value'][i]):.4g} ± {sd[i]:.2g} {unit}".strip()
        names.append(f"{name}\n{numbers}" + ("" if bool(varying["metric_agrees"][i]) else " (not straight)"))
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.axvline(0.0, color=GREY, lw=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("deviation in standard deviations by the gradient")
    legend(ax, axes, "outside lower center", 3)
    return figure
