"""Functions that are linear between knots, by the segment in which the lanes of a packet are.

Lanes of a fit are one trajectory, changed a little: they nearly always lie in the same segment of a table, and step
after step in the same one. What a segment needs is put into memory once before the loop over steps; a step asks whether
all lanes are where the last one was, and looks for the segment of each lane only if not.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any, cast

import numpy as np

from jaxmodel.lanes.directions import Directions
from jaxmodel.lanes.emitter import FLAGS, Emitter, Value, constant
from jaxmodel.lanes.memory import Room
from jaxmodel.lanes.operands import Array, Memory, Operand, Series, array_of

# With fewer knots the sum over all segments takes no longer. Assumed.
LEAST_KNOTS = 6
_INDEX = np.dtype(np.int64)


@dataclasses.dataclass(frozen=True)
class Segments:
    """A function in memory.

    Attributes:
        ends: first and last knot.
        count: of segments.
        knots: where they begin, and where the last one ends; `values` there.
        bounds: knots, but those at the ends infinite.
        slopes: of segments.
        last: address of the number of the segment that was used last.
    """

    ends: tuple[Value, Value]
    count: int
    knots: Room
    values: Room
    bounds: Room
    slopes: Room
    last: str

    @property
    def pointers(self) -> str:
        """Return its arrays as arguments of a call."""
        return ", ".join(f"ptr {room.place}" for room in (self.knots, self.values, self.bounds, self.slopes))


class OnSegments(Directions):
    """The part of a lowering that computes functions that are linear between knots."""

    def on_segments(self, x: Operand, knots: Operand, values: Operand) -> Operand | None:
        """Return the value at x, a number or a series of numbers; None where the sum over all segments is no longer."""
        if any(isinstance(one, Series) for one in (knots, values)) or knots.shape != values.shape:
            return None
        if math.prod(knots.shape) < LEAST_KNOTS or any(one.wide for one in _numbers(knots)):
            return None
        if isinstance(x, Series):
            return self.lazy(x.length, x.dtype, lambda index: self._value(x.at(index), self._segments(knots, values)))
        number: Any = x[()] if isinstance(x, np.ndarray) and x.shape == () else None
        if number is None or not number.wide:
            return None
        return array_of(self._value(number, self._segments(knots, values)))

    def _segments(self, knots: Array | Memory, values: Array | Memory) -> Segments:
        """Return the segments, put into memory before the outermost loop that is possible."""
        numbers = (*_numbers(knots), *_numbers(values))

        def written_out() -> Segments:
            return self._written_out(*(self.loaded(x) if isinstance(x, Memory) else x for x in (knots, values)))

        found = self.e.before_loop(numbers, written_out)
        return cast(Segments, found or self.e.once(("segments", numbers), written_out))

    def _written_out(self, knots: Array, values: Array) -> Segments:
        e, count, dtype = self.e, knots.size - 1, knots[0].dtype
        at, level, bounds, slopes = (self.reserve(knots.size, None, dtype) for _ in range(4))
        for number, (knot, value) in enumerate(zip(knots, values, strict=True)):
            self.put(at, str(number), knot)
            self.put(level, str(number), value)
        last = self.numbers_at(self.reserve(1, None, _INDEX), "0")("0")
        e.store(constant(0, _INDEX), last)
        found = Segments((knots[0], knots[count]), count, at, level, bounds, slopes, last)
        e.lines.append(f"  call void @{_filled_in(e, dtype)}({found.pointers}, i64 {count})")
        return found

    def _value(self, x: Value, table: Segments) -> Value:
        e = self.e
        low, high = table.ends
        x = e.select(e.compare("fcmp olt", x, low), low, x)
        x = e.widen(e.select(e.compare("fcmp ogt", x, high), high, x))
        place = e.load(table.last, _INDEX, False).text
        begins, ends = self.taken(table.bounds, place), self.taken(table.bounds, self.sum(place, 1))
        inside = e.binary("and", e.compare("fcmp oge", x, begins), e.compare("fcmp olt", x, ends))
        outside = e.binary("xor", inside, e.widen(constant(True)))
        knot, value, slope = (self.taken(room, place) for room in (table.knots, table.values, table.slopes))
        usual = e.intrinsic("fmuladd", e.binary("fsub", x, knot), slope, value)

        def of_each_lane() -> tuple[Value]:
            call = f"call {e.type_of(x.dtype, True)} @{_of_each_lane(e, x.dtype)}"
            given = f"{e.typed(x)}, {table.pointers}, i64 {table.count}, ptr {table.last}"
            return (e.emit(f"{call}({given})", x.dtype, True),)

        return e.instead(outside, (usual,), of_each_lane)[0]


def _numbers(x: Array | Memory) -> list[Value]:
    """Return what an array is known by: its numbers, or where they are."""
    if isinstance(x, Memory):
        return [Value(x.pointer, _INDEX), constant(x.first, _INDEX)]
    return list(x)


_ARRAYS = "ptr %knots, ptr %values, ptr %bounds, ptr %slopes, i64 %count"


def _filled_in(e: Emitter, dtype: np.dtype) -> str:
    """Return the name of the function that fills in bounds and slopes, written once."""
    name = f"segments_filled_in_{dtype.name}"
    if name in e.declarations:
        return name
    kind, align = e.type_of(dtype, True), dtype.itemsize
    infinity = [e.widen(constant(sign * np.inf, dtype)).text for sign in (-1.0, 1.0)]
    e.declarations[name] = f"""define private void @{name}({_ARRAYS}) noinline nounwind {{
entry:
  br label %round
round:
  %k = phi i64 [ 0, %entry ], [ %next, %round ]
  %next = add i64 %k, 1
{_loads(kind, align, "knots", "k", "k0")}
{_loads(kind, align, "knots", "next", "k1")}
{_loads(kind, align, "values", "k", "v0")}
{_loads(kind, align, "values", "next", "v1")}
  %rise = fsub {kind} %v1, %v0
  %run = fsub {kind} %k1, %k0
  %slope = fdiv {kind} %rise, %run
  %to_slope = getelementptr {kind}, ptr %slopes, i64 %k
  store {kind} %slope, ptr %to_slope, align {align}
  %to_bound = getelementptr {kind}, ptr %bounds, i64 %k
  store {kind} %k0, ptr %to_bound, align {align}
  %ends = icmp eq i64 %next, %count
  br i1 %ends, label %done, label %round
done:
  store {kind} {infinity[0]}, ptr %bounds, align {align}
  %to_last = getelementptr {kind}, ptr %bounds, i64 %count
  store {kind} {infinity[1]}, ptr %to_last, align {align}
  ret void
}}"""
    return name


def _of_each_lane(e: Emitter, dtype: np.dtype) -> str:
    """Return the name of the function that looks for the segment of each lane and keeps the first's, written once."""
    name = f"segments_of_lanes_{dtype.name}"
    if name in e.declarations:
        return name
    kind, align, lanes = e.type_of(dtype, True), dtype.itemsize, range(e.lanes)
    whole, one = e.type_of(_INDEX, True), e.type_of(dtype, False)
    gathered = []
    for array in ("knots", "values", "slopes"):
        before = "poison"
        for lane in lanes:
            gathered += [
                f"  %{array}_at{lane} = getelementptr {one}, ptr %{array}, i64 %n{lane}",
                f"  %{array}{lane} = load {one}, ptr %{array}_at{lane}, align {align}",
                f"  %{array}_to{lane} = insertelement {kind} {before}, {one} %{array}{lane}, i64 {lane}",
            ]
            before = f"%{array}_to{lane}"
    places = [
        f"  %s{lane} = extractelement {whole} %segment, i64 {lane}\n"
        f"  %m{lane} = mul i64 %s{lane}, {e.lanes}\n  %n{lane} = add i64 %m{lane}, {lane}"
        for lane in lanes
    ]
    last = e.lanes - 1
    scalar = {"double": "f64", "float": "f32"}[one]
    fused = f"llvm.fmuladd.v{e.lanes}{scalar}"
    e.declarations[fused] = f"declare {kind} @{fused}({kind}, {kind}, {kind})"
    e.declarations[name] = f"""define private {kind} @{name}({kind} %x, {_ARRAYS}, ptr %last) noinline cold nounwind {{
entry:
  br label %round
round:
  %k = phi i64 [ 1, %entry ], [ %next, %round ]
  %so_far = phi {whole} [ zeroinitializer, %entry ], [ %segment, %round ]
{_loads(kind, align, "bounds", "k", "bound")}
  %passed = fcmp oge {kind} %x, %bound
  %one = zext <{e.lanes} x i1> %passed to {whole}
  %segment = add {whole} %so_far, %one
  %next = add i64 %k, 1
  %ends = icmp sge i64 %next, %count
  br i1 %ends, label %done, label %round
done:
{chr(10).join(places)}
  store i64 %s0, ptr %last, align 8
{chr(10).join(gathered)}
  %from = fsub {FLAGS} {kind} %x, %knots_to{last}
  %found = call {FLAGS} {kind} @{fused}({kind} %from, {kind} %slopes_to{last}, {kind} %values_to{last})
  ret {kind} %found
}}"""
    return name


def _loads(kind: str, align: int, array: str, index: str, name: str) -> str:
    return (
        f"  %{name}_at = getelementptr {kind}, ptr %{array}, i64 %{index}\n"
        f"  %{name} = load {kind}, ptr %{name}_at, align {align}"
    )
