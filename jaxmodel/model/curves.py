"""Curves over state of charge (and temperature): the paper's formulas, or a user's tables."""

from __future__ import annotations

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.lanes.piecewise import piecewise_linear
from jaxmodel.model.declaration import Scalar

# Eqs. 3-6 and 10 turn negative or explode just below this state of charge (C_TS at 0.005, C_TL at 0.011):
# they are held at their value here.
SOC_FORMULA_FLOOR = 0.012

# A table of more values is looked up; a smaller one is summed over its segments, without a gather. In a scan of 16
# lanes the sum takes 0.5 (4 x 11 values) to 0.65 (13 x 30) of the time, of 1,000 lanes 0.9 to 1.4 of it; but with five
# tables of 13 x 30 values the kernel of a diagnosis is too large for XLA.
MOST_SUMMED = 150

LUT_SOC = (0.0, 0.05, 0.15, 0.4, 0.7, 1.0)
LUT_TEMPERATURE_DEGC = (-20.0, 0.0, 20.0, 40.0, 60.0, 80.0, 100.0)


class Curve(eqx.Module):
    """A quantity of one cell as a function of state of charge and temperature."""

    @abc.abstractmethod
    def __call__(self, soc: Scalar, temperature_degC: Scalar) -> Scalar:
        """Return the value at one state of charge and temperature."""

    @abc.abstractmethod
    def inside(self, soc: Scalar, temperature_degC: Scalar) -> Array:
        """Return True where the curve is within its defined range."""


class OpenCircuitVoltage(Curve):
    """V_oc of Chen and Rincon-Mora (2006), the paper's reference [6], in V."""

    def __call__(self, soc: Scalar, temperature_degC: Scalar) -> Scalar:
        """Return -1.031 e^(-35 SOC) + 3.685 + 0.2156 SOC - 0.1178 SOC^2 + 0.3201 SOC^3."""
        return -1.031 * jnp.exp(-35.0 * soc) + 3.685 + soc * (0.2156 + soc * (-0.1178 + soc * 0.3201))

    def inside(self, soc: Scalar, temperature_degC: Scalar) -> Array:
        """Return True for a state of charge between 0 and 1."""
        return (soc >= 0.0) & (soc <= 1.0)


class Exponential(Curve):
    """amplitude e^(-rate SOC) + offset: the form of eqs. 3-6 and 10, held below SOC 0.012."""

    amplitude: float = eqx.field(static=True)
    rate: float = eqx.field(static=True)
    offset: float = eqx.field(static=True)

    def __call__(self, soc: Scalar, temperature_degC: Scalar) -> Scalar:
        """Return the value at one state of charge; it does not depend on temperature."""
        return self.amplitude * jnp.exp(-self.rate * jnp.maximum(soc, SOC_FORMULA_FLOOR)) + self.offset

    def inside(self, soc: Scalar, temperature_degC: Scalar) -> Array:
        """Return True above the state of charge below which the formula is held."""
        return soc >= SOC_FORMULA_FLOOR


class SeriesResistance(Curve):
    """R_ints of eqs. 9 and 10 in ohm: -1.399e-5 T^2 - 2.768e-4 T + R_int0(SOC), T in degC.

    As printed it is negative above about 64 degC at SOC 1; it is computed as printed.
    """

    at_zero_degC: Curve

    def __call__(self, soc: Scalar, temperature_degC: Scalar) -> Scalar:
        """Return the resistance at one state of charge and temperature."""
        quadratic = temperature_degC * (-2.768e-4 - 1.399e-5 * temperature_degC)
        return quadratic + self.at_zero_degC(soc, temperature_degC)

    def inside(self, soc: Scalar, temperature_degC: Scalar) -> Array:
        """Return True where the resistance is positive and its formula not held."""
        return self.at_zero_degC.inside(soc, temperature_degC) & (self(soc, temperature_degC) > 0.0)


class Table(Curve):
    """Linear interpolation over SOC, and over temperature where there is one row per temperature; held at the ends."""

    soc: Float[Array, " soc"]
    values: Float[Array, "temperature soc"]
    temperature_degC: Float[Array, " temperature"]

    def __init__(self, soc, values, temperature_degC=None):
        """Build a table from values over SOC, shape (soc,), or over both, shape (temperature, soc)."""
        self.soc = jnp.asarray(soc, dtype=float)
        self.values = jnp.atleast_2d(jnp.asarray(values, dtype=float))
        self.temperature_degC = jnp.asarray([20.0] if temperature_degC is None else temperature_degC, dtype=float)

    def __call__(self, soc: Scalar, temperature_degC: Scalar) -> Scalar:
        """Return the interpolated value at one state of charge and temperature."""
        if self.values.shape[0] == 1:
            return interpolate(soc, self.soc, self.values[0])
        if self.values.size > MOST_SUMMED:
            return _looked_up(soc, temperature_degC, self)
        # One by one, as a batch of points would be the second axis of their array, which vector instructions lack.
        rows = [interpolate(soc, self.soc, row) for row in self.values]
        covered = _covered(temperature_degC, self.temperature_degC)
        return rows[0] + sum(covered[i] * (rows[i + 1] - rows[i]) for i in range(len(rows) - 1))

    def inside(self, soc: Scalar, temperature_degC: Scalar) -> Array:
        """Return True within the breakpoints (of temperature too, where the table has several rows)."""
        within = (soc >= self.soc[0]) & (soc <= self.soc[-1])
        if self.values.shape[0] > 1:
            within &= (temperature_degC >= self.temperature_degC[0]) & (temperature_degC <= self.temperature_degC[-1])
        return within


