"""The door to kernels: a function of one lane over many, compiled once for all calls that are alike."""

from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable, Hashable, Mapping
from typing import Any, TypeVar, cast

import jax
import numpy as np

from jaxmodel.lanes.module import Written
from jaxmodel.lanes.operands import NotNative

_Kind = TypeVar("_Kind", bound=Written)
_HALVES = {"float64": "float32", "int64": "int32", "uint64": "uint32"}
_compiling = threading.Lock()


def over(
    kind: type[_Kind],
    function: Callable[[Any, Any], Any],
    shared: Any,
    own: Any,
    known_by: Hashable,
    *,
    single: bool = False,
    **options: Any,
) -> _Kind:
    """Return the kernel of a function of one lane. It is compiled once, and a refusal is found once.

    Args:
        kind: `Kernel` or `CudaKernel`.
        function: from what all lanes share and what is a lane's own to its results; pure.
        shared: a pytree of arrays or their shapes.
        own: the same, of one lane.
        known_by: what the function depends on beside these shapes.
        single: compute in float32; the arguments are taken as such.
        options: of the kind.

    Raises:
        NotNative: an operation has no instructions.
    """
    leaves, structure = jax.tree.flatten((shared, own))
    halves = _HALVES if single else {}
    shapes = tuple((np.shape(x), np.dtype(halves.get(np.dtype(x.dtype).name, x.dtype))) for x in leaves)
    key = (kind, known_by, structure, shapes, single, tuple(sorted(options.items())))
    with _compiling:
        found = _kernel(_Asked(key, function, options))
    if isinstance(found, NotNative):
        raise found
    return cast(_Kind, found)


@dataclasses.dataclass(frozen=True)
class _Asked:
    """A function, known by what its kernel depends on."""

    key: tuple[type[Written], Hashable, Any, tuple[Any, ...], bool, tuple[Any, ...]]
    function: Callable[[Any, Any], Any] = dataclasses.field(compare=False)
    options: Mapping[str, Any] = dataclasses.field(compare=False)


@functools.lru_cache(maxsize=64)
def _kernel(asked: _Asked) -> Written | NotNative:
    kind, _, structure, shapes, single, _ = asked.key
    shared, own = jax.tree.unflatten(structure, [jax.ShapeDtypeStruct(*one) for one in shapes])
    try:
        with jax.enable_x64(not single):
            return kind(asked.function, shared, own, **asked.options)
    except NotNative as reason:  # kept, so that it is traced once
        return reason
