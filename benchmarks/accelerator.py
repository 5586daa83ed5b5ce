"""A GPU: sweeps as a CUDA kernel and through XLA, beside a processor's core, in picoseconds per lane and step.

The Lorenz system is what two programs for GPUs publish figures of (MPGOS, DiffEqGPU): the classical Runge-Kutta method,
1,000 steps, a parameter that differs from lane to lane.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.timing import alternate
from benchmarks.work import Ours, study_of
from jaxmodel.lanes import CudaKernel
from jaxmodel.sweeps.by_cuda import is_cuda

LANES = (4_096, 65_536, 1_048_576)
# What two processors' rounding may make of a result, relative.
MOST_APART = {"float64": 1e-12, "float32": 1e-4}
_LORENZ_STEPS, _LORENZ_LANES, _STEP = 1000, 1_048_576, 1e-3


def on_accelerator() -> dict[str, Any]:
    """Time all there is on the first GPU; without one, say so."""
    device = jax.devices()[0]
    if not is_cuda(device):
        return {"left_out": f"JAX has no GPU of NVIDIA here, its first device is {device.platform}"}
    sweeps = [
        _sweep(kind, lanes, precision) for kind in ("cell", "robot") for precision in MOST_APART for lanes in LANES
    ]
    return {"gpu": device.device_kind, "sweeps": sweeps, "lorenz": [_lorenz(dtype) for dtype in MOST_APART]}


def _sweep(kind: str, lanes: int, precision: str) -> dict[str, Any]:
    """Time a sweep; its first lanes are compared with those of this machine's processor."""
    study = study_of(kind, lanes, precision=precision)
    ours = Ours(study, 1)
    contestants: dict[str, Any] = {"cuda": ours}
    if precision == "float64":
        contestants["xla"] = Ours(study, 1, through_xla=True)
    found = ours()
    if lanes == LANES[0]:
        on_processor = Ours(study, processor=True)()
        apart = {n: float(np.max(np.abs(found[n] - x) / np.abs(x))) for n, x in on_processor.items()}
        if max(apart.values()) > MOST_APART[precision]:
            raise AssertionError(f"the GPU's numbers and the processor's differ: {apart}")
    else:
        apart = {}
    times = {name: timing.as_row(lanes * ours.steps) for name, timing in alternate(contestants, 3).items()}
    return {"kind": kind, "lanes": lanes, "steps": ours.steps, "precision": precision, "apart": apart, **times}


def _lorenz(precision: str) -> dict[str, Any]:
    """Time the Lorenz system: as a CUDA kernel made from the JAX function below, and that function through XLA."""
    dtype = np.dtype(precision)
    over = np.linspace(0.0, 21.0, _LORENZ_LANES, dtype=dtype)
    through_xla = jax.jit(jax.vmap(_last_of_lorenz))
    with jax.enable_x64(precision == "float64"):
        kernel = CudaKernel(lambda shared, own: _last_of_lorenz(own), (), jax.ShapeDtypeStruct((), dtype))
    loaded = kernel.on(0, ())
    by_kernel = np.stack(loaded.start(over, over.size).tree(), axis=-1)
    by_xla = np.stack([np.asarray(x) for x in through_xla(over)], axis=-1)
    settled = over < 20.0  # beyond it the system is chaotic, and any two orders of rounding part
    apart = float(np.max(np.abs(by_kernel - by_xla)[settled]))
    contestants = {
        "cuda": lambda: loaded.start(over, over.size).wait(),
        "xla": lambda: jax.block_until_ready(through_xla(over)),
    }
    times = {n: timing.as_row(over.size * _LORENZ_STEPS) for n, timing in alternate(contestants).items()}
    return {"precision": precision, "lanes": over.size, "steps": _LORENZ_STEPS, "apart": apart, **times}


def _last_of_lorenz(rho: Any) -> tuple[Any, Any, Any]:
    """Return the state after all steps."""

    def slope(state: Any) -> Any:
        x, y, z = state
        return jnp.stack([10.0 * (y - x), x * (rho - z) - y, x * y - 8.0 / 3.0 * z])

    def step(state: Any, _: Any) -> tuple[Any, None]:
        first = slope(state)
        second = slope(state + 0.5 * _STEP * first)
        third = slope(state + 0.5 * _STEP * second)
        fourth = slope(state + _STEP * third)
        return state + _STEP / 6.0 * (first + 2.0 * second + 2.0 * third + fourth), None

    begin = jnp.array([1.0, 0.0, 0.0], jnp.asarray(rho).dtype)
    last, _ = jax.lax.scan(step, begin, None, length=_LORENZ_STEPS)
    return tuple(last)
