"""Pictures of the proving ground: how far probabilities can be believed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from benchmarks.discrepancy.judge import BINS, Judged
from benchmarks.discrepancy.rates import rate
from jaxmodel.plots.style import BLUE, GREY, PAGE_CM, new_figure, styled


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
