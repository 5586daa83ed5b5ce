"""What derivatives cost: both modes, central differences and doubling on the same lanes, in runs; a gradient's memory.

Equal information: the derivative of one number by all of its p parameters. Forward mode takes p tangents, reverse mode
one pass back, central differences 2 p + 1 runs, doubling p + 1 (and is no derivative: its error is what it misses).
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from benchmarks.long_gradient import STEPS
from benchmarks.timing import alternate
from benchmarks.work import AMBIENT_DEGC, DURATION_S, DUTY
from jaxmodel.base.jax_settings import SWEEP_OPTIONS
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import constant
from jaxmodel.sensitivity.by_vectors import answers, slopes
from jaxmodel.sensitivity.checkpoint import in_blocks
from jaxmodel.sensitivity.response import Response, make_response, steps_of
from jaxmodel.sweeps.devices import CPU_BLOCK

LANES = 1024
METRIC = "delivered_energy_Wh"
_LOADS = {"cell": {"current_A": 3.0}, "robot": {"load_torque_Nm": 0.175, "duty": DUTY}}
_CYCLES = np.linspace(0.5, 2.0, LANES)  # of the cycles stated: each lane is a run of its own
# Ways that take many runs of each lane are timed on a part of the lanes: they fill a processor with less.
_PART = 8
# A call takes so many lanes: a run as in a sweep; what derivatives keep of as many leaves the caches.
_AT_ONCE = {"run": CPU_BLOCK}
_AT_ONCE_ELSE = 64
# As `sensitivity` calls them on processors: vector instructions, beside a run of the same.
_KERNEL_RUN, _KERNEL_FORWARD = "run, as a kernel", "forward mode, as a kernel"
_DIFFERENCE = 1e-3  # of a parameter's own value, or of its stated step


def response_of(kind: str) -> Response:
    """Return the energy of half an hour as a function of all that enters; not from full charge, which has no double."""
    profile = constant(DURATION_S, 1.0, ambient_degC=AMBIENT_DEGC, **_LOADS[kind])
    return make_response(Model(kind, Parameters(initial_soc=jnp.asarray(0.9))), profile, None, (METRIC,), ())


def _programs(response: Response, size: Array) -> dict[str, Callable]:
    """Return for each way its pure function of one lane's parameters: the derivatives by their steps, in Wh."""
    ways = jnp.diag(size)

    def energy(numbers: Response, values: Array) -> Array:
        return numbers(values).metrics[0]

    def forward_mode(numbers: Response, values: Array) -> Array:
        def push(way: Array) -> tuple[Array, Array]:
            return jax.jvp(lambda x: energy(numbers, x), (values,), (way,))

        return jax.vmap(push, out_axes=(None, 0))(ways)[1]

    def reverse_mode(numbers: Response, values: Array) -> Array:
        return size * jax.grad(lambda x: in_blocks(lambda y: energy(numbers, y), x))(values)

    def central(numbers: Response, values: Array) -> Array:
        away = _DIFFERENCE * ways
        found = jax.vmap(lambda x: energy(numbers, x))(jnp.concatenate([values[None], values + away, values - away]))
        return (found[1 : size.size + 1] - found[size.size + 1 :]) / (2.0 * _DIFFERENCE)

    def doubled(numbers: Response, values: Array) -> Array:
        found = jax.vmap(lambda x: energy(numbers, x))(jnp.concatenate([values[None], values + ways]))
        return found[1:] - found[0]

    return {
        "run": energy,
        "forward mode": forward_mode,
        "reverse mode": reverse_mode,
        "central differences": central,
        "doubling": doubled,
    }


def cost_of(kind: str, lanes: int = LANES, rounds: int = 2) -> list[dict[str, Any]]:
    """Return a row for each way: its time in runs of the same lanes, the memory it needs, and its error.

    The error is the largest of a lane's derivatives' errors by its largest derivative, each by a step of its parameter.
    """
    response = response_of(kind)
    step = steps_of(response)
    count = len(response.names)
    at = np.tile(np.asarray(response.values()), (lanes, 1))
    at[:, response.names.index("cycles")] *= np.resize(_CYCLES, lanes)
    arrays, rest = eqx.partition(response, eqx.is_array)
    runs = {"run": 1, "central differences": 2 * count + 1, "doubling": count + 1}
    contestants, memory, found, some = {}, {}, {}, {}
    for name, one in _programs(response, jnp.asarray(step.size)).items():
        some[name] = lanes // _PART if runs.get(name, 1) > 1 else lanes
        calls = max(1, some[name] // _AT_ONCE.get(name, _AT_ONCE_ELSE))
        batches = [jnp.asarray(batch) for batch in np.split(at[: some[name]], calls)]

        def all_lanes(arrays: Response, at: Array, one: Callable = one) -> Array:
            return jax.vmap(lambda values: one(eqx.combine(arrays, rest), values))(at)

        options = SWEEP_OPTIONS if jax.default_backend() == "cpu" else None
        compiled = jax.jit(all_lanes).lower(arrays, batches[0]).compile(options)
        used = compiled.memory_analysis()
        memory[name] = used.temp_size_in_bytes / 2**20 if used else float("nan")

        def contest(name: str = name, compiled: Callable = compiled, batches: list[Array] = batches) -> None:
            found[name] = np.concatenate([np.asarray(compiled(arrays, batch)) for batch in batches])

        contestants[name] = contest

    def kernel_run() -> None:
        found[_KERNEL_RUN] = np.asarray(answers(response, at)[0].metrics[:, 0])

    def kernel_forward() -> None:
        found[_KERNEL_FORWARD] = np.asarray(slopes(response, at, count)[1].metrics[..., 0]) * step.size

    if jax.default_backend() == "cpu":
        contestants |= {_KERNEL_RUN: kernel_run, _KERNEL_FORWARD: kernel_forward}
        some |= dict.fromkeys((_KERNEL_RUN, _KERNEL_FORWARD), lanes)
    times = {name: timing.as_row() for name, timing in alternate(contestants, rounds).items()}
    exact, counted = found["forward mode"], {"doubling": step.in_bounds}
    rows = []
    for name, row in times.items():
        more = lanes / some[name]
        unit = times[_KERNEL_RUN if name in (_KERNEL_RUN, _KERNEL_FORWARD) else "run"]
        times_run = {key: more * row[key] / unit[key] for key in ("best_s", "cpu_s")}
        error = None
        if name not in ("run", "forward mode", _KERNEL_RUN):
            truth = exact[: some[name]]
            off = np.abs(found[name] - truth)[:, counted.get(name, slice(None))].max(axis=1)
            error = float(np.max(off / np.abs(truth).max(axis=1)))
        rows.append(
            {"kind": kind, "way": name, "lanes": some[name], "steps": response.stepped.duration_s.size}
            | {"parameters": count, "runs": runs.get(name), "memory_MiB": memory.get(name), "error": error}
            | {"times_run": times_run["best_s"], "times_run_cpu": times_run["cpu_s"]}
            | row
        )
    return rows


def cost_of_derivatives() -> list[dict[str, Any]]:
    """Return the rows of a cell and of a robot."""
    return [row for kind in _LOADS for row in cost_of(kind)]


def memory_of_a_long_gradient() -> dict[str, float]:
    """Return what a gradient through 100,000 steps takes of memory, the whole process, JAX included."""
    ran = subprocess.run(
        [sys.executable, "-m", "benchmarks.long_gradient"], capture_output=True, text=True, check=True, timeout=600
    )
    return {"steps": STEPS, "peak_MiB": float(ran.stdout.split()[0]) / 1024.0}
