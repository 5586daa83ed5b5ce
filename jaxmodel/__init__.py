"""An electro-thermal model of a lithium pack driving brushed DC motors: a pure step, scanned."""

import jax

# The model's accuracy (SOC to 1e-6 over hours) is out of reach of float32; there is no later moment to ask.
jax.config.update("jax_enable_x64", True)
