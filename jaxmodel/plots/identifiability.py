"""Identifiability: sources of information, correlations, joint confidence regions, profile likelihoods."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator

from jaxmodel.diagnosis.advice.identifiability import Identifiability, Profiled
from jaxmodel.diagnosis.identification import Identification
from jaxmodel.plots.style import (
    BLUE,
    GREY,
    LINES,
    ORANGE,
    PAGE_CM,
    axis_label,
    legend,
    new_figure,
    one_axes,
    power_of_ten,
    styled,
)

_PRIOR, _PRIORS_OF_OTHERS = "#b5b5b5", "#dddddd"


def pictures_of(identification: Identification) -> dict[str, Figure]:
    """Return every picture that an identification has data for, by name."""
    found, asked = identification.found, [one.name for one in identification.profiles]
    pictures = {"information": information_bars(found)}
    if len(found.names) > 1:
        pictures["correlations"] = correlations(found)
        for first, second in _pairs(found, asked):
            pictures[f"ellipse-{first}-{second}"] = ellipse(found, first, second)
    for one in identification.profiles:
        pictures[f"profile-{one.name}"] = profile_beside_quadratic(one, found.units[found.names.index(one.name)])
    return pictures


def _pairs(found: Identifiability, asked: Sequence[str]) -> list[tuple[str, str]]:
    """Return each requested parameter with the one most correlated with it, or the most correlated pair."""
    size = np.abs(found.information.correlation() - np.eye(len(found.names)))
    if not asked:
        first, second = np.unravel_index(int(np.argmax(size)), size.shape)
        return [(found.names[first], found.names[second])]
    return [(name, found.names[int(np.argmax(size[found.names.index(name)]))]) for name in asked]


@styled
def information_bars(found: Identifiability) -> Figure:
    """Draw for each parameter the shares of runs and of sensors in the final information."""
    figure = new_figure(PAGE_CM, 4.6 + 0.62 * len(found.names))
    left, right = figure.subplots(1, 2, sharey=True)
    _stacked(left, found, found.runs, found.shares_by_run())
    _stacked(right, found, found.sensors, found.shares_by_sensor())
    left.set_title("by run")
    right.set_title("by sensor")
    for axes in (left, right):
        axes.set_xlim(0.0, 100.0)
        axes.set_xlabel("share of the information [%]")
        axes.grid(visible=False, axis="y")
        axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.16 - 0.35 / len(found.names)), ncols=1, handlelength=1.2)
    gain = found.prior_sd / found.sd
    names = [
        f"{name}  (x {g:.2g})" if g < 100 else f"{name}  (x {g:.0f})" for name, g in zip(found.names, gain, strict=True)
    ]
    left.set_yticks(np.arange(len(names)), names)
    left.invert_yaxis()
    return figure


def _stacked(axes: Axes, found: Identifiability, names: tuple[str, ...], shares: np.ndarray) -> None:
    places, begin = np.arange(len(found.names)), np.zeros(len(found.names))
    own, others = found.shares_known_before()
    bars = [(name, part, LINES[i % len(LINES)]) for i, (name, part) in enumerate(zip(names, shares, strict=True))]
    bars += [("prior", own, _PRIOR), ("priors of other parameters", others, _PRIORS_OF_OTHERS)]
    for name, part, colour in bars:
        axes.barh(places, 100.0 * part, left=begin, height=0.68, color=colour, label=name, edgecolor="white", lw=0.4)
        begin = begin + 100.0 * part


@styled
def ellipse(found: Identifiability, first: str, second: str, ax: Axes | None = None) -> Figure:
    """Draw the confidence regions of two parameters: prior, posterior, and each run alone with the prior.

    Args:
        found: what the runs determine.
        first: the name of a parameter.
        second: that of another.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    i, j = found.names.index(first), found.names.index(second)
    centre, scale = found.values[[i, j]], found.prior_sd[[i, j]]

    def outline(covariance: np.ndarray, size: float) -> np.ndarray:
        turn = np.linspace(0.0, 2.0 * np.pi, 181)
        circle = np.stack([np.cos(turn), np.sin(turn)])
        root = np.linalg.cholesky(covariance[np.ix_([i, j], [i, j])])
        return centre[:, None] + size * scale[:, None] * (root @ circle)

    figure, axes = one_axes(ax, 0.72 * PAGE_CM, 0.62 * PAGE_CM)
    width, unit = len(found.sensors), np.eye(len(found.names))
    for number, (run, colour) in enumerate(zip(found.runs, LINES[2:] * len(found.runs), strict=False)):
        part = found.information.parts[number * width : (number + 1) * width].sum(axis=0)
        axes.plot(*outline(np.linalg.inv(part + unit), 1.0), color=colour, lw=1.0, ls="--", label=f"{run} alone")
    after = found.information.covariance
    axes.fill(*outline(after, 2.0), color=BLUE, alpha=0.15, lw=0.0)
    axes.fill(*outline(after, 1.0), color=BLUE, alpha=0.45, lw=0.0, label="all runs, one and two sd")
    axes.plot(*centre, "+", color="black", markersize=6)
    # A prior that is far wider would shrink all others to a dot.
    low, high = axes.get_xlim(), axes.get_ylim()
    if np.all(scale < 6.0 * np.array([low[1] - low[0], high[1] - high[0]])):
        axes.plot(*outline(unit, 1.0), color=GREY, lw=1.2, label="prior, one sd")
    axes.locator_params(nbins=6)
    axes.set_xlabel(axis_label(first, found.units[i]))
    axes.set_ylabel(axis_label(second, found.units[j]))
    legend(ax, axes, "outside lower center", 2)
    return figure


