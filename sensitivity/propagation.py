"""The uncertainty of parameters, propagated through a run: by the gradient and by sampling, side by side.

Two ways to the spread of a number y of a run, from a covariance C of the parameters:

    gradient    sd^2 = J C J', J = dy/dp: exact where y is straight over the spread, and costs one run with tangents
    sampling    runs at drawn parameters: any shape of y, to a share of 1/sqrt(2 draws)

Where they disagree by more than the draws explain, y is curved over the spread, or the parameter itself is far from
normal, and the sampling is right.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import xarray
from jaxtyping import Array, Float, Int
from scipy.stats import norm, qmc

from jaxmodel.base.errors import ParameterError
from jaxmodel.lanes import NotNative
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff, Status
from jaxmodel.sensitivity import by_vectors
from jaxmodel.sensitivity.derivatives import coordinates, jacobian
from jaxmodel.sensitivity.response import Answer, Response, make_response
from jaxmodel.sweeps.metrics import Metric

QUANTILES = (0.025, 0.16, 0.5, 0.84, 0.975)
# The two ways agree where sd differ by less than this share, and mean and ends of the interval are off by less than it
# of an sd, beyond what so many draws leave open (two or three of their standard errors).
AGREED = 0.1
LEAST_DRAWS = 8  # that are run: of fewer no sd is known. Assumed.
_AT_ONCE = 64


def propagate(
    model: Model,
    profile: Profile,
    sd: Mapping[str, float],
    correlation: np.ndarray | None = None,
    metrics: Iterable[str | Metric] | None = None,
    outputs: Iterable[str] | None = None,
    *,
    cutoff: Cutoff | None = None,
    draws: int = 512,
    seed: int = 0,
) -> xarray.Dataset:
    """Return the spread of metrics and outputs that comes of uncertain parameters.

    Parameters are normal; those that the table takes on a logarithm are log-normal with the same spread at the model's
    value. Draws are the points of a scrambled Sobol sequence. A draw outside of a parameter's bounds, or whose run is
    not finite, is left out and counted.

    Args:
        model: any kind; its leaves are scalars, at which parameters are centred.
        profile: inputs over time.
        sd: standard deviations by name of a parameter or input, in the parameter's unit.
        correlation: of the parameters in the order of `sd`; none where it is not given.
        metrics: as in `local_sensitivities`.
        outputs: as in `local_sensitivities`.
        cutoff: where each run ends.
        draws: how many runs are sampled, 8 or more; rounded up to a power of two.
        seed: of the draws.

    Returns:
        A data set over parameter, metric, output, time_s and quantile:
        value, sd (parameter);
        metric_value, metric_unit, metric_sd_gradient, metric_sd_sampled, metric_mean, metric_agrees (metric);
        metric_share (metric, parameter): of the variance by the gradient, adding up to 1;
        metric_quantile (metric, quantile);
        output_value, output_sd_gradient, output_sd_sampled, output_mean, output_agrees (output, time_s);
        output_quantile (output, quantile, time_s).
        Attributes: draws, and out_of_bounds and failed, how many of them were left out.

    Raises:
        ParameterError: a name is unknown, an sd is negative, the correlations contradict each other, or fewer than
            eight draws can be run.
        SweepError: a metric is unknown.
    """
    if draws < LEAST_DRAWS:
        raise ParameterError(f"uncertain: {draws} draws show no spread; give {LEAST_DRAWS} or more.")
    response = make_response(model, profile, tuple(sd), metrics, outputs, cutoff)
    spread = np.array([sd[name] for name in response.names], dtype=float)
    root = _root(spread, correlation)
    answer, slopes = jacobian(response, response.values(), "forward")
    ways = np.asarray(slopes.metrics).T @ root, np.moveaxis(np.asarray(slopes.outputs), 0, -1) @ root
    by_gradient = [np.sqrt(np.sum(way**2, axis=-1)) for way in ways]

    points = _draws(response, root, 2 ** int(np.ceil(np.log2(draws))), seed)
    info = response.table()
    lower, upper = (np.array([getattr(one, end) for one in info]) for end in ("lower", "upper"))
    within = np.all((points >= lower) & (points <= upper), axis=1)
    if np.sum(within) < LEAST_DRAWS:
        raise ParameterError(
            f"uncertain: {np.sum(~within)} of {len(points)} draws are outside the bounds of the parameters, and fewer "
            f"than {LEAST_DRAWS} are left; give more draws, or smaller standard deviations."
        )
    sampled, status = _answers(response, points[within])
    finite = status != Status.NOT_FINITE
    if np.sum(finite) < LEAST_DRAWS:
        raise ParameterError(
            f"uncertain: {np.sum(~finite)} of {len(finite)} runs at drawn parameters are not finite, and fewer than "
            f"{LEAST_DRAWS} are left; give more draws, or smaller standard deviations."
        )
    at_metrics, at_outputs = np.asarray(sampled.metrics)[finite], np.asarray(sampled.outputs)[finite]
    metric_sd, output_sd = at_metrics.std(axis=0, ddof=1), at_outputs.std(axis=0, ddof=1)
    numbers = (np.asarray(answer.metrics), by_gradient[0], at_metrics.mean(axis=0), metric_sd)
    over_time = (np.asarray(answer.outputs), by_gradient[1], at_outputs.mean(axis=0), output_sd)
    variance = np.where(by_gradient[0] > 0.0, by_gradient[0] ** 2, np.nan)
    jac = np.asarray(slopes.metrics).T
    return xarray.Dataset(
        {
            "value": ("parameter", np.asarray(response.values())),
            "unit": ("parameter", [one.unit for one in info]),
            "sd": ("parameter", spread),
            "metric_value": ("metric", numbers[0]),
            "metric_unit": ("metric", [metric.unit for metric in response.metrics]),
            "metric_sd_gradient": ("metric", numbers[1]),
            "metric_mean": ("metric", numbers[2]),
            "metric_sd_sampled": ("metric", numbers[3]),
            "metric_agrees": ("metric", _agree(numbers[0], numbers[1], at_metrics)),
            "metric_share": (("metric", "parameter"), jac * (jac @ root @ root.T) / variance[:, None]),
            "metric_quantile": (("metric", "quantile"), np.quantile(at_metrics, QUANTILES, axis=0).T),
            "output_value": (("output", "time_s"), over_time[0]),
            "output_sd_gradient": (("output", "time_s"), over_time[1]),
            "output_mean": (("output", "time_s"), over_time[2]),
            "output_sd_sampled": (("output", "time_s"), over_time[3]),
            "output_agrees": (("output", "time_s"), _agree(over_time[0], over_time[1], at_outputs)),
            "output_quantile": (
                ("output", "quantile", "time_s"),
                np.moveaxis(np.quantile(at_outputs, QUANTILES, axis=0), 0, 1),
            ),
        },
        coordinates(response) | {"quantile": list(QUANTILES)},
        {"draws": len(points), "out_of_bounds": int(np.sum(~within)), "failed": int(np.sum(~finite))},
    )


def _root(spread: np.ndarray, correlation: np.ndarray | None) -> np.ndarray:
    """Return a matrix R with R R' the covariance."""
    if np.any(spread < 0.0) or not np.all(np.isfinite(spread)):
        raise ParameterError("uncertain: a standard deviation must be a finite number, 0 or more.")
    if correlation is None:
        return np.diag(spread)
    values, vectors = np.linalg.eigh(0.5 * (correlation + correlation.T))
    if values[0] < -1e-8:
        raise ParameterError(
            "uncertain: the correlations contradict each other; no covariance has a negative variance."
        )
    return spread[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def _draws(response: Response, root: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Return drawn values, shape (draws, parameters)."""
    standard = norm.ppf(qmc.Sobol(root.shape[1], scramble=True, rng=seed).random(count))
    values = np.asarray(response.values())
    away = standard @ root.T
    logarithmic = np.array([one.transform == "log" for one in response.table()]) & (values > 0.0)
    safe = np.where(logarithmic, values, 1.0)
    return np.where(logarithmic, values * np.exp(np.where(logarithmic, away / safe, 0.0)), values + away)


def _answers(response: Response, points: np.ndarray) -> tuple[Answer, np.ndarray]:
    with contextlib.suppress(NotNative):
        return by_vectors.answers(response, points)
    filled = np.concatenate([points, np.repeat(points[-1:], -len(points) % _AT_ONCE, axis=0)])
    parts = [_some(response, jnp.asarray(part)) for part in np.split(filled, len(filled) // _AT_ONCE)]
    answer, status = jax.tree.map(lambda *each: np.concatenate(each)[: len(points)], *parts)
    return answer, status


@eqx.filter_jit
def _some(response: Response, points: Float[Array, "draws parameter"]) -> tuple[Answer, Int[Array, " draws"]]:
    def one(values: Array) -> tuple[Answer, Array]:
        answer, run = response.run(response.named(values))
        return answer, run.status

    return jax.vmap(one)(points)


def _agree(value: np.ndarray, gradient: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return where the gradient's sd, centre and interval are the sampling's, to AGREED and what draws leave open."""
    count, sampled = len(samples), samples.std(axis=0, ddof=1)
    largest = np.maximum(np.maximum(gradient, sampled), 1e-12 * np.maximum(np.abs(value), 1e-300))
    agrees = np.abs(sampled - gradient) <= (AGREED + 3.0 / np.sqrt(2.0 * count)) * largest
    agrees &= np.abs(samples.mean(axis=0) - value) <= (AGREED + 3.0 / np.sqrt(count)) * largest
    for share in (QUANTILES[0], QUANTILES[-1]):
        normal = norm.ppf(share)
        error = np.sqrt(share * (1.0 - share) / count) / norm.pdf(normal)
        away = np.quantile(samples, share, axis=0) - (value + normal * gradient)
        agrees &= np.abs(away) <= (AGREED + 2.0 * error) * largest
    return agrees
