"""Metrics of a run: numbers reduced while the run advances, so that no trajectory is stored.

A metric is three small pure functions of one lane: `init` from the first row, `update` after each step, `finish` at
the end. The engine calls `update` for steps that the run takes and leaves out those after its cut-off. A metric
of the user's own is written in the same way and put in a study's list as an object.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from jaxmodel.model.declaration import Scalar
from jaxmodel.sweeps.power import LOSSES
from jaxmodel.sweeps.sums import add, nothing

Carry = Any


class Moment(eqx.Module):
    """One lane at one time.

    Attributes:
        columns: the inputs and what ideal sensors read, by the names of case files.
        valid: False where the model's equations make no sense.
        powers: as in `jaxmodel.sweeps.power`, where a metric asks for them.
    """

    columns: Mapping[str, Scalar]
    valid: Bool[Array, ""]
    powers: Mapping[str, Scalar] = eqx.field(default_factory=dict)


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
        asks_powers: True where it reads the powers of a moment, which cost something.

    Example:
        >>> from jaxmodel import sweeps
        >>> metric = sweeps.metrics_of("cell")["final_soc"]
        >>> metric.name, metric.kinds
        ('final_soc', ('cell', 'robot'))
    """

    asks_powers: ClassVar[bool] = False

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
class FittedGradient(Metric):
    """Slope of the least-squares line through a column at the rows of the profile, per second."""

    column: str

    def init(self, first: Moment) -> Carry:
        """Carry time, number of rows, both means, and the sums of squares and products about them."""
        zero = jnp.zeros(())
        return zero, jnp.ones(()), zero, first.columns[self.column], zero, zero

    def update(self, carry: Carry, step: Step) -> Carry:
        """Add the row that the step ends, if it ends one (Welford's sums, which do not cancel)."""
        time, count, mean_time, mean, squares, products = carry
        value, row = step.after.columns[self.column], jnp.asarray(step.ends_row, dtype=float)
        time, count = time + step.duration_s, count + row
        share, away = row / count, row * (time - mean_time)
        mean_time, mean = mean_time + share * (time - mean_time), mean + share * (value - mean)
        return time, count, mean_time, mean, squares + away * (time - mean_time), products + away * (value - mean)

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the slope; NaN where the run ended before its second row."""
        *_, squares, products = carry
        return products / jnp.where((squares > 0.0) & (end.elapsed_s > 0.0), squares, jnp.nan)


@dataclasses.dataclass(frozen=True)
class Way(Metric):
    """The way over ground, by the trapezium rule within each step; forwards and backwards both count."""

    asks_powers: ClassVar[bool] = True

    def init(self, first: Moment) -> Carry:
        """Start at zero."""
        return nothing()

    def update(self, carry: Carry, step: Step) -> Carry:
        """Add the way of the step."""
        before, after = (jnp.abs(moment.powers["ground_speed_m_s"]) for moment in (step.before, step.after))
        return add(carry, 0.5 * (before + after) * step.duration_s)

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the way."""
        return carry[0]


@dataclasses.dataclass(frozen=True)
class Ratio(Metric):
    """The time integral of some powers over that of others, by the trapezium rule within each step.

    A sum whose name ends in `speed_m_s` counts by its size. NaN where the denominator is not positive.
    """

    asks_powers: ClassVar[bool] = True

    over: tuple[str, ...]
    under: tuple[str, ...]

    def init(self, first: Moment) -> Carry:
        """Start both at zero."""
        return nothing(), nothing()

    def update(self, carry: Carry, step: Step) -> Carry:
        """Add the step to both."""
        return tuple(
            add(total, 0.5 * (self._sum(names, step.before) + self._sum(names, step.after)) * step.duration_s)
            for total, names in zip(carry, (self.over, self.under), strict=True)
        )

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the ratio."""
        (over, *_), (under, *_) = carry
        return over / jnp.where(under > 0.0, under, jnp.nan)

    def _sum(self, names: tuple[str, ...], moment: Moment) -> Scalar:
        parts = [moment.powers[name] for name in names]
        return sum(jnp.abs(x) if n.endswith("speed_m_s") else x for n, x in zip(names, parts, strict=True))  # type: ignore[return-value]


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
        return nothing()

    def update(self, carry: Carry, step: Step) -> Carry:
        """Add the step."""
        return add(carry, 0.5 * (self._product(step.before) + self._product(step.after)) * step.duration_s)

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the integral in the metric's unit, or the mean over the elapsed time."""
        return carry[0] / (end.elapsed_s if self.mean else self.seconds_per_unit)

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
    Way("distance_m", "m", "way that the robot drives, forwards and backwards", _ROBOT),
    Ratio(
        "energy_per_metre_J", "J/m", "energy of the pack per metre of way", _ROBOT, ("pack_W",), ("ground_speed_m_s",)
    ),
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


_CAUSES = {
    "ohmic_W": "the cells' ohmic resistance",
    "polarisation_W": "polarisation of the cells",
    "copper_W": "winding and brushes",
    "friction_W": "friction in motor and gear",
    "electronics_W": "on-board electronics and bridge",
}
_ON_REQUEST = (
    FittedGradient(
        "soc_gradient_fitted", "1/s", "slope of the straight line through the state of charge", _BATTERY, "soc"
    ),
    Ratio(
        "efficiency",
        "",
        "work / energy from the open-circuit voltage or the terminals",
        _ALL,
        ("work_W",),
        ("source_W",),
    ),
    *(
        Ratio(
            f"loss_share_{cause.removesuffix('_W')}",
            "",
            f"share of the losses: {_CAUSES[cause]}",
            (kind,),
            (cause,),
            causes,
        )
        for kind, causes in LOSSES.items()
        for cause in causes
    ),
)


def metrics_on_request(kind: str) -> dict[str, Metric]:
    """Return the shipped metrics of a kind that cost more and are computed only where they are named.

    Example:
        >>> from jaxmodel import sweeps
        >>> sorted(sweeps.metrics_on_request("robot"))[:2]
        ['efficiency', 'loss_share_copper']
    """
    return {metric.name: metric for metric in _ON_REQUEST if kind in metric.kinds}


def metrics_of(kind: str) -> dict[str, Metric]:
    """Return the metrics that every study of a kind has unless it names its own, in the order of tables.

    Example:
        >>> from jaxmodel import sweeps
        >>> sweeps.metrics_of("cell")["delivered_energy_Wh"].unit
        'W h'
    """
    return {metric.name: metric for metric in _SHIPPED if kind in metric.kinds}