@styled
def correlations(found: Identifiability, ax: Axes | None = None) -> Figure:
    """Draw the correlations of the estimates as a heat map.

    Args:
        found: what the runs determine.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    table = found.information.correlation()
    count = len(found.names)
    figure, axes = one_axes(ax, min(PAGE_CM, 6.5 + 1.05 * count), 4.5 + 0.75 * count)
    axes.pcolormesh(table, cmap="RdBu_r", vmin=-1.0, vmax=1.0, edgecolor="white", lw=1.0)
    for (row, column), number in np.ndenumerate(table):
        colour = "white" if abs(number) > 0.6 else "black"
        axes.text(column + 0.5, row + 0.5, f"{number:.2f}", ha="center", va="center", fontsize=7.5, color=colour)
    axes.set_xticks(np.arange(count) + 0.5, found.names, rotation=35, ha="right")
    axes.set_yticks(np.arange(count) + 0.5, found.names)
    axes.invert_yaxis()
    axes.grid(visible=False)
    axes.tick_params(length=0)
    axes.set_title("correlation of the estimates", fontweight="normal", fontsize=8.5, color="#555555")
    return figure


@styled
def profile_beside_quadratic(profiled: Profiled, unit: str, ax: Axes | None = None) -> Figure:
    """Draw the profile likelihood of one parameter and the quadratic approximation from its information.

    Args:
        profiled: the profile.
        unit: of the parameter.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    figure, axes = one_axes(ax, 0.8 * PAGE_CM, 7.5)
    extra, power = power_of_ten(np.abs(profiled.values))
    values = profiled.values * extra
    fine = np.linspace(values[0], values[-1], 201)
    # In the coordinate of the fit, which may be a logarithm, the root of the quadratic is linear.
    sides = np.sign(np.arange(values.size) - values.size // 2)
    root = PchipInterpolator(values, sides * np.sqrt(profiled.quadratic))(fine)
    axes.plot(fine, root**2, color=BLUE, label="quadratic approximation")
    axes.plot(values, profiled.rise, "o-", color=ORANGE, markersize=4, label="profile: all others fitted again")
    for level, words in ((1.0, "one sd"), (4.0, "two sd")):
        axes.axhline(level, color=GREY, lw=0.7, ls=":")
        axes.text(values[-1], level, f" {words}", va="bottom", ha="right", fontsize=7.5, color=GREY)
    axes.set_xlabel(axis_label(profiled.name, f"{power}{unit}".strip()))
    axes.set_ylabel("rise of chi-square")
    legend(ax, axes, "outside lower center", 2)
    return figure
