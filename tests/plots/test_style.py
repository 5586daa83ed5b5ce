"""A picture is shown by a notebook at its size on paper; of long series what stands out is drawn."""

from __future__ import annotations

import io

import matplotlib.image
import numpy as np
import pytest
from matplotlib.figure import Figure

from jaxmodel.plots.style import (
    CSS_DOTS_PER_INCH,
    DOTS_PER_INCH,
    MOST_ROWS,
    drawn_rows,
    new_figure,
    plain_log,
    png,
    styled,
)


def test_notebook_shows_picture_at_its_size() -> None:
    picture = new_figure(10.0, 5.0)
    data, size = picture._repr_png_()
    pixels = matplotlib.image.imread(io.BytesIO(data)).shape
    assert size["width"] / CSS_DOTS_PER_INCH == pytest.approx(10.0 / 2.54, rel=0.01)
    assert pixels[1] / DOTS_PER_INCH == pytest.approx(size["width"] / CSS_DOTS_PER_INCH, rel=0.01)
    assert pixels[0] / pixels[1] == pytest.approx(0.5, rel=0.01)


@styled
def _named(name: str) -> Figure:
    figure = new_figure(10.0, 5.0)
    axes = figure.subplots()
    axes.plot([1.0, 1000.0], label=name)
    axes.set_yscale("log")
    plain_log(axes.yaxis)
    axes.set_title(name)
    axes.legend()
    return figure


@pytest.mark.parametrize("name", ["5 $ and $\\frac{", "电压", "\u202e<b>", "%s {0} [red]"])
def test_any_name_can_be_drawn(name: str) -> None:
    figure = _named(name)
    assert png(figure).startswith(b"\x89PNG")
    labels = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert not any("$" in label for label in labels)


def test_short_series_are_drawn_whole_and_long_ones_with_what_stands_out() -> None:
    assert drawn_rows([np.zeros(MOST_ROWS)]).size == MOST_ROWS
    first, second = np.zeros(40 * MOST_ROWS + 7), np.full(40 * MOST_ROWS + 7, np.nan)
    first[123_456], first[-1], second[77] = 5.0, -3.0, 1.0
    rows = drawn_rows([first, second])
    assert rows.size <= 1.5 * MOST_ROWS
    assert {0, 77, 123_456, first.size - 1} <= set(rows)
    assert np.all(np.diff(rows) > 0)
