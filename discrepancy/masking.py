"""Effects that hide each other: neither is seen alone, both together explain what is there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from discrepancy.score import SAME_COSINE, ScoreTable

_PAIR_MARGIN = 8.0


@dataclass(frozen=True)
class Pair:
    """Two candidates together.

    Attributes:
        labels: of both.
        shapes: index of the shape of each.
        amplitudes: of each, its first where it has several, in its own unit.
        chi2: drop in chi-square of both together.
    """

    labels: tuple[str, str]
    shapes: tuple[int, int]
    amplitudes: tuple[float, float]
    chi2: float


def masking_pairs(table: ScoreTable) -> tuple[Pair, ...]:
    """Find pairs of effects that explain far more together than any alone.

    Args:
        table: the scores of the single candidates.

    Returns:
        Pairs whose joint drop exceeds the best single one by more than critical_z^2 + 8 (for one amplitude more; by the
        chi-square of the same p for several), best first; each at its best shapes, all amplitudes on their allowed
        sides. Pairs nearly parallel are left out.
    """
    projection = table.projection
    best = max(table.effects, key=lambda effect: effect.chi2)
    tail = 2.0 * norm.sf(table.critical_z)
    found: dict[tuple[str, str], Pair] = {}
    blocks = [block for block in projection.blocks if block.dof]
    for i, first in enumerate(blocks):
        for second in blocks[i + 1 :]:
            if first.candidate == second.candidate or np.linalg.norm(projection.cross(first, second), 2) > SAME_COSINE:
                continue
            drop, *fitted = projection.joint_drop(first, second)
            labels = (first.candidate, second.candidate)
            more_amplitudes = max(1, first.dof + second.dof - best.dof)
            enough = best.chi2 + chi2.isf(tail, more_amplitudes) + _PAIR_MARGIN
            if drop <= enough or (labels in found and drop <= found[labels].chi2):
                continue
            if first.allows(fitted[0]) and second.allows(fitted[1]):
                sizes = [float(block.amplitudes(one)[0][0]) for block, one in zip((first, second), fitted, strict=True)]
                found[labels] = Pair(labels, (first.shape, second.shape), (sizes[0], sizes[1]), drop)
    return tuple(sorted(found.values(), key=lambda pair: -pair.chi2))
