"""What two parameters do together: second derivatives of metrics, beside the doubling of both.

To second order a step s in p and one of t in q change a metric y by

    s y_p + t y_q + (s^2 y_pp + t^2 y_qq) / 2 + s t y_pq

so that the change by both steps less the changes by each alone is s t y_pq: the interaction. Where both steps are
doublings it is (p q / y) y_pq as a share of y. A response that is a product of powers, y = c p^a q^b, has an
interaction too, the product of both changes: it says nothing that the elasticities a and b do not say already. What is
more or less than `power_law` is a true joint action.
"""

from __future__ import annotations

from collections.abc import Iterable

import jax
import numpy as np
import xarray

from jaxmodel.base.errors import ParameterError
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sensitivity.derivatives import answer_variables, coordinates, pushforward, relative
from jaxmodel.sensitivity.metrics import VALID_SHARE
from jaxmodel.sensitivity.response import make_response, steps_of
from jaxmodel.sweeps.metrics import Metric

# Second derivatives are differences of fourth order of exact slopes, this share of a step apart: ten digits. A jvp of a
# jvp has three more, and took more than seven minutes to compile for a robot, where slopes take twenty seconds.
APART = 1e-3
_PLACES, _WEIGHTS = np.array([-2.0, -1.0, 1.0, 2.0]), np.array([1.0, -8.0, 8.0, -1.0]) / 12.0


def second_derivatives(
    model: Model,
    profile: Profile,
    pairs: Iterable[tuple[str, str]],
    metrics: Iterable[str | Metric] | None = None,
    *,
    cutoff: Cutoff | None = None,
) -> xarray.Dataset:
    """Return the second derivatives of metrics by pairs of parameters, beside the doubling of both at once.

    Steps are those of the doubling test: a parameter's own value, where that means nothing a stated one. A name may be
    paired with itself: two steps of it are then compared with one and one.

    Args:
        model: any kind; its leaves are scalars.
        profile: inputs over time.
        pairs: of parameters, those of effects or inputs, named as in `local_sensitivities`.
        metrics: as in `local_sensitivities`.
        cutoff: where each run ends.

    Returns:
        A data set over metric, parameter (every name once) and pair, whose names are first and second (pair):
        value, unit, step, doubles (parameter); metric_value, metric_unit (metric);
        second_derivative (metric, pair), in the metric's unit by those of both parameters;
        change_first, change_second, change_both (metric, pair): simulated, in the metric's unit, NaN out of bounds;
        change_joint = both - first - second, and predicted_joint = step step second_derivative, what it is near by;
        effect_first, effect_second, effect_both, effect_joint (metric, pair): the same by the metric;
        interaction: predicted_joint by the metric, (p q / y) d2y/dp dq where both steps double;
        power_law: the joint effect of a product of powers, (2^a - 1)(2^b - 1), a and b the elasticities;
        valid_share (pair): of the run after both steps, the share of its rows in which the equations make sense.

    Raises:
        ParameterError: a parameter is unknown, or no pair is given.
        SweepError: a metric is unknown.
    """
    chosen = list(dict.fromkeys(pairs))
    if not chosen:
        raise ParameterError("pairs: none is given; name two parameters or inputs at least.")
    names = tuple(dict.fromkeys(name for pair in chosen for name in pair))
    response = make_response(model, profile, names, metrics, (), cutoff)
    step, here = steps_of(response), np.asarray(response.values())
    one, other = np.array([[names.index(name) for name in pair] for pair in chosen]).T
    by = np.diag(step.size)

    # Slopes along the second parameter at four places along the first; then each alone, and both.
    about = here + APART * _PLACES[:, None, None] * by[one]
    slopes_of = np.broadcast_to(by[other], about.shape)
    alone, both = here + by, here + by[one] + by[other]
    at = np.concatenate([about.reshape(-1, here.size), alone, both, np.tile(here, (len(names), 1))])
    along = np.concatenate([slopes_of.reshape(-1, here.size), np.zeros_like(alone), np.zeros_like(both), by])
    answers, slopes, runs = pushforward(response, at, along)
    base = jax.tree.map(lambda x: x[-1], answers)
    values, slope = np.asarray(answers.metrics), np.asarray(slopes.metrics)
    near, far = about.shape[0] * len(chosen), len(names) + len(chosen)
    bent = np.tensordot(_WEIGHTS / APART, slope[:near].reshape(4, len(chosen), -1), axes=1).T
    table = response.table()
    lower, upper = (np.array([getattr(info, end) for info in table]) for end in ("lower", "upper"))

    def change(points: np.ndarray, found: np.ndarray) -> np.ndarray:
        inside = np.all((points >= lower) & (points <= upper), axis=1)
        return np.where(inside[:, None], found - values[-1], np.nan).T

    moved = change(alone, values[near : near + len(names)])
    together = change(both, values[near + len(names) : near + far])
    changes = {"first": moved[:, one], "second": moved[:, other], "both": together}
    changes["joint"] = changes["both"] - changes["first"] - changes["second"]
    linear = relative(response, slope[near + far :].T, base)
    with np.errstate(over="ignore"):
        growth = np.where(step.doubles, np.exp2(linear) - 1.0, np.nan)
    valid = np.asarray(runs.values[VALID_SHARE.name])[near + len(names) : near + far]
    dims = ("metric", "pair")
    described = {name: v for name, v in answer_variables(response, base, step).items() if name != "output_value"}
    place = {name: v for name, v in coordinates(response).items() if name not in ("output", "time_s")}
    return xarray.Dataset(
        described
        | {"second_derivative": (dims, bent / (step.size[one] * step.size[other]))}
        | {f"change_{which}": (dims, found) for which, found in changes.items()}
        | {"predicted_joint": (dims, bent)}
        | {f"effect_{which}": (dims, relative(response, found, base)) for which, found in changes.items()}
        | {
            "interaction": (dims, relative(response, bent, base)),
            "valid_share": ("pair", valid),
            "power_law": (dims, np.where(one == other, np.nan, growth[:, one] * growth[:, other])),
        },
        place | {"first": ("pair", [p for p, _ in chosen]), "second": ("pair", [q for _, q in chosen])},
        {"simulations": len(at)},
    )
