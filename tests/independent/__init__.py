"""An independent simulator of the continuous-time equations, and a maker of measurements with hidden effects.

It shares no code with the product: what it and the product agree on is the physics.
"""

import jax

jax.config.update("jax_enable_x64", True)

from .integrate import simulate  # noqa: E402  (the precision is set before anything is traced)

__all__ = ["simulate"]
