"""A sentence on where a model fails, what belongs together in one explanation, and what explanations look at."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from discrepancy.residuals.regimes import Bins, cut, regimes
from discrepancy.residuals.table import Bools, ChannelResiduals, Floats

OPEN_CIRCUIT_VOLTAGE, RESISTANCE, HEAT = "open_circuit_voltage", "resistance", "heat"
TEMPERATURE_DEPENDENCE, ONE_RUN = "temperature_dependence", "run"

# What drives the hardware, the first that a channel has and is not itself.
DRIVES = ("current_A", "pack_current_A", "load_torque_Nm", "motor_current_A", "duty")


@dataclass(frozen=True)
class Statement:
    """One sentence on where a model fails.

    Attributes:
        channel: the channel.
        condition: that it is about; "run" for one run.
        lower: where it begins; -inf for everything below `upper`.
        upper: where it ends.
        text: the sentence.
        cause: `open_circuit_voltage`, `resistance`, `heat`, `temperature_dependence`, `run`, or "" for none that shows.
        value: what would have to be added to the model's quantity: its voltage, resistance, temperature.
        unit: of the value.
        runs_seen: runs that show it.
        share: part of the channel's mean square that it accounts for.
        size: root mean square of what it accounts for where it holds, in the channel's unit.
        readings: how many it rests on.
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
    """What is left of a channel's residuals, and the conditions in which it is looked at.

    Attributes:
        residuals: what has not been told yet.
        conditions: that take part, in order of preference.
        cuts: each cut into ranges.
        capacity_Ah: of the cell, where known.
        most_p: chance of a false statement over all conditions.
        given: sum of squares by time before anything was told; 0 where nothing was.
        counted: that of the runs that are still looked at, where some were set aside; 0 where none was.
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
        """Return what drives the hardware, where it spans anything."""
        return next((name for name in DRIVES if name in self.conditions), None)

    @property
    def beside(self) -> str:
        """Return what a sentence begins with: what it tells may be part of what was measured only."""
        return "Beside that, " if self.given else ""

    @property
    def total(self) -> float:
        """Return the sum of squares by time of which shares are told."""
        return self.given or float(np.sum(self.residuals.weight_s * self.residuals.error**2))

    def less(self, told: Floats) -> View:
        """Return the view of what is left."""
        return dataclasses.replace(self, residuals=self.residuals.less(told), given=self.total)

    def without_run(self, run: int) -> View:
        """Return the view of the other runs, of which what takes part is asked again."""
        rest = self.residuals.rows(self.residuals.run != run)
        counted = float(np.sum(rest.weight_s * rest.error**2))
        return dataclasses.replace(view_of(rest, self.capacity_Ah, self.most_p), given=self.total, counted=counted)

    def share(self, told: Floats, rows: Bools | None = None) -> float:
        """Return the part of the squares that goes with what is told, of some rows or of all."""
        r = self.residuals
        gone = r.weight_s * (r.error**2 - (r.error - told) ** 2)
        return float(np.sum(gone if rows is None else gone[rows]) / self.total)


def view_of(residuals: ChannelResiduals, capacity_Ah: float | None, most_p: float) -> View:
    """Return the first view of a channel's residuals."""
    names = regimes(residuals).names
    return View(residuals, names, {name: cut(residuals, name) for name in names}, capacity_Ah, most_p)


@dataclass(frozen=True, eq=False)
class Explanation:
    """Statements that belong together, and what they tell of every reading.

    Attributes:
        statements: the sentences.
        parts: for each, the rows that it is about.
        told: (n,) what they explain of each error.
        share: of the mean square.
        preference: by how much more than its share it counts.
    """

    statements: tuple[Statement, ...]
    parts: tuple[Bools, ...]
    told: Floats
    share: float
    preference: float

    def only(self, wanted: Callable[[Statement], bool]) -> Explanation:
        """Return the explanation with some of its statements, and what these alone tell."""
        kept = [k for k, one in enumerate(self.statements) if wanted(one)]
        rows = np.zeros(self.told.size, dtype=bool)
        for k in kept:
            rows |= self.parts[k]
        statements = tuple(self.statements[k] for k in kept)
        return dataclasses.replace(
            self,
            statements=statements,
            parts=tuple(self.parts[k] for k in kept),
            told=np.where(rows, self.told, 0.0),
            share=sum((one.share for one in statements), 0.0),
        )


def make(view: View, told: Floats, rows: Bools, **in_words: Any) -> tuple[Statement, Bools]:
    """Return a statement on some rows, and the rows."""
    r = view.residuals
    size = float(np.sqrt(np.average(told[rows] ** 2, weights=r.weight_s[rows])))
    return Statement(r.channel, share=view.share(told, rows), size=size, readings=int(rows.sum()), **in_words), rows


def alone(made: tuple[Statement, Bools], told: Floats, preference: float) -> Explanation:
    """Return the explanation that one statement makes."""
    return Explanation((made[0],), (made[1],), told, made[0].share, preference)


def in_runs(seen: int, present: int, of: int) -> str:
    """Return 'in 3 of 4 runs', or of those that were there at all."""
    there = " that were there" if present < of else ""
    if seen < present:
        return f"in {seen} of {present} runs{there}"
    return {1: "in the one run that was there", 2: f"in both runs{there}"}.get(present, f"in all {present} runs{there}")
