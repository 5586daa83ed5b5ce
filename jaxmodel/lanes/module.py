"""What a kernel is made from: a function of one lane, traced and written as instructions over packets of lanes."""

from __future__ import annotations

import dataclasses
import io
import json
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.cache import keep, kept
from jaxmodel.lanes import machine
from jaxmodel.lanes.directions import Target
from jaxmodel.lanes.emitter import NEAR, Emitter, Value
from jaxmodel.lanes.loop import Loop
from jaxmodel.lanes.lowering import Lowering
from jaxmodel.lanes.operands import MOST_IN_REGISTERS, MOST_SPREAD, Memory, NotNative, Series
from jaxmodel.lanes.tangents import seeds

NAME = "run"
# What a form of an operation that nobody foresaw raises: the function then runs through XLA, and is none the worse.
_UNFORESEEN = (AttributeError, IndexError, KeyError, NotImplementedError, TypeError, ValueError)
_LEAVES = ("shared", "own", "results")


@dataclasses.dataclass(frozen=True)
class Leaf:
    """An argument or result; `moved` where it is derivatives, with an axis of directions in front."""

    shape: tuple[int, ...]
    dtype: np.dtype
    moved: bool = False

    @property
    def size(self) -> int:
        """The number of its elements."""
        return math.prod(self.shape)


@dataclasses.dataclass(frozen=True)
class Module:
    """What a kernel is made from: the text of its instructions, and what the function's arguments and results are."""

    lanes: int
    shared: list[Leaf]
    own: list[Leaf]
    results: list[Leaf]
    consts: list[np.ndarray]
    text: str = ""
    room: list[int] = dataclasses.field(default_factory=list)

    def packed(self) -> bytes:
        """Return it as bytes."""
        leaves = {name: [[list(x.shape), x.dtype.str] for x in getattr(self, name)] for name in _LEAVES}
        head = json.dumps(leaves | {"lanes": self.lanes, "room": self.room, "text": self.text})
        file = io.BytesIO()
        np.savez_compressed(file, *self.consts, head=np.frombuffer(head.encode(), np.uint8))
        return file.getvalue()

    @classmethod
    def unpacked(cls, content: bytes) -> Module:
        """Return what `packed` made."""
        with np.load(io.BytesIO(content)) as arrays:
            head = json.loads(arrays["head"].tobytes())
            consts = [arrays[f"arr_{number}"] for number in range(len(arrays.files) - 1)]
        shared, own, results = ([Leaf(tuple(shape), np.dtype(kind)) for shape, kind in head[n]] for n in _LEAVES)
        return cls(head["lanes"], shared, own, results, consts, head["text"], head["room"])


