"""Panels at fixed positions: an automatic layout would take as long as the drawing itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.plots.style import PAGE_CM, new_figure

_RIGHT_CM = 0.3
_LEGEND_LINE_CM, _LEGEND_CM = 0.47, 0.2


class Row(NamedTuple):
    """The height of a row of panels, and the space below it, in cm."""

    height_cm: float
    below_cm: float = 0.35


class Panels(NamedTuple):
    """A figure of a page's width.

    Attributes:
        figure: the figure.
        grid: (rows, columns) its axes; those of a column may share the x axis.
        width_cm: of each.
    """

    figure: Figure
    grid: np.ndarray
    width_cm: float

    def label_y(self, axes: Axes, label: str, away_cm: float) -> None:
        """Label a panel's y axis at a fixed distance, so that the labels of a column are aligned."""
        axes.set_ylabel(label)
        axes.yaxis.set_label_coords(-away_cm / self.width_cm, 0.5)

    def legend(self, handles: Iterable, labels: Sequence[str], markerscale: float = 1.0) -> None:
        """Put a legend below all panels, in the space given by `legend_cm`."""
        self.figure.legend(
            list(handles),
            labels,
            loc="lower center",
            bbox_to_anchor=(0.5, 0.0),
            ncols=legend_columns(labels),
            markerscale=markerscale,
        )


def panels(
    rows: Sequence[Row],
    columns: int,
    *,
    left_cm: float,
    between_cm: float,
    top_cm: float,
    bottom_cm: float,
    share_x: Literal["column", "none"] = "column",
    share_y: Literal["row", "none"] = "none",
) -> Panels:
    """Return panels in rows and columns over the width of a page.

    Args:
        rows: from the top; `bottom_cm` replaces the space below the last.
        columns: number of columns.
        left_cm: space left of the first column.
        between_cm: space between two columns.
        top_cm: space above the first row.
        bottom_cm: space below the last row.
        share_x: whether the panels of a column share the x axis, and label it once.
        share_y: whether the panels of a row share the y axis, and label it once.
    """
    height = top_cm + sum(row.height_cm + row.below_cm for row in rows) - rows[-1].below_cm + bottom_cm
    width = (PAGE_CM - left_cm - _RIGHT_CM - between_cm * (columns - 1)) / columns
    figure = new_figure(PAGE_CM, height, layout="none")
    grid = np.empty((len(rows), columns), dtype=object)
    top = height - top_cm
    for number, row in enumerate(rows):
        for column in range(columns):
            place = (left_cm + column * (width + between_cm), top - row.height_cm, width, row.height_cm)
            axes = figure.add_axes(
                tuple(float(part) / whole for part, whole in zip(place, (PAGE_CM, height) * 2, strict=True)),  # type: ignore[arg-type]
                sharex=grid[0, column] if number and share_x == "column" else None,
                sharey=grid[number, 0] if share_y == "row" and column else None,
            )
            axes.tick_params(
                labelbottom=share_x == "none" or number == len(rows) - 1, labelleft=share_y == "none" or column == 0
            )
            grid[number, column] = axes
        top -= row.height_cm + row.below_cm
    return Panels(figure, grid, width)


def legend_columns(labels: Sequence[str]) -> int:
    """Return the number of legend entries in a row."""
    return len(labels) if sum(len(label) + 6 for label in labels) < 90 else 2


def legend_cm(labels: Sequence[str]) -> float:
    """Return the height of a legend below the panels, in cm."""
    return _LEGEND_CM + _LEGEND_LINE_CM * -(-len(labels) // legend_columns(labels))
