"""What a step of the filter costs a controller that computes in float32: error, operations and memory."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.in_short import InShort
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.kalman import Measured, Tuning, corrected_step, ekf, state_names

BYTES = 4


@dataclasses.dataclass(frozen=True, repr=False)
class SinglePrecision(InShort):
    """A filter in float32 beside the same in float64.

    Attributes:
        soc_error: largest difference of the states of charge over the run.
        sd_error: largest difference of their sd, as a share of it.
        count_bound: the largest rounding error of the charge if the voltage corrected nothing: rows times 2^-25, half
            the spacing of float32 below 1.
        operations: floating-point operations of a step, as XLA counts them.
        state_bytes: states and their covariance, kept from step to step.
        table_bytes: numbers of model and tuning, constant.
        working_bytes: what a step needs besides, as XLA plans it.
    """

    soc_error: float
    sd_error: float
    count_bound: float
    operations: float
    state_bytes: int
    table_bytes: int
    working_bytes: int


def single_precision(
    model: Model, tuning: Tuning, measured: Measured, start_soc: float, pairs_sd_V: float = 0.0
) -> SinglePrecision:
    """Run a filter in float32 and float64 over a run, and count what a step takes.

    Args:
        model: of kind "cell"; see `for_estimation`.
        tuning: its assumed errors.
        measured: the run.
        start_soc: assumed at the start, 0 to 1.
        pairs_sd_V: as in `ekf`.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import operation, preset_model
        >>> model = operation.for_estimation(preset_model("samsung_30q", "cell"))
        >>> time_s = jnp.arange(0.0, 600.0, 10.0)
        >>> current_A, degC, voltage_V = jnp.full(60, 2.0), jnp.full(60, 20.0), jnp.linspace(4.0, 3.9, 60)
        >>> measured = operation.Measured(time_s, current_A, degC, voltage_V)
        >>> operation.single_precision(model, operation.Tuning(), measured, 0.9).soc_error < 1e-4
        True
    """
    given = (model, tuning, measured, jnp.asarray(start_soc, dtype=float), jnp.asarray(pairs_sd_V, dtype=float))
    double = jax.jit(ekf)(*given)
    with jax.enable_x64(False):
        single_given = jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), dtype=np.float32), given)
        single = jax.jit(ekf)(*single_given)
        size = len(state_names(model))
        row = tuple(jnp.zeros(()) for _ in range(4))
        carried = (jnp.full(size, 0.5), jnp.eye(size))
        compiled = jax.jit(corrected_step).lower(*single_given[:2], *carried, jnp.ones(()), row).compile()
        counted, planned = compiled.cost_analysis(), compiled.memory_analysis()
    operations = np.nan if counted is None else float(counted["flops"])
    working = 0 if planned is None else int(planned.temp_size_in_bytes)
    numbers = sum(np.size(leaf) for leaf in jax.tree.leaves(given[:2]))
    sd = np.asarray(double.sd)
    return SinglePrecision(
        soc_error=float(np.abs(np.asarray(single.soc) - np.asarray(double.soc)).max()),
        sd_error=float(np.max(np.abs(np.asarray(single.sd) - sd) / sd)),
        count_bound=measured.time_s.size * 2.0**-25,
        operations=operations,
        state_bytes=BYTES * (size + size * size),
        table_bytes=BYTES * numbers,
        working_bytes=working,
    )
