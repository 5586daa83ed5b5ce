"""What is left in the residuals of a fitted model, and in which equation it acts: the deficiency map.

Each block is a smooth unknown law: a channel's error as multiplier x f(variable), f piecewise linear on a few knots,
projected off what the model's own unknowns can imitate. Under a model that is right the chi-square of a block is that
of its rank.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.stats import chi2 as chi2_distribution

KNOTS = 9
# A direction of which the model's own unknowns imitate all but this share is theirs.
ABSORBED = 0.03
# Probability, over all blocks together, that a right model is called wrong.
FAMILYWISE = 1e-3


@dataclasses.dataclass(frozen=True)
class Block:
    """One smooth unknown law and how much of the residual it would explain.

    Attributes:
        channel: output whose error it is.
        multiplier: "" or the input that multiplies the law.
        variable: what the law is a function of.
        chi2: drop in chi-square that the law promises, over the residual's own variance.
        rank: free numbers in it.
        p_value: of so large a chi-square under a right model, corrected for the number of blocks.
        knots: values of the variable.
        law: the law at the knots, in the channel's unit (per unit of the multiplier).
        drop: the same drop in chi-square over the stated noise, the unit in which fitted models are compared.
    """

    channel: str
    multiplier: str
    variable: str
    chi2: float
    rank: int
    p_value: float
    knots: np.ndarray
    law: np.ndarray
    drop: float = np.inf

    @property
    def significant(self) -> bool:
        """Return True where a right model would hardly leave this much."""
        return self.p_value < FAMILYWISE

    def sentence(self) -> str:
        """Say where it acts and how it depends on state and input."""
        change = self.law[np.argmax(self.knots)] - self.law[np.argmin(self.knots)]
        trend = "rising" if change > 0.0 else "falling"
        shape = "" if np.all(np.diff(self.law) * change >= 0.0) else ", not evenly"
        factor = f" in proportion to {self.multiplier}" if self.multiplier else ""
        return (
            f"what is left acts on {self.channel}{factor} as a function of {self.variable}, {trend}{shape} "
            f"by {abs(change):.3g} over {self.knots.min():.3g} to {self.knots.max():.3g}"
        )


def deficiency_map(
    base: np.ndarray,
    residual: np.ndarray,
    channel_of: np.ndarray,
    channels: tuple[str, ...],
    scale: np.ndarray,
    variables: dict[str, np.ndarray],
    multipliers: dict[str, np.ndarray],
) -> list[Block]:
    """Return every block's evidence, strongest first.

    Args:
        base: (n + p, p) whitened sensitivities of the readings to the model's unknowns, prior rows appended.
        residual: (n + p,) whitened residual with prior rows.
        channel_of: (n,) number of each reading's channel.
        channels: their names.
        scale: (n,) noise sd of each reading, in its unit.
        variables: by name, (n,) what a law may be a function of.
        multipliers: by name, (n,) what may multiply a law; "" is 1.
    """
    rows = channel_of.size
    q, _ = np.linalg.qr(base)
    left = residual - q @ (q.T @ residual)
    found = []
    for number, channel in enumerate(channels):
        mine = channel_of == number
        if mine.sum() < 10 * KNOTS:
            continue
        # The channel's own level is what the errors scatter by from one reading to the next: a noise sd stated to two
        # digits is itself uncertain by some percent, which is no law.
        fast = np.diff(left[:rows][mine])
        variance = max(float(np.mean(fast**2)) / 2.0, 1e-12)
        for multiplier, factor in multipliers.items():
            for variable, values in variables.items():
                # x f(x) is but another f(x).
                made = _hats(values[mine]) if variable != multiplier else None
                if made is None:
                    continue
                hats, knots = made
                columns = np.zeros((base.shape[0], hats.shape[1]))
                columns[np.flatnonzero(mine)] = hats * (factor[mine] / scale[mine])[:, None]
                length = np.linalg.norm(columns, axis=0)
                columns, hats_kept = columns[:, length > 0.0] / length[length > 0.0], length > 0.0
                columns -= q @ (q.T @ columns)
                basis, size, mix = np.linalg.svd(columns, full_matrices=False)
                own = size > ABSORBED
                if not own.any():
                    continue
                along = basis[:, own].T @ left
                explained = float(np.sum(along**2)) / variance
                law = np.zeros(knots.size)
                law[hats_kept] = (mix[own].T @ (along / size[own])) / length[hats_kept]
                found.append(
                    (channel, multiplier, variable, explained, int(own.sum()), knots, law, explained * variance)
                )
    blocks = [
        Block(
            channel=channel,
            multiplier=multiplier,
            variable=variable,
            chi2=explained,
            rank=rank,
            p_value=min(1.0, len(found) * float(chi2_distribution.sf(explained, rank))),
            knots=knots,
            law=law,
            drop=drop,
        )
        for channel, multiplier, variable, explained, rank, knots, law, drop in found
    ]
    return sorted(blocks, key=lambda block: block.chi2 - block.rank * np.log(rows), reverse=True)


def _hats(values: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Return piecewise linear hat functions on quantile knots, shape (n, knots)."""
    knots = np.unique(np.quantile(values, np.linspace(0.0, 1.0, KNOTS)))
    if knots.size < 2 or np.ptp(knots) < 1e-9 * max(1.0, float(np.abs(knots).max())):
        return None
    return np.stack([np.interp(values, knots, unit) for unit in np.eye(knots.size)], axis=1), knots
