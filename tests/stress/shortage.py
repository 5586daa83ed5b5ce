"""What runs out at a chosen moment: the n-th file that is begun in a folder, or the n-th array of numpy.

Both count; with `at=0` nothing fails, and the count says how many moments there are. A process of its own takes both
from its environment, before it imports anything else:

    python -c "from tests.stress.shortage import from_environment; from_environment(); ..."
"""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import functools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import llvmlite.binding as llvm
import numpy as np

# Of a process of its own: "files" or "arrays", the moment, "1" if it lasts, and the folder of the files.
VARIABLES = ("SHORT_OF", "SHORT_AT", "SHORT_ON", "SHORT_IN")
_MAKE = ("open", "os.mkdir", "os.rename")
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT


Asked = Callable[[], int]
"""Returns how often something was asked for so far."""


@dataclasses.dataclass
class _Watch:
    folder: str
    at: int
    lasts: bool
    error: Callable[[], BaseException]
    each: Callable[[], object]
    asked: int = 0


_watched: list[_Watch] = []


@functools.cache
def _listening() -> bool:
    """Listen to what Python says of files; a listener stays as long as the process."""

    def hear(event: str, arguments: tuple) -> None:
        if not _watched or event not in _MAKE:
            return
        watch = _watched[-1]
        if event == "open" and not (arguments[2] or 0) & _WRITING:
            return
        path = arguments[1 if event == "os.rename" else 0]
        if isinstance(path, int) or not os.path.abspath(os.fsdecode(path)).startswith(watch.folder):
            return
        watch.asked += 1
        watch.each()
        if watch.at and (watch.asked == watch.at or (watch.lasts and watch.asked > watch.at)):
            raise watch.error()

    sys.addaudithook(hear)
    return True


@contextlib.contextmanager
def of_files(
    folder: Path,
    at: int = 0,
    *,
    lasts: bool = False,
    error: Callable[[], BaseException] = MemoryError,
    each: Callable[[], object] = lambda: None,
) -> Iterator[Asked]:
    """Let the n-th file or folder that is made, written to or put in its place in a folder fail.

    Args:
        folder: what is in it counts, and the folder itself.
        at: n, from 1 on; 0 for none.
        lasts: all after it fail too.
        error: what is raised.
        each: is called at each of them.
    """
    _listening()
    watch = _Watch(os.path.abspath(folder), at, lasts, error, each)
    _watched.append(watch)
    try:
        yield lambda: watch.asked
    finally:
        _watched.pop()


# Numpy asks a handler for the memory of each array. These are those of C, but for the moment at which they have none.
# The handler is one for all: arrays that it has made may outlive those who asked for it.
_HANDLERS = """
@asked = global i64 0
@at = global i64 0
@lasts = global i64 0
declare ptr @malloc(i64)
declare ptr @calloc(i64, i64)
declare ptr @realloc(ptr, i64)
declare void @free(ptr)

define i1 @is_short() {
  %before = atomicrmw add ptr @asked, i64 1 seq_cst
  %now = add i64 %before, 1
  %at = load i64, ptr @at
  %lasts = load i64, ptr @lasts
  %is_it = icmp eq i64 %now, %at
  %is_after = icmp sgt i64 %now, %at
  %any = icmp ne i64 %at, 0
  %on = icmp ne i64 %lasts, 0
  %late = and i1 %is_after, %on
  %later = and i1 %late, %any
  %short = or i1 %is_it, %later
  ret i1 %short
}
define void @gone(ptr %context, ptr %old, i64 %size) {
  call void @free(ptr %old)
  ret void
}
"""
# Of an array's memory: by what name numpy asks, whom of C, and with which arguments.
_MEMORY = (
    ("new", "malloc", "i64 %size"),
    ("empty", "calloc", "i64 %count, i64 %size"),
    ("larger", "realloc", "ptr %old, i64 %size"),
)
_HANDLERS += "".join(
    f"""
define ptr @{name}(ptr %context, {taken}) {{
  %short = call i1 @is_short()
  br i1 %short, label %none, label %some
none:
  ret ptr null
some:
  %found = call ptr @{of}({taken})
  ret ptr %found
}}
"""
    for name, of, taken in _MEMORY
)


class _Handler(ctypes.Structure):
    """`PyDataMem_Handler` of numpy's C interface."""

    _fields_ = (
        ("name", ctypes.c_char * 127),
        ("version", ctypes.c_uint8),
        ("context", ctypes.c_void_p),
        ("malloc", ctypes.c_void_p),
        ("calloc", ctypes.c_void_p),
        ("realloc", ctypes.c_void_p),
        ("free", ctypes.c_void_p),
    )


class _Arrays:
    """Numpy's memory."""

    _SET = 304  # the place of `PyDataMem_SetHandler` in numpy's C interface

    def __init__(self) -> None:
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        machine = llvm.Target.from_default_triple().create_target_machine()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(_HANDLERS), machine)
        self._engine.finalize_object()
        self.asked, self.at, self.lasts = (
            ctypes.c_int64.from_address(self._engine.get_global_value_address(name))
            for name in ("asked", "at", "lasts")
        )
        address = self._engine.get_function_address
        own = (address(name) for name in ("new", "empty", "larger", "gone"))
        self._handler = _Handler(b"short", 1, None, *own)
        new = ctypes.pythonapi.PyCapsule_New
        new.restype, new.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
        self._name = ctypes.c_char_p(b"mem_handler")  # the capsule keeps its address
        self.capsule = new(ctypes.addressof(self._handler), self._name, None)
        where = ctypes.pythonapi.PyCapsule_GetPointer
        where.restype, where.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
        interface = where(np._core._multiarray_umath._ARRAY_API, None)  # type: ignore[attr-defined]
        place = ctypes.cast(interface, ctypes.POINTER(ctypes.c_void_p))[self._SET]
        self.set = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.py_object)(place)


@functools.cache
def _arrays() -> _Arrays:
    return _Arrays()


@contextlib.contextmanager
def of_arrays(at: int = 0, *, lasts: bool = False) -> Iterator[Asked]:
    """Let numpy have no memory for the n-th array that this thread, and what it starts tasks in, asks for.

    Args:
        at: n, from 1 on; 0 for none.
        lasts: there is none for all after it either.
    """
    arrays = _arrays()
    arrays.asked.value, arrays.at.value, arrays.lasts.value = 0, at, int(lasts)
    before = arrays.set(arrays.capsule)
    try:
        yield lambda: arrays.asked.value
    finally:
        arrays.at.value = 0
        arrays.set(before)


def from_environment() -> None:
    """Begin what the environment asks for, until the process ends; without it nothing."""
    what, at, lasts, folder = (os.environ.get(name, "") for name in VARIABLES)
    if what:
        short = (
            of_arrays(int(at), lasts=bool(lasts))
            if what == "arrays"
            else of_files(Path(folder), int(at), lasts=bool(lasts))
        )
        short.__enter__()
