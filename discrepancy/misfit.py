"""What is left in the residuals of a fitted model, and in which equation it acts: the deficiency map.

Each block is a smooth unknown law: a channel's error as multiplier x f(variable), f piecewise linear on a few knots,
projected off what the model's own unknowns can imitate. Under a model that is right the chi-square of a block is that
of its rank.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from jaxmodel.units import unit_of

KNOTS, EVEN_KNOTS = 9, 7
# A direction of which the model's own unknowns imitate all but this share is theirs.
ABSORBED = 0.03
# A free number that moves the readings by less than this share of what another does has no say in the law.
FAINT = 1e-3
# A law that explains this share of what another does cannot be told from it.
AS_GOOD = 0.99
# Probability, over all blocks together, that a right model is called wrong.
FAMILYWISE = 1e-3


@dataclasses.dataclass(frozen=True)
class Block:
    """One smooth unknown law and how much of the residual it would explain.

    Attributes:
        channel: output whose error it is, or the equation in which it acts.
        multiplier: "" or the input that multiplies the law.
        variable: what the law is a function of.
        chi2: drop in chi-square that the law promises, over the variance of what then scatters.
        rank: free numbers in it.
        p_value: of so large a chi-square under a right model, corrected for the number of blocks.
        knots: values of the variable.
        law: the law at the knots, in the channel's unit (per unit of the multiplier).
        drop: the same drop in chi-square over the stated noise, the unit in which fitted models are compared.
        unit: of the law's values.
        port: of the model, or its input, that the law adds to; "" where it is one channel's.
        leaves: by number of each channel that it moves, the RMS of the whitened residuals that it would leave there.
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
    unit: str = ""
    port: str = ""
    leaves: Mapping[int, float] = dataclasses.field(default_factory=dict)

    @property
    def in_equation(self) -> bool:
        """Return True for a law in an equation, which moves every channel that the equation reaches."""
        return self.port != ""

    @property
    def significant(self) -> bool:
        """Return True where a right model would hardly leave this much."""
        return self.p_value < FAMILYWISE

    def sentence(self, tried: Iterable[Block] = ()) -> str:
        """Say where it acts and how it depends on state and input; of all laws tried, which variables serve as well."""
        factor = f" in proportion to {self.multiplier}" if self.multiplier else ""
        return (
            f"what is left acts on {self.channel}{factor} as a function of {self.variable}, {self.shape()} over "
            f"{self.knots.min():.3g} to {self.knots.max():.3g}{self._or(tried)}"
        )

    def shape(self) -> str:
        """Say how the law runs: by how much it rises or falls, or between which extremes it does both."""
        law = self.law[np.argsort(self.knots)]
        turns = np.diff(law)
        unit = f" {self.unit}" if self.unit else ""
        if np.all(turns >= 0.0) or np.all(turns <= 0.0):
            return f"{'rising' if law[-1] > law[0] else 'falling'} by {abs(law[-1] - law[0]):.3g}{unit}"
        low, high = np.argmin(self.law), np.argmax(self.law)
        return (
            f"rising and falling between {self.law[low]:.3g}{unit} at {self.knots[low]:.3g} and "
            f"{self.law[high]:.3g}{unit} at {self.knots[high]:.3g}"
        )

    def _or(self, tried: Iterable[Block]) -> str:
        """Name the variables of which the same law explains all but a hundredth as much."""
        place = (self.channel, self.multiplier)
        others = [
            other.variable
            for other in tried
            if (other.channel, other.multiplier) == place
            and other.variable != self.variable
            and other.drop > AS_GOOD * self.drop
        ]
        return f"; a function of {' or '.join(others)} explains as much" if others else ""


@dataclasses.dataclass(frozen=True)
class Tried:
    """A law that was tried: the readings' answers to its free numbers, and what these are.

    Attributes:
        channel, multiplier, variable, unit, port: as of a `Block`.
        columns: (rows, knots) whitened answers.
        rows: numbers of the rows that these are; the law moves no other.
        knots: values of the variable.
        reaches: numbers of the channels that the law moves.
    """

    channel: str
    multiplier: str
    variable: str
    columns: np.ndarray
    rows: np.ndarray
    knots: np.ndarray
    reaches: tuple[int, ...]
    unit: str = ""
    port: str = ""


