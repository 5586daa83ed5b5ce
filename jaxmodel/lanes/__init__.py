"""Functions of one lane as instructions of the processor or of a GPU, from their jaxpr."""

from typing import TYPE_CHECKING

from jaxmodel.base.lazy import names_when_used

if TYPE_CHECKING:
    from jaxmodel.lanes.compiled import over
    from jaxmodel.lanes.cuda import CudaCall, CudaError, CudaKernel
    from jaxmodel.lanes.kernel import ROWS, STEPS, Kernel
    from jaxmodel.lanes.machine import processor
    from jaxmodel.lanes.module import Written
    from jaxmodel.lanes.operands import NotNative
    from jaxmodel.lanes.pool import Pool

__all__ = [
    "ROWS",
    "STEPS",
    "CudaCall",
    "CudaError",
    "CudaKernel",
    "Kernel",
    "NotNative",
    "Pool",
    "Written",
    "over",
    "processor",
]

__getattr__, __dir__ = names_when_used(__name__, __file__)
