"""Functions of one lane as instructions of the processor or of a GPU, from their jaxpr."""

from jaxmodel.native.cuda import CudaCall, CudaError, CudaKernel
from jaxmodel.native.in_jax import in_jax
from jaxmodel.native.kernel import ROWS, STEPS, Kernel
from jaxmodel.native.machine import processor
from jaxmodel.native.module import Written
from jaxmodel.native.operands import NotNative
from jaxmodel.native.pool import Pool

__all__ = [
    "ROWS", "STEPS", "CudaCall", "CudaError", "CudaKernel", "Kernel", "NotNative", "Pool", "Written", "in_jax",
    "processor",
]  # fmt: skip
