"""An electro-thermal model of a lithium pack driving brushed DC motors: a pure step, scanned."""

import jax

from jaxmodel.devices import keep_sums_in_kernels, use_all_cores

# Before any array, there is no later moment to ask: the model's accuracy (SOC to 1e-6 over hours) is out of reach of
# float32, and JAX counts the devices once.
jax.config.update("jax_enable_x64", True)
use_all_cores()
keep_sums_in_kernels()
