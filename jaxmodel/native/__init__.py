"""Functions of one lane as vector instructions of the processor, from their jaxpr."""

from jaxmodel.native.in_jax import in_jax
from jaxmodel.native.kernel import ROWS, STEPS, Kernel
from jaxmodel.native.machine import processor
from jaxmodel.native.operands import NotNative
from jaxmodel.native.pool import Pool

__all__ = ["ROWS", "STEPS", "Kernel", "NotNative", "Pool", "in_jax", "processor"]
