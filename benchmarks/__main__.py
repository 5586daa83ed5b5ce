"""`make bench`: lanes of a batch against the same lanes one by one, and derivatives against plain runs."""

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

LANES = 256
ROWS = 1800


def _timed(function: Callable, argument) -> tuple[float, float]:
    """Return the seconds of the first call, which compiles, and of the fastest of three more."""
    began = time.perf_counter()
    jax.block_until_ready(function(argument))
    first = time.perf_counter() - began
    runs = []
    for _ in range(3):
        began = time.perf_counter()
        jax.block_until_ready(function(argument))
        runs.append(time.perf_counter() - began)
    return first - min(runs), min(runs)


def main() -> None:
    """Print the table."""
    profile = constant(ROWS, 1.0, duty=0.3, load_torque_Nm=0.175, ambient_degC=20.0)
    model = Model("robot")
    course, times = track(model, profile), jnp.asarray(profile.time_s)

    def final_soc(k_tau):
        return run_track(with_values(model, {"k_tau": k_tau}), course, times).readings["soc"][-1]

    values = jnp.asarray(np.linspace(0.03, 0.05, LANES))
    single = jax.jit(final_soc)
    rows = {
        f"{LANES} lanes, one by one": _timed(lambda all_: [single(value) for value in all_], values),
        f"{LANES} lanes, vmapped": _timed(jax.jit(jax.vmap(final_soc)), values),
        "one lane": _timed(single, values[0]),
        "one lane, forward derivative": _timed(jax.jit(jax.jacfwd(final_soc)), values[0]),
        "one lane, reverse derivative": _timed(jax.jit(jax.grad(final_soc)), values[0]),
    }
    print(f"robot, {ROWS} s at 1 s, float64, {jax.device_count()} x {jax.devices()[0].device_kind}")
    for name, (compile_s, run_s) in rows.items():
        print(f"{name:32s} compile {compile_s:6.2f} s   run {1e3 * run_s:9.2f} ms")
    loop, batch = rows[f"{LANES} lanes, one by one"][1], rows[f"{LANES} lanes, vmapped"][1]
    plain = rows["one lane"][1]
    print(f"vmapped against one by one: {loop / batch:.2f} times as fast")
    print(f"forward derivative: {rows['one lane, forward derivative'][1] / plain:.2f} plain runs")
    print(f"reverse derivative: {rows['one lane, reverse derivative'][1] / plain:.2f} plain runs")


if __name__ == "__main__":
    main()