class Written:
    """A function (shared, own) -> results of one lane, written over packets of lanes; a kind of kernel compiles it.

    Attributes:
        module: its instructions, arguments and results.
        lanes: in a packet.
    """

    # Of a kind of kernel: the lanes of its packets if it has no choice, whether it may call the C library, and the
    # ending of the name under which its instructions are kept.
    LANES: ClassVar[int | None] = None
    HAS_LIBRARY: ClassVar[bool] = True
    ENDING: ClassVar[str] = "kernel"

    def __init__(
        self,
        function: Callable,
        shared: Any,
        own: Any,
        lanes: int | None = None,
        sizes: Sequence[int] = (),
        known_as: str = "",
        by: str = "",
        alike: bool = False,
    ) -> None:
        """Compile a function.

        Args:
            function: of the arguments below, for one lane; pure.
            shared: a pytree of arrays that are the same for all lanes.
            own: a pytree of the arrays of one lane, or their shapes; a dictionary where derivatives are asked for.
            lanes: in a packet, by default two registers of doubles; one with derivatives, whose coefficients then fit
                the fastest cache.
            sizes: lengths of axes in the shapes of the arguments that stand for others, given when the kernel runs
                (`STEPS`, `ROWS`): one kernel for runs of any length.
            known_as: names the function, its source and its arguments: with the same name it is not even traced again.
                Its results are a list then.
            by: names a vector in `own`, by whose numbers the results are differentiated. The kernel then gives a pair:
                the results, and their derivatives, with the vector's axis before the results' own.
            alike: the lanes of a packet differ little, so that they mostly lie in the same segments of tables.

        Raises:
            NotNative: it has an operation that has no vector instructions here.
        """
        self._sizes = tuple(sizes)
        self._workspaces: dict[tuple[int, ...], int] = {}  # by the sizes of a call
        kept_as = f"{machine.digest(known_as)}.{self.ENDING}" if known_as else ""
        module = _kept(kept_as)
        self._tree: Any = None if module is None else jax.tree.structure([0] * len(module.results))
        if module is None:
            module = self._made(function, shared, own, lanes or self.LANES, by, alike)
            if kept_as:
                keep(kept_as, module.packed())
        self.module, self.lanes = module, module.lanes
        try:
            self._compile()
        except RuntimeError as error:  # LLVM refuses the text
            raise NotNative(f"a step of the function ({error})") from error

    def _compile(self) -> None:
        """Compile the module.

        Raises:
            RuntimeError: LLVM refuses it.
        """
        raise NotImplementedError

    def _made(self, function: Callable, shared: Any, own: Any, lanes: int | None, by: str, alike: bool) -> Module:
        given: tuple[Any, ...] = (shared, own, own[by]) if by else (shared, own)
        traced, shapes = jax.make_jaxpr(_pushed(function, by) if by else function, return_shape=True)(*given)
        jaxpr = traced.jaxpr
        first, last = (len(jax.tree.leaves(some)) for some in (shared, given[:2]))
        self._tree = jax.tree.structure(shapes)
        results = _leaves(jaxpr.outvars)
        if by:
            values = len(jax.tree.leaves(shapes[0]))
            results[values:] = [Leaf((*own[by].shape, *x.shape), x.dtype, moved=True) for x in results[values:]]
        module = Module(
            lanes=lanes or _packet(jaxpr, registers=1 if by else 2),
            shared=_leaves(jaxpr.invars[:first]),
            own=_leaves(jaxpr.invars[first:last]),
            results=results,
            consts=[np.asarray(c) for c in traced.consts],
        )
        try:
            return _written(module, jaxpr, self._sizes, self.HAS_LIBRARY, alike)
        except _UNFORESEEN as error:
            raise NotNative(f"a step of the function ({type(error).__name__}: {error})") from error

    def workspace_size(self, sizes: Sequence[int] = ()) -> int:
        """Return how many numbers of working memory a thread needs."""
        key = tuple(sizes)
        if key not in self._workspaces:
            self._workspaces[key] = max(1, sum(self._actual(count, sizes) for count in self.module.room)) * self.lanes
        return self._workspaces[key]

    def buffers(self, count: int, sizes: Sequence[int] = ()) -> list[np.ndarray]:
        """Return arrays for the results of so many lanes, a multiple of a packet."""
        return [
            np.empty((*(self._actual(size, sizes) for size in leaf.shape), count), leaf.dtype)
            for leaf in self.module.results
        ]

    def _actual(self, number: int, sizes: Sequence[int]) -> int:
        """Return the length that a number stands for."""
        for stands, size in zip(self._sizes, sizes, strict=True):
            if abs(number - stands) <= NEAR:
                return number - stands + size
        return number

    def as_given(self, shared: Any) -> list[np.ndarray]:
        """Return the constants and what all lanes share, in order, as the kernel reads them."""
        leaves = zip(jax.tree.leaves(shared), self.module.shared, strict=True)
        return [*self.module.consts, *(np.ascontiguousarray(x, leaf.dtype) for x, leaf in leaves)]

    def own_as_given(self, own: Any) -> list[np.ndarray]:
        """Return the arrays of the lanes, which have the lanes along the last axis, as the kernel reads them."""
        leaves = zip(jax.tree.leaves(own), self.module.own, strict=True)
        return [np.ascontiguousarray(x, leaf.dtype) for x, leaf in leaves]

    def tree(self, results: Sequence[np.ndarray], count: int) -> Any:
        """Return results as the function's, with an axis of lanes first."""
        return self.unflattened([np.moveaxis(x, -1, 0)[:count] for x in results])

    def unflattened(self, results: Sequence[Any]) -> Any:
        """Return results in order as the function's."""
        return jax.tree.unflatten(self._tree, results)


def _pushed(function: Callable, by: str) -> Callable:
    """Return the function with the change of its results along a change of a vector of its lane."""

    def push(shared: Any, own: dict[str, Any], along: jax.Array) -> tuple[Any, Any]:
        results, changes = jax.jvp(lambda vector: function(shared, {**own, by: vector}), (own[by],), (along,))
        # Numbers that are no floats have no derivatives.
        return results, jax.tree.map(
            lambda x, y: y if jnp.issubdtype(x.dtype, jnp.floating) else None, results, changes
        )

    return push


