"""A statement on where a model fails, explanations made of statements, and the view that they are derived from."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxmodel.diagnosis.residuals.regimes import Bins, cut, regimes
from jaxmodel.diagnosis.residuals.table import Bools, ChannelResiduals, Floats

OPEN_CIRCUIT_VOLTAGE, RESISTANCE, HEAT = "open_circuit_voltage", "resistance", "heat"
TEMPERATURE_DEPENDENCE, ONE_RUN = "temperature_dependence", "run"

# Possible drives, in order of preference: the first that is a condition of the channel.
DRIVES = ("current_A", "pack_current_A", "load_torque_Nm", "motor_current_A", "duty")


@dataclass(frozen=True)
class Statement:
    """One sentence on where a model fails.

    Attributes:
        channel: the channel.
        condition: the condition; "run" for one run.
        lower: where it begins; -inf for everything below `upper`.
        upper: where it ends.
        text: the sentence.
        cause: `open_circuit_voltage`, `resistance`, `heat`, `temperature_dependence`, `run`, or "" if unknown.
        value: what would have to be added to the model's quantity: its voltage, resistance, temperature.
        unit: of the value.
        runs_seen: number of runs that show it.
        share: part of the channel's mean square that it explains.
        size: root mean square of the explained part where it holds, in the channel's unit.
        readings: number of readings behind it.
    """

    channel: str
    condition: str
    lower: float
    upper: float
    text: str
    cause: str
    value: float
    unit: str
    runs_seen: int
    share: float
    size: float
    readings: int


@dataclass(frozen=True, eq=False)
class View:
    """The unexplained residuals of a channel, and the conditions that may explain them.

    Attributes:
        residuals: the part that is not explained yet.
        conditions: those that take part, in order of preference.
        cuts: each cut into ranges.
        capacity_Ah: of the cell, where known.
        most_p: chance of a false statement over all conditions.
        given: sum of squares, weighted by time, before anything was explained; 0 if nothing was.
        counted: the same over the runs that remain, if some were set aside; 0 if none was.
    """

    residuals: ChannelResiduals
    conditions: tuple[str, ...]
    cuts: Mapping[str, Bins]
    capacity_Ah: float | None
    most_p: float
    given: float = 0.0
    counted: float = 0.0

    @property
    def drive(self) -> str | None:
        """Return the name of the drive; None if it does not vary materially."""
        return next((name for name in DRIVES if name in self.conditions), None)

    @property
    def prefix(self) -> str:
        """Return how a sentence begins: a later one is about what the statements before it left unexplained."""
        return "In addition, " if self.given else ""

    @property
    def total(self) -> float:
        """Return the sum of squares, weighted by time, to which shares refer."""
        return self.given or float(np.sum(self.residuals.weight_s * self.residuals.error**2))

    def less(self, explained: Floats) -> View:
        """Return the view without an explained part."""
        return dataclasses.replace(self, residuals=self.residuals.less(explained), given=self.total)

    def without_run(self, run: int) -> View:
        """Return the view of the other runs, with its conditions chosen again."""
        rest = self.residuals.rows(self.residuals.run != run)
        counted = float(np.sum(rest.weight_s * rest.error**2))
        return dataclasses.replace(view_of(rest, self.capacity_Ah, self.most_p), given=self.total, counted=counted)

    def share(self, explained: Floats, rows: Bools | None = None) -> float:
        """Return the share of the squares that an explanation removes, over some rows or all."""
        r = self.residuals
        gone = r.weight_s * (r.error**2 - (r.error - explained) ** 2)
        return float(np.sum(gone if rows is None else gone[rows]) / self.total)


def view_of(residuals: ChannelResiduals, capacity_Ah: float | None, most_p: float) -> View:
    """Return the first view of a channel's residuals."""
    names = regimes(residuals).names
    return View(residuals, names, {name: cut(residuals, name) for name in names}, capacity_Ah, most_p)


@dataclass(frozen=True, eq=False)
class Explanation:
    """Statements that belong together, and the part of every error that they explain.

    Attributes:
        statements: the sentences.
        parts: for each, its rows.
        explained: (n,) the explained part of each error.
        share: of the mean square.
        preference: factor on the share when explanations are compared.
    """

    statements: tuple[Statement, ...]
    parts: tuple[Bools, ...]
    explained: Floats
    share: float
    preference: float

    def only(self, wanted: Callable[[Statement], bool]) -> Explanation:
        """Return the explanation with only some of its statements."""
        kept = [k for k, one in enumerate(self.statements) if wanted(one)]
        rows = np.zeros(self.explained.size, dtype=bool)
        for k in kept:
            rows |= self.parts[k]
        statements = tuple(self.statements[k] for k in kept)
        return dataclasses.replace(
            self,
            statements=statements,
            parts=tuple(self.parts[k] for k in kept),
            explained=np.where(rows, self.explained, 0.0),
            share=sum((one.share for one in statements), 0.0),
        )


def make(view: View, explained: Floats, rows: Bools, **in_words: Any) -> tuple[Statement, Bools]:
    """Return a statement on some rows, and the rows."""
    r = view.residuals
    size = float(np.sqrt(np.average(explained[rows] ** 2, weights=r.weight_s[rows])))
    return Statement(
        r.channel, share=view.share(explained, rows), size=size, readings=int(rows.sum()), **in_words
    ), rows


def alone(made: tuple[Statement, Bools], explained: Floats, preference: float) -> Explanation:
    """Return the explanation that consists of one statement."""
    return Explanation((made[0],), (made[1],), explained, made[0].share, preference)


def in_runs(seen: int, present: int, of: int) -> str:
    """Return 'in 3 of 4 runs', of the runs that cover the range."""
    there = " that cover it" if present < of else ""
    if seen < present:
        return f"in {seen} of {present} runs{there}"
    return {1: "in the only run that covers it", 2: f"in both runs{there}"}.get(
        present, f"in all {present} runs{there}"
    )
