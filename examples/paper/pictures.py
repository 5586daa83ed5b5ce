"""Comparisons with the paper: candidates for Table 1, the voltage of Fig. 8, the tests, the doubling."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from jaxmodel.plots import LINES, new_figure, styled

BLUE, ORANGE, BLACK, GREY = *LINES[:2], "#1a1a1a", "#8c8c8c"
PAGE_CM = 17.0  # text width of an A4 report

DASHES = ("-", (0, (5, 2)), (0, (1, 1.4)), (0, (5, 1.5, 1, 1.5)))


@styled
def carried_slopes(
    printed: Mapping[float, float], half_step: float, fits: Mapping[str, Mapping[float, float]]
) -> Figure:
    """Draw the slopes of Table 1 with their rounding, and those of each hypothesis.

    Args:
        printed: slope [1/s] by ambient [degC].
        half_step: half of the printed step.
        fits: by hypothesis, its slopes.
    """
    figure = new_figure(PAGE_CM, 9.5)
    axes = figure.subplots()
    at = np.array(list(printed))
    for number, (name, slopes) in enumerate(fits.items()):
        style = DASHES[number // len(LINES[:6]) % len(DASHES)]
        width = 3.0 if number == 0 else 1.4  # others may lie upon the first
        axes.plot(at, 1e4 * np.array([slopes[t] for t in at]), color=LINES[number % 6], ls=style, lw=width, label=name)
    values = 1e4 * np.array(list(printed.values()))
    marked = {"fmt": "s", "color": BLACK, "markersize": 4, "capsize": 3, "zorder": 5}
    axes.errorbar(at, values, 1e4 * half_step, label="Table 1, as printed", **marked)
    axes.set_xlabel("ambient [°C]")
    axes.set_ylabel("slope of the charge [10⁻⁴ / s]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@styled
def cell_voltage(
    discharges: Mapping[str, tuple[np.ndarray, np.ndarray, Sequence[float]]], printed: Sequence[tuple[float, float]]
) -> Figure:
    """Draw the voltage of a cell over time with its third-order polynomial, and the points given in the paper.

    Args:
        discharges: by name, time [s], voltage [V] and the polynomial's coefficients, highest power first.
        printed: points of time [s] and voltage [V].
    """
    figure = new_figure(PAGE_CM, 9.0)
    axes = figure.subplots()
    for (name, (time_s, volts, cubic)), colour in zip(discharges.items(), LINES, strict=False):
        axes.plot(time_s[1:], volts[1:], color=colour, lw=1.0 if "alternating" in name else 1.5, alpha=0.8, label=name)
        axes.plot(time_s[1:], np.polyval(cubic, time_s[1:]), color=colour, lw=1.2, ls=(0, (2, 1.5)))
    axes.plot([], [], color=BLACK, lw=1.2, ls=(0, (2, 1.5)), label="third-order polynomial of each")
    axes.plot(*np.array(printed).T, "s", color=BLACK, markerfacecolor="white", label="levels given in the paper")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("voltage of one cell [V]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@styled
def tests(
    names: Sequence[str],
    printed: np.ndarray,
    over_test: np.ndarray,
    allowed: np.ndarray,
    model: np.ndarray,
) -> Figure:
    """Draw the gradients of the four tests: printed, allowed by the voltmeter, and of the model.

    Args:
        names: of the tests.
        printed: Table 5, V/s, shape (tests,).
        over_test: drop of Table 3 over the half hour, V/s, shape (tests,).
        allowed: steepest and flattest consistent with the readings, V/s, shape (2, tests).
        model: the model's, V/s, shape (tests,).
    """
    figure = new_figure(PAGE_CM, 7.0)
    axes = figure.subplots()
    place = np.arange(len(names))
    allowed_label = "range allowed by readings to 0.1 V over 1800 s"
    axes.bar(place, 1e5 * (allowed[1] - allowed[0]), 0.5, 1e5 * allowed[0], color="#d9d9d9", label=allowed_label)
    axes.hlines(1e5 * over_test, place - 0.25, place + 0.25, color=GREY, lw=2.0, label="drop of Table 3 over 1800 s")
    axes.plot(place - 0.08, 1e5 * printed, "s", color=ORANGE, label="Table 5, as printed")
    axes.plot(place + 0.08, 1e5 * model, "o", color=BLUE, label="model, from the charge that rests at 22.6 V")
    axes.axhline(0.0, color=BLACK, lw=0.7)
    axes.set_xticks(place, names)
    axes.set_ylabel("gradient of one cell [10⁻⁵ V/s]")
    axes.grid(visible=False, axis="x")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


@styled
def doubled_voltages(time_s: np.ndarray, base: np.ndarray, moved: Mapping[str, np.ndarray]) -> Figure:
    """Draw the voltage of a cell, unchanged and with components doubled, over time [s]; voltages in V."""
    figure = new_figure(PAGE_CM, 8.5)
    axes = figure.subplots()
    axes.plot(time_s[1:], base[1:], color=BLACK, lw=2.0, label="unchanged")
    for number, (name, volts) in enumerate(moved.items()):
        axes.plot(time_s[1:], volts[1:], color=LINES[number % 6], ls=DASHES[1 + number // 6], label=name)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("voltage of one cell [V]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure
