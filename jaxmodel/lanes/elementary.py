"""Elementary functions in vector arithmetic, to one or two units in the last place.

Each is a reduction of the argument and a polynomial. The coefficients are interpolations at Chebyshev nodes, computed
with 60 digits; their error is below a tenth of the rounding of the result.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np

from jaxmodel.lanes.emitter import Emitter, Value, constant


@dataclasses.dataclass(frozen=True)
class Format:
    """What a floating-point format asks of the functions.

    Attributes:
        mantissa: bits of the fraction.
        bias: of the exponent.
        exp: of (e^r - 1 - r) / r^2, |r| <= ln(2) / 2, lowest power first.
        log: of (log((1 + s) / (1 - s)) / s - 2) / s^2 in s^2, up to a ratio of sqrt(2).
        sine: of (sin(r) / r - 1) / r^2 in r^2, |r| <= pi / 4.
        cosine: of (cos(r) - 1 + r^2 / 2) / r^4 in r^2.
        ln2: in two parts, the first with zeros at the end, so that a product with a whole number is exact.
        quarter: pi / 2 in three such parts.
        fine_quarter: pi / 2 in three parts of all digits, for products that are not rounded.
        largest: argument of the exponential without overflow.
        least: argument of the exponential without underflow.
    """

    mantissa: int
    bias: int
    exp: tuple[float, ...]
    log: tuple[float, ...]
    sine: tuple[float, ...]
    cosine: tuple[float, ...]
    ln2: tuple[float, float]
    quarter: tuple[float, float, float]
    fine_quarter: tuple[float, ...]
    largest: float
    least: float


def _hex(text: str) -> tuple[float, ...]:
    return tuple(map(float.fromhex, text.split()))


DOUBLE = Format(
    mantissa=52,
    bias=1023,
    exp=_hex(
        "0x1.0000000000001p-1 0x1.5555555555556p-3 0x1.5555555553d63p-5 0x1.11111111109b3p-7 0x1.6c16c1788bd90p-10 "
        "0x1.a01a01a7c41d5p-13 0x1.a019b90d2ae7ap-16 0x1.71de0dae63bb3p-19 0x1.289185613a3d6p-22 0x1.af38a9b0ec855p-26"
    ),
    log=_hex(
        "0x1.5555555555558p-1 0x1.99999999952d7p-2 0x1.2492492df281ap-2 0x1.c71c62e3f11e6p-3 0x1.7462b51cb66b1p-3 "
        "0x1.39fe51a7c18f9p-3 0x1.2b5900de53b32p-3"
    ),
    sine=_hex(
        "-0x1.5555555555555p-3 0x1.1111111110bb1p-7 -0x1.a01a019e8357dp-13 0x1.71de37961e4c6p-19 "
        "-0x1.ae600a926c89ap-26 0x1.5e0af186af739p-33"
    ),
    cosine=_hex(
        "0x1.5555555555555p-5 -0x1.6c16c16c16966p-10 0x1.a01a019f4e867p-16 -0x1.27e4fa17a41b4p-22 "
        "0x1.1eeb68b109173p-29 -0x1.907d7aebd5e3dp-37"
    ),
    ln2=(float.fromhex("0x1.62e42feep-1"), float.fromhex("0x1.a39ef35793c76p-33")),
    quarter=(
        float.fromhex("0x1.921fb544p+0"),
        float.fromhex("0x1.0b4611a6p-34"),
        float.fromhex("0x1.3198a2e037073p-69"),
    ),
    fine_quarter=_hex("0x1.921fb54442d18p+0 0x1.1a62633145c07p-54 -0x1.f1976b7ed8fbcp-110"),
    largest=709.78,
    least=-708.39,
)
SINGLE = Format(
    mantissa=23,
    bias=127,
    exp=_hex(
        "0x1.0000000000000p-1 0x1.5554dcf88fd17p-3 0x1.5555192d5f5dep-5 0x1.120b6e42d2112p-7 0x1.6d11093a17fd8p-10"
    ),
    log=_hex("0x1.5555554bb1b2fp-1 0x1.9999eb63e783dp-2 0x1.245c40aecb50cp-2 0x1.ddcf7101b6371p-3"),
    sine=_hex("-0x1.555552a43b210p-3 0x1.110c282749f3ap-7 -0x1.9ac96b052ede0p-13"),
    cosine=_hex("0x1.555554414e3a6p-5 -0x1.6c12d2887c343p-10 0x1.9bd86445fb99bp-16"),
    ln2=(float.fromhex("0x1.62ep-1"), float.fromhex("0x1.0bfbe8p-15")),
    quarter=(1.5703125, 0.0004837512969970703, 7.549789948768648e-08),
    fine_quarter=_hex("0x1.921fb60000000p+0 -0x1.777a5c0000000p-25 -0x1.ee59da0000000p-50"),
    largest=88.72,
    least=-87.33,
)


class Elementary:
    """The functions, written to an emitter for one floating-point type."""

    def __init__(self, emitter: Emitter, dtype: np.dtype) -> None:
        self.e = emitter
        self.dtype = np.dtype(dtype)
        self.format = DOUBLE if self.dtype == np.float64 else SINGLE
        self.bits = np.dtype(np.int64 if self.dtype == np.float64 else np.int32)
        # Added to a small number, this leaves its nearest whole number in the last bits.
        self._shift = self.k(1.5 * 2.0**self.format.mantissa)

    def k(self, value: float) -> Value:
        """Return a constant of the type."""
        return constant(value, self.dtype)

    def whole(self, value: int) -> Value:
        """Return a constant of the integer type of the same size."""
        return constant(value, self.bits)

    def add(self, x: Value, y: Value) -> Value:
        """Return x + y."""
        return self.e.binary("fadd", x, y)

    def sub(self, x: Value, y: Value) -> Value:
        """Return x - y."""
        return self.e.binary("fsub", x, y)

    def mul(self, x: Value, y: Value) -> Value:
        """Return x y."""
        return self.e.binary("fmul", x, y)

    def div(self, x: Value, y: Value) -> Value:
        """Return x / y."""
        return self.e.binary("fdiv", x, y)

    def fma(self, x: Value, y: Value, z: Value) -> Value:
        """Return x y + z, in one rounding where the processor can."""
        return self.e.intrinsic("fmuladd", x, y, z)

    def neg(self, x: Value) -> Value:
        """Return -x."""
        return self.e.unary("fneg", x)

    def abs(self, x: Value) -> Value:
        """Return |x|."""
        return self.e.intrinsic("fabs", x)

    def less(self, x: Value, y: Value) -> Value:
        """Return x < y."""
        return self.e.compare("fcmp olt", x, y)

    def polynomial(self, x: Value, coefficients: Sequence[float]) -> Value:
        """Return the sum of coefficients times powers of x, lowest first."""
        value = self.k(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            value = self.fma(value, x, self.k(coefficient))
        return value

    def _as_bits(self, x: Value) -> Value:
        return self.e.convert("bitcast", x, self.bits)

    def _as_float(self, x: Value) -> Value:
        return self.e.convert("bitcast", x, self.dtype)

    def _nearest(self, x: Value) -> tuple[Value, Value]:
        """Return the nearest whole number of a small number: as a number, and in the last bits of an integer."""
        shifted = self.add(x, self._shift)
        return self.sub(shifted, self._shift), self._as_bits(shifted)

    def _exp_parts(self, x: Value) -> tuple[Value, Value, Value]:
        """Return q and n with e^x = 2^n (1 + q), n as bits of an exponent, and the number n."""
        number, bits = self._nearest(self.mul(x, self.k(1.4426950408889634)))
        rest = self.fma(number, self.k(-self.format.ln2[0]), x)
        rest = self.fma(number, self.k(-self.format.ln2[1]), rest)
        grown = self.fma(self.mul(rest, rest), self.polynomial(rest, self.format.exp), rest)
        exponent = self.e.binary("shl", bits, self.whole(self.format.mantissa))
        return grown, exponent, number

    def exp(self, x: Value) -> Value:
        """Return e^x; it is never below the smallest normal number."""
        held = self.e.select(self.e.compare("fcmp ogt", self.k(self.format.least), x), self.k(self.format.least), x)
        grown, exponent, _ = self._exp_parts(held)
        one_more = self.add(grown, self.k(1.0))
        value = self._as_float(self.e.binary("add", self._as_bits(one_more), exponent))
        return self.e.select(self.e.compare("fcmp ogt", x, self.k(self.format.largest)), self.k(np.inf), value)

    def expm1(self, x: Value) -> Value:
        """Return e^x - 1, accurate near zero."""
        deep = self.k(-60.0 if self.dtype == np.float64 else -30.0)
        held = self.e.select(self.less(x, deep), deep, x)
        grown, exponent, _ = self._exp_parts(held)
        half = self._as_float(self.e.binary("add", self._as_bits(self.k_wide(0.5, held)), exponent))
        value = self.fma(half, grown, self.sub(half, self.k(0.5)))
        value = self.add(value, value)
        return self.e.select(
            self.e.compare("fcmp ole", x, self.k(self.format.largest)), value, self.mul(x, self.k(np.inf))
        )

    def k_wide(self, value: float, like: Value) -> Value:
        """Return a constant in as many lanes as another number has."""
        return self.e.widen(self.k(value)) if like.wide else self.k(value)

    def _log_parts(self, x: Value) -> tuple[Value, Value]:
        """Return n and m with x = 2^n m, m from sqrt(1/2) to sqrt(2), for x > 0 and finite."""
        digits = self.format.mantissa
        tiny = self.less(x, self.k(float(np.finfo(self.dtype).tiny)))
        x = self.e.select(tiny, self.mul(x, self.k(2.0 ** (digits + 2))), x)
        bits = self._as_bits(x)
        root = int(np.asarray(np.sqrt(0.5), self.dtype).view(self.bits))
        # With a bias, so that a shift which fills with zeros does.
        biased = self.e.binary("add", bits, self.whole((self.format.bias << digits) - root))
        power = self.e.binary("lshr", biased, self.whole(digits))
        # In the last bits of a large number, it becomes one without a conversion of integers, which AVX2 has not.
        number = self._as_float(self.e.binary("add", power, self._as_bits(self._shift)))
        number = self.sub(number, self.k(1.5 * 2.0**digits + self.format.bias))
        number = self.sub(number, self.e.select(tiny, self.k(digits + 2.0), self.k(0.0)))
        unbiased = self.e.binary("sub", power, self.whole(self.format.bias))
        part = self._as_float(self.e.binary("sub", bits, self.e.binary("shl", unbiased, self.whole(digits))))
        return number, part

    def _log_ends(self, x: Value, value: Value) -> Value:
        """Return a logarithm, with those of zero, infinity, negative numbers and what is not a number."""
        value = self.e.select(self.less(x, self.k(np.inf)), value, x)
        value = self.e.select(self.e.compare("fcmp olt", x, self.k(0.0)), self.k(np.nan), value)
        return self.e.select(self.e.compare("fcmp oeq", x, self.k(0.0)), self.k(-np.inf), value)

    def log(self, x: Value) -> Value:
        """Return the natural logarithm."""
        number, part = self._log_parts(x)
        f = self.sub(part, self.k(1.0))
        s = self.div(f, self.add(f, self.k(2.0)))
        z = self.mul(s, s)
        rest = self.mul(z, self.polynomial(z, self.format.log))
        square = self.mul(self.mul(f, f), self.k(0.5))
        low = self.fma(s, self.add(square, rest), self.mul(number, self.k(self.format.ln2[1])))
        value = self.fma(number, self.k(self.format.ln2[0]), self.sub(f, self.sub(square, low)))
        return self._log_ends(x, value)

    def log1p(self, x: Value) -> Value:
        """Return log(1 + x), accurate near zero."""
        u = self.add(self.k(1.0), x)
        lost = self.div(self.sub(x, self.sub(u, self.k(1.0))), u)
        value = self.add(self.log(u), lost)
        # Also where u is 0 or infinite, and the loss therefore not a number.
        inside = self.e.binary("and", self.e.compare("fcmp ogt", u, self.k(0.0)), self.less(u, self.k(np.inf)))
        return self.e.select(inside, value, self.log(u))

    def tanh(self, x: Value) -> Value:
        """Return the hyperbolic tangent."""
        size, most = self.abs(x), self.k(22.0)
        size = self.e.select(self.e.compare("fcmp ogt", size, most), most, size)
        grown = self.expm1(self.add(size, size))
        return self.e.intrinsic("copysign", self.div(grown, self.add(grown, self.k(2.0))), x)

    def logistic(self, x: Value) -> Value:
        """Return 1 / (1 + e^-x)."""
        return self.div(self.k(1.0), self.add(self.k(1.0), self.exp(self.neg(x))))

    def asinh(self, x: Value) -> Value:
        """Return the inverse hyperbolic sine."""
        size = self.abs(x)
        large = self.e.compare("fcmp ogt", size, self.k(1e9))
        held = self.e.select(large, self.k(1.0), size)
        square = self.mul(held, held)
        root = self.e.intrinsic("sqrt", self.add(square, self.k(1.0)))
        near = self.log1p(self.add(held, self.div(square, self.add(root, self.k(1.0)))))
        far = self.add(self.log(size), self.k(0.6931471805599453))
        return self.e.intrinsic("copysign", self.e.select(large, far, near), x)

    def sine_and_cosine(self, x: Value) -> tuple[Value, Value]:
        """Return sin and cos; where a lane has an angle beyond 1e6 rad, those of the C library if there is one."""
        near = self._of_angle(x, self.format.quarter, self.fma)
        far = self.e.compare("fcmp ogt", self.abs(x), self.k(1e6))
        sine, cosine = self.e.rarely(far, near, lambda: self._of_large_angle(x))
        return sine, cosine

    def _of_large_angle(self, x: Value) -> tuple[Value, Value]:
        if self.e.has_library:
            return self.e.by_lane("sin", x), self.e.by_lane("cos", x)
        # So large that it has few digits within a turn.
        held = self.e.select(self.less(self.abs(x), self.k(2.0 ** (self.format.mantissa - 2))), x, self.k(np.nan))
        return self._of_angle(held, self.format.fine_quarter, functools.partial(self.e.intrinsic, "fma"))

    def _of_angle(
        self, x: Value, quarter: tuple[float, ...], fused: Callable[[Value, Value, Value], Value]
    ) -> tuple[Value, Value]:
        """Return sin and cos of an angle, from which quarters of a turn are subtracted in parts."""
        number, bits = self._nearest(self.mul(x, self.k(0.6366197723675814)))
        rest = x
        for part in quarter:
            rest = fused(number, self.k(-part), rest)
        square = self.mul(rest, rest)
        sine = self.fma(self.mul(rest, square), self.polynomial(square, self.format.sine), rest)
        cosine = self.fma(
            self.mul(square, square),
            self.polynomial(square, self.format.cosine),
            self.fma(square, self.k(-0.5), self.k(1.0)),
        )
        swapped = self._bit(bits, 1)
        first, second = self.e.select(swapped, cosine, sine), self.e.select(swapped, sine, cosine)
        down = self._bit(bits, 2)
        left = self._bit(self.e.binary("add", bits, self.whole(1)), 2)
        return self.e.select(down, self.neg(first), first), self.e.select(left, self.neg(second), second)

    def _bit(self, bits: Value, mask: int) -> Value:
        return self.e.compare("icmp ne", self.e.binary("and", bits, self.whole(mask)), self.whole(0))

    def power(self, x: Value, y: Value) -> Value:
        """Return x^y, from a logarithm in two parts; as in C at zero, infinity and negative x."""
        e, k = self.e, self.k
        x, y = e.alike(x, y)
        size = self.abs(x)
        number, part = self._log_parts(size)
        f, bottom = self.sub(part, k(1.0)), self.add(part, k(1.0))
        s = self.div(f, bottom)
        # What the quotient leaves over: also of the sum below it, which is rounded where the part is above 1.
        missed = self.sub(part, self.sub(bottom, k(1.0)))
        s_low = self.div(self._remainder(s, bottom, f, missed), bottom)
        z = self.mul(s, s)
        tail = self.fma(self.mul(s, z), self.polynomial(z, self.format.log), self.add(s_low, s_low))
        whole = self.mul(number, k(self.format.ln2[0]))
        double = self.add(s, s)
        high = self.add(whole, double)
        lost = self.add(self.sub(whole, self.sub(high, self.sub(high, whole))), self.sub(double, self.sub(high, whole)))
        low = self.add(self.add(tail, self.mul(number, k(self.format.ln2[1]))), lost)
        high, low = self.add(high, low), self.add(self.sub(high, self.add(high, low)), low)
        product = self.mul(y, high)
        rest = self.add(self._product_error(y, high, product), self.mul(y, low))
        value = self.exp(product)
        fine = e.binary("and", self.less(self.abs(rest), k(1.0)), self.less(value, k(np.inf)))
        value = e.select(fine, self.fma(value, rest, value), value)
        value = e.select(self.less(size, k(np.inf)), value, e.select(self.less(y, k(0.0)), k(0.0), k(np.inf)))
        zero = e.select(self.less(y, k(0.0)), k(np.inf), k(0.0))
        value = e.select(e.compare("fcmp oeq", size, k(0.0)), zero, value)
        is_whole = e.compare("fcmp oeq", e.intrinsic("floor", y), y)
        half = self.mul(y, k(0.5))
        odd = e.binary("and", is_whole, e.compare("fcmp one", e.intrinsic("floor", half), half))
        undefined = e.binary("and", self.less(x, k(0.0)), e.compare("fcmp one", x, k(-np.inf)))
        undefined = e.select(is_whole, constant(False), undefined)
        value = e.select(odd, e.intrinsic("copysign", value, x), value)
        value = e.select(undefined, k(np.nan), value)
        broken = e.binary("or", e.compare("fcmp uno", x, x), e.compare("fcmp uno", y, y))
        value = e.select(broken, k(np.nan), value)
        endless = e.binary("and", e.compare("fcmp oeq", size, k(1.0)), e.compare("fcmp oeq", self.abs(y), k(np.inf)))
        one = e.binary("or", e.compare("fcmp oeq", y, k(0.0)), e.compare("fcmp oeq", x, k(1.0)))
        one = e.binary("or", one, endless)
        return e.select(one, k(1.0), value)

    def _remainder(self, s: Value, bottom: Value, f: Value, missed: Value) -> Value:
        """Return f - s (bottom + missed) without the rounding of the product."""
        exact = self.e.intrinsic("fma", self.neg(s), bottom, f)
        return self.sub(exact, self.mul(s, missed))

    def _product_error(self, x: Value, y: Value, product: Value) -> Value:
        """Return x y - product."""
        return self.e.intrinsic("fma", x, y, self.neg(product))
