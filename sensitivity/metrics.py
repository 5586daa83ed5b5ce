"""Which numbers of a run are differentiated: those of a sweep that have a derivative, and two of the paper's own."""

from __future__ import annotations

from collections.abc import Iterable

import jax.numpy as jnp

from jaxmodel.base.errors import SweepError, nearest
from jaxmodel.model.declaration import Scalar
from jaxmodel.sweeps import metrics as of_sweeps
from jaxmodel.sweeps.metrics import Carry, End, Metric, RowValue


class FittedSlope(of_sweeps.FittedGradient):
    """A sweep's fitted gradient with a value, and so a derivative, for a run of one row too."""

    def finish(self, carry: Carry, end: End) -> Scalar:
        """Return the slope; 0 where the run ended before its second row."""
        *_, squares, products = carry
        return jnp.where(squares > 0.0, products / jnp.where(squares > 0.0, squares, 1.0), 0.0)


_SLOPE = "slope of the straight line through the terminal voltage (the paper's Figs. 8 and 9, Table 5)"
_OWN = (
    RowValue("final_voltage_V", "V", "terminal voltage of the cell at the end", ("cell",), "voltage_V", "last"),
    RowValue("final_voltage_V", "V", "terminal voltage of the pack at the end", ("robot",), "pack_voltage_V", "last"),
    FittedSlope("voltage_gradient", "V/s", _SLOPE, ("cell",), "voltage_V"),
    FittedSlope("voltage_gradient", "V/s", _SLOPE, ("robot",), "pack_voltage_V"),
)
# They change by whole steps and rows: their derivative is zero, and says nothing.
_IN_WHOLE_STEPS = (of_sweeps.TimeToCutoff, of_sweeps.ValidShare)
VALID_SHARE = of_sweeps.metrics_of("cell")["valid_share"]


def has_derivative(metric: Metric) -> bool:
    """Return False for the metrics that change by whole steps or rows."""
    return not isinstance(metric, _IN_WHOLE_STEPS)


def metrics_of(kind: str) -> dict[str, Metric]:
    """Return the metrics of a kind of model that have a derivative, by name."""
    known = of_sweeps.metrics_of(kind) | {metric.name: metric for metric in _OWN if kind in metric.kinds}
    return {name: metric for name, metric in known.items() if has_derivative(metric)}


def choose_metrics(wanted: Iterable[str | Metric] | None, kind: str) -> tuple[Metric, ...]:
    """Return the metrics asked for, by name or as they are; None asks for all of the kind but those on request.

    Raises:
        SweepError: the kind has no such metric; the message gives the nearest name.
    """
    by_default = metrics_of(kind)
    known = by_default | of_sweeps.metrics_on_request(kind)
    chosen = []
    for given in by_default if wanted is None else wanted:
        if isinstance(given, str) and given not in known:
            raise SweepError(
                f"metrics: a {kind} has no metric '{given}' with a derivative.{nearest(given, known)} "
                f"It has {', '.join(known)}."
            )
        chosen.append(known[given] if isinstance(given, str) else given)
    return tuple(chosen)
