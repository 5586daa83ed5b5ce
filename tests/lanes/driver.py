"""A driver of a GPU for machines without one: memory is the host's, and a launch runs each thread in turn."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

from jaxmodel.lanes import CudaKernel, machine
from jaxmodel.lanes.kernel import _ARGUMENTS
from jaxmodel.lanes.module import NAME


class Driver:
    """The calls that `jaxmodel.lanes.cuda` makes, each with the meaning that CUDA's manual gives it.

    Attributes:
        held: arrays by their address, as long as they are not freed.
        launches: the lanes of each launch.
        allowed: bytes in all.
    """

    def __init__(self, allowed: int = 2**40) -> None:
        self.held: dict[int, np.ndarray] = {}
        self.launches: list[int] = []
        self.allowed = allowed
        self.module: Any = None

    def knows(self, kernel: CudaKernel) -> None:
        """Take a kernel's instructions; the host runs those for packets of one lane, from which its PTX is made too."""
        self.module = machine.load(kernel.module.text, NAME, _ARGUMENTS, kept_on_disk=False)

    def cuDeviceGet(self, *arguments: Any) -> int:
        return 0

    cuDevicePrimaryCtxRetain = cuCtxPushCurrent_v2 = cuCtxPopCurrent_v2 = cuCtxSynchronize = cuDeviceGet
    cuModuleLoadData = cuModuleGetFunction = cuDeviceGet

    def cuGetErrorString(self, code: int, text: Any) -> int:
        text._obj.value = b"out of memory"
        return 0

    def cuMemAlloc_v2(self, address: Any, size: Any) -> int:
        if sum(x.nbytes for x in self.held.values()) + size.value > self.allowed:
            return 2
        array = np.zeros(size.value, np.uint8)
        self.held[array.ctypes.data] = array
        address._obj.value = array.ctypes.data
        return 0

    def cuMemFree_v2(self, address: Any) -> int:
        del self.held[address.value]
        return 0

    def cuMemcpyHtoD_v2(self, to: Any, source: Any, size: Any) -> int:
        ctypes.memmove(to.value, source.value, size.value)
        return 0

    def cuMemcpyDtoH_v2(self, to: Any, source: Any, size: Any) -> int:
        ctypes.memmove(to.value, source.value, size.value)
        return 0

    def cuMemGetInfo_v2(self, free: Any, total: Any) -> int:
        free._obj.value = total._obj.value = self.allowed
        return 0

    def cuLaunchKernel(self, function: Any, *rest: Any) -> int:
        blocks, threads, pointers = rest[0], rest[3], rest[8]
        numbers = [ctypes.cast(pointer, ctypes.POINTER(ctypes.c_int64))[0] for pointer in pointers]
        _, count, sizes, arguments, work, room = numbers
        assert blocks * threads >= count > (blocks - 1) * threads
        self.launches.append(count)
        for lane in range(count):
            self.module.call(lane, lane + 1, count, sizes, arguments, work + lane * room)
        return 0
