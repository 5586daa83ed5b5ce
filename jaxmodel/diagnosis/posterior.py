"""A fitted model as draws of its posterior, in the groups of ArviZ: one `xarray.DataTree`.

The posterior is a normal distribution in the coordinates of the fit (Laplace's approximation): no Markov chain samples
it. The fitted runs are simulated for each draw.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from jaxmodel.base.units import split_unit, unit_of
from jaxmodel.base.version import __version__
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.data import FitData
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.estimates import estimates_of
from jaxmodel.fit.gauss_newton import errors_at
from jaxmodel.fit.settings import SEED

_DRAWN = ("chain", "draw")
_MADE_BY = {"inference_library": "jaxmodel", "inference_library_version": __version__}
_OF_THE_POSTERIOR = (
    "Independent draws of the normal approximation to the posterior at the best fit (Laplace), in the coordinates of "
    "the fit; no Markov chain. Correlations are those of the posterior, sd those of the fit (the larger of posterior "
    "and sandwich over runs). Curves of tables are drawn too, and are not here."
)
_OF_THE_SCORES = (
    "Log density of each reading, divided by the number of readings for each independent one, so that their sum is "
    "that of the independent readings: -(e^2 / (2 s^2) + log(s sqrt(2 pi))) / m."
)
_OF_THE_PREDICTIONS = "What each draw predicts, without noise."


def posterior_tree(cache: FitCache, fit: Fit, draws: int) -> xr.DataTree:
    """Return draws of a model's numbers, what they predict, and the log score of each reading under each.

    Args:
        cache: of the case.
        fit: the model.
        draws: their number.

    Returns:
        Groups `posterior` (chain, draw), and over the readings of each channel `posterior_predictive` and
        `log_likelihood` (chain, draw, reading), `observed_data` and `constant_data` with the best fit, its residual and
        the sd of the channel.
    """
    data, spec = cache.view.data, fit.spec
    scale = fit.sd / np.sqrt(np.diag(fit.covariance))
    root = np.linalg.cholesky(fit.covariance * np.outer(scale, scale))
    steps = root @ np.random.default_rng(SEED).normal(size=(len(spec.free), draws))
    places = np.repeat(fit.x[None], draws, axis=0)
    places[:, list(spec.free)] += steps.T
    of_draws = errors_at(cache.view, cache.space.problem(spec), spec, places)
    groups: dict[str, xr.Dataset] = {"posterior": _posterior(cache, fit, steps)}
    parts: dict[str, dict[str, Any]] = {
        name: {} for name in ("posterior_predictive", "log_likelihood", "observed_data", "constant_data")
    }
    coordinates: dict[str, Any] = {}
    for channel, rows, about in _channels(cache, data):
        axis = f"{channel}_reading"
        weight, dims = fit.likelihood.channels[channel], (*_DRAWN, axis)
        off = of_draws[rows].T[None]
        score = -0.5 * (off / weight.sd) ** 2 - np.log(weight.sd * np.sqrt(2.0 * np.pi))
        value, label = data.value[rows], {"long_name": about["long_name"], "units": about["units"]}
        parts["posterior_predictive"][channel] = (dims, value - off, label)
        parts["log_likelihood"][channel] = (dims, score / weight.inflation)
        parts["observed_data"][channel] = (axis, value, label)
        parts["constant_data"] |= {
            f"{channel}_best": (axis, value - fit.errors[rows], label),
            f"{channel}_residual": (axis, fit.errors[rows], label),
            f"{channel}_sd": ((), weight.sd, label | {"long_name": "s of the weights of its errors"}),
            f"{channel}_inflation": ((), weight.inflation, {"long_name": "readings for each independent one"}),
        }
        coordinates[f"{channel}_time_s"] = (axis, data.time_s[rows], {"units": "s", "long_name": "time"})
        coordinates[f"{channel}_run"] = (axis, data.run[rows].astype(np.int32), about["run"])
    said = {"posterior_predictive": _OF_THE_PREDICTIONS, "log_likelihood": _OF_THE_SCORES}
    for name, variables in parts.items():
        drawn = {"chain": [0], "draw": np.arange(draws)} if name in said else {}
        comment = {"comment": said[name]} if name in said else {}
        groups[name] = xr.Dataset(variables, coordinates | drawn, {**_MADE_BY, **comment})
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {**_MADE_BY, "title": cache.case.title, "added": " + ".join(fit.added) or "base model"}
    return tree


def _posterior(cache: FitCache, fit: Fit, steps: np.ndarray) -> xr.Dataset:
    """Return the draws of each number that the tables of a diagnosis have, in its unit."""
    layout, spec = cache.space.layout, fit.spec
    estimates, _ = estimates_of(cache, fit)
    variables = {}
    for place, moved in zip(spec.free, steps, strict=True):
        name = layout.name_of(place)
        if name in estimates:
            coordinate = layout.coordinates[place]
            values = [coordinate.number(fit.x[place] + step) for step in moved]
            label = {"units": estimates[name].unit, "best": estimates[name].value, "sd_of_fit": estimates[name].sd}
            variables[name] = (_DRAWN, np.array([values]), label)
    coordinates = {"chain": [0], "draw": np.arange(steps.shape[1])}
    return xr.Dataset(variables, coordinates, {**_MADE_BY, "comment": _OF_THE_POSTERIOR})


def _channels(cache: FitCache, data: FitData) -> Iterator[tuple[str, np.ndarray, Mapping[str, Any]]]:
    """Give each fitted channel, its rows among the readings, and the attributes of it and of its runs."""
    numbers = np.unique(data.run)
    names = ["_".join(cache.case.runs[number].name.split()) for number in numbers]
    run = {"long_name": "run", "flag_values": numbers.astype(np.int32), "flag_meanings": " ".join(names)}
    for channel, slices in data.by_channel.items():
        rows = np.concatenate([np.arange(one.start, one.stop) for one in slices])
        yield channel, rows, {"long_name": split_unit(channel)[0], "units": unit_of(channel), "run": run}
