"""Pictures of a load estimate: torque along a run with its band, and torque by group of runs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.case.records import chosen_run
from jaxmodel.operation.load import LoadEstimate
from jaxmodel.plots.style import (
    BLUE,
    LINES,
    PAGE_CM,
    axis_label,
    drawn_rows,
    legend,
    minutes_or_seconds,
    new_figure,
    one_axes,
    styled,
)


@styled
def load_of_run(estimate: LoadEstimate, run: str | None = None) -> Figure:
    """Draw speed, current and load torque along a run, the first by default; the band is two sd of each row."""
    name = chosen_run(run, [one.run for one in estimate.runs])
    (of_run,) = (one for one in estimate.runs if one.run == name)
    table = of_run.table
    table = table.iloc[drawn_rows([table["load_torque_Nm"].to_numpy()])]
    scale, unit = minutes_or_seconds(table["time_s"].to_numpy())
    time = table["time_s"].to_numpy() * scale
    figure = new_figure(PAGE_CM, 9.0)
    top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(1, 1, 2))
    top.plot(time, table["speed_rad_s"], color=LINES[0])
    top.set_ylabel("speed\n[rad/s]")
    middle.plot(time, table["current_A"], color=LINES[1])
    middle.set_ylabel("current\n[A]")
    torque, sd = table["load_torque_Nm"].to_numpy(), table["sd_Nm"].to_numpy()
    bottom.fill_between(time, torque - 2.0 * sd, torque + 2.0 * sd, color=BLUE, alpha=0.25, linewidth=0.0, label="2 sd")
    bottom.plot(time, torque, color=BLUE, label="load torque")
    bottom.axhline(0.0, color="0.6", linewidth=0.6)
    bottom.set_ylabel(axis_label("load torque", "N m"))
    bottom.set_xlabel(f"time [{unit}]")
    legend(None, bottom, "outside lower center", 2)
    top.set_title(f"{estimate.name}: {name}", fontsize=9.0)
    return figure


@styled
def load_by_group(estimates: Sequence[LoadEstimate], ax: Axes | None = None) -> Figure:
    """Draw the mean torque of each group of runs with two sd, a mark for each motor."""
    groups = list(dict.fromkeys(group for one in estimates for group in one.by_group().index))
    figure, axes = one_axes(ax, PAGE_CM, 1.2 + 1.1 * len(groups) + 2.0)
    for number, one in enumerate(estimates):
        table = one.by_group().reindex(groups)
        place = np.arange(len(groups)) + 0.16 * (number - 0.5 * (len(estimates) - 1))
        colour = LINES[number % len(LINES)]
        mean, spread = table["torque_Nm"], table["spread_Nm"]
        axes.barh(place, 2.0 * spread, left=mean - spread, height=0.1, color=colour, alpha=0.25, linewidth=0.0)
        axes.errorbar(
            table["torque_Nm"], place, xerr=2.0 * table["sd_Nm"], fmt="o", color=colour, markersize=4.0, capsize=2.5,
            label=one.name,
        )  # fmt: skip
    axes.set_yticks(range(len(groups)), groups)
    axes.invert_yaxis()
    axes.set_xlabel("torque against the motion [N m]: mean with 2 sd; pale: how much it varies within a run")
    if len(estimates) > 1:
        legend(ax, axes, "outside lower center", len(estimates))
    return figure
