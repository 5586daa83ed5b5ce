"""The evidence of a diagnosis: errors of the models, corrections of tables, scores of effects, candidates."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.diagnosis.result import ChannelError, CurveFound, Diagnosis, ScoreEntry
from jaxmodel.diagnosis.wording import candidate_name, effect_name, is_law, ladder_names
from jaxmodel.plots.style import (
    BASE,
    BLACK,
    FINAL,
    FLOOR,
    GREY,
    PAGE_CM,
    SKY,
    axis_label,
    column_label,
    legend,
    new_figure,
    one_axes,
    plain_log,
    styled,
)

# Knots with an sd of more than this times the median do not set the scale.
_UNCERTAIN = 4.0
_RUNG_WIDTH, _RUNG_LINES = 38, 3  # letters of a rung's name on one line, and its lines
_MODEL_WIDTH = 46


@styled
def ladder(diagnosis: Diagnosis) -> Figure:
    """Draw each channel's error of each model of a diagnosis; see `errors_of_models`."""
    noise_sd = {channel: noise.sd for channel, noise in diagnosis.noise.items()}
    return errors_of_models([one.errors for one in diagnosis.ladder], ladder_names(diagnosis.ladder), noise_sd)


@styled
def errors_of_models(
    models: Sequence[Mapping[str, ChannelError]], names: Sequence[str], noise_sd: Mapping[str, float]
) -> Figure:
    """Draw each channel's error of each model, on fit runs and on check runs, as bars from the noise floor.

    On the logarithmic scale the length of a bar is the ratio of error to noise.

    Args:
        models: errors by channel, model after model.
        names: of the models.
        noise_sd: the noise floor of each channel to draw, in the channel's unit.
    """
    channels = list(noise_sd)
    columns = min(len(channels), 2)
    rows = -(-len(channels) // columns)
    figure = new_figure(PAGE_CM, 1.8 + rows * (1.5 + 1.0 * len(models)))
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axes, channel in zip(grid.flat, channels, strict=False):
        errors = [(one[channel].fit, one[channel].check) for one in models]
        _errors_of_channel(axes, channel, errors, names, noise_sd[channel])
    for axes in grid.flat[len(channels) :]:
        axes.set_visible(False)
    grid[0, 0].invert_yaxis()
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _errors_of_channel(
    axes: Axes, channel: str, errors: Sequence[tuple[float, float]], names: Sequence[str], floor: float
) -> None:
    quantity, unit = split_unit(channel)
    positive = [e for pair in errors for e in pair if np.isfinite(e) and e > 0.0]
    scale, shown_unit = readable([*positive, floor], difference_unit(unit))
    places = np.arange(len(errors))
    lowest = floor if floor > 0.0 else 0.5 * min(positive, default=1.0)
    styles = (("fit runs", BASE, -0.19), ("check runs", FINAL, 0.19))
    for number, (label, colour, offset) in enumerate(styles):
        values = np.array([pair[number] for pair in errors]) * scale
        shown = np.isfinite(values) & (values > 0.0)
        axes.barh(
            places[shown] + offset,
            values[shown] - lowest * scale,
            left=lowest * scale,
            height=0.34,
            color=colour,
            label=label,
        )
        for place, value in zip(places[shown] + offset, values[shown], strict=True):
            axes.annotate(
                f"{value:.3g}",
                (max(value, lowest * scale), place),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                fontsize=8.0,
            )
    if floor > 0.0:
        axes.axvline(floor * scale, color=FLOOR, lw=2.0, label="sensor noise")
    axes.set_xscale("log")
    low, high = min([lowest, *positive]) * scale, max([lowest, *positive]) * scale
    high = max(high, 3.0 * low)  # bars of a channel that every model fits stay short
    axes.set_xlim(low / (high / low) ** 0.06 / 1.05, high * (high / low) ** 0.18 * 1.3)
    plain_log(axes.xaxis)
    axes.grid(visible=False, axis="y")
    axes.set_yticks(
        places, [textwrap.fill(name, _RUNG_WIDTH, max_lines=_RUNG_LINES, placeholder=" …") for name in names]
    )
    axes.set_xlabel(axis_label(f"RMS error, {quantity}", shown_unit))


@styled
def scores(diagnosis: Diagnosis, most: int = 24, ax: Axes | None = None) -> Figure:
    """Draw the size of every effect's standard score at the calibrated base model, the strongest on top.

    Args:
        diagnosis: with scores.
        most: effects to draw.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    entries = sorted(diagnosis.scores, key=lambda entry: -abs(entry.z))[:most]
    critical = diagnosis.critical_z
    figure, axes = one_axes(ax, PAGE_CM, 2.2 + 0.52 * len(entries))
    places = np.arange(len(entries))
    for place, entry in zip(places, entries, strict=True):
        colour, face, _ = _score_style(entry)
        axes.plot([0.0, abs(entry.z)], [place, place], color=colour, lw=1.6, solid_capstyle="butt")
        axes.plot(abs(entry.z), place, "o", color=colour, markerfacecolor=face, markersize=5.5)
        if not entry.blind:
            axes.annotate(
                _signed(entry.z),
                (abs(entry.z), place),
                xytext=(6, 0),
                textcoords="offset points",
                va="center",
                fontsize=7.5,
            )
    for entry in {_score_style(e)[2]: e for e in entries}.values():
        colour, face, label = _score_style(entry)
        axes.plot([], [], "o", color=colour, markerfacecolor=face, markersize=5.5, label=label)
    axes.axvline(
        critical, color=BLACK, lw=1.2, ls=(0, (4, 2)), label=f"critical value {critical:.2f}, for all effects together"
    )
    largest = max([abs(entry.z) for entry in entries], default=critical)
    if largest > 10.0 * critical:
        axes.set_xscale("symlog", linthresh=critical, linscale=1.0)
        decades = [10.0**k for k in range(1, int(np.log10(largest)) + 1)]
        axes.set_xticks([0.0, *range(1, int(critical) + 1), *decades])
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.minorticks_off()
        axes.set_xlim(0.0, largest * 2.2)
    else:
        axes.set_xlim(0.0, 1.12 * max(largest, critical))
    axes.set_yticks(places, [effect_name(entry.label) for entry in entries])
    axes.set_ylim(len(entries) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("|z| of the effect's amplitude (its sign is printed)")
    legend(ax, axes, "outside lower center", 2)
    return figure


def _signed(z: float) -> str:
    """Return a score with its sign, to three digits."""
    if abs(z) < 0.005:
        return "0"
    return f"{z:+,.0f}" if abs(z) >= 100.0 else f"{z:+.3g}"


def _score_style(entry: ScoreEntry) -> tuple[str, str, str]:
    """Return colour, face and legend of a score."""
    if entry.significant:
        return FINAL, FINAL, "significant"
    if entry.blind:
        return GREY, "white", "not detectable with these data"
    return SKY, SKY, "not significant"


@styled
def candidates(diagnosis: Diagnosis, ax: Axes | None = None) -> Figure:
    """Draw the probability of each model with at least half a percent.

    Args:
        diagnosis: with the models that it compared.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    shown = [one for one in diagnosis.candidates if one[1] >= 0.005] or diagnosis.candidates[:1]
    names = [textwrap.fill(candidate_name(name), _MODEL_WIDTH) for name, _ in shown]
    values = np.array([probability for _, probability in shown])
    lines = max(name.count("\n") for name in names)
    figure, axes = one_axes(ax, PAGE_CM, 1.6 + (0.68 + 0.4 * lines) * len(names))
    places = np.arange(len(names))
    axes.barh(places, values, height=0.6, color=[FINAL if v == values.max() else BASE for v in values])
    for place, value in zip(places, values, strict=True):
        text = f"{value:.2f}"
        axes.annotate(text, (value, place), xytext=(4, 0), textcoords="offset points", va="center", fontsize=8.5)
    axes.set_xlim(0.0, 1.08)
    axes.set_xticks(np.linspace(0.0, 1.0, 6))
    axes.set_yticks(places, names)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("probability")
    return figure


@styled
def promises(table: pd.DataFrame, most: int = 16, ax: Axes | None = None) -> Figure:
    """Draw the expected gain of log evidence of each candidate over the present model, the best on top.

    Args:
        table: name, group and log_evidence, as an investigation ranks its candidates.
        most: candidates to draw.
        ax: axes of yours to draw on; by default those of a new figure.
    """
    shown = table.sort_values("log_evidence", ascending=False).head(most)
    groups = list(dict.fromkeys(shown["group"]))
    figure, axes = one_axes(ax, PAGE_CM, 2.0 + 0.52 * len(shown))
    places = np.arange(len(shown))
    for group, colour in zip(groups, itertools.cycle((FINAL, BASE, SKY, GREY, BLACK))):
        own = (shown["group"] == group).to_numpy()
        axes.barh(places[own], shown["log_evidence"][own], height=0.6, color=colour, label=group)
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_yticks(places, [effect_name(name) for name in shown["name"]])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("score: expected gain of log evidence")
    legend(ax, axes, "outside lower center", 5)
    return figure


@styled
def curves(found: Sequence[CurveFound]) -> Figure:
    """Draw the correction of each table or relation, with one and two standard deviations.

    Args:
        found: one curve at least.
    """
    columns = min(len(found), 2)
    rows = -(-len(found) // columns)
    figure = new_figure(PAGE_CM, 0.8 + 5.6 * rows)
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes, curve in zip(grid.flat, found, strict=False):
        _curve(axes, curve)
    for axes in grid.flat[len(found) :]:
        axes.set_visible(False)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def _curve(axes: Axes, curve: CurveFound) -> None:
    if curve.unit:
        whole, per, part = curve.unit.partition("/")
        scale, unit = readable(curve.value, whole)
        unit += per + part

        def shown(values: np.ndarray) -> np.ndarray:
            return scale * values
    else:
        unit = "%"

        def shown(values: np.ndarray) -> np.ndarray:
            return 100.0 * (np.exp(np.clip(values, -10.0, 10.0)) - 1.0)

    axes.axhline(0.0, color=GREY, lw=0.7)
    for times, alpha, label in ((2.0, 0.13, "2 sd"), (1.0, 0.25, "1 sd")):
        low, high = shown(curve.value - times * curve.sd), shown(curve.value + times * curve.sd)
        axes.fill_between(curve.at, low, high, color=FINAL, alpha=alpha, lw=0, label=label)
    axes.plot(curve.at, shown(curve.value), "o-", color=FINAL, markersize=3.5, label="correction")
    # A knot that the data hardly determine must not flatten the others.
    certain = curve.sd <= _UNCERTAIN * float(np.median(curve.sd))
    reach = np.concatenate([shown(curve.value + side * curve.sd)[certain] for side in (-2.0, 2.0)] + [np.zeros(1)])
    margin = 0.06 * max(float(np.ptp(reach)), 1e-12)
    axes.set_ylim(float(reach.min()) - margin, float(reach.max()) + margin)
    axes.set_xlabel(column_label(curve.over))
    factor = f" per {column_label(curve.multiplier)}" if curve.multiplier else ""
    axes.set_ylabel(axis_label("correction", f"{unit}{factor}" if unit else factor.strip()))
    kind = "unknown law" if is_law(curve.label) else "table of the case" if curve.stated else "the model's formula"
    axes.set_title(textwrap.fill(f"{curve.relation}: {kind}", 46))
