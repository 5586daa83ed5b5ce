"""Common style of all pictures: fonts, a palette for any colour vision, labels with units, scales."""

from __future__ import annotations

import functools
import io
import warnings
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Literal, ParamSpec

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imsave
from matplotlib.ticker import FuncFormatter, LogLocator, SymmetricalLogLocator

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.units import split_unit

P = ParamSpec("P")

PAGE_CM = 17.0  # text width of an A4 report
DOTS_PER_INCH = 170
# Rows of a run that are drawn over time: some for each column of dots of a page.
MOST_ROWS = 10_000
CSS_DOTS_PER_INCH = 96  # of a browser

# Colours of Okabe and Ito, distinguishable with any kind of colour vision and in grey.
GREY, BLACK = "#8c8c8c", "#1a1a1a"
BLUE, ORANGE, GREEN, SKY, PURPLE = "#0072b2", "#d55e00", "#009e73", "#56b4e9", "#cc79a7"
LINES = (BLUE, ORANGE, GREEN, PURPLE, SKY, "#e69f00", BLACK)
"""Colours of lines, in the order in which pictures take them."""
MEASURED, BASE, FINAL, FLOOR = "#6e6e6e", BLUE, ORANGE, "#009e73"
SEQUENCE = "cividis"

_RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.parse_math": False,  # a dollar sign in a name of the user's is one
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#4d4d4d",
    "axes.linewidth": 0.7,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.formatter.useoffset": False,
    "axes.formatter.limits": (-4, 5),
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "xtick.color": "#333333",
    "ytick.color": "#333333",
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.4,
    "figure.constrained_layout.use": True,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def styled(draw: Callable[P, Figure]) -> Callable[P, Figure]:
    """Apply this style within a plotting function, without changing the global matplotlib settings.

    Example:
        >>> from jaxmodel import plots
        >>> @plots.styled
        ... def mine():
        ...     figure = plots.new_figure(8.0, 6.0)
        ...     figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
        ...     return figure
        >>> len(mine().axes)
        1
    """

    @functools.wraps(draw)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> Figure:
        with matplotlib.rc_context(_RC):
            return draw(*args, **kwargs)

    return wrapper


class Picture(Figure):
    """A figure that a notebook shows as it is; it shows matplotlib's own where pyplot was imported, else their name."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        width, height = self.get_size_inches() * CSS_DOTS_PER_INCH
        return png(self), {"width": round(width), "height": round(height)}


def new_figure(width_cm: float, height_cm: float, layout: Literal["constrained", "none"] = "constrained") -> Figure:
    """Return an empty figure of a size in cm, which pyplot does not keep open.

    Example:
        >>> from jaxmodel import plots
        >>> figure = plots.new_figure(16.0, 8.0)
        >>> left, right = figure.subplots(1, 2)
        >>> figure.get_size_inches().round(1).tolist()
        [6.3, 3.1]
    """
    figure = Picture(figsize=(width_cm / 2.54, height_cm / 2.54), dpi=DOTS_PER_INCH, layout=layout)  # type: ignore[arg-type]
    FigureCanvasAgg(figure)
    return figure


def one_axes(ax: Axes | None, width_cm: float, height_cm: float) -> tuple[Figure, Axes]:
    """Return the caller's axes with their figure, or those of a new figure of a size in cm."""
    if ax is None:
        figure = new_figure(width_cm, height_cm)
        return figure, figure.subplots()
    figure = ax.get_figure(root=True)
    assert figure is not None, "axes that were removed from their figure"
    return figure, ax


def legend(
    ax: Axes | None,
    axes: Axes,
    loc: Literal["outside lower center", "outside right upper"],
    ncols: int,
    handles: Sequence[Any] | None = None,
) -> None:
    """Put a legend outside of a figure of its own; within axes of the caller, as the figure may hold more.

    Args:
        ax: the axes that the caller has given, if any.
        axes: those that are drawn on.
        loc: outside of the figure.
        ncols: columns there.
        handles: to be named; by default all of the axes that have a label.
    """
    shown = list(handles) if handles is not None else axes.get_legend_handles_labels()[0]
    if ax is not None:
        axes.legend(handles=shown)
        return
    figure = axes.get_figure(root=True)
    assert figure is not None, "axes that were removed from their figure"
    figure.legend(handles=shown, loc=loc, ncols=ncols)


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG."""
    return _encoded(_drawn(figure))


def _drawn(figure: Figure) -> FigureCanvasAgg:
    """Return a figure's canvas, drawn once: `savefig` would draw it twice."""
    canvas = FigureCanvasAgg(figure)
    with matplotlib.rc_context(_RC), warnings.catch_warnings():
        # A figure too full for its layout is drawn as it is: nothing that who reads the terminal could mend.
        warnings.filterwarnings("ignore", message=".*layout", category=UserWarning)
        # A letter of the user's that the font lacks is drawn as a box.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font", category=UserWarning)
        canvas.draw()
    return canvas


