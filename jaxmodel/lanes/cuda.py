"""A function of one lane as a CUDA kernel: a thread per lane, the whole function in its registers.

The instructions are those of `Kernel`, written for packets of one lane. LLVM makes PTX of them, and the driver of the
GPU makes machine code of that: no CUDA toolkit is needed on the user's machine.
"""

from __future__ import annotations

import ctypes
import functools
import sys
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import jax
import llvmlite.binding as llvm
import numpy as np

from jaxmodel.lanes import machine
from jaxmodel.lanes.module import NAME, Written

_TRIPLE = "nvptx64-nvidia-cuda"
# The oldest GPUs (Volta, 2017) and the PTX of the oldest driver (CUDA 11.0) that run it; newer ones run it too.
_PROCESSOR, _PTX = "sm_70", "+ptx70"
# Threads of a block. Measured on an H200: 64 and 128 alike, 256 slower by a twentieth for a robot.
_BLOCK = 128
_ENTRY = "over_lanes"
_LIBRARY = {"win32": "nvcuda.dll"}.get(sys.platform, "libcuda.so.1")
_OUT_OF_MEMORY = 2
_THREADS = ("tid.x", "ctaid.x", "ntid.x")


class CudaError(RuntimeError):
    """The driver of the GPU refused a call."""


class CudaKernel(Written):
    """A function (shared, own) -> results of one lane, as PTX; `on` loads it on a GPU.

    Attributes:
        ptx: the text that a driver compiles.
    """

    LANES = 1
    HAS_LIBRARY = False
    ENDING = "cuda"

    def _compile(self) -> None:
        self.ptx = machine.compiled_for(_gpu(), self._with_entry())

    def on(self, number: int, shared: Any) -> OnDevice:
        """Return the kernel loaded on GPU `number`, with what all lanes share in its memory."""
        return OnDevice(self, Device(number), shared)

    def _with_entry(self) -> str:
        """Return the module with what a thread begins with: it runs the one packet that has its number."""
        inner = self.module.text.replace(f"define void @{NAME}", f"define internal void @{NAME}", 1)
        inner = inner.replace('"prefer-vector-width"="512"', "alwaysinline", 1)
        special = "\n".join(f"declare i32 @llvm.nvvm.read.ptx.sreg.{name}()" for name in _THREADS)
        thread, block, width = (f"call i32 @llvm.nvvm.read.ptx.sreg.{name}()" for name in _THREADS)
        return f"""{inner}
{special}
define ptx_kernel void @{_ENTRY}(i64 %first, i64 %count, ptr %sizes, ptr %arguments, ptr %work, i64 %room) {{
  %thread = {thread}
  %block = {block}
  %width = {width}
  %before = mul i32 %block, %width
  %number = add i32 %before, %thread
  %packet = zext i32 %number to i64
  %next = add i64 %packet, 1
  %inside = icmp slt i64 %packet, %count
  br i1 %inside, label %run, label %end
run:
  %offset = mul i64 %packet, %room
  %own = getelementptr i8, ptr %work, i64 %offset
  call void @{NAME}(i64 %packet, i64 %next, i64 %count, ptr %sizes, ptr %arguments, ptr noalias %own)
  br label %end
end:
  ret void
}}
"""


