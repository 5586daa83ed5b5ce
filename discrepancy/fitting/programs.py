"""Programs compiled once for each shape of their arguments, and stored as executables in the folder of JAX's cache.

The cache of JAX saves only compilation: it identifies a program after tracing and lowering, which takes most of a
second each. Here a program is identified by its arguments and by the source code that would be traced.
"""

from __future__ import annotations

import contextlib
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

from jaxmodel.jax_settings import QUICK_OPTIONS

# Packages whose source is traced: those of the project, and others.
_PROJECT = ("jaxmodel", "discrepancy")
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
                    file = _file_of(key) if are_of_project(classes) else None
                    self.compiled[key], value = _read(file, leaves) or self._made(leaves, tree, rest, file)
                    return value
        return self.compiled[key](*leaves)

    def _made(self, leaves: Sequence[Array], tree: Any, rest: Any, file: Path | None) -> tuple[_Compiled, Array]:
        def of_leaves(*leaves: Array) -> Array:
            return self._function(*eqx.combine(jax.tree.unflatten(tree, leaves), rest))

        if file is not None:
            # The name makes the program unique in the cache of JAX: an executable read from there cannot be stored
            # here.
            of_leaves.__name__ = file.stem.replace("-", "_")
        options = QUICK_OPTIONS if jax.default_backend() == "cpu" else None
        made = jax.jit(of_leaves, compiler_options=options).lower(*leaves).compile()
        if file is not None:
            _write(file, made)
        return made, made(*leaves)


def are_of_project(classes: Iterable[type]) -> bool:
    """Return whether all classes are of this project."""
    return all(one.__module__.partition(".")[0] in _PROJECT for one in classes)


def _file_of(key: object) -> Path | None:
    """Return the file of the program for these arguments; None if it is not stored."""
    folder, described = jax.config.jax_compilation_cache_dir, repr(key)  # type: ignore[attr-defined]
    if not folder or " at 0x" in described:  # the key contains a memory address
        return None
    name = hashlib.sha256(f"{made_from()} {described}".encode()).hexdigest()
    return Path(folder) / f"jaxmodel-{name}.program"


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


def _read(path: Path | None, arguments: Sequence[Array]) -> tuple[_Compiled, Array] | None:
    """Return a stored program and its value; None if there is none that runs."""
    if path is None or not path.exists():
        return None
    try:
        stored = pickle.loads(zlib.decompress(path.read_bytes()))
        found = serialize_executable.deserialize_and_load(*stored, execution_devices=jax.devices()[:1])
        return found, jax.block_until_ready(found(*arguments))
    except Exception:  # truncated, or from another jaxlib: it is compiled again
        with contextlib.suppress(OSError):  # read-only folder
            path.unlink()
        return None


def _write(path: Path, made: jax.stages.Compiled) -> None:
    """Store a program atomically; if that fails, it is compiled again next time."""
    try:
        whole = zlib.compress(pickle.dumps(serialize_executable.serialize(made)), level=1)  # to a sixth, in 10 ms
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        part.write_bytes(whole)
        part.replace(path)
    except (OSError, ValueError, NotImplementedError):
        return
