"""Local sensitivities: the exact derivative of every metric and output by every parameter, in one pass."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array, Float

from jaxmodel.lanes import NotNative
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sensitivity import by_vectors
from jaxmodel.sensitivity.checkpoint import LONGEST, in_blocks
from jaxmodel.sensitivity.response import Answer, Response, Steps, make_response, steps_of
from jaxmodel.sweeps.lane import Outcome
from jaxmodel.sweeps.metrics import Metric

Mode = Literal["forward", "reverse"]
Points = Float[np.ndarray, "lanes parameter"] | Float[Array, "lanes parameter"]


def choose_mode(parameters: int, numbers: int, steps: int = LONGEST) -> Mode:
    """Return the cheaper way to differentiate some numbers by some parameters, in one run of so many steps.

    Break-even as measured on one core, half an hour in steps of 1 s, in ms. Forward mode: a cell of 11 parameters 2.5,
    of 16 some 6, a robot of 32 parameters 127. Reverse mode, one kernel each way: 0.8 for one number of the cell, 2.0
    for eight; 9.9 for one of the robot, 13.5 for four. So reverse mode costs some three tangents, half a one for each
    further number. A run cut into blocks is no one kernel: then some fifty, and two or three (measured earlier).
    """
    break_even = 2.5 + 0.6 * numbers if steps <= LONGEST else 48.0 + 2.5 * numbers
    return "reverse" if parameters > break_even else "forward"


def jacobian(response: Response, values: Float[Array, " parameter"], mode: Mode) -> tuple[Answer, Answer]:
    """Return the answer and its derivatives, the parameters' axis first.

    Forward mode on a processor runs as vector instructions where that is possible, which saves XLA's compilation.

    Args:
        response: the differentiated run.
        values: where, in the units of the table.
        mode: "forward" pushes a tangent for each parameter through the run; "reverse" pulls a cotangent for each metric
            back through it.

    Returns:
        The answer, and its derivatives: shapes (parameter, metric) and (parameter, output, rows), in the unit of the
        number by that of the parameter.

    Raises:
        ValueError: reverse mode where outputs are asked for: it would take a pass for each row.
    """
    if mode == "forward":
        with contextlib.suppress(NotNative):
            found = by_vectors.slopes(response, np.asarray(values)[None], values.size)
            return jax.tree.map(lambda x: x[0], found)
    return _jacobian_by_xla(response, values, mode)


@eqx.filter_jit
def _jacobian_by_xla(response: Response, values: Float[Array, " parameter"], mode: Mode) -> tuple[Answer, Answer]:
    if mode == "forward":

        def push(direction: Array) -> tuple[Answer, Answer]:
            return jax.jvp(response, (values,), (direction,))

        # out_axes None: the run itself is computed once, beside all its tangents.
        return jax.vmap(push, out_axes=(None, 0))(jnp.eye(values.size))
    if response.outputs:
        raise ValueError("Reverse mode gives the metrics alone: ask for outputs=(), or for mode 'forward'.")
    answer, pull = jax.vjp(lambda at: in_blocks(response, at), values)
    pulled = jax.vmap(lambda metric: pull(Answer(metric, jnp.zeros_like(answer.outputs)))[0])(
        jnp.eye(answer.metrics.size)
    )
    return answer, Answer(pulled.T, jnp.zeros((values.size, *answer.outputs.shape)))


def pushforward(response: Response, at: Points, along: Points) -> tuple[Answer, Answer, Outcome]:
    """Return the answer at each point, its derivative along the direction of that lane, and the outcome of the run.

    Args:
        response: that is differentiated.
        at: parameter values, shape (lanes, parameter).
        along: the directions, of the same shape.
    """
    with contextlib.suppress(NotNative):
        return by_vectors.pushed(response, np.asarray(at), np.asarray(along))
    return _pushforward_by_xla(response, jnp.asarray(at), jnp.asarray(along))


@eqx.filter_jit
def _pushforward_by_xla(
    response: Response, at: Float[Array, "lanes parameter"], along: Float[Array, "lanes parameter"]
) -> tuple[Answer, Answer, Outcome]:
    def lane(values: Array, direction: Array) -> tuple[Answer, Answer, Outcome]:
        return jax.jvp(lambda x: response.run(response.named(x)), (values,), (direction,), has_aux=True)

    return jax.vmap(lane)(at, along)


def local_sensitivities(
    model: Model,
    profile: Profile,
    names: Iterable[str] | None = None,
    metrics: Iterable[str | Metric] | None = None,
    outputs: Iterable[str] | None = None,
    *,
    cutoff: Cutoff | None = None,
    mode: Mode | None = None,
) -> xarray.Dataset:
    """Return the derivatives of metrics and outputs by parameters, in units and as elasticities.

    The elasticity of a number y by a parameter p is (p/y) dy/dp: y changes by so many percent for each percent of p. It
    is NaN where it means nothing: y or p is zero, a temperature in degC or a shift. The change by a stated `step` is
    always given.

    Args:
        model: any kind; its leaves are scalars.
        profile: inputs over time.
        names: parameters, those of effects ("effect.parameter"), curves of the cell (by a factor) and inputs of the
            profile (the ambient by a shift in K, any other by a factor); None takes all that enter.
        metrics: names of `jaxmodel.sensitivity.metrics`, or one's own; None takes all of the kind.
        outputs: readings wanted over time; None takes all, () none.
        cutoff: where the run ends; its last row is held fixed while parameters move.
        mode: "forward" or "reverse" differentiation; None chooses the cheaper, which the attributes record.

    Returns:
        A data set over parameter, metric, output and time_s:
        value, unit, step, doubles (parameter): `doubles` where the step is the parameter's value;
        metric_value, metric_unit (metric);
        metric_derivative, metric_change (the derivative times the step), elasticity (metric, parameter);
        output_value (output, time_s);
        output_derivative, output_change (output, parameter, time_s): over time, p dy/dp where the step is p.

    Raises:
        ParameterError: a parameter or output is unknown; the message gives the nearest name.
        SweepError: a metric is unknown.
        ValueError: reverse mode, and outputs are asked for.
    """
    response = make_response(model, profile, names, metrics, outputs, cutoff)
    if mode is None:
        counts = len(response.names), len(response.metrics), response.stepped.duration_s.size
        mode = "forward" if response.outputs else choose_mode(*counts)
    answer, derivative = jacobian(response, response.values(), mode)
    step = steps_of(response)
    by_metric, by_output = np.asarray(derivative.metrics).T, np.swapaxes(np.asarray(derivative.outputs), 0, 1)
    change = by_metric * step.size
    return xarray.Dataset(
        answer_variables(response, answer, step)
        | {
            "metric_derivative": (("metric", "parameter"), by_metric),
            "metric_change": (("metric", "parameter"), change),
            "elasticity": (("metric", "parameter"), np.where(step.doubles, relative(response, change, answer), np.nan)),
            "output_derivative": (("output", "parameter", "time_s"), by_output),
            "output_change": (("output", "parameter", "time_s"), by_output * step.size[:, None]),
        },
        coordinates(response),
        {"mode": mode, "passes": len(response.names) if mode == "forward" else len(response.metrics)},
    )


def relative(response: Response, change: np.ndarray, base: Answer) -> np.ndarray:
    """Return changes, shape (metric, parameter), by the metrics; NaN where one is zero or a temperature in degC."""
    proportional = np.array([metric.unit != "degC" for metric in response.metrics], dtype=bool)
    values = np.asarray(base.metrics)
    divisor = np.where(proportional & (values != 0.0), values, np.nan)
    return change / divisor[:, None]


def coordinates(response: Response) -> dict[str, Any]:
    """Return the coordinates of the data sets of a response."""
    return {
        "parameter": list(response.names),
        "metric": [metric.name for metric in response.metrics],
        "output": list(response.outputs),
        "time_s": np.asarray(response.time_s),
    }


def answer_variables(response: Response, answer: Answer, step: Steps) -> dict[str, Any]:
    """Return what every data set of a response says of its parameters, and of the run itself."""
    return {
        "value": ("parameter", np.asarray(response.values())),
        "unit": ("parameter", [info.unit for info in response.table()]),
        "step": ("parameter", step.size),
        "doubles": ("parameter", step.doubles),
        "metric_value": ("metric", np.asarray(answer.metrics)),
        "metric_unit": ("metric", [metric.unit for metric in response.metrics]),
        "output_value": (("output", "time_s"), np.asarray(answer.outputs)),
    }
