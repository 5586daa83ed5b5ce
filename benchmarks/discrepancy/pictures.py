"""Pictures of the proving ground: power by score, by effect and by size, and how far probabilities can be believed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, PercentFormatter
from scipy.stats import norm

from benchmarks.discrepancy.judge import BINS, Judged
from benchmarks.discrepancy.ranges import PLACES
from benchmarks.discrepancy.rates import rate
from workbench.pictures.style import BLACK, BLUE, GREEN, GREY, ORANGE, PAGE_CM, SEQUENCE, new_figure, styled

if TYPE_CHECKING:  # it looks inside the method, which a picture does not
    from benchmarks.discrepancy.compare import Hidden

COLOUR = {"cell": BLUE, "motor": ORANGE, "robot": GREEN}
# Sigma: what lies outside is drawn at the edge. And the ends of the groups whose share is shown.
LEAST, LARGEST = 0.1, 10_000.0
GROUPS = (0.1, 2.0, 6.0, 30.0, 300.0, 10_000.0)


@styled
def power_picture(hidden: Sequence[Hidden]) -> Figure:
    """Draw the share of hidden effects that were found against how far they stood out, and each of them by name."""
    names = sorted({each.name for each in hidden}, reverse=True)
    figure = new_figure(PAGE_CM, 8.0 + 0.48 * len(names))
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[6.0, 0.5 * len(names) + 0.5])
    sigma = np.array([np.clip(each.sigma, LEAST, LARGEST) for each in hidden])
    grid = np.geomspace(LEAST, LARGEST, 300)
    limit = float(np.mean([each.critical_z for each in hidden]))
    upper.plot(grid, norm.sf(limit - grid), color=GREY, label="by theory: score significant")
    for found, colour, shift, label in (
        ([each.significant for each in hidden], GREY, 0.96, "score significant"),
        ([each.named for each in hidden], BLUE, 1.04, "named by the diagnosis"),
    ):
        for number, (low, high) in enumerate(itertools.pairwise(GROUPS)):
            inside = (sigma >= low) & ((sigma < high) | (high == LARGEST))
            share = rate(np.array(found)[inside])
            if not share.of:
                continue
            centre = shift * np.sqrt(low * high)
            upper.errorbar(
                centre,
                share.share,
                share.arms,
                fmt="o",
                markersize=4.5,
                color=colour,
                capsize=2.0,
                label=label if number == len(GROUPS) - 2 else None,
            )
            if colour == BLUE:
                upper.annotate(f"{share.of}", (centre, -0.02), ha="center", va="top", fontsize=7.5, color=GREY)
    upper.set_ylim(-0.12, 1.05)
    upper.yaxis.set_major_formatter(PercentFormatter(1.0))
    upper.set_ylabel("hidden effects found")
    upper.legend(loc="lower center", bbox_to_anchor=(0.42, 1.02), ncols=3, fontsize=8.0)
    for place, name in enumerate(names):
        for each in hidden:
            if each.name == name:
                colour = COLOUR[each.kind]
                lower.plot(
                    np.clip(each.sigma, LEAST, LARGEST),
                    place,
                    "o",
                    markersize=6.0,
                    markeredgecolor=colour,
                    markerfacecolor=colour if each.named else "none",
                )
    for kind, colour in COLOUR.items():
        lower.plot([], [], "o", color=colour, label=kind)
    lower.plot([], [], "o", markeredgecolor=BLACK, markerfacecolor="none", label="not named")
    lower.axvline(limit, color=GREY, linewidth=1.0)
    lower.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
    lower.set_ylim(-0.7, len(names) - 0.3)
    lower.set_xscale("log")
    lower.set_xlim(0.8 * LEAST, 1.25 * LARGEST)
    lower.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    lower.set_xlabel("how far the true effect stands out: expected score after projection [sigma]")
    figure.legend(*lower.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


@styled
def range_picture(lifts: Mapping[str, Mapping[str, np.ndarray]]) -> Figure:
    """Draw, for every effect and size, the probability that its score would be significant, mean over the cases."""
    kinds = [kind for kind in COLOUR if kind in lifts]
    names = sorted({name for kind in kinds for name in lifts[kind]}, reverse=True)
    figure = new_figure(PAGE_CM, 3.0 + 0.42 * len(names))
    panels = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    mesh = None
    for axes, kind in zip(panels, kinds, strict=True):
        shares = np.full((len(names), PLACES.size), np.nan)
        cases = 0
        for row, name in enumerate(names):
            if name in lifts[kind]:
                shares[row] = np.mean(norm.cdf(lifts[kind][name]), axis=0)
                cases = max(cases, len(lifts[kind][name]))
        mesh = axes.pcolormesh(PLACES, range(len(names)), shares, cmap=SEQUENCE, vmin=0.0, vmax=1.0, shading="nearest")
        axes.grid(False)
        axes.set_title(f"{kind}, {cases} cases")
        axes.set_xticks([0.0, 1.0], ["low end", "high end"])
        for label, side in zip(axes.get_xticklabels(), ("left", "right"), strict=True):
            label.set_horizontalalignment(side)
        axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names])
        axes.tick_params(length=0)
    assert mesh is not None
    panels[len(kinds) // 2].set_xlabel("size within the effect's usual range")
    bar = figure.colorbar(mesh, ax=panels, format=PercentFormatter(1.0), shrink=0.6, pad=0.02)
    bar.set_label("power: score beyond its critical value")
    return figure


@styled
def reliability_picture(cases: Sequence[Judged]) -> Figure:
    """Draw how often answers are right against the probability that they give themselves."""
    figure = new_figure(0.72 * PAGE_CM, 0.58 * PAGE_CM)
    axes = figure.subplots()
    axes.plot([0.0, 1.0], [0.0, 1.0], color=GREY, linewidth=1.0)
    for low, high in itertools.pairwise(BINS):
        inside = [case for case in cases if low < case.probability <= high]
        if not inside:
            continue
        share = rate(case.right for case in inside)
        said = float(np.mean([case.probability for case in inside]))
        axes.errorbar(said, share.share, share.arms, fmt="o", color=BLUE, capsize=2.0)
        axes.annotate(
            f"{share.hits} of {share.of}",
            (said, share.share),
            xytext=(8, -3) if high == BINS[-1] else (-6, -10 if share.share > 0.1 else 5),
            textcoords="offset points",
            ha="left" if high == BINS[-1] else "right",
            fontsize=8.0,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )
    axes.set_xlim(0.0, 1.22)  # room for the last label
    axes.set_ylim(0.0, 1.03)
    axes.set_xticks(np.linspace(0.0, 1.0, 6))
    axes.set_aspect("equal")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(PercentFormatter(1.0))
    axes.set_xlabel("probability of the likeliest hypothesis")
    axes.set_ylabel("answers that are right")
    return figure
