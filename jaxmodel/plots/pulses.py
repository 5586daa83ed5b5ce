"""Pulses and steps of a run as small multiples: measured, model and residual of each, as an HPPC test is looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.case.records import Run
from jaxmodel.diagnosis.residuals.pulses import Pulse, pulses
from jaxmodel.plots.panels import Row, legend_cm, panels
from jaxmodel.plots.runs import model_colours
from jaxmodel.plots.style import FLOOR, GREY, MEASURED, axis_label, drawn_rows, styled

MOST = 12  # pulses in one picture: if there are more, evenly spread ones and the worst
_COLUMNS = 4
_ABOVE_CM, _BELOW_CM = 2.5, 1.5
_NOISE = "noise, ±2 sd"


@styled
def pulse_by_pulse(
    run: Run,
    models: Mapping[str, Mapping[str, np.ndarray]],
    channel: str,
    noise_sd: float,
    most: int = MOST,
) -> Figure:
    """Draw each pulse or step of a run by itself: measured and modelled above, the residual below.

    The time counts from the edge of the load. Panels of readings have an axis of their own, so that the shape of a
    pulse is seen; those of residuals share one, so that pulses are compared.

    Args:
        run: with pulses or steps, and with readings of the channel.
        models: predictions by channel of one or two models, by the name in the legend; the better one last.
        channel: the reading to draw.
        noise_sd: of its sensor, in the channel's unit.
        most: pulses to draw.

    Raises:
        MeasurementError: the run has no pulses or steps with readings of the channel.
    """
    measured = run.measured.outputs.get(channel, np.full(run.measured.time_s.size, np.nan))
    found = [one for one in pulses(run) if np.sum(np.isfinite(measured[one.rows])) > 1]
    if not found:
        raise MeasurementError(
            f"{run.name}: no pulse or step with readings of {channel}; draw the whole run by plot.run('{run.name}')."
        )
    residuals = {name: measured - predicted[channel] for name, predicted in models.items()}
    shown = _chosen(found, list(residuals.values())[-1], most)
    columns = min(_COLUMNS, len(shown))
    blocks = -(-len(shown) // columns)
    legend = ["measured", *models, _NOISE]
    drawn = panels(
        [Row(_ABOVE_CM, 0.15), Row(_BELOW_CM, 1.35)] * blocks,
        columns,
        left_cm=1.75,
        between_cm=1.05,
        top_cm=0.75,
        bottom_cm=1.1 + legend_cm(legend),
        share_x="none",
    )
    quantity, unit = split_unit(channel)
    inside = np.concatenate([errors[one.rows] for one in shown for errors in residuals.values()])
    scale, small_unit = readable(inside, difference_unit(unit))
    reach = scale * max(float(np.nanmax(np.abs(inside))), 2.5 * noise_sd)
    time_scale, time_unit = _time_unit(run, shown)
    for place, one in enumerate(shown):
        block, column = divmod(place, columns)
        above, below = drawn.grid[2 * block : 2 * block + 2, column]
        rows = np.arange(one.before, one.last + 1)
        rows = rows[drawn_rows([measured[rows], *(errors[rows] for errors in residuals.values())])]
        time = time_scale * (run.measured.time_s[rows] - run.measured.time_s[one.before])
        above.plot(time, measured[rows], ".", color=MEASURED, markersize=3.0, label="measured")
        below.axhspan(-2.0 * scale * noise_sd, 2.0 * scale * noise_sd, color=FLOOR, alpha=0.25, lw=0, label=_NOISE)
        below.axhline(0.0, color=GREY, lw=0.7)
        for colour, (name, predicted) in zip(model_colours(len(models)), models.items(), strict=True):
            above.plot(time, predicted[channel][rows], color=colour, lw=1.2, label=name)
            below.plot(time, scale * residuals[name][rows], ".-", color=colour, markersize=2.0, lw=0.7)
        below.set_ylim(-1.08 * reach, 1.08 * reach)
        above.set_title(_title(run, one, models), fontsize=8.0, fontweight="normal", pad=3.0)
        below.set_xlim(above.get_xlim())
        _ticks(above, below, first=column == 0)
        if column == 0:
            drawn.label_y(above, axis_label(quantity, unit), 1.2)
            drawn.label_y(below, axis_label("residual", small_unit).replace(" ", "\n"), 1.0)
        if place + columns >= len(shown):
            below.set_xlabel(f"time [{time_unit}]")
    for place in range(len(shown), blocks * columns):
        for axes in drawn.grid[-2:, place % columns]:
            axes.set_visible(False)
    handles: dict[str, Any] = {}
    for axes in drawn.grid[:2, 0]:
        for handle, name in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    drawn.legend([handles[name] for name in legend], legend, markerscale=2.0)
    return drawn.figure


def _ticks(above: Axes, below: Axes, *, first: bool) -> None:
    """Label few ticks of a small panel; residuals, on one scale for all, in the first column alone."""
    for axes, most in ((above, 3), (below, 2)):
        axes.tick_params(labelsize=7.0, pad=2.0)
        axes.yaxis.set_major_locator(MaxNLocator(most))
        axes.xaxis.set_major_locator(MaxNLocator(4))
    above.tick_params(labelbottom=False)
    below.tick_params(labelleft=first)


def _chosen(found: Sequence[Pulse], errors: np.ndarray, most: int) -> list[Pulse]:
    """Return at most so many pulses in their order: evenly spread, and the one with the largest error."""
    if len(found) <= most:
        return list(found)

    def size(one: Pulse) -> float:
        read = errors[one.rows]
        return float(np.sqrt(np.mean(read[np.isfinite(read)] ** 2)))

    worst = max(range(len(found)), key=lambda place: size(found[place]))
    even = {round(place) for place in np.linspace(0, len(found) - 1, most)}
    if worst not in even:
        nearest = min(even - {0, len(found) - 1}, key=lambda place: abs(place - worst), default=0)
        even = even - {nearest} | {worst}
    return [found[place] for place in sorted(even)]


def _time_unit(run: Run, shown: Sequence[Pulse]) -> tuple[float, str]:
    """Return the factor and unit of time for the longest of some pulses."""
    time_s = run.measured.time_s
    longest = max(float(time_s[one.last] - time_s[one.before]) for one in shown)
    return (1e3, "ms") if longest < 2.0 else (1.0, "s") if longest <= 600.0 else (1.0 / 60.0, "min")


def _title(run: Run, one: Pulse, models: Mapping[str, Mapping[str, np.ndarray]]) -> str:
    """Return a pulse's level, and its state of charge, or the time at which it comes where a model has none."""
    unit = split_unit(one.drive)[1]
    level = f"{one.level:.3g} {unit}".strip() if unit else f"{split_unit(one.drive)[0]} {one.level:.3g}"
    soc = list(models.values())[-1].get("soc")
    if soc is not None:
        return f"{level}, SOC {soc[one.before]:.2f}"
    since = float(run.measured.time_s[one.before] - run.measured.time_s[0])
    return f"{level}, at {since:.3g} s" if since < 6000.0 else f"{level}, at {since / 60.0:.3g} min"
