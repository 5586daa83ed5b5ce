"""Functions of one lane as vector instructions of the processor, from their jaxpr."""

from jaxmodel.native.kernel import Kernel
from jaxmodel.native.lowering import NotNative
from jaxmodel.native.machine import processor
from jaxmodel.native.pool import Pool

__all__ = ["Kernel", "NotNative", "Pool", "processor"]
