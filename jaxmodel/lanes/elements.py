"""Operations on numbers by the names of JAX's primitives: (lowering, values, params, dtype of the result) -> value."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from jaxmodel.lanes.emitter import Value, constant
from jaxmodel.lanes.operands import NotNative
from jaxmodel.lanes.tangents import LINEAR, Tangent


def _arithmetic(of_floats: str, of_integers: str) -> Callable:
    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        return lowering.e.binary(of_floats if dtype.kind == "f" else of_integers, *given)

    return operation


def _comparison(of_floats: str, of_integers: str) -> Callable:
    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        kind = given[0].dtype.kind
        if kind == "f":
            return lowering.e.compare(f"fcmp {of_floats}", *given)
        sign = "" if of_integers in ("eq", "ne") else ("s" if kind == "i" else "u")
        return lowering.e.compare(f"icmp {sign}{of_integers}", *given)

    return operation


def _before(or_equal: bool) -> Callable:
    """Return whether a number is before another where what is not a number comes last."""

    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        e, (x, y) = lowering.e, given
        if or_equal:
            return e.binary("or", e.compare("fcmp ole", x, y), e.compare("fcmp uno", y, y))
        last = e.binary("and", e.compare("fcmp uno", y, y), e.compare("fcmp ord", x, x))
        return e.binary("or", e.compare("fcmp olt", x, y), last)

    return operation


def _extreme(larger: bool) -> Callable:
    """Return the larger or smaller of two numbers; not a number if one is not."""

    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        e, (x, y) = lowering.e, given
        if dtype.kind == "b":
            return e.binary("or" if larger else "and", x, y)
        if dtype.kind in "iu":
            return e.intrinsic(("s" if dtype.kind == "i" else "u") + ("max" if larger else "min"), x, y)
        if y.is_constant:
            x, y = y, x
        if x.is_constant:  # one instruction, which returns the second number where the comparison fails
            return e.select(e.compare("fcmp ogt" if larger else "fcmp olt", x, y), x, y)
        # Half the instructions of `llvm.maximum`, which also puts -0 below 0.
        chosen = e.select(e.compare("fcmp ogt" if larger else "fcmp olt", x, y), x, y)
        return e.select(e.compare("fcmp uno", x, x), x, chosen)

    return operation


def _function(name: str) -> Callable:
    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        return getattr(lowering.functions(dtype), name)(*given)

    return operation


def _intrinsic(name: str) -> Callable:
    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        if dtype.kind != "f":
            raise NotNative(f"{name} of whole numbers")
        return lowering.e.intrinsic(name, *given)

    return operation


def _library(name: str) -> Callable:
    def operation(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
        return lowering.e.by_lane(name, *given)

    return operation


def _neg(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind == "f":
        return lowering.e.unary("fneg", given[0])
    return lowering.e.binary("sub", constant(0, dtype), given[0])


def _abs(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind == "f":
        return lowering.e.intrinsic("fabs", given[0])
    return lowering.e.intrinsic("smax", given[0], _neg(lowering, given, params, dtype))


def _sign(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    e, x = lowering.e, given[0]
    kind = "f" if dtype.kind == "f" else "i"
    up, down = ("fcmp ogt", "fcmp olt") if kind == "f" else ("icmp sgt", "icmp slt")
    zero = constant(0, dtype)
    return e.select(
        e.compare(up, x, zero), constant(1, dtype), e.select(e.compare(down, x, zero), constant(-1, dtype), x)
    )


def _not(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.e.binary("xor", given[0], constant(dtype.kind == "b" or -1, dtype))


def _is_finite(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    x = given[0]
    return lowering.e.compare("fcmp olt", lowering.e.intrinsic("fabs", x), constant(np.inf, x.dtype))


def _select_n(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    which, *cases = given
    if which.dtype.kind == "b":
        chosen = lowering.e.select(which, cases[1], cases[0])
        if all(case in _WITH_EXACT_RECIPROCAL for case in cases):
            no, yes = (_WITH_EXACT_RECIPROCAL[case] for case in cases)
            lowering.e.once((_EXACT, chosen), lambda: lowering.e.select(which, yes, no))
        return chosen
    chosen = cases[-1]
    for number in reversed(range(len(cases) - 1)):
        chosen = lowering.e.select(
            lowering.e.compare("icmp sle", which, constant(number, which.dtype)), cases[number], chosen
        )
    return chosen


def _integer_pow(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    """Return x^n by squaring."""
    times = ELEMENTS["mul"]
    exponent, square, result = abs(params["y"]), given[0], None
    if params["y"] < 0 and lowering.directions:  # the derivative of a quotient, beside others by the same number
        return _integer_pow(lowering, [lowering.e.reciprocal(square)], {"y": exponent}, dtype)
    while exponent:
        if exponent & 1:
            result = square if result is None else times(lowering, [result, square], {}, dtype)
        exponent >>= 1
        if exponent:
            square = times(lowering, [square, square], {}, dtype)
    if result is None:
        return constant(1, dtype)
    return lowering.e.reciprocal(result) if params["y"] < 0 else result


def _one_minus_square(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.e.binary("fsub", constant(1.0, dtype), _square(lowering, given, params, dtype))


def _square(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return ELEMENTS["mul"](lowering, [given[0], given[0]], {}, dtype)


def _pow(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    x, y = given
    if y.dtype.kind != "f":
        y = convert(lowering, [y], {}, dtype)
    return lowering.functions(dtype).power(x, y)


def _rsqrt(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.e.binary("fdiv", constant(1, dtype), lowering.e.intrinsic("sqrt", given[0]))


def _sine(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.functions(dtype).sine_and_cosine(given[0])[0]


def _cosine(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    return lowering.functions(dtype).sine_and_cosine(given[0])[1]


def _round(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    to_even = int(params["rounding_method"]) == 1
    return lowering.e.intrinsic("roundeven" if to_even else "round", given[0])


def _clamp(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    low, x, high = given
    x = ELEMENTS["max"](lowering, [low, x], {}, dtype)
    return ELEMENTS["min"](lowering, [x, high], {}, dtype)


def convert(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    """Return a number in another type."""
    e, x = lowering.e, given[0]
    source, target = x.dtype, np.dtype(dtype)
    if source == target:
        return x
    if x.is_constant and not x.wide and source.kind + target.kind in ("ii", "iu", "ui", "uu"):
        return constant(np.asarray(int(x.text)).astype(target), target)
    pair = source.kind + target.kind
    if target.kind == "b":
        zero = constant(0, source)
        return e.compare("fcmp une" if source.kind == "f" else "icmp ne", x, zero)
    if pair == "ff":
        return e.convert("fpext" if target.itemsize > source.itemsize else "fptrunc", x, target)
    if source.kind == "b":
        return e.select(x, constant(1, target), constant(0, target))
    if source.kind in "iu" and target.kind == "f":
        return e.convert("sitofp" if source.kind == "i" else "uitofp", x, target)
    if source.kind == "f":
        return e.saturated("fptosi" if target.kind == "i" else "fptoui", x, target)
    if target.itemsize == source.itemsize:
        return dataclasses.replace(x, dtype=target)
    if target.itemsize < source.itemsize:
        return e.convert("trunc", x, target)
    return e.convert("sext" if source.kind == "i" else "zext", x, target)


def _div(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind == "f":
        exact = lowering.e.once((_EXACT, given[1]), lambda: None)
        return lowering.e.binary("fdiv", *given) if exact is None else lowering.e.binary("fmul", given[0], exact)
    return _of_whole(lowering, "div", given, constant(-1, dtype), _neg(lowering, given, params, dtype))


def _remainder(lowering: Any, given: list[Value], params: dict, dtype: np.dtype) -> Value:
    if dtype.kind == "f":
        return lowering.e.by_lane("fmod", *given) if lowering.e.has_library else _fmod(lowering.e, *given)
    return _of_whole(lowering, "rem", given, given[0], constant(0, dtype))


def _fmod(e: Any, x: Value, y: Value) -> Value:
    """Return x - y trunc(x / y), exact as long as the quotient is: where it is rounded up, one is taken back."""
    quotient = e.intrinsic("trunc", e.binary("fdiv", x, y))
    size, rest = e.intrinsic("fabs", y), e.intrinsic("fma", e.unary("fneg", quotient), y, x)
    zero = constant(0.0, x.dtype)
    step = e.intrinsic("copysign", size, x)
    wrong = e.compare("fcmp olt", e.binary("fmul", rest, step), zero)
    rest = e.select(wrong, e.binary("fadd", rest, step), rest)
    too_large = e.compare("fcmp oge", e.intrinsic("fabs", rest), size)
    return e.intrinsic("copysign", e.select(too_large, e.binary("fsub", rest, step), rest), x)


# Numbers that the derivatives of a maximum are divided by, and what they are as factors, exactly.
_EXACT = "exact reciprocal"
_WITH_EXACT_RECIPROCAL = {
    constant(number, dtype): constant(1 / number, dtype) for number in (1.0, 2.0) for dtype in (np.float32, np.float64)
}


def _of_whole(lowering: Any, operation: str, given: list[Value], by_zero: Value, by_minus_one: Value) -> Value:
    """Return a quotient or remainder of whole numbers, without the two cases at which a processor ends the process."""
    e, (x, y) = lowering.e, given
    sign = "s" if x.dtype.kind == "i" else "u"
    cases = [(constant(0, x.dtype), by_zero)] + ([(constant(-1, x.dtype), by_minus_one)] if sign == "s" else [])
    held = y
    for case, _ in cases:
        held = e.select(e.compare("icmp eq", y, case), constant(1, x.dtype), held)
    found = e.binary(sign + operation, x, held)
    for case, result in cases:
        found = e.select(e.compare("icmp eq", y, case), result, found)
    return found


_OF_NUMBERS: dict[str, Callable] = {
    "add": _arithmetic("fadd", "add"),
    "add_any": _arithmetic("fadd", "add"),
    "sub": _arithmetic("fsub", "sub"),
    "mul": _arithmetic("fmul", "mul"),
    "div": _div,
    "rem": _remainder,
    "neg": _neg,
    "abs": _abs,
    "sign": _sign,
    "max": _extreme(larger=True),
    "min": _extreme(larger=False),
    "gt": _comparison("ogt", "gt"),
    "ge": _comparison("oge", "ge"),
    "lt": _comparison("olt", "lt"),
    "le": _comparison("ole", "le"),
    "le_to": _before(or_equal=True),
    "lt_to": _before(or_equal=False),
    "eq": _comparison("oeq", "eq"),
    "ne": _comparison("une", "ne"),
    "and": _arithmetic("and", "and"),
    "or": _arithmetic("or", "or"),
    "xor": _arithmetic("xor", "xor"),
    "not": _not,
    "is_finite": _is_finite,
    "select_n": _select_n,
    "clamp": _clamp,
    "convert_element_type": convert,
    "integer_pow": _integer_pow,
    "square": _square,
    "one_minus_square": _one_minus_square,  # from JAX 0.11 on
    "pow": _pow,
    "sqrt": _intrinsic("sqrt"),
    "rsqrt": _rsqrt,
    "floor": _intrinsic("floor"),
    "ceil": _intrinsic("ceil"),
    "round": _round,
    "exp": _function("exp"),
    "expm1": _function("expm1"),
    "log": _function("log"),
    "log1p": _function("log1p"),
    "tanh": _function("tanh"),
    "logistic": _function("logistic"),
    "asinh": _function("asinh"),
    "sin": _sine,
    "cos": _cosine,
    **{
        name: _library(name)
        for name in (
            "tan",
            "asin",
            "acos",
            "atan",
            "atan2",
            "sinh",
            "cosh",
            "acosh",
            "atanh",
            "cbrt",
            "erf",
            "erfc",
            "exp2",
        )
    },
}


def _also_of_tangents(name: str, of_numbers: Callable) -> Callable:
    def operation(lowering: Any, given: list[Any], params: dict, dtype: np.dtype) -> Any:
        if not any(isinstance(x, Tangent) for x in given):
            return of_numbers(lowering, given, params, dtype)
        if name not in LINEAR:
            raise NotNative(f'the operation "{name}" on derivatives')
        return LINEAR[name](lowering.e, given, params)

    return operation


ELEMENTS = {name: _also_of_tangents(name, of_numbers) for name, of_numbers in _OF_NUMBERS.items()}
REDUCE = {
    "reduce_sum": ELEMENTS["add"],
    "reduce_prod": ELEMENTS["mul"],
    "reduce_max": ELEMENTS["max"],
    "reduce_min": ELEMENTS["min"],
    "reduce_and": ELEMENTS["and"],
    "reduce_or": ELEMENTS["or"],
}


def neutral(name: str, dtype: np.dtype) -> Value:
    """Return the number with which a reduction begins."""
    value = {
        "reduce_sum": 0, "reduce_prod": 1, "reduce_max": -np.inf, "reduce_min": np.inf, "reduce_and": True,
        "reduce_or": False,
    }[name]  # fmt: skip
    if dtype.kind in "iu" and not np.isfinite(value):
        value = np.iinfo(dtype).min if value < 0 else np.iinfo(dtype).max
    return constant(value, dtype)


def element(name: str) -> Callable:
    """Return the operation of a primitive on numbers; NotNative if there is none."""
    if name not in ELEMENTS:
        raise NotNative(f'the operation "{name}"')
    return ELEMENTS[name]