class Leftover:
    """What a calibrated model leaves and its own unknowns cannot take."""

    def __init__(self, base: np.ndarray, residual: np.ndarray, channel_of: np.ndarray) -> None:
        """Project the residual.

        Args:
            base: (n + p, p) whitened sensitivities of the readings to the model's unknowns, prior rows appended.
            residual: (n + p,) whitened residual with prior rows.
            channel_of: (n,) number of each reading's channel.
        """
        self.channel_of = channel_of
        self._channel = np.concatenate([channel_of, np.full(residual.size - channel_of.size, -1)])
        self._q, _ = np.linalg.qr(base)
        self.left = residual - self._q @ (self._q.T @ residual)

    def blocks(self, laws: Iterable[Tried]) -> list[Block]:
        """Return the evidence for each law, strongest first."""
        found = []
        for law in laws:
            length = np.linalg.norm(law.columns, axis=0)
            kept = length > FAINT * length.max(initial=0.0)
            if not kept.any():
                continue
            columns = law.columns[:, kept] / length[kept]
            q, left = self._q[law.rows], self.left[law.rows]
            imitated = q.T @ columns
            # Their inner products once projected: as many numbers as knots squared, whatever the readings.
            squared, mix = np.linalg.eigh(columns.T @ columns - imitated.T @ imitated)
            own = squared > ABSORBED**2
            if not own.any():
                continue
            size, mix = np.sqrt(squared[own]), mix[:, own]
            along = (mix.T @ (columns.T @ left)) / size
            taken = mix @ (along / size)
            values = np.zeros(law.knots.size)
            values[kept] = taken / length[kept]
            # What scatters once the law is taken off: a law that jumps with an input is no noise.
            rest = left - columns @ taken + q @ (imitated @ taken)
            by_channel = {one: rest[self._channel[law.rows] == one] for one in law.reaches}
            variance = _scatter(by_channel.values())
            leaves = {one: float(np.sqrt(np.mean(errors**2))) for one, errors in by_channel.items()}
            found.append((law, float(np.sum(along**2)), variance, int(own.sum()), values, leaves))
        blocks = [
            Block(
                channel=law.channel,
                multiplier=law.multiplier,
                variable=law.variable,
                chi2=drop / variance,
                rank=rank,
                p_value=min(1.0, len(found) * float(chi2_distribution.sf(drop / variance, rank))),
                knots=law.knots,
                law=values,
                drop=drop,
                unit=law.unit,
                port=law.port,
                leaves=leaves,
            )
            for law, drop, variance, rank, values, leaves in found
        ]
        return strongest_first(blocks, self.channel_of.size)


def _scatter(channels: Iterable[np.ndarray]) -> float:
    """Return the variance of channels' errors from one reading to the next, in units of the stated noise.

    A noise sd stated to two digits is itself uncertain by some percent, which is no law.
    """
    fast = np.concatenate([np.diff(errors) for errors in channels])
    return max(float(np.mean(fast**2)) / 2.0, 1e-12)


def strongest_first(blocks: Iterable[Block], readings: int) -> list[Block]:
    """Return laws by what they explain less what their free numbers would by chance (as in BIC)."""
    return sorted(blocks, key=lambda block: block.drop - block.rank * np.log(readings), reverse=True)


def deficiency_map(
    leftover: Leftover,
    channels: tuple[str, ...],
    whiten: Callable[[np.ndarray, np.ndarray], np.ndarray],
    variables: dict[str, np.ndarray],
    multipliers: dict[str, np.ndarray],
) -> list[Block]:
    """Return every block of a channel and its evidence, strongest first.

    Args:
        leftover: of a calibrated model.
        channels: names of the channels.
        whiten: makes columns (rows, k) of a channel's errors, in its unit, white noise of unit variance; it is given
            the numbers of the rows.
        variables: by name, (n,) what a law may be a function of.
        multipliers: by name, (n,) what may multiply a law; "" is 1.
    """

    def laws() -> Iterable[Tried]:
        for number, channel in enumerate(channels):
            mine = np.flatnonzero(leftover.channel_of == number)
            if mine.size < 10 * KNOTS:
                continue
            for multiplier, factor in multipliers.items():
                for variable, values in variables.items():
                    # x f(x) is but another f(x).
                    made = hats(values[mine], KNOTS, EVEN_KNOTS) if variable != multiplier else None
                    if made is None:
                        continue
                    shapes, knots = made
                    columns = whiten(shapes * factor[mine][:, None], mine)
                    unit = law_unit(unit_of(channel), multiplier)
                    yield Tried(channel, multiplier, variable, columns, mine, knots, (number,), unit)

    return leftover.blocks(laws())


def law_unit(unit: str, multiplier: str) -> str:
    """Return the unit of a law's values: of what it adds, for each unit of what multiplies it."""
    if not multiplier:
        return "K" if unit == "degC" else unit
    return f"{unit}/{unit_of(multiplier) or f'unit of {multiplier}'}"


def hats(values: np.ndarray, count: int = KNOTS, even: int = 2) -> tuple[np.ndarray, np.ndarray] | None:
    """Return piecewise linear hat functions, shape (n, knots), and their knots; None where nothing varies.

    Knots are so many quantiles, where the readings are, and so many evenly spaced, for what begins at the far end; what
    takes few values has a knot at each, and none between them, where no reading says anything.
    """
    levels = np.unique(values)
    if levels.size <= count:
        return _hats_at(values, levels)
    spread = np.linspace(values.min(), values.max(), even)
    quantiles = np.quantile(values, np.linspace(0.0, 1.0, count))
    apart = 0.3 * np.ptp(values) / max(count, even)
    inner = [x for x in spread[1:-1] if np.abs(quantiles - x).min() > apart]
    return _hats_at(values, np.unique([*quantiles, *inner]))


def _hats_at(values: np.ndarray, knots: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    if knots.size < 2 or np.ptp(knots) < 1e-9 * max(1.0, float(np.abs(knots).max())):
        return None
    return np.stack([np.interp(values, knots, unit) for unit in np.eye(knots.size)], axis=1), knots
