"""What a sweep keeps of each run: numbers reduced while the run advances, so that no trajectory is stored.

A metric is three small pure functions of one lane: `init` from the first row, `update` after each step, `finish` at
the end. The engine calls `update` for steps that the run takes and leaves out those after its cut-off. A user's own
metric is written in the same way and put in a study's list as an object.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Mapping
from typing import Any, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxmodel.declaration import Scalar

Carry = Any


class Moment(eqx.Module):
    """One lane at one time.

    Attributes:
        columns: the inputs and what ideal sensors read, by the names of case files.
        valid: False where the model's equations make no sense.
    """

    columns: Mapping[str, Scalar]
    valid: Bool[Array, ""]


class Step(eqx.Module):
    """A step that a lane has taken, both its ends under the inputs that held over it.

    Attributes:
        before: at its start.
        after: at its end.
        duration_s: its length.
        ends_row: True where a row of the profile ends with it; after a jump of the inputs a row takes many steps.
    """

    before: Moment
    after: Moment
    duration_s: Scalar
    ends_row: Bool[Array, ""]


class End(eqx.Module):
    """How a run ended: after how many seconds, and whether at its cut-off."""

    elapsed_s: Scalar
    reached_cutoff: Bool[Array, ""]


@dataclasses.dataclass(frozen=True)
class Metric(abc.ABC):
    """One number per lane.

    Attributes:
        name: of the variable in the result.
        unit: of the value; "" is a pure number.
        meaning: one line for tables and plots.
        kinds: the kinds of model that have it.
    """

    name: str
    unit: str
    meaning: str
    kinds: tuple[str, ...]

    @abc.abstractmethod
    def init(self, first: Moment) -> Carry:
        """Return what is carried from step to step, as it is at the first row: a pytree of scalars."""

    @abc.abstractmethod
    def update(self, carry: Carry, step: Step) -> Carry:
        """Return what is carried after a step."""

    @abc.abstractmethod
    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the value at the end of the run."""


@dataclasses.dataclass(frozen=True)
class MeanGradient(Metric):
    """Change of a column from the first row to the end, per second."""

    column: str

    def init(self, first: Moment) -> Carry:
        """Carry the first and the latest value."""
        return first.columns[self.column], first.columns[self.column]

    def update(self, carry: Carry, step: Step) -> Carry:
        """Keep the first value and take the latest."""
        return carry[0], step.after.columns[self.column]

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return (last - first) / elapsed."""
        return (carry[1] - carry[0]) / end.elapsed_s


@dataclasses.dataclass(frozen=True)
class TimeToCutoff(Metric):
    """The end of the step in which the run passed its cut-off; NaN where it did not."""

    def init(self, first: Moment) -> Carry:
        """Carry nothing: the engine knows."""
        return ()

    def update(self, carry: Carry, step: Step) -> Carry:
        """Carry nothing."""
        return ()

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the elapsed time of a run that reached its cut-off."""
        return jnp.where(end.reached_cutoff, end.elapsed_s, jnp.nan)


@dataclasses.dataclass(frozen=True)
class Integral(Metric):
    """The time integral of a product of columns, by the trapezium rule within each step; or its mean over time.

    Both ends of a step are read under the inputs that hold over it, so a jump between steps costs no accuracy.
    """

    columns: tuple[str, ...]
    seconds_per_unit: float = 1.0
    mean: bool = False

    def init(self, first: Moment) -> Carry:
        """Start at zero."""
        return jnp.zeros(())

    def update(self, carry: Carry, step: Step) -> Carry:
        """Add the step."""
        return carry + 0.5 * (self._product(step.before) + self._product(step.after)) * step.duration_s

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the integral in the metric's unit, or the mean over the elapsed time."""
        return carry / (end.elapsed_s if self.mean else self.seconds_per_unit)

    def _product(self, moment: Moment) -> Scalar:
        return math.prod(moment.columns[name] for name in self.columns)  # type: ignore[return-value]


@dataclasses.dataclass(frozen=True)
class RowValue(Metric):
    """The least, greatest or last value of a column at the rows of the profile: what a logger would have seen."""

    column: str
    keep: Literal["least", "greatest", "last"]

    def init(self, first: Moment) -> Carry:
        """Carry the value of the first row."""
        return first.columns[self.column]

    def update(self, carry: Carry, step: Step) -> Carry:
        """Compare with the row that the step ends, if it ends one."""
        value = step.after.columns[self.column]
        kept = {"least": jnp.minimum, "greatest": jnp.maximum, "last": lambda _, new: new}[self.keep](carry, value)
        return jnp.where(step.ends_row, kept, carry)

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the value."""
        return carry


@dataclasses.dataclass(frozen=True)
class ValidShare(Metric):
    """The share of the rows at which the model's equations make sense."""

    def init(self, first: Moment) -> Carry:
        """Carry the number of valid rows and of all rows."""
        return first.valid.astype(float), jnp.ones(())

    def update(self, carry: Carry, step: Step) -> Carry:
        """Count the row that the step ends, if it ends one."""
        row = jnp.asarray(step.ends_row, dtype=float)
        return carry[0] + row * step.after.valid, carry[1] + row

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return valid rows / rows."""
        return carry[0] / carry[1]


_CELL, _ROBOT, _BATTERY, _DRIVE = ("cell",), ("robot",), ("cell", "robot"), ("motor", "robot")
_ALL = ("cell", "motor", "robot")
_PACK = ("pack_voltage_V", "pack_current_A")
_TERMINALS = ("voltage_V", "current_A")
_SHIPPED = (
    MeanGradient("soc_gradient", "1/s", "mean slope of the state of charge over the run", _BATTERY, "soc"),
    RowValue("final_soc", "", "state of charge at the end", _BATTERY, "soc", "last"),
    TimeToCutoff("time_to_cutoff_s", "s", "time until the cut-off, missing where it is not reached", _BATTERY),
    Integral("delivered_charge_Ah", "A h", "charge delivered by the cell", _CELL, _TERMINALS[1:], 3600.0),
    Integral("delivered_charge_Ah", "A h", "charge delivered by the pack", _ROBOT, _PACK[1:], 3600.0),
    Integral("delivered_energy_Wh", "W h", "energy delivered by the cell", _CELL, _TERMINALS, 3600.0),
    Integral("delivered_energy_Wh", "W h", "energy delivered by the pack", _ROBOT, _PACK, 3600.0),
    RowValue("min_voltage_V", "V", "lowest terminal voltage of the cell", _CELL, "voltage_V", "least"),
    RowValue("min_pack_voltage_V", "V", "lowest terminal voltage of the pack", _ROBOT, "pack_voltage_V", "least"),
    Integral("mean_speed_rad_s", "rad/s", "speed of the motor, mean over time", _DRIVE, ("speed_rad_s",), mean=True),
    *(
        metric
        for part, kinds in (("cell", _BATTERY), ("winding", _DRIVE), ("case", _DRIVE))
        for column, what in ((f"{part}_temperature_degC", f"{part} temperature"),)
        for metric in (
            RowValue(f"peak_{column}", "degC", f"highest {what}", kinds, column, "greatest"),
            RowValue(f"final_{column}", "degC", f"{what} at the end", kinds, column, "last"),
        )
    ),
    ValidShare("valid_share", "", "share of the rows at which the equations make sense", _ALL),
)


def metrics_of(kind: str) -> dict[str, Metric]:
    """Return the shipped metrics of a kind of model by name, in the order of tables."""
    return {metric.name: metric for metric in _SHIPPED if kind in metric.kinds}
