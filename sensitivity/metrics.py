"""Single numbers that sum up a run: what a designer, or the paper's tables, would compare between two runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from jaxmodel.errors import ParameterError, nearest
from jaxmodel.parameters import Parameters, Scalar


class Log(eqx.Module):
    """A run as a data logger would hold it, row by row.

    Attributes:
        time_s: shape (rows,).
        columns: readings and inputs by name, each of shape (rows,); inputs as reported, readings as the sensors give them.
        end_row: last row before the cut-off, where the run has one.
        parameters: the base parameters of the model that ran.
    """

    time_s: Float[Array, " rows"]
    columns: dict[str, Float[Array, " rows"]]
    end_row: Int[Array, ""]
    parameters: Parameters

    def span_s(self) -> Float[Array, " rows"]:
        """Return the time since the row before, 0 at the first row and after the end of the run."""
        since = jnp.diff(self.time_s, prepend=self.time_s[0])
        return jnp.where(jnp.arange(self.time_s.size) <= self.end_row, since, 0.0)

    def duration_s(self) -> Scalar:
        """Return the time from the first row to the end of the run."""
        return self.time_s[self.end_row] - self.time_s[0]


@dataclasses.dataclass(frozen=True)
class Metric:
    """One number of a run.

    Attributes:
        name: as in tables; the unit is in it where a person reads it.
        unit: SI.
        meaning: one line.
        columns: for each kind it exists for, the columns it reads.
        compute: from the log and these columns, in their order, to the number; pure JAX.
    """

    name: str
    unit: str
    meaning: str
    columns: Mapping[str, tuple[str, ...]] = dataclasses.field(hash=False)
    compute: Callable[..., Scalar]

    def __call__(self, kind: str, log: Log) -> Scalar:
        """Return the number for the log of one run of a kind."""
        return self.compute(log, *(log.columns[name] for name in self.columns[kind]))

    def exists(self, kind: str, columns: Iterable[str]) -> bool:
        """Return True if a run of this kind with these columns has the number."""
        return kind in self.columns and set(self.columns[kind]) <= set(columns)


def _soc_gradient(log: Log, soc: Array) -> Scalar:
    return (soc[log.end_row] - soc[0]) / log.duration_s()


def _final(log: Log, values: Array) -> Scalar:
    return values[log.end_row]


def _cell_voltage_gradient(log: Log, voltage: Array) -> Scalar:
    weight = jnp.where(jnp.arange(log.time_s.size) <= log.end_row, 1.0, 0.0)
    away = log.time_s - jnp.sum(weight * log.time_s) / jnp.sum(weight)
    return jnp.sum(weight * away * voltage) / jnp.sum(weight * away**2)


def _pack_cell_voltage_gradient(log: Log, voltage: Array) -> Scalar:
    # A pack's cells share its voltage equally, as a voltmeter on the pack would have it.
    return _cell_voltage_gradient(log, voltage / log.parameters.n_series)


def _energy(log: Log, voltage: Array, current: Array) -> Scalar:
    return jnp.sum(log.span_s() * voltage * current)


def _mean(log: Log, values: Array) -> Scalar:
    return jnp.sum(log.span_s() * values) / log.duration_s()


def _rise(log: Log, temperature: Array, ambient: Array) -> Scalar:
    return temperature[log.end_row] - ambient[log.end_row]


_ALL = (
    Metric(
        "soc_gradient_per_s",
        "1/s",
        "change of the state of charge over the run, by its duration (the paper's Tables 1 and 2)",
        {"cell": ("soc",), "robot": ("soc",)},
        _soc_gradient,
    ),
    Metric(
        "final_voltage_V",
        "V",
        "terminal voltage at the end: of the cell, or of the pack",
        {"cell": ("voltage_V",), "robot": ("pack_voltage_V",)},
        _final,
    ),
    Metric(
        "cell_voltage_gradient_V_per_s",
        "V/s",
        "slope of the straight line through the voltage of one cell (the paper's Fig. 8 and Table 5)",
        {"cell": ("voltage_V",)},
        _cell_voltage_gradient,
    ),
    Metric(
        "cell_voltage_gradient_V_per_s",
        "V/s",
        "slope of the straight line through the pack's voltage, by cell (the paper's Fig. 8 and Table 5)",
        {"robot": ("pack_voltage_V",)},
        _pack_cell_voltage_gradient,
    ),
    Metric(
        "delivered_energy_J",
        "J",
        "voltage times current over the run, as logged: by the cell, by the pack, or to the motor",
        {
            "cell": ("voltage_V", "current_A"),
            "motor": ("voltage_V", "current_A"),
            "robot": ("pack_voltage_V", "pack_current_A"),
        },
        _energy,
    ),
    Metric(
        "mean_current_A",
        "A",
        "mean of the logged current of the motor, or of the pack",
        {"motor": ("current_A",), "robot": ("pack_current_A",)},
        _mean,
    ),
    Metric(
        "final_speed_rad_s",
        "rad/s",
        "speed of the motor at the end",
        {"motor": ("speed_rad_s",), "robot": ("speed_rad_s",)},
        _final,
    ),
    Metric(
        "final_winding_rise_K",
        "K",
        "winding above ambient at the end",
        {kind: ("winding_temperature_degC", "ambient_degC") for kind in ("motor", "robot")},
        _rise,
    ),
)


def metrics_of(kind: str, columns: Iterable[str]) -> dict[str, Metric]:
    """Return the metrics that a run of a kind with these columns has, by name."""
    known = set(columns)
    return {metric.name: metric for metric in _ALL if metric.exists(kind, known)}


def choose_metrics(
    wanted: Iterable[str | Metric] | None, kind: str, columns: Iterable[str]
) -> tuple[Metric, ...]:
    """Return the metrics asked for, by name or as they are; None asks for all that the run has.

    Raises:
        ParameterError: the run has no such metric; the message gives the nearest name.
    """
    columns = tuple(columns)
    known = metrics_of(kind, columns)
    if wanted is None:
        return tuple(known.values())
    chosen = []
    for entry in wanted:
        metric = known.get(entry) if isinstance(entry, str) else entry
        if metric is None or not metric.exists(kind, columns):
            name = entry if isinstance(entry, str) else entry.name
            raise ParameterError(
                f"metrics: this run of kind '{kind}' has no metric '{name}'.{nearest(name, known)} "
                f"It has {', '.join(known)}."
            )
        chosen.append(metric)
    return tuple(chosen)
