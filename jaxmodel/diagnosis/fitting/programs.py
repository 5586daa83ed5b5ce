"""Programs compiled once for each shape of their arguments, and kept as executables (see `jaxmodel.base.cache`).

The cache of JAX saves only compilation: it identifies a program after tracing and lowering, which takes most of a
second each. Here a program is identified by its arguments and by the source code that would be traced.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import os
import pickle
import platform
import threading
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.experimental import serialize_executable
from jaxtyping import Array

from jaxmodel.base.cache import keep, kept
from jaxmodel.base.jax_settings import QUICK_OPTIONS

# Packages whose source is traced: those of the project, and others.
_PROJECT = ("jaxmodel",)
_OTHERS = ("jax", "jaxlib", "equinox", "numpy")

_Compiled = Callable[..., Array]


class Programs:
    """A function of pytrees, compiled for each shape of its arguments; non-arrays are part of the program.

    It is thread-safe: the first thread compiles a program while others wait.
    """

    def __init__(self, function: Callable[..., Array]) -> None:
        """Take a pure function."""
        self._function = function
        self.compiled: dict[object, _Compiled] = {}
        self._compiling: defaultdict[object, threading.Lock] = defaultdict(threading.Lock)

    def __call__(self, *arguments: Any, classes: Sequence[type] = ()) -> Array:
        """Return the function's value.

        Args:
            arguments: pytrees.
            classes: of the arguments; a program with a class of the user is not stored, because its source may change.
        """
        arrays, rest = eqx.partition(arguments, eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        of_rest, rest_tree = jax.tree.flatten(rest)
        key = (tree, rest_tree, tuple(of_rest), tuple(map(jax.typeof, leaves)))
        if key not in self.compiled:
            with self._compiling[key]:
                if key not in self.compiled:
                    name = _name_of(key) if are_of_project(classes) else ""
                    self.compiled[key], value = _read(name, leaves) or self._made(leaves, tree, rest, name)
                    return value
        return self.compiled[key](*leaves)

    def _made(self, leaves: Sequence[Array], tree: Any, rest: Any, name: str) -> tuple[_Compiled, Array]:
        def of_leaves(*leaves: Array) -> Array:
            return self._function(*eqx.combine(jax.tree.unflatten(tree, leaves), rest))

        if name:
            # The name makes the program unique in the cache of JAX: an executable read from there cannot be stored
            # here.
            of_leaves.__name__ = f"jaxmodel_{name}"
        options = QUICK_OPTIONS if jax.default_backend() == "cpu" else None
        made = jax.jit(of_leaves, compiler_options=options).lower(*leaves).compile()
        if name:
            _write(name, made)
        return made, made(*leaves)


def are_of_project(classes: Iterable[type]) -> bool:
    """Return whether all classes are of this project."""
    return all(one.__module__.partition(".")[0] in _PROJECT for one in classes)


def _name_of(key: object) -> str:
    """Return the name of the program for these arguments; "" if it is not stored."""
    folder, described = jax.config.jax_compilation_cache_dir, repr(key)  # type: ignore[attr-defined]
    if not folder or " at 0x" in described:  # the key contains a memory address
        return ""
    return hashlib.sha256(f"{made_from()} {described}".encode()).hexdigest()


@functools.cache
def made_from() -> str:
    """Return a digest of the traced source, the compiler, and the machine."""
    digest = hashlib.sha256()
    here = Path(__file__).resolve().parents[2]
    for path in sorted(path for package in _PROJECT for path in (here / package).rglob("*.py")):
        digest.update(path.read_bytes())
    device = jax.devices()[0]
    described = (
        [importlib.metadata.version(package) for package in _OTHERS],
        [device.platform, device.device_kind, device.client.platform_version],
        [platform.machine(), np.show_config(mode="dicts")["SIMD Extensions"]],  # type: ignore[index, call-overload]
        [jax.config.jax_enable_x64, os.environ.get("XLA_FLAGS")],  # type: ignore[attr-defined]
        QUICK_OPTIONS,
    )
    digest.update(repr(described).encode())
    return digest.hexdigest()


def _read(name: str, arguments: Sequence[Array]) -> tuple[_Compiled, Array] | None:
    """Return a stored program and its value; None if there is none that runs."""
    whole = kept(_file(name)) if name else None
    if whole is None:
        return None
    try:
        stored = pickle.loads(zlib.decompress(whole))
        found = serialize_executable.deserialize_and_load(*stored, execution_devices=jax.devices()[:1])
        return found, jax.block_until_ready(found(*arguments))
    except Exception:  # from another jaxlib, whose errors are of any type: it is compiled again
        return None


def _write(name: str, made: jax.stages.Compiled) -> None:
    """Store a program; if that fails, it is compiled again next time."""
    try:
        whole = zlib.compress(pickle.dumps(serialize_executable.serialize(made)), level=1)  # to a sixth, in 10 ms
    except (ValueError, NotImplementedError):
        return
    keep(_file(name), whole)


def _file(name: str) -> str:
    return f"{name}.program"