def _encoded(canvas: FigureCanvasAgg) -> bytes:
    """Return what is drawn on a canvas as a PNG."""
    buffer = io.BytesIO()
    imsave(buffer, canvas.buffer_rgba(), format="png", origin="upper", dpi=canvas.figure.dpi)
    return buffer.getvalue()


def save(pictures: Iterable[tuple[str, Figure]], folder: str | Path) -> list[Path]:
    """Write each picture as `NAME.png` to a folder, which is made if need be; return the files."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)

    def write(name: str, canvas: FigureCanvasAgg) -> Path:
        file = folder / f"{name}.png"
        write_whole(file, _encoded(canvas))
        return file

    # Encoding needs no lock of Python: one picture is encoded while the next is drawn.
    with ThreadPoolExecutor(1) as encoder:
        return [one.result() for one in [encoder.submit(write, name, _drawn(figure)) for name, figure in pictures]]


def axis_label(quantity: str, unit: str) -> str:
    """Return 'quantity [unit]', or the quantity alone where it is a pure number."""
    return f"{quantity} [{unit}]" if unit else quantity


def column_label(column: str) -> str:
    """Return the axis label of a column of a case."""
    return axis_label(*split_unit(column))


def power_of_ten(values: np.ndarray) -> tuple[float, str]:
    """Return a factor and its text for an axis label, for numbers too small or large to be read."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max()) if finite.size else 0.0
    if largest == 0.0 or 1e-2 <= largest < 1e5:
        return 1.0, ""
    power = int(np.floor(np.log10(largest)))
    return 10.0**-power, f"10{str(power).translate(_SUPERSCRIPT)} "


def residual_scale(axes: Axes, models: Sequence[np.ndarray], floor: float) -> None:
    """Scale the y axis for residuals of some models: linear, unless the worst would hide the best.

    Then it is linear up to the best model's residuals or the noise, and logarithmic beyond.
    """
    sizes = [float(np.percentile(size, 98.0)) for r in models if (size := np.abs(r[np.isfinite(r)])).size]
    if not sizes:
        return
    smallest, largest = max(min(sizes), 3.0 * floor), max(sizes)
    if smallest <= 0.0 or largest <= 25.0 * smallest:
        return
    axes.set_yscale("symlog", linthresh=smallest, linscale=1.0)
    decade = 10.0 ** np.ceil(np.log10(smallest))
    decades = [decade * 10.0**k for k in range(int(np.log10(2.0 * largest / decade)) + 1)]
    lowest, highest = (float(f([f(r[np.isfinite(r)], initial=0.0) for r in models])) for f in (np.min, np.max))
    axes.set_yticks([*(-d for d in reversed(decades)), 0.0, *decades])
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(SymmetricalLogLocator(base=10.0, linthresh=smallest, subs=[2, 5]))
    axes.set_ylim(min(1.5 * lowest, -smallest), max(1.5 * highest, smallest))


def drawn_rows(series: Sequence[np.ndarray]) -> np.ndarray:
    """Return the rows of long series, (rows,) each, to be drawn: all of a short one.

    Of more than `MOST_ROWS` the lowest and highest of each series in equal parts: a picture has no more columns of
    dots, and nothing that stands out is lost.
    """
    rows = series[0].size
    if rows <= MOST_ROWS:
        return np.arange(rows)
    parts = MOST_ROWS // (2 * len(series))
    length = -(-rows // parts)
    begins = np.arange(0, rows, length)
    found = [begins, [rows - 1]]
    for values in series:
        padded = np.pad(values, (0, begins.size * length - rows), constant_values=np.nan).reshape(-1, length)
        there = np.isfinite(padded)
        found.append(begins + np.argmin(np.where(there, padded, np.inf), axis=1))
        found.append(begins + np.argmax(np.where(there, padded, -np.inf), axis=1))
    return np.unique(np.concatenate(found))


def plain_log(axis: Any) -> None:
    """Label a logarithmic axis with plain numbers, at 1, 2 and 5 if there is space."""
    low, high = sorted(axis.get_view_interval())
    decades = np.log10(high / low)
    subs = (1.0, 2.0, 5.0) if decades < 2.2 else (1.0, 3.0) if decades < 3.2 else (1.0,)
    axis.set_major_locator(LogLocator(subs=subs))
    axis.set_minor_locator(LogLocator(subs="auto"))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(FuncFormatter(lambda value, _: ""))


def minutes_or_seconds(time_s: np.ndarray) -> tuple[float, str]:
    """Return the factor and unit for a time axis of this length."""
    span = float(time_s[-1] - time_s[0])
    return (1.0, "s") if span <= 600.0 else (1.0 / 60.0, "min") if span <= 6 * 3600.0 else (1.0 / 3600.0, "h")
