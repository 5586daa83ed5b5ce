"""A kernel as a call of XLA: the function through which a program of JAX reaches it.

It reads XLA's call frame, whose layout is that of `xla/ffi/api/c_api.h` (version 0.3), in LLVM instructions: no
compiler of C is needed. XLA refuses a version that it no longer knows when the function is registered.
"""

from __future__ import annotations

import ctypes

import jax

from jaxmodel.native import machine
from jaxmodel.native.kernel import Kernel, NotNative

HANDLER = "handler"
# The version of XLA's interface, and where its structures have what is read here, in bytes.
_MAJOR, _MINOR = 0, 3
_EXTENSION, _ARGUMENTS, _RESULTS = 8, 72, 112
_TYPE, _METADATA, _IS_METADATA = 8, 24, 1
_VERSION, _TRAITS = 24, 32
_DATA, _RANK, _DIMENSIONS = 24, 32, 40


def handler(kernel: Kernel) -> str:
    """Return the LLVM text of the function that XLA calls: constants, shared and own arrays in, results out.

    The own arrays and the results have whole packets of lanes along their last axis; there is an own array.
    """
    given, results = len(kernel.arguments_of_call), len(kernel.results_of_call(0))
    lines = [
        f"define ptr @{HANDLER}(ptr %frame) nounwind {{",
        "entry:",
        *_loaded("extension", "%frame", _EXTENSION),
        "  %plain = icmp eq ptr %extension, null",
        "  br i1 %plain, label %execute, label %extended",
        "extended:",
        *_loaded("type", "%extension", _TYPE, "i32"),
        f"  %asks = icmp eq i32 %type, {_IS_METADATA}",
        "  br i1 %asks, label %describe, label %execute",
        "describe:",  # what version this is
        *_loaded("metadata", "%extension", _METADATA),
        f"  %version = getelementptr i8, ptr %metadata, i64 {_VERSION}",
        f"  store i32 {_MAJOR}, ptr %version",
        "  %minor = getelementptr i8, ptr %version, i64 4",
        f"  store i32 {_MINOR}, ptr %minor",
        f"  %traits = getelementptr i8, ptr %metadata, i64 {_TRAITS}",
        "  store i32 0, ptr %traits",
        "  ret ptr null",
        "execute:",
        *_loaded("given", "%frame", _ARGUMENTS),
        *_loaded("found", "%frame", _RESULTS),
        f"  %pointers = alloca ptr, i64 {given + results}",
    ]
    for number in range(given + results):
        base, place = ("%given", number) if number < given else ("%found", number - given)
        lines += _loaded(f"buffer{number}", base, 8 * place)
        lines += _loaded(f"data{number}", f"%buffer{number}", _DATA)
        lines.append(f"  %to{number} = getelementptr ptr, ptr %pointers, i64 {number}")
        lines.append(f"  store ptr %data{number}, ptr %to{number}")
    last = f"%buffer{given - 1}"
    return "\n".join([
        *lines,
        *_loaded("rank", last, _RANK, "i64"),
        *_loaded("dimensions", last, _DIMENSIONS),
        "  %lanes = getelementptr i64, ptr %dimensions, i64 %rank",
        "  %before = getelementptr i64, ptr %lanes, i64 -1",
        "  %count = load i64, ptr %before",
        f"  %packets = sdiv i64 %count, {kernel.lanes}",
        f"  %work = call ptr @malloc(i64 {8 * kernel.workspace_size()})",
        f"  %run = inttoptr i64 {kernel.address} to ptr",
        "  call void %run(i64 0, i64 %packets, i64 %count, ptr null, ptr %pointers, ptr %work)",
        "  call void @free(ptr %work)",
        "  ret ptr null",
        "}",
        "declare ptr @malloc(i64)",
        "declare void @free(ptr)",
    ])  # fmt: skip


def register(kernel: Kernel) -> str:
    """Make a kernel known to XLA and return its name there; both stay in memory as long as the process.

    Raises:
        NotNative: this version of XLA does not take it.
    """
    function = machine.load(handler(kernel), HANDLER, [ctypes.c_void_p], kept_on_disk=False)
    name = f"jaxmodel_kernel_{len(_REGISTERED)}"
    try:
        jax.ffi.register_ffi_target(name, jax.ffi.pycapsule(function.call), platform="cpu")
    except Exception as error:  # whatever a later version raises
        raise NotNative(f"a call from XLA ({error})") from error
    _REGISTERED.append((kernel, function))
    return name


# What XLA may call has to stay.
_REGISTERED: list[tuple[Kernel, machine.Function]] = []


def _loaded(name: str, base: str, offset: int, kind: str = "ptr") -> list[str]:
    return [
        f"  %at.{name} = getelementptr i8, ptr {base}, i64 {offset}",
        f"  %{name} = load {kind}, ptr %at.{name}",
    ]
