"""A loop over indices, with values that go from round to round."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxmodel.lanes.emitter import Emitter, Value


class Loop:
    """A loop over indices from 0; carried values are phi nodes.

    Attributes:
        index: the text of the index.
        carried: values at the start of a round; after the loop those at its end.
        next: values at the end of a round, to be set in the body.
    """

    def __init__(self, emitter: Emitter, length: int, begin: Sequence[Value] = ()) -> None:
        self.e, self.length, self.begin = emitter, length, list(begin)
        self.next: list[Value] = []

    def __enter__(self) -> Loop:
        e = self.e
        self._before, self._head, self._done = e.block, e.name("loop"), e.name("done")
        self.index = e.register(np.dtype("i8"), False).text
        self.carried = [e.register(x.dtype, True) for x in self.begin]
        # A loop of no rounds leaves the values at its start.
        count = e.count(self.length)
        if count.startswith("%"):
            some = e.emit(f"icmp sgt i64 {count}, 0", np.dtype(bool), False)
        else:
            some = Value("true" if self.length else "false", np.dtype(bool))
        e.begin_loop()
        e.branch(some, self._head, self._done)
        e.start_block(self._head)
        self._place = len(e.lines)
        e.begin_scope()
        return self

    def __exit__(self, kind: Any, *rest: Any) -> None:
        if kind is not None:
            return
        e = self.e
        e.end_scope()
        e.end_loop()
        count = e.count(self.length)
        following = e.emit(f"add nuw nsw i64 {self.index}, 1", np.dtype("i8"), False)
        ends = e.emit(f"icmp eq i64 {following.text}, {count}", np.dtype(bool), False)
        last = e.block
        e.branch(ends, self._done, self._head)
        lines = [f"  {self.index} = phi i64 [ 0, %{self._before} ], [ {following.text}, %{last} ]"]
        after = []
        results = []
        for register, start, new in zip(self.carried, self.begin, self.next, strict=True):
            kind_text = e.type_of(register.dtype, True)
            lines.append(
                f"  {register.text} = phi {kind_text} [ {start.text}, %{self._before} ], [ {new.text}, %{last} ]"
            )
            result = e.register(register.dtype, True)
            after.append(
                f"  {result.text} = phi {kind_text} [ {start.text}, %{self._before} ], [ {new.text}, %{last} ]"
            )
            results.append(result)
        e.lines[self._place : self._place] = lines
        e.start_block(self._done)
        e.lines += after
        self.carried = results
