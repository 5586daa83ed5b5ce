"""Responses and their derivatives as vector instructions of the processor: packets of lanes, spread over threads."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.lanes import Kernel, NotNative, Pool, over
from jaxmodel.sensitivity.response import Answer, Response
from jaxmodel.sweeps.lane import Outcome

# Packets of a call of a kernel: few, so that threads end together and progress moves.
_PACKETS = 8


def slopes(
    response: Response, at: np.ndarray, asked: int, done: Callable[[int], None] = lambda lanes: None
) -> tuple[Answer, Answer]:
    """Return the answers at points and their derivatives by the first parameters, which come after the lanes' axis.

    Args:
        response: that is differentiated.
        at: parameter values, shape (lanes, parameter).
        asked: how many parameters to differentiate by.
        done: called with lanes as they are done.

    Raises:
        NotNative: an operation has no vector instructions.
    """
    own = {"by": at[:, :asked], "others": at[:, asked:]}
    (metrics, outputs), (of_metrics, of_outputs) = _run("slopes", response, own, done)
    answer = _answer_of(response, metrics, outputs, len(at))
    return answer, _answer_of(response, of_metrics, of_outputs, len(at), asked)


def pushed(response: Response, at: np.ndarray, along: np.ndarray) -> tuple[Answer, Answer, Outcome]:
    """Return the answers at points, their derivatives along a direction of each lane, and the outcomes of the runs.

    Raises:
        NotNative: an operation has no vector instructions.
    """
    own = {"by": np.zeros((len(at), 1)), "at": at, "along": along}
    (metrics, outputs, outcome), (of_metrics, of_outputs, _) = _run("pushed", response, own)
    slope = jax.tree.map(lambda x: x[:, 0], _answer_of(response, of_metrics, of_outputs, len(at), 1))
    return _answer_of(response, metrics, outputs, len(at)), slope, jax.tree.map(jnp.asarray, outcome)


def answers(response: Response, at: np.ndarray) -> tuple[Answer, np.ndarray]:
    """Return the answers at points, and the status of each run.

    Raises:
        NotNative: an operation has no vector instructions.
    """
    metrics, outputs, status = _run("answers", response, {"at": at})
    return _answer_of(response, metrics, outputs, len(at)), status


def _answer_of(response: Response, metrics: list[np.ndarray], outputs: list[np.ndarray], *before: int) -> Answer:
    """Return answers from metrics and outputs that are apart, with some axes before those of an answer."""
    rows = response.time_s.size
    return Answer(
        metrics=jnp.asarray(np.stack(metrics, axis=-1) if metrics else np.zeros((*before, 0))),
        outputs=jnp.asarray(np.stack(outputs, axis=-2) if outputs else np.zeros((*before, 0, rows))),
    )


def _run(
    what: str, response: Response, own: dict[str, np.ndarray], done: Callable[[int], None] = lambda lanes: None
) -> Any:
    if jax.default_backend() != "cpu":
        raise NotNative("an accelerator")
    arrays, rest = eqx.partition(response, eqx.is_array)
    arrays = jax.tree.map(np.asarray, arrays)
    statics, of_rest = jax.tree.flatten(rest)

    def one_lane(arrays: Any, own: dict[str, jax.Array]) -> Any:
        return _FUNCTIONS[what](eqx.combine(arrays, rest), own)

    one = {name: x[0] for name, x in own.items()}
    by = "by" if "by" in own else ""
    kernel = over(Kernel, one_lane, arrays, one, (what, of_rest, tuple(statics)), by=by)
    with Pool(os.cpu_count() or 1) as pool:
        return pool.start(kernel, arrays, own, len(next(iter(own.values()))), _PACKETS).tree(done)


def _slopes(response: Response, own: dict[str, jax.Array]) -> Any:
    return response.parts(response.named(jnp.concatenate([own["by"], own["others"]])))[:2]


def _pushed(response: Response, own: dict[str, jax.Array]) -> Any:
    *found, outcome = response.parts(response.named(own["at"] + own["by"][0] * own["along"]))
    return *found, jax.lax.stop_gradient(outcome)


def _answers(response: Response, own: dict[str, jax.Array]) -> Any:
    *found, outcome = response.parts(response.named(own["at"]))
    return *found, outcome.status


_FUNCTIONS: dict[str, Callable[[Response, dict[str, jax.Array]], Any]] = {
    "slopes": _slopes,
    "pushed": _pushed,
    "answers": _answers,
}