@functools.cache
def _gpu() -> Any:
    """Return the target machine of any GPU."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(_TRIPLE).create_target_machine(cpu=_PROCESSOR, features=_PTX, opt=3)


class OnDevice:
    """A kernel on a GPU, with what all lanes share; calls follow one another in the order of their start."""

    def __init__(self, kernel: CudaKernel, device: Device, shared: Any) -> None:
        self._kernel, self._device = kernel, device
        self._function = device.loaded(kernel.ptx)
        self._shared = [device.put(x) for x in kernel.as_given(shared)]
        self._sizes = device.put(np.zeros(1, np.int64))

    @property
    def bytes_per_lane(self) -> int:
        """What a lane of a call takes of the memory of the GPU."""
        leaves = (*self._kernel.module.own, *self._kernel.module.results)
        return sum(leaf.size * leaf.dtype.itemsize for leaf in leaves) + 8 * self._kernel.workspace_size()

    @property
    def free_bytes(self) -> int:
        """What is free of the memory of the GPU."""
        return self._device.free_bytes()

    def start(self, own: Any, count: int) -> CudaCall:
        """Start a call over so many lanes, which `own` has along its first axis; it returns before they are done.

        Raises:
            MemoryError: the GPU has too little memory for so many lanes.
        """
        moved = jax.tree.map(lambda x: np.moveaxis(np.asarray(x), 0, -1), own)
        results = self._kernel.buffers(count)
        given = [*self._shared, *map(self._device.put, self._kernel.own_as_given(moved))]
        found = [self._device.room(x.nbytes) for x in results]
        room = 8 * self._kernel.workspace_size()
        work = self._device.room(room * count)
        addresses = self._device.put(np.array([x.address for x in (*given, *found)], np.uint64))
        numbers = [0, count, self._sizes.address, addresses.address, work.address, room]
        self._device.launch(self._function, -(-count // _BLOCK), _BLOCK, numbers)
        return CudaCall(self._kernel, results, found, (given, work, addresses))


class CudaCall:
    """Lanes that a GPU is at."""

    def __init__(self, kernel: CudaKernel, results: list[np.ndarray], found: list[DeviceArray], alive: Any) -> None:
        self._kernel, self._results, self._found = kernel, results, found
        self._alive = alive  # until the results have been copied

    def wait(self) -> None:
        """Wait until the lanes are done, and copy nothing."""
        self._found[0].device.wait()

    def tree(self) -> Any:
        """Return the results when they are there, as those of the function, the lanes along the first axis."""
        for mine, theirs in zip(self._results, self._found, strict=True):
            theirs.copy_to(mine)
        self._alive, self._found = None, []
        return self._kernel.tree(self._results, self._results[0].shape[-1])


class Device:
    """A GPU, through its driver, in the context that JAX uses too."""

    def __init__(self, number: int) -> None:
        """Take GPU `number` of those that this process sees.

        Raises:
            CudaError: the driver refuses.
        """
        self._driver = _driver()
        handle, self._context = ctypes.c_int(), ctypes.c_void_p()
        self._call("cuDeviceGet", ctypes.byref(handle), number)
        self._call("cuDevicePrimaryCtxRetain", ctypes.byref(self._context), handle)

    def _call(self, name: str, *arguments: Any) -> None:
        _checked(self._driver, name, getattr(self._driver, name)(*arguments))

    @contextmanager
    def _in_context(self) -> Iterator[None]:
        """Make the GPU's context this thread's."""
        self._call("cuCtxPushCurrent_v2", self._context)
        try:
            yield
        finally:
            self._driver.cuCtxPopCurrent_v2(ctypes.byref(ctypes.c_void_p()))

    def loaded(self, ptx: str) -> Any:
        """Return the entry of a module, compiled by the driver.

        Raises:
            CudaError: the driver does not know the text, or is too old for it.
        """
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        with self._in_context():
            self._call("cuModuleLoadData", ctypes.byref(module), ptx.encode() + b"\0")
            self._call("cuModuleGetFunction", ctypes.byref(function), module, _ENTRY.encode())
        return function

    def room(self, size: int) -> DeviceArray:
        """Return memory of the GPU that is freed with the object.

        Raises:
            MemoryError: there is too little.
        """
        address = ctypes.c_uint64()
        with self._in_context():
            self._call("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(size, 8)))
        return DeviceArray(self, address.value)

    def put(self, values: np.ndarray) -> DeviceArray:
        """Return a copy of an array in the memory of the GPU."""
        room = self.room(values.nbytes)
        with self._in_context():
            self._call(
                "cuMemcpyHtoD_v2",
                ctypes.c_uint64(room.address),
                ctypes.c_void_p(values.ctypes.data),
                ctypes.c_size_t(values.nbytes),
            )
        return room

    def launch(self, function: Any, blocks: int, threads: int, numbers: Sequence[int]) -> None:
        """Start a kernel with arguments of 64 bits."""
        values = [ctypes.c_uint64(number) for number in numbers]
        pointers = (ctypes.c_void_p * len(values))(*(ctypes.addressof(value) for value in values))
        with self._in_context():
            self._call("cuLaunchKernel", function, blocks, 1, 1, threads, 1, 1, 0, None, pointers, None)

    def wait(self) -> None:
        """Wait until all that was started is done."""
        with self._in_context():
            self._call("cuCtxSynchronize")

    def fetch(self, address: int, into: np.ndarray) -> None:
        """Copy memory of the GPU into an array, when what was started before is done."""
        with self._in_context():
            self._call(
                "cuMemcpyDtoH_v2",
                ctypes.c_void_p(into.ctypes.data),
                ctypes.c_uint64(address),
                ctypes.c_size_t(into.nbytes),
            )

    def free(self, address: int) -> None:
        """Give memory of the GPU back."""
        with self._in_context():
            self._driver.cuMemFree_v2(ctypes.c_uint64(address))

    def free_bytes(self) -> int:
        """Return what is free of the memory of the GPU."""
        free, total = ctypes.c_size_t(), ctypes.c_size_t()
        with self._in_context():
            self._call("cuMemGetInfo_v2", ctypes.byref(free), ctypes.byref(total))
        return free.value


class DeviceArray:
    """Memory of a GPU, given back with the object."""

    def __init__(self, device: Device, address: int) -> None:
        self.device, self.address = device, address
        given_back = weakref.finalize(self, device.free, address)
        given_back.atexit = False  # type: ignore[misc]  # the driver does it then, and may be gone

    def copy_to(self, array: np.ndarray) -> None:
        """Fill an array with what is there."""
        self.device.fetch(self.address, array)


@functools.cache
def _driver() -> Any:
    """Return the driver's library, started.

    Raises:
        CudaError: there is none, or it does not start.
    """
    try:
        driver = ctypes.CDLL(_LIBRARY)
    except OSError as error:
        raise CudaError(f"no driver of a GPU was found ({error})") from error
    _checked(driver, "cuInit", driver.cuInit(0))
    return driver


def _checked(driver: Any, name: str, code: int) -> None:
    """Raise an error if a call of the driver did not succeed."""
    if not code:
        return
    text = ctypes.c_char_p()
    driver.cuGetErrorString(code, ctypes.byref(text))
    reason = f"{name}: {(text.value or b'unknown error').decode()} (CUDA error {code})"
    if code == _OUT_OF_MEMORY:
        raise MemoryError(reason)
    raise CudaError(reason)
