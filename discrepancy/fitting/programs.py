"""Programs compiled once: for each shape of their arguments, by one thread, and kept whole where JAX keeps a cache.

JAX's own cache saves compiling alone: it tells programs by what they are once they are traced and lowered, which takes
most of a second each. Here a program is told by its arguments and by the source that would be traced.
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
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax.experimental import serialize_executable
from jaxtyping import Array

# Of a processor's code: bit for bit what XLA makes by itself. This level is compiled in 50 to 60 % of the time, and
# runs as fast; long vectors take 10 to 20 % off both.
_QUICKLY: dict[str, Any] = {"xla_backend_optimization_level": 1, "xla_cpu_prefer_vector_width": "512"}
# What is traced is written in these packages, our own and others.
_OURS = ("jaxmodel", "discrepancy")
_OTHERS = ("jax", "jaxlib", "equinox", "numpy")

_Compiled = Callable[..., Array]


class Programs:
    """A function of pytrees, compiled for each shape of its arguments; what is no array in them is part of the program.

    Many threads may call it: the first to ask for a program compiles it while others wait.
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
            classes: of the arguments; a program with one of the user's is not kept, for its source may change.
        """
        arrays, rest = eqx.partition(arguments, eqx.is_array)
        leaves, tree = jax.tree.flatten(arrays)
        of_rest, rest_tree = jax.tree.flatten(rest)
        key = (tree, rest_tree, tuple(of_rest), tuple(map(jax.typeof, leaves)))
        if key not in self.compiled:
            with self._compiling[key]:
                if key not in self.compiled:
                    kept = _file_of(key) if _all_ours(classes) else None
                    self.compiled[key], value = _read(kept, leaves) or self._made(leaves, tree, rest, kept)
                    return value
        return self.compiled[key](*leaves)

    def _made(self, leaves: Sequence[Array], tree: Any, rest: Any, kept: Path | None) -> tuple[_Compiled, Array]:
        def of_leaves(*leaves: Array) -> Array:
            return self._function(*eqx.combine(jax.tree.unflatten(tree, leaves), rest))

        if kept is not None:
            # By this name JAX's cache takes it for another program than one of like code that it may hold: what is read
            # from that cache cannot be kept whole.
            of_leaves.__name__ = kept.stem.replace("-", "_")
        options = _QUICKLY if jax.default_backend() == "cpu" else None
        made = jax.jit(of_leaves, compiler_options=options).lower(*leaves).compile()
        if kept is not None:
            _write(kept, made)
        return made, made(*leaves)


def _all_ours(classes: Sequence[type]) -> bool:
    return all(one.__module__.partition(".")[0] in _OURS for one in classes)


def _file_of(key: object) -> Path | None:
    """Return where the program of these arguments is kept; None where none is."""
    folder, described = jax.config.jax_compilation_cache_dir, repr(key)  # type: ignore[attr-defined]
    if not folder or " at 0x" in described:  # told by where it stands in this process's memory
        return None
    name = hashlib.sha256(f"{_made_from()} {described}".encode()).hexdigest()
    return Path(folder) / f"jaxmodel-{name}.program"


@functools.cache
def _made_from() -> str:
    """Return a digest of the source that is traced, of what compiles it, and of the machine that it is compiled for."""
    digest = hashlib.sha256()
    here = Path(__file__).resolve().parents[2]
    for path in sorted(path for package in _OURS for path in (here / package).rglob("*.py")):
        digest.update(path.read_bytes())
    device = jax.devices()[0]
    described = (
        [importlib.metadata.version(package) for package in _OTHERS],
        [device.platform, device.device_kind, device.client.platform_version],
        [platform.machine(), np.show_config(mode="dicts")["SIMD Extensions"]],  # type: ignore[index, call-overload]
        [jax.config.jax_enable_x64, os.environ.get("XLA_FLAGS")],  # type: ignore[attr-defined]
        _QUICKLY,
    )
    digest.update(repr(described).encode())
    return digest.hexdigest()


def _read(path: Path | None, arguments: Sequence[Array]) -> tuple[_Compiled, Array] | None:
    """Return a program that was kept, and its value; None where there is none, or none that runs."""
    if path is None or not path.exists():
        return None
    try:
        kept = pickle.loads(zlib.decompress(path.read_bytes()))
        found = serialize_executable.deserialize_and_load(*kept, execution_devices=jax.devices()[:1])
        return found, jax.block_until_ready(found(*arguments))
    except Exception:  # cut short, or of a jaxlib that reads another form: it is made anew
        with contextlib.suppress(OSError):  # of a folder that may only be read
            path.unlink()
        return None


def _write(path: Path, made: jax.stages.Compiled) -> None:
    """Keep a program, whole or not at all; where it cannot be, it is made again the next time."""
    try:
        whole = zlib.compress(pickle.dumps(serialize_executable.serialize(made)), level=1)  # to a sixth, in 10 ms
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        part.write_bytes(whole)
        part.replace(path)
    except (OSError, ValueError, NotImplementedError):
        return
