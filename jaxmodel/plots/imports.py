"""An imported run: every column over time, and where something was found."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from jaxmodel.base.units import split_unit
from jaxmodel.plots.panels import Row, panels
from jaxmodel.plots.style import BLUE, GREY, LINES, ORANGE, column_label, minutes_or_seconds, styled

_PANEL_CM, _LEFT_CM, _LABEL_CM, _TIME_CM = 3.1, 2.3, 1.6, 1.05
_LINE_CM, _CHARACTERS, _MOST_NOTES = 0.38, 118, 6
# More points than a picture has pixels are drawn as the least and largest of each stretch.
_MOST_POINTS = 4000


@styled
def imported_run(
    name: str,
    time_s: np.ndarray,
    columns: Mapping[str, np.ndarray],
    marked: Sequence[tuple[str, str, Sequence[tuple[float, float]]]] = (),
    notes: Sequence[str] = (),
) -> Figure:
    """Draw a run with what was found in it; a column that never changes stands in the title.

    Args:
        name: of the run.
        time_s: of each row [s], shape (rows,).
        columns: by name, shape (rows,) each.
        marked: what was found: its sort, its column ('' or time_s for all), and the times that it concerns.
        notes: sentences below the picture.
    """
    still = {column: values[0] for column, values in columns.items() if np.all(values == values[0])}
    if len(still) == len(columns):
        still = {}
    columns = {column: values for column, values in columns.items() if column not in still}
    constant = ", ".join(f"{quantity} {still[c]:.4g} {unit}" for c in still for quantity, unit in [split_unit(c)])
    lines = [line for note in notes[:_MOST_NOTES] for line in textwrap.wrap(note, _CHARACTERS, subsequent_indent="   ")]
    if len(notes) > _MOST_NOTES:
        lines.append(f"and {len(notes) - _MOST_NOTES} more in import.json")
    drawn = panels(
        [Row(_PANEL_CM)] * len(columns),
        1,
        left_cm=_LEFT_CM,
        between_cm=0.0,
        top_cm=0.9,
        bottom_cm=_TIME_CM + _LINE_CM * (len(lines) + 1),
    )
    factor, unit = minutes_or_seconds(time_s)
    drawn.grid[0, 0].set_title(f"{name} ({constant})" if constant else name)
    for axes, (column, values) in zip(drawn.grid[:, 0], columns.items(), strict=True):
        x, y = thinned(time_s, values)
        axes.plot(x * factor, y, color=BLUE, linewidth=0.9, rasterized=True)
        drawn.label_y(axes, column_label(column), _LABEL_CM)
        for number, (_, of, places) in enumerate(marked):
            if of not in ("", "time_s", column):
                continue
            colour = LINES[number % len(LINES)] if of == column else ORANGE if of == "time_s" else GREY
            for begin, end in places:
                width = max(end - begin, 0.002 * float(time_s[-1] - time_s[0]))
                axes.axvspan(begin * factor, (begin + width) * factor, color=colour, alpha=0.25, linewidth=0.0)
    drawn.grid[-1, 0].set_xlabel(f"time [{unit}]")
    if lines:
        drawn.figure.text(0.02, 0.01, "\n".join(lines), fontsize=7.0, va="bottom", ha="left")
    return drawn.figure


def thinned(time_s: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return at most so many points that a picture shows, with the extremes of each stretch kept."""
    if values.size <= _MOST_POINTS:
        return time_s, values
    size = -(-values.size // (_MOST_POINTS // 2))
    starts = np.arange(0, values.size, size)
    low, high = np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)
    return np.repeat(time_s[starts], 2), np.stack([low, high], axis=1).ravel()
