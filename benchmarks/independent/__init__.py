"""An independent simulator of the continuous-time equations, and a maker of measurements with hidden effects.

It shares no code with the product: what the two agree on is the physics.
"""

import jax

jax.config.update("jax_enable_x64", True)

from benchmarks.independent.integrate import simulate  # noqa: E402  (the precision is set before anything is traced)
from benchmarks.independent.make_case import Run, write_case  # noqa: E402
from benchmarks.independent.profiles import PATTERNS, make_profile  # noqa: E402

__all__ = ["PATTERNS", "Run", "make_profile", "simulate", "write_case"]
