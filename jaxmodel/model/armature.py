"""Armature and rotor: a stiff coupled pair, solved exactly over a step as a linear system with dry friction.

The pair dx/dt = f(x), x = (i_a, w), is linear in the base model. Here it is linearised at the start of the step (the
exponential Rosenbrock method; exact where the pair is linear), so that a step may be far shorter or far longer than its
time constants (0.7 ms and 4 ms). Coulomb friction enters as in the time stepping of contact mechanics (Moreau): its
torque over the step is the one within [-level, +level] that lets the rotor slide, or that holds it at standstill. No
event detection is needed, standstill is exact, and a reversal within a step is accurate to first order in that step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from jaxmodel.model.circle import sine_and_cosine
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.flow import mean_exponential
from jaxmodel.model.root import rising_root

# Size of (m^2 - det) h^2 below which the matrix exponential is a series in it.
_NEAR_CRITICAL = 1e-2


class Pair(NamedTuple):
    """A current (A) and a speed (rad/s), or their rates; scalars, which a compiler keeps in registers."""

    current: Scalar
    speed: Scalar

    def plus(self, other: Pair, times: Scalar | float = 1.0) -> Pair:
        """Return self + times other."""
        return Pair(self.current + times * other.current, self.speed + times * other.speed)

    def times(self, factor: Scalar | float) -> Pair:
        """Return factor self."""
        return Pair(factor * self.current, factor * self.speed)


class Matrix(NamedTuple):
    """A 2 x 2 matrix [[a, b], [c, d]] over pairs."""

    a: Scalar
    b: Scalar
    c: Scalar
    d: Scalar

    def __matmul__(self, pair: Pair) -> Pair:
        """Return the product with a pair."""
        return Pair(self.a * pair.current + self.b * pair.speed, self.c * pair.current + self.d * pair.speed)

    @property
    def trace(self) -> Scalar:
        """Return a + d."""
        return self.a + self.d

    @property
    def determinant(self) -> Scalar:
        """Return a d - b c."""
        return self.a * self.d - self.b * self.c

    def inverse(self) -> Matrix:
        """Return the inverse."""
        determinant = self.determinant
        return Matrix(self.d / determinant, -self.b / determinant, -self.c / determinant, self.a / determinant)

    def times(self, factor: Scalar, plus: Scalar) -> Matrix:
        """Return factor self + plus identity."""
        return Matrix(factor * self.a + plus, factor * self.b, factor * self.c, factor * self.d + plus)


class ArmatureStep(eqx.Module):
    """The pair over one step: values at its end, and means over it."""

    current_A: Scalar
    speed_rad_s: Scalar
    mean_current_A: Scalar
    mean_speed_rad_s: Scalar
    current_variance_A2: Scalar
    coulomb_torque_Nm: Scalar


def matrix_exponential(matrix: Matrix, duration: Scalar) -> Matrix:
    """Return exp(A h) of a stable 2 x 2 matrix: overdamped or underdamped, and smooth between the two."""
    mean = 0.5 * matrix.trace
    determinant = matrix.determinant
    discriminant = mean * mean - determinant
    scaled = discriminant * duration * duration
    # Most motors are far from critical damping: the branch spares them the sine and cosine.
    even, odd = jax.lax.cond(
        scaled >= _NEAR_CRITICAL, _overdamped, _underdamped, mean, determinant, discriminant, scaled, duration
    )
    return matrix.times(odd, plus=even - odd * mean)


def _overdamped(mean, determinant, discriminant, scaled, duration) -> tuple[Scalar, Scalar]:
    """Return e^(m h) cosh(r h) and e^(m h) sinh(r h) / r with r^2 = m^2 - det, without cancellation."""
    # The other branch's lanes come here too where a batch evaluates both.
    root = jnp.sqrt(jnp.where(scaled >= _NEAR_CRITICAL, discriminant, 1.0))
    fast = mean - root
    slow = determinant / jnp.where(fast == 0.0, 1.0, fast)
    slow_decay, fast_decay = jnp.exp(slow * duration), jnp.exp(fast * duration)
    return 0.5 * (slow_decay + fast_decay), 0.5 * (slow_decay - fast_decay) / root


def _underdamped(mean, determinant, discriminant, scaled, duration) -> tuple[Scalar, Scalar]:
    """Return the same near critical damping and below: by series, or by e^(m h) cos(r h) and e^(m h) sin(r h) / r."""
    series = jnp.abs(scaled) < _NEAR_CRITICAL
    root = jnp.sqrt(jnp.where(series | (scaled > 0.0), 1.0, -discriminant))
    decay = jnp.exp(mean * duration)
    sine, cosine = sine_and_cosine(root * duration)
    near = jnp.where(series, scaled, 0.0)
    cosh = 1.0 + near / 2.0 * (1.0 + near / 12.0 * (1.0 + near / 30.0 * (1.0 + near / 56.0)))
    sinh = 1.0 + near / 6.0 * (1.0 + near / 20.0 * (1.0 + near / 42.0 * (1.0 + near / 72.0)))
    return decay * jnp.where(series, cosh, cosine), decay * jnp.where(series, duration * sinh, sine / root)


def _integral_of_square(matrix: Matrix, start: Pair, end: Pair) -> Scalar:
    """Return the integral of i^2 for dy/dt = A y, y = (i, w), from start to end.

    It is the first entry of the matrix S with A S + S A' = end end' - start start', written out.
    """
    currents = start.current**2 - end.current**2
    mixed = start.current * start.speed - end.current * end.speed
    speeds = start.speed**2 - end.speed**2
    crossed = matrix.d * matrix.d * currents - 2.0 * matrix.b * matrix.d * mixed + matrix.b * matrix.b * speeds
    return -(matrix.determinant * currents + crossed) / (2.0 * matrix.trace * matrix.determinant)


def stable(jacobian: Matrix, torque_slope: Scalar, duration: Scalar) -> Matrix:
    """Bound a Jacobian if an effect would make the pair unstable or singular: deep saturation, falling friction.

    The method stays consistent with an inexact Jacobian, at lower order.

    Args:
        jacobian: of the rates by (i_a, w).
        torque_slope: k_tau / J of a motor without saturation; with a far smaller slope the inverse loses precision.
        duration: of the step, s; growth that is slow compared with it is kept, faster growth is not.
    """
    a, b, c, d = jacobian
    a = jnp.minimum(a, -1e-9)
    b = jnp.minimum(b, -1e-9)
    flat = 1e-3 * torque_slope
    c = jnp.maximum(c, -0.5 * a / (b * jnp.where(duration > 0.0, duration, 1.0)))
    c = jnp.where(jnp.abs(c) < flat, flat, c)
    d = jnp.minimum(d, jnp.minimum(0.5 * b * jnp.maximum(c, flat) / a, -0.5 * a))
    return Matrix(a, b, c, d)


def _hold_or_slide(free_speed: Scalar, speed_per_torque: Scalar, level: Scalar, past_speed: Scalar) -> Scalar:
    """Return the friction torque that stops the free motion, as far as its level allows."""
    moves = speed_per_torque > 0.0
    stopping = jnp.where(moves, free_speed / jnp.where(moves, speed_per_torque, 1.0), jnp.sign(past_speed) * level)
    return jnp.clip(stopping, -level, level)


class Bend(NamedTuple):
    """The part of a law of the current that its linearisation leaves out.

    Attributes:
        off_the_line: what di/dt (A/s) at a pair is less than on the line, rising with the current but for the line.
        line: slope of the line, 1/s.
    """

    off_the_line: Callable[[Pair], Scalar]
    line: Scalar


def solve_pair(
    start: Pair,
    rate: Pair,
    drift: Pair,
    jacobian: Matrix,
    level: Scalar,
    inertia: Scalar,
    duration: Scalar,
    bend: Bend | None = None,
) -> ArmatureStep:
    """Advance (i_a, w) over a step with the voltage given, eqs. 11-13.

    Args:
        start: i_a (A) and w (rad/s) at the start.
        rate: their rates there, without Coulomb friction.
        drift: change per second of these rates as the slow states move.
        jacobian: of the rates by the pair.
        level: size of the Coulomb friction in N m, holding and sliding.
        inertia: J in kg m^2.
        duration: s; zero leaves the pair as it is.
        bend: the nonlinear remainder. Like friction it is held over the step at the value that fits the end of the
            step: a step far longer than the time constants ends in the exact equilibrium.
    """
    inverse = jacobian.inverse()
    decay = matrix_exponential(jacobian, duration)
    creep = (inverse @ drift).times(-1.0)  # velocity of the moving equilibrium
    equilibrium = start.plus(inverse @ rate, -1.0).plus(inverse @ creep)
    per_torque = Pair(inverse.b / inertia, inverse.d / inertia)

    free_end = equilibrium.plus(creep, duration).plus(decay @ start.plus(equilibrium, -1.0))
    response = per_torque.plus(decay @ per_torque, -1.0)
    if bend is not None:
        per_rate = Pair(inverse.a, inverse.c)
        slowed = per_rate.plus(decay @ per_rate, -1.0)

        def end_with(less: Scalar) -> Pair:
            end = free_end.plus(slowed, less)
            return end.plus(response, _hold_or_slide(end.speed, -response.speed, level, start.speed))

        less = rising_root(
            lambda less: less - bend.off_the_line(end_with(less)),
            near=jnp.zeros(()),
            least_slope=1.0 - duration * mean_exponential(-jacobian.a * duration) * jnp.maximum(bend.line, 0.0),
        )
        equilibrium, free_end = equilibrium.plus(per_rate, less), free_end.plus(slowed, less)
    torque = _hold_or_slide(free_end.speed, -response.speed, level, start.speed)

    equilibrium = equilibrium.plus(per_torque, torque)
    away_start = start.plus(equilibrium, -1.0)
    away_end = decay @ away_start
    end = equilibrium.plus(creep, duration).plus(away_end)
    moving = duration > 0.0
    safe = jnp.where(moving, duration, 1.0)
    away_mean = (inverse @ away_end.plus(away_start, -1.0)).times(1.0 / safe)
    mean = equilibrium.plus(creep, 0.5 * duration).plus(away_mean)
    return ArmatureStep(
        current_A=jnp.where(moving, end.current, start.current),
        speed_rad_s=jnp.where(moving, end.speed, start.speed),
        mean_current_A=mean.current,
        mean_speed_rad_s=mean.speed,
        current_variance_A2=_integral_of_square(jacobian, away_start, away_end) / safe - away_mean.current**2,
        coulomb_torque_Nm=torque,
    )


def solve_speed(
    current_A: Scalar,
    start: Scalar,
    rate: Scalar,
    slope: Scalar,
    level: Scalar,
    inertia: Scalar,
    duration: Scalar,
) -> ArmatureStep:
    """Advance the speed alone over a step with the current imposed, eq. 13; `slope` is d(rate)/dw, at most zero."""
    reach = duration * mean_exponential(-slope * duration)
    free_end = start + rate * reach
    torque = _hold_or_slide(free_end, reach / inertia, level, start)
    end = free_end - torque / inertia * reach
    return ArmatureStep(
        current_A=current_A,
        speed_rad_s=end,
        mean_current_A=current_A,
        mean_speed_rad_s=0.5 * (start + end),
        current_variance_A2=jnp.zeros(()),
        coulomb_torque_Nm=torque,
    )
