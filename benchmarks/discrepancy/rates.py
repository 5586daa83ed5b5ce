"""Shares of cases with their intervals, and tables of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from statsmodels.stats.proportion import proportion_confint


@dataclasses.dataclass(frozen=True)
class Rate:
    """How many of how many, with the 95 % interval (Wilson) of the share."""

    hits: int
    of: int

    @property
    def share(self) -> float:
        """The share; nan without a case."""
        return self.hits / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the share."""
        if not self.of:
            return 0.0, 1.0
        low, high = np.asarray(proportion_confint(self.hits, self.of, method="wilson"), dtype=float)
        return float(low), float(high)

    @property
    def arms(self) -> list[list[float]]:
        """How far the interval reaches below and above the share, as a plot asks for it."""
        low, high = self.interval
        return [[max(0.0, self.share - low)], [max(0.0, high - self.share)]]

    def __str__(self) -> str:
        """Say it in words."""
        if not self.of:
            return "no case"
        low, high = self.interval
        return f"{self.share:6.1%}  ({low:.0%} to {high:.0%}; {self.hits} of {self.of})"


def rate(hits: Iterable[bool]) -> Rate:
    """Count."""
    values = list(hits)
    return Rate(sum(values), len(values))


def in_words(found: Rate | float) -> str:
    """Return a figure of merit as text."""
    return str(found) if isinstance(found, Rate) else f"{found:.3f}" if np.isfinite(found) else "no case"


def markdown(table: Mapping[str, Mapping[str, Rate | float | str]], first: str, methods: Sequence[str] = ()) -> str:
    """Return rates by method as a table for a page: a share, its interval, and of how many."""
    rows = {name: table[name] for name in methods or table if name in table}
    columns = list(next(iter(rows.values())))
    lines = [f"| {first} | {' | '.join(columns)} |", "| --- |" + " --- |" * len(columns)]
    lines += [f"| {name} | {' | '.join(_cell(found[c]) for c in columns)} |" for name, found in rows.items()]
    return "\n".join(lines)


def _cell(found: Rate | float | str) -> str:
    if isinstance(found, str):
        return found
    if not isinstance(found, Rate):
        return f"{found:.3g}" if np.isfinite(found) else ""
    if not found.of:
        return ""
    low, high = found.interval
    return f"{found.hits} of {found.of} ({100 * low:.0f} to {100 * high:.0f} %)"