def _looked_up(soc: Scalar, temperature_degC: Scalar, table: Table) -> Scalar:
    """Return the value of a large table from the four around it; the same as the sum over all segments."""
    low, share = _segment(soc, table.soc)
    below, part = _segment(temperature_degC, table.temperature_degC)
    values, width = table.values.ravel(), table.values.shape[1]
    first = below * width + low
    cold = values[first] + share * (values[first + 1] - values[first])
    warm = values[first + width] + share * (values[first + width + 1] - values[first + width])
    return cold + part * (warm - cold)


def _segment(x: Scalar, knots: Float[Array, " knots"]) -> tuple[Array, Scalar]:
    """Return the index of the segment of x, and the share of it that lies below x, 0 to 1."""
    held = _held(x, knots)
    low = jnp.sum(held >= knots[1:-1])
    return low, (held - knots[low]) / (knots[low + 1] - knots[low])


def _held(x: Scalar, knots: Float[Array, " knots"]) -> Scalar:
    """Return x within the knots; at an end the slope is that of the inner side."""
    return jnp.where(x < knots[0], knots[0], jnp.where(x > knots[-1], knots[-1], x))


@piecewise_linear
def interpolate(x: Scalar, knots: Float[Array, " knots"], values: Float[Array, " knots"]) -> Scalar:
    """Return the piecewise linear value at x, held at the ends.

    Of a small table a sum over the segments, without a gather.

    Args:
        x: where, in the unit of the knots.
        knots: strictly increasing.
        values: one for each knot.
    """
    if knots.shape[0] == 1:
        return values[0]
    if knots.shape[0] > MOST_SUMMED:
        low, share = _segment(x, knots)
        return values[low] + share * (values[low + 1] - values[low])
    return values[0] + jnp.sum(_covered(x, knots) * jnp.diff(values))


def _covered(x: Scalar, knots: Float[Array, " knots"]) -> Float[Array, " segments"]:
    """Return how much of each segment between knots lies below x, 0 to 1."""
    share = (_held(x, knots) - knots[:-1]) / jnp.diff(knots)
    inner = jnp.concatenate([share[:1], jnp.maximum(share[1:], 0.0)])
    return jnp.concatenate([jnp.minimum(inner[:-1], 1.0), inner[-1:]])


def between_knots(x: Scalar, knots: tuple[float, ...], values: Float[Array, " knots"]) -> Scalar:
    """Return values at fixed knots, linear between them and held at the ends.

    Each weight is the minimum of two lines, clipped to 0 and 1, which is far cheaper in a compiled step than a table
    with variable knots.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import between_knots
        >>> float(between_knots(jnp.array(0.25), (0.0, 0.5, 1.0), jnp.array([3.0, 3.6, 4.2])))
        3.3
    """
    at = np.asarray(knots, dtype=float)
    rise = np.concatenate([[0.0], 1.0 / np.diff(at)])
    fall = np.concatenate([1.0 / np.diff(at), [0.0]])
    up = np.where(rise > 0.0, 1.0 - rise * at, 1.0)
    down = np.where(fall > 0.0, 1.0 + fall * at, 1.0)
    return _between(x, at, values, rise, fall, up, down)


@piecewise_linear
def _between(x, knots, values, rise, fall, up, down):
    return jnp.sum(jnp.clip(jnp.minimum(up + rise * x, down - fall * x), 0.0, 1.0) * values)


class CellCurves(eqx.Module):
    """The curves that make a cell: V_oc (V), R_ints, R_TS, R_TL (ohm), C_TS, C_TL (F), and dU/dT (V/K) if known."""

    ocv: Curve = OpenCircuitVoltage()
    R_ints: Curve = SeriesResistance(at_zero_degC=Exponential(0.1562, 24.37, 0.07446))
    R_TS: Curve = Exponential(0.3208, 29.14, 0.04669)
    C_TS: Curve = Exponential(-752.9, 13.51, 703.6)
    R_TL: Curve = Exponential(6.603, 155.2, 0.04984)
    C_TL: Curve = Exponential(-6056.0, 27.12, 4475.0)
    dU_dT: Curve | None = None


CURVE_NAMES = ("ocv", "R_ints", "R_TS", "C_TS", "R_TL", "C_TL")


def look_up(curve: Curve, soc=LUT_SOC, temperature_degC=LUT_TEMPERATURE_DEGC) -> Table:
    """Return the table of a curve at the paper's `lut` fidelity.

    The paper used 6 SOC breakpoints and 7 temperatures (-20 to 100 in steps of 20) and prints neither the breakpoints
    nor the values; the breakpoints here are assumed, denser where the curves bend.
    """
    over_soc = jax.vmap(curve, in_axes=(0, None))
    over_both = jax.vmap(over_soc, in_axes=(None, 0))
    return Table(soc, over_both(jnp.asarray(soc), jnp.asarray(temperature_degC)), temperature_degC)


def look_up_curves(curves: CellCurves) -> CellCurves:
    """Return the curves at `lut` fidelity: R_ints over SOC and temperature, the RC elements over SOC; V_oc stays."""
    over_soc_alone = (20.0,)
    return CellCurves(
        ocv=curves.ocv,
        R_ints=look_up(curves.R_ints),
        **{name: look_up(getattr(curves, name), temperature_degC=over_soc_alone) for name in CURVE_NAMES[2:]},
    )
