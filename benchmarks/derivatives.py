"""Lanes of a batch against the same lanes one by one, and derivatives against plain runs."""

from __future__ import annotations

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.model import Model
from jaxmodel.names import with_values
from jaxmodel.profile import constant
from jaxmodel.simulate import run_track, track

LANES = 64
ROWS = 1800


def _timed(function: Callable, argument) -> dict[str, float]:
    """Return the seconds that compiling takes, and the fastest of three runs."""
    began = time.perf_counter()
    jax.block_until_ready(function(argument))
    first = time.perf_counter() - began
    runs = []
    for _ in range(3):
        began = time.perf_counter()
        jax.block_until_ready(function(argument))
        runs.append(time.perf_counter() - began)
    return {"compile_s": first - min(runs), "run_s": min(runs)}


def derivatives() -> dict[str, dict[str, float]]:
    """Return compile and run times by name."""
    profile = constant(ROWS, 1.0, duty=0.3, load_torque_Nm=0.175, ambient_degC=20.0)
    model = Model("robot")
    course, times = track(model, profile), jnp.asarray(profile.time_s)

    def final_soc(k_tau):
        return run_track(with_values(model, {"k_tau": k_tau}), course, times).readings["soc"][-1]

    values = jnp.asarray(np.linspace(0.03, 0.05, LANES))
    # `run_track` is compiled as it is. A `jit` around it makes this XLA abort where one number alone is used.
    return {
        f"{LANES} lanes, one by one": _timed(lambda all_: [final_soc(value) for value in all_], values),
        f"{LANES} lanes, vmapped": _timed(jax.vmap(final_soc), values),
        "one lane": _timed(final_soc, values[0]),
        "one lane, forward derivative": _timed(jax.jacfwd(final_soc), values[0]),
        "one lane, reverse derivative": _timed(jax.grad(final_soc), values[0]),
    }