def _written(module: Module, jaxpr: Any, sizes: Sequence[int], has_library: bool, alike: bool) -> Module:
    """Return the module with its text: a loop over packets."""
    moved = jaxpr.invars[len(module.shared) + len(module.own) :]
    directions = [seeds(v.aval.shape[0], v.aval.dtype) for v in moved]
    e = Emitter(module.lanes, {size: f"%size{k}" for k, size in enumerate(sizes)}, has_library)
    for k in range(len(sizes)):
        e.lines.append(f"  %at{k} = getelementptr i64, ptr %sizes, i64 {k}\n  %size{k} = load i64, ptr %at{k}")
    lowering = Lowering(e, "%work", sum(map(len, directions)), alike)
    pointers = [
        e.load(e.address("%arguments", str(k), np.dtype("i8"), False), np.dtype("i8"), False)
        for k in range(len(module.shared) + len(module.consts) + len(module.own) + len(module.results))
    ]
    pointers = iter([_pointer(e, value) for value in pointers])
    consts = [_shared(e, lowering, next(pointers), Leaf(c.shape, c.dtype)) for c in module.consts]
    shared = [_shared(e, lowering, next(pointers), leaf) for leaf in module.shared]
    packet, head, done = "%packet", e.name("packets"), e.name("finished")
    before = e.block
    e.lines.append(f"  %any = icmp slt i64 %first, %last\n  br i1 %any, label %{head}, label %{done}")
    e.start_block(head)
    place = len(e.lines)
    own = [_own(e, next(pointers), leaf) for leaf in module.own]
    results = lowering.run(jaxpr, consts, [*shared, *own, *directions])
    _store(e, lowering, list(zip(results, module.results, pointers, strict=True)))
    e.lines.append(f"  %next = add nsw i64 {packet}, 1\n  %ends = icmp eq i64 %next, %last")
    last = e.block
    e.lines.append(f"  br i1 %ends, label %{done}, label %{head}")
    e.lines.insert(place, f"  {packet} = phi i64 [ %first, %{before} ], [ %next, %{last} ]")
    e.start_block(done)
    body = e.text()
    declared = "\n".join(e.declarations.values())
    text = (
        f"define void @{NAME}(i64 %first, i64 %last, i64 %count, ptr %sizes, ptr %arguments, "
        "ptr noalias %work) "
        f'nounwind "prefer-vector-width"="512" {{\nentry:\n{body}\n  ret void\n}}\n{declared}\n'
    )
    return dataclasses.replace(module, text=text, room=lowering.room)


def _kept(name: str) -> Module | None:
    """Return the module that was kept under a name, if it has one."""
    content = kept(name) if name else None
    return None if content is None else Module.unpacked(content)


def _leaves(variables: Sequence[Any]) -> list[Leaf]:
    return [Leaf(tuple(v.aval.shape), np.dtype(v.aval.dtype)) for v in variables]


def _packet(jaxpr: Any, registers: int) -> int:
    floats = {np.dtype(v.aval.dtype).itemsize for v in jaxpr.invars if np.dtype(v.aval.dtype).kind == "f"}
    return registers * machine.vector_bits() // (8 * max(floats, default=8))


def _pointer(e: Emitter, value: Value) -> str:
    return e.emit(f"inttoptr i64 {value.text} to ptr", np.dtype("i8"), False).text


def _shared(e: Emitter, lowering: Lowering, pointer: str, leaf: Leaf) -> Any:
    memory = Memory(pointer, leaf.shape, leaf.dtype)
    return lowering.loaded(memory) if leaf.size <= MOST_SPREAD else memory


def _own(e: Emitter, pointer: str, leaf: Leaf) -> Any:
    if leaf.size > MOST_IN_REGISTERS:
        if len(leaf.shape) > 1:
            raise NotNative(f"an array of shape {leaf.shape} in each lane")
        return Series(leaf.size, leaf.dtype, lambda index: e.load(_row(e, pointer, index, leaf), leaf.dtype, True))
    result = np.empty(leaf.size, dtype=object)
    for number in range(leaf.size):
        result[number] = e.load(_row(e, pointer, str(number), leaf), leaf.dtype, True)
    return result.reshape(leaf.shape)


def _row(e: Emitter, pointer: str, row: str, leaf: Leaf) -> str:
    """Return the address of this packet's numbers in a row."""
    index = np.dtype("i8")
    start = e.emit(f"mul i64 {row}, %count", index, False).text
    here = e.emit(f"mul i64 %packet, {e.lanes}", index, False).text
    at = e.emit(f"add i64 {start}, {here}", index, False).text
    return e.address(pointer, at, leaf.dtype, False)


def _store(e: Emitter, lowering: Lowering, results: list[tuple[Any, Leaf, str]]) -> None:
    """Store results; those over steps in one loop for each length, so that what they share is computed once."""
    long: dict[int, list[tuple[Any, Leaf, str]]] = {}
    targets = []
    for value, leaf, pointer in results:
        if isinstance(value, np.ndarray):
            for number, element in enumerate(value.ravel()):
                targets += _put(e, element, leaf, pointer, str(number), value.size)
        else:
            long.setdefault(leaf.shape[-1], []).append((lowering.series(value), leaf, pointer))
    lowering.follow(targets)
    for length, group in long.items():
        with Loop(e, length) as loop:
            targets = []
            for series, leaf, pointer in group:
                targets += _put(e, series.at(loop.index), leaf, pointer, loop.index, length)
            lowering.follow(targets)


def _put(e: Emitter, element: Any, leaf: Leaf, pointer: str, index: str, size: int) -> list[Target]:
    """Store an element of a result that has so many; return where it belongs if it is derivatives."""
    if not leaf.moved:
        e.store(e.widen(element), _row(e, pointer, index, leaf))
        return []

    def address(way: str) -> str:
        before = e.emit(f"mul i64 {way}, {e.count(size)}", np.dtype("i8"), False).text
        return _row(e, pointer, e.emit(f"add i64 {before}, {index}", np.dtype("i8"), False).text, leaf)

    return [Target(element, address)]
