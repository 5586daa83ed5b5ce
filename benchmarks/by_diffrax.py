"""The cell by diffrax's adaptive solvers under `vmap`, on the same devices as ours."""

from __future__ import annotations

from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import equations
from benchmarks.work import AMBIENT_DEGC, DURATION_S

SOLVERS = ("Tsit5", "Kvaerno5")


class ByDiffrax:
    """A solver on lanes of current and cycles; the tolerance may be changed without compiling anew."""

    def __init__(
        self,
        solver: str,
        current_A: np.ndarray,
        cycles: np.ndarray,
        charge_C: float,
        times_s: tuple[float, ...] = (DURATION_S,),
    ) -> None:
        self.tolerance = 1e-6
        # A program for each device, started together: diffrax's implicit solvers refuse to be compiled for several.
        shares = zip(jax.devices(), *(np.array_split(x, jax.device_count()) for x in (current_A, cycles)), strict=True)
        self._shares = [jax.device_put(share, device) for device, *share in shares]
        term = diffrax.ODETerm(lambda t, y, current: jnp.stack(equations.rates(jnp, *y, current, charge_C)))

        def solve(tolerance: Any, current: Any, cycles: Any) -> tuple[Any, Any]:
            solution = diffrax.diffeqsolve(
                term,
                getattr(diffrax, solver)(),
                0.0,
                float(DURATION_S),
                None,
                jnp.array([1.0, 0.0, 0.0]),
                args=current,
                saveat=diffrax.SaveAt(ts=jnp.array(times_s, dtype=float)),
                stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
                adjoint=diffrax.ForwardMode(),
                max_steps=100_000,
            )
            assert solution.ys is not None
            soc, short_V, long_V = solution.ys.T
            return soc, equations.voltage(jnp, soc, short_V, long_V, current, cycles, AMBIENT_DEGC)

        self._run = jax.jit(jax.vmap(solve, in_axes=(None, 0, 0)))

    def __call__(self) -> tuple[np.ndarray, np.ndarray]:
        """Return SOC and voltage of all lanes at the times, shape (lanes, times)."""
        found = [self._run(self.tolerance, *share) for share in self._shares]
        soc, volts = (np.concatenate(parts) for parts in zip(*found, strict=True))
        return soc, volts
