"""The armature and rotor: stiff, coupled, and solved exactly over a step as a linear pair with dry friction.

The pair dx/dt = f(x), x = (i_a, w), is linear in the base model. Here it is linearised at the start of the step (the
exponential Rosenbrock method; exact where the pair is linear), so that a step may be far shorter or far longer than its
time constants (0.7 ms and 4 ms). Coulomb friction enters as in the time stepping of contact mechanics (Moreau): its
torque over the step is the one within [-level, +level] that lets the rotor slide, or that holds it at standstill. There
is no event to find, standstill is exact, and a reversal inside a step is right to first order in that step.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxmodel.declaration import Scalar
from jaxmodel.flow import mean_exponential

Pair = Float[Array, "2"]
Matrix = Float[Array, "2 2"]


class ArmatureStep(eqx.Module):
    """The pair over one step: values at its end, and means over it."""

    current_A: Scalar
    speed_rad_s: Scalar
    mean_current_A: Scalar
    mean_speed_rad_s: Scalar
    current_variance_A2: Scalar
    coulomb_torque_Nm: Scalar


def matrix_exponential(matrix: Matrix, duration: Scalar) -> Matrix:
    """Return exp(A h) of a stable 2 x 2 matrix: over- and underdamped, and smooth where the two meet."""
    a, b, c, d = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
    mean = 0.5 * (a + d)
    determinant = a * d - b * c
    discriminant = mean * mean - determinant
    scaled = discriminant * duration * duration

    series = jnp.abs(scaled) < 1e-2
    root = jnp.sqrt(jnp.where(series, 1.0, jnp.abs(discriminant)))
    fast = mean - root
    slow = jnp.where(discriminant > 0.0, determinant / jnp.where(fast == 0.0, 1.0, fast), mean)  # no cancellation
    slow_decay, fast_decay, mean_decay = jnp.exp(slow * duration), jnp.exp(fast * duration), jnp.exp(mean * duration)
    angle = jnp.where(discriminant > 0.0, 0.0, root * duration)

    cosh_series = 1.0 + scaled / 2.0 * (1.0 + scaled / 12.0 * (1.0 + scaled / 30.0 * (1.0 + scaled / 56.0)))
    sinh_series = 1.0 + scaled / 6.0 * (1.0 + scaled / 20.0 * (1.0 + scaled / 42.0 * (1.0 + scaled / 72.0)))
    overdamped = discriminant > 0.0
    even = jnp.where(overdamped, 0.5 * (slow_decay + fast_decay), mean_decay * jnp.cos(angle))
    odd = jnp.where(overdamped, 0.5 * (slow_decay - fast_decay), mean_decay * jnp.sin(angle)) / root
    even = jnp.where(series, mean_decay * cosh_series, even)
    odd = jnp.where(series, mean_decay * duration * sinh_series, odd)
    return even * jnp.eye(2) + odd * (matrix - mean * jnp.eye(2))


def _inverse(matrix: Matrix) -> Matrix:
    determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    adjugate = jnp.array([[matrix[1, 1], -matrix[0, 1]], [-matrix[1, 0], matrix[0, 0]]])
    return adjugate / determinant


def _integral_of_outer(matrix: Matrix, start: Pair, end: Pair) -> Matrix:
    """Return the integral of y y' for dy/dt = A y from start to end: A S + S A' = end end' - start start'."""
    drop = jnp.outer(start, start) - jnp.outer(end, end)
    trace = matrix[0, 0] + matrix[1, 1]
    determinant = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
    shifted = matrix - trace * jnp.eye(2)
    return -(determinant * drop + shifted @ drop @ shifted.T) / (2.0 * trace * determinant)


def stable(jacobian: Matrix, torque_slope: Scalar, duration: Scalar) -> Matrix:
    """Bound a Jacobian where an effect would make the pair unstable or singular: deep saturation, falling friction.

    The method stays consistent with an inexact Jacobian; only its order falls, and only there.

    Args:
        jacobian: of the rates by (i_a, w).
        torque_slope: k_tau / J of a motor that does not saturate; against a slope far smaller the inverse is lost.
        duration: of the step, s; a growth that is slow beside it is followed, a faster one is not.
    """
    a, b, c, d = jacobian[0, 0], jacobian[0, 1], jacobian[1, 0], jacobian[1, 1]
    a = jnp.minimum(a, -1e-9)
    b = jnp.minimum(b, -1e-9)
    flat = 1e-3 * torque_slope
    c = jnp.maximum(c, -0.5 * a / (b * jnp.where(duration > 0.0, duration, 1.0)))
    c = jnp.where(jnp.abs(c) < flat, flat, c)
    d = jnp.minimum(d, jnp.minimum(0.5 * b * jnp.maximum(c, flat) / a, -0.5 * a))
    return jnp.array([[a, b], [c, d]])


def _hold_or_slide(free_speed: Scalar, speed_per_torque: Scalar, level: Scalar, past_speed: Scalar) -> Scalar:
    """Return the friction torque that stops the free motion, as far as its level allows."""
    moves = speed_per_torque > 0.0
    stopping = jnp.where(moves, free_speed / jnp.where(moves, speed_per_torque, 1.0), jnp.sign(past_speed) * level)
    return jnp.clip(stopping, -level, level)


def solve_pair(
    start: Pair, rate: Pair, drift: Pair, jacobian: Matrix, level: Scalar, inertia: Scalar, duration: Scalar
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
    """
    inverse = _inverse(jacobian)
    decay = matrix_exponential(jacobian, duration)
    creep = -inverse @ drift  # velocity of the moving equilibrium
    equilibrium = start - inverse @ rate + inverse @ creep
    per_torque = inverse @ jnp.array([0.0, 1.0]) / inertia

    free_end = equilibrium + creep * duration + decay @ (start - equilibrium)
    response = per_torque - decay @ per_torque
    torque = _hold_or_slide(free_end[1], -response[1], level, start[1])

    equilibrium = equilibrium + per_torque * torque
    away_start = start - equilibrium
    away_end = decay @ away_start
    moving = duration > 0.0
    end = jnp.where(moving, equilibrium + creep * duration + away_end, start)
    safe = jnp.where(moving, duration, 1.0)
    away_mean = inverse @ (away_end - away_start) / safe
    mean = equilibrium + 0.5 * creep * duration + away_mean
    variance = _integral_of_outer(jacobian, away_start, away_end)[0, 0] / safe - away_mean[0] ** 2
    return ArmatureStep(
        current_A=end[0],
        speed_rad_s=end[1],
        mean_current_A=mean[0],
        mean_speed_rad_s=mean[1],
        current_variance_A2=variance,
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
