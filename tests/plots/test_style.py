"""A picture is shown by a notebook at its size on paper."""

from __future__ import annotations

import io

import matplotlib.image
import pytest

from plots.style import CSS_DOTS_PER_INCH, DOTS_PER_INCH, new_figure


def test_notebook_shows_picture_at_its_size() -> None:
    picture = new_figure(10.0, 5.0)
    data, size = picture._repr_png_()
    pixels = matplotlib.image.imread(io.BytesIO(data)).shape
    assert size["width"] / CSS_DOTS_PER_INCH == pytest.approx(10.0 / 2.54, rel=0.01)
    assert pixels[1] / DOTS_PER_INCH == pytest.approx(size["width"] / CSS_DOTS_PER_INCH, rel=0.01)
    assert pixels[0] / pixels[1] == pytest.approx(0.5, rel=0.01)
