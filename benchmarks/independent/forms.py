"""Other forms of the catalogue's effects, as real hardware might have them in place of the model's equations.

Each is as strong as the catalogue's form at some usual point, and as smooth; nothing else is the same. An effect has
its other form where its parameter `other` is 1.
"""

from __future__ import annotations

from collections.abc import Mapping

import jax
import jax.numpy as jnp

# Effects with another form, and what it is.
OTHER_FORMS = {
    "arrhenius_resistance": "exponential in the temperature itself, not its inverse",
    "capacity_temperature": "levels off 30 K away from the reference",
    "rate_capacity": "grows in proportion to the rate, not as its power",
    "ocv_hysteresis": "turns fast and then saturates at once",
    "entropic_ocv": "half as strong in an empty cell as in a full one",
    "self_heating": "loses heat by free convection, which grows with the temperature",
    "slow_diffusion": "stronger in an empty cell",
    "charge_transfer": "logarithm of the current (Tafel), not its inverse hyperbolic sine",
    "saturation": "root of a sum of squares",
    "stribeck_friction": "exponential of the speed, not of its square",
    "windage": "the speed to the power of 1.7",
    "friction_temperature": "levels off 30 K away from the reference",
    "magnet_temperature": "steeper when hot",
    "gear_loss": "grows slower than the load",
}


def either(effect: Mapping[str, jax.Array], usual: jax.Array, other: jax.Array) -> jax.Array:
    """Return an effect's other form where it has that, else the catalogue's."""
    return jnp.where(jnp.asarray(effect["other"]) > 0.0, other, usual)


def levelling(away: jax.Array, width: float = 30.0) -> jax.Array:
    """Return what is proportional to `away` near zero and levels off beyond the width."""
    return width * jnp.tanh(away / width)
