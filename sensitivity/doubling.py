"""The paper's parametric sensitivity test (section 4, Fig. 9): each parameter doubled, beside what derivatives predict.

A doubling is not small: a discharge by a capacity C falls as 1/C, its elasticity is -1 and doubling C halves it. Three
predictions of the relative change stand beside the simulated one, all from derivatives at the parameter's value p:

    linear       e = (p/y) y'                       the elasticity itself
    quadratic    e + curvature, (p^2/(2 y)) y''     the next term of the series, which need not converge so far out
    power law    2^e - 1                            straight in logarithms: exact for y = c p^e
"""

from __future__ import annotations

from collections.abc import Iterable

import equinox as eqx
import jax
import numpy as np
import xarray
from jaxtyping import Array, Float, Int

from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sensitivity.derivatives import answer_variables, coordinates, pushforward, relative
from jaxmodel.sensitivity.labels import labelled
from jaxmodel.sensitivity.metrics import VALID_SHARE
from jaxmodel.sensitivity.response import Answer, Response, make_response, steps_of
from jaxmodel.sweeps.metrics import Metric

# Curvatures are central differences of exact slopes, this share of a step to both sides: good to some seven digits. The
# exact second derivative, a jvp of a jvp, took five to ten times as long to compile.
NEARBY = 1e-4


class Doubling(eqx.Module):
    """The answer before and after each parameter's step, and its derivatives along the step.

    Attributes:
        base: the answer without a step; of all others, the parameters' axis comes first.
        moved: after the step.
        slope: first derivative, in steps: the linear prediction of `moved - base`.
        curvature: second derivative, in steps.
        status: how the run after the step ended, a `jaxmodel.model.simulation.Status`.
        valid_share: share of its rows in which the equations make sense.
    """

    base: Answer
    moved: Answer
    slope: Answer
    curvature: Answer
    status: Int[Array, " parameter"]
    valid_share: Float[Array, " parameter"]


def double(response: Response, values: Float[Array, " parameter"], size: np.ndarray) -> Doubling:
    """Move each parameter in turn by a step: four lanes each, all in one program of runs and their slopes."""
    directions = np.diag(size)
    shares = np.array([0.0, -NEARBY, NEARBY, 1.0])
    at = np.asarray(values) + shares[:, None, None] * directions
    along = np.broadcast_to(directions, at.shape)
    flat = pushforward(response, at.reshape(-1, values.size), along.reshape(-1, values.size))
    answers, slopes, runs = jax.tree.map(lambda x: x.reshape(shares.size, values.size, *x.shape[1:]), flat)
    return Doubling(
        base=jax.tree.map(lambda x: x[0, 0], answers),  # the same for every parameter
        moved=jax.tree.map(lambda x: x[3], answers),
        slope=jax.tree.map(lambda x: x[0], slopes),
        curvature=jax.tree.map(lambda x: (x[2] - x[1]) / (2.0 * NEARBY), slopes),
        status=runs.status[3],
        valid_share=runs.values[VALID_SHARE.name][3],
    )


def doubling_test(
    model: Model,
    profile: Profile,
    names: Iterable[str] | None = None,
    metrics: Iterable[str | Metric] | None = None,
    outputs: Iterable[str] | None = None,
    *,
    cutoff: Cutoff | None = None,
) -> xarray.Dataset:
    """Return the effect of doubling each parameter, beside the predictions of the local derivatives.

    A parameter that has no proportional change (a temperature in degC, a shift, zero) is moved by its stated `step`
    instead. Where value + step is outside the parameter's bounds, what the simulation gave is NaN; predictions stay.

    Args:
        model: any kind; its leaves are scalars.
        profile: inputs over time.
        names: as in `local_sensitivities`.
        metrics: as in `local_sensitivities`.
        outputs: as in `local_sensitivities`.
        cutoff: where each run ends.

    Returns:
        A data set over parameter, metric, output and time_s:
        value, unit, step, doubles, in_bounds, status, valid_share (parameter);
        metric_value, metric_unit (metric);
        metric_moved, linear_change, curvature_change (metric, parameter), in the metric's unit;
        effect = (y(p + step) - y(p)) / y(p), linear, curvature, power_law (metric, parameter), by the metric: NaN
        where it is zero or a temperature in degC, power_law also where the step is no doubling;
        output_value (output, time_s); output_moved, output_linear (output, parameter, time_s), in the output's unit.

    Raises:
        ParameterError: a parameter or output is unknown; the message gives the nearest name.
        SweepError: a metric is unknown.

    Example:
        >>> from jaxmodel import Model, constant
        >>> from jaxmodel.sensitivity import doubling_test
        >>> profile = constant(600.0, 60.0, current_A=2.0, ambient_degC=20.0)
        >>> data = doubling_test(Model("cell"), profile, ["capacity_Ah"], ["final_soc"])
        >>> list(data.data_vars)[:3]
        ['value', 'unit', 'step']
    """
    response = make_response(model, profile, names, metrics, outputs, cutoff)
    step = steps_of(response)
    result = double(response, response.values(), step.size)
    base, moved, slope, curvature = (
        np.asarray(part.metrics).T for part in (result.base, result.moved, result.slope, result.curvature)
    )
    moved = np.where(step.in_bounds, moved, np.nan)
    linear = relative(response, slope, result.base)
    with np.errstate(over="ignore"):  # a metric near zero has an elasticity beyond any power
        power_law = np.where(step.doubles, np.exp2(linear) - 1.0, np.nan)
    over_time, over_time_moved, over_time_slope = (
        np.asarray(part.outputs) for part in (result.base, result.moved, result.slope)
    )
    over_time_moved = np.where(step.in_bounds[:, None, None], over_time_moved, np.nan)
    data = xarray.Dataset(
        answer_variables(response, result.base, step)
        | {
            "in_bounds": ("parameter", step.in_bounds),
            "status": ("parameter", np.asarray(result.status)),
            "valid_share": ("parameter", np.asarray(result.valid_share)),
            "metric_moved": (("metric", "parameter"), moved),
            "linear_change": (("metric", "parameter"), slope),
            "curvature_change": (("metric", "parameter"), 0.5 * curvature),
            "effect": (("metric", "parameter"), relative(response, moved - base[:, None], result.base)),
            "linear": (("metric", "parameter"), linear),
            "curvature": (("metric", "parameter"), relative(response, 0.5 * curvature, result.base)),
            "power_law": (("metric", "parameter"), power_law),
            "output_moved": (("output", "parameter", "time_s"), np.swapaxes(over_time_moved, 0, 1)),
            "output_linear": (("output", "parameter", "time_s"), np.swapaxes(over_time + over_time_slope, 0, 1)),
        },
        coordinates(response),
        {"simulations": 4 * len(response.names)},
    )
    return labelled(data)
