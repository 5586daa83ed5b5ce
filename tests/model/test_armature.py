"""The pair of armature current and speed: against SciPy's matrix exponential and a fine integration of eqs. 11-13."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm

from jaxmodel.model.armature import ArmatureStep, Matrix, Pair, matrix_exponential, solve_pair, solve_speed, stable

R, L, K, J = 0.103, 7.2e-5, 0.0385, 5.42e-5


def scalars(matrix) -> Matrix:
    return Matrix(*(jnp.asarray(x) for x in np.ravel(matrix)))


def pair(values) -> Pair:
    return Pair(*(jnp.asarray(x, dtype=float) for x in values))


def array(matrix: Matrix) -> np.ndarray:
    return np.asarray(matrix).reshape(2, 2)


exponential = jax.jit(matrix_exponential)
solve = jax.jit(solve_pair)
solve_at_current = jax.jit(solve_speed)


def motor_matrix(inductance: float = L, viscous: float = 1e-5) -> np.ndarray:
    return np.array([[-R / inductance, -K / inductance], [K / J, -viscous / J]])


def critical_inductance(viscous: float) -> float:
    """The inductance at which the two time constants of the armature meet: (a - d)^2 = -4 b c."""
    # (R/L - v/J)^2 = 4 K^2 / (L J), a quadratic in 1/L.
    return 1.0 / max(np.roots([R**2, -2.0 * R * viscous / J - 4.0 * K**2 / J, (viscous / J) ** 2]).real)


MATRICES = {
    "overdamped": motor_matrix(1e-5),
    "underdamped": motor_matrix(1e-3),
    "critical": motor_matrix(critical_inductance(1e-5)),
    "nearly critical": motor_matrix(critical_inductance(1e-5) * (1.0 + 1e-9)),
    "without friction": motor_matrix(viscous=0.0),
}
DURATIONS = [0.0, 1e-6, 1e-4, 1.7e-3, 0.02, 1.0, 300.0]


@pytest.mark.parametrize("damping", MATRICES)
@pytest.mark.parametrize("duration", DURATIONS)
def test_matrix_exponential_is_scipys(damping: str, duration: float):
    matrix = MATRICES[damping]
    found = array(exponential(scalars(matrix), jnp.asarray(duration)))
    np.testing.assert_allclose(found, expm(matrix * duration), rtol=1e-9, atol=1e-11 * np.abs(matrix).max() / 1e3)


@given(*[st.floats(-3.0, 3.0)] * 3, st.floats(0.02, 3.0), st.floats(1e-3, 30.0))
def test_matrix_exponential_of_any_stable_matrix(a: float, b: float, c: float, spread: float, duration: float):
    matrix = np.array([[a, b], [c, -a - spread]])
    assume(np.linalg.eigvals(matrix).real.max() < 0.0)
    found = array(exponential(scalars(matrix), jnp.asarray(duration)))
    np.testing.assert_allclose(found, expm(matrix * duration), rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("damping", ["overdamped", "underdamped", "critical"])
def test_derivative_of_the_matrix_exponential(damping: str):
    """Where the two time constants meet, the square root has no derivative; the exponential has."""
    matrix, step = MATRICES[damping], 1e-4

    def at(scale):
        scaled = scalars(matrix)._replace(b=matrix[0, 1] * scale)
        return matrix_exponential(scaled, jnp.asarray(1e-3))

    found = array(jax.jit(jax.jacfwd(at))(jnp.asarray(1.0)))
    weights = {-2.0: 1.0, -1.0: -8.0, 1.0: 8.0, 2.0: -1.0}
    entry = np.array([[0.0, 1.0], [0.0, 0.0]]) * matrix
    expected = sum(w * expm((matrix + k * step * entry) * 1e-3) for k, w in weights.items()) / (12 * step)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)


def advance(
    start, voltage, load, drift=(0.0, 0.0), level=0.01, matrix=None, inductance=L, duration=2e-3
) -> ArmatureStep:
    """One step of a motor at a voltage (V) under a load (N m)."""
    matrix = motor_matrix() if matrix is None else matrix
    rate = matrix @ np.asarray(start) + [voltage / inductance, -load / J]
    scalar_arguments = (jnp.asarray(x, dtype=float) for x in (level, J, duration))
    return solve(pair(start), pair(rate), pair(drift), scalars(matrix), *scalar_arguments)


@pytest.mark.parametrize("damping", MATRICES)
@pytest.mark.parametrize("duration", [1e-5, 1e-3, 0.02, 0.5])
@pytest.mark.parametrize("drift", [(0.0, 0.0), (800.0, -20.0)], ids=["still", "drifting"])
def test_a_sliding_step_is_the_fine_integration(damping: str, duration: float, drift: tuple[float, float]):
    """Values at the end, means and variance of the current, also while the slow states move the equilibrium."""
    matrix, start = MATRICES[damping], np.array([3.0, 150.0])
    inductance = -K / matrix[0, 1]
    constant = np.array([7.0 / inductance, -(0.05 + 0.01) / J])

    def rates(t, x):
        return matrix @ x + constant + np.asarray(drift) * t

    fine = solve_ivp(rates, (0.0, duration), start, "DOP853", rtol=1e-12, atol=1e-10, dense_output=True, max_step=2e-3)
    assert fine.sol is not None
    assert fine.y[1].min() > 0.0  # it slides forward throughout
    edges = list(fine.t[1:-1])

    def integral(function):
        return quad_vec(function, 0.0, duration, epsrel=1e-11, points=edges, limit=4000)[0]

    mean = integral(fine.sol) / duration
    variance = integral(lambda t: (fine.sol(t)[0] - mean[0]) ** 2) / duration

    step = advance(start, 7.0, 0.05, drift, matrix=matrix, inductance=inductance, duration=duration)
    np.testing.assert_allclose([step.current_A, step.speed_rad_s], fine.y[:, -1], rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose([step.mean_current_A, step.mean_speed_rad_s], mean, rtol=1e-7, atol=1e-7)
    if drift == (0.0, 0.0):  # a moving equilibrium adds nothing that heats: it is not in the variance
        assert float(step.current_variance_A2) == pytest.approx(variance, rel=1e-5, abs=1e-9 * mean[0] ** 2)
    assert float(step.coulomb_torque_Nm) == pytest.approx(0.01, rel=1e-12)


@given(st.floats(-100.0, 100.0), st.floats(-600.0, 600.0), st.floats(-24.0, 24.0))
def test_no_time_changes_no_bit_of_the_pair(current: float, speed: float, voltage: float):
    step = advance([current, speed], voltage, 0.1, drift=(300.0, -5.0), duration=0.0)
    assert (float(step.current_A), float(step.speed_rad_s)) == (current, speed)


@given(st.floats(-0.25, 0.25), st.sampled_from([1e-4, 1e-2, 1.0, 300.0]))
def test_standstill_holds_below_breakaway_and_only_there(load: float, duration: float):
    step = advance([0.0, 0.0], 0.0, load, level=0.1, duration=duration)
    if abs(load) < 0.1:
        assert abs(float(step.speed_rad_s)) < 1e-12
        assert float(step.coulomb_torque_Nm) == pytest.approx(-load, abs=1e-9)
    else:
        assert np.sign(float(step.speed_rad_s)) == -np.sign(load) or abs(load) < 0.1 + 1e-9
        assert float(step.coulomb_torque_Nm) == pytest.approx(-np.sign(load) * 0.1)


def test_a_coasting_rotor_comes_to_rest_and_not_beyond():
    """Without a current only friction acts: the speed is a straight line until it is zero."""
    almost_none = 1e-5
    matrix = np.array([[-R / L, -almost_none / L], [almost_none / J, 0.0]])
    for duration, speed in [(0.1, 100.0 - 0.1 * 0.01 / J), (0.5, 100.0 - 0.5 * 0.01 / J), (0.6, 0.0), (60.0, 0.0)]:
        step = advance([0.0, 100.0], 0.0, 0.0, matrix=matrix, duration=duration)
        assert float(step.speed_rad_s) == pytest.approx(speed, abs=1e-3)


@given(st.floats(-20.0, 20.0), st.floats(-0.3, 0.3), st.floats(-400.0, 400.0), st.sampled_from([1e-4, 0.01, 1.0]))
def test_friction_never_exceeds_its_level_and_mirrors_with_the_motion(voltage, load, speed, duration):
    step = advance([1.0, speed], voltage, load, duration=duration)
    mirror = advance([-1.0, -speed], -voltage, -load, duration=duration)
    assert abs(float(step.coulomb_torque_Nm)) <= 0.01
    for one, other in zip(jax.tree.leaves(step), jax.tree.leaves(mirror), strict=True):
        assert abs(float(one)) == abs(float(other))
    assert float(step.current_variance_A2) == float(mirror.current_variance_A2)


@given(
    st.floats(-6.0, 6.0),
    st.floats(-300.0, 300.0),
    st.just(0.0) | st.floats(1e-12, 1e-3),
    st.sampled_from([1e-4, 0.05, 2.0, 300.0]),
)
def test_speed_at_an_imposed_current(current: float, speed: float, viscous: float, duration: float):
    torque, decay = K * current - 0.02, viscous / J
    step = solve_at_current(
        *(jnp.asarray(x) for x in (current, speed, torque / J - decay * speed, -decay, 0.0, J, duration))
    )
    reach = duration if viscous == 0.0 else -np.expm1(-decay * duration) / decay
    exact = speed * np.exp(-decay * duration) + torque / J * reach
    assert float(step.speed_rad_s) == pytest.approx(exact, rel=1e-9, abs=1e-9)
    assert float(step.mean_current_A) == current
    held = solve_at_current(*(jnp.asarray(x) for x in (current, 0.0, torque / J, -decay, 0.3, J, duration)))
    assert abs(float(held.speed_rad_s)) <= 1e-15 * abs(torque / J * reach)
    assert float(held.coulomb_torque_Nm) == pytest.approx(torque, abs=1e-12)


@given(st.floats(-3e5, 1e3), st.floats(-1e3, 1e3), st.floats(-500.0, 5e3), st.floats(1e-5, 300.0))
def test_a_bounded_jacobian_does_not_run_away_within_the_step(a: float, c: float, d: float, duration: float):
    bounded = array(stable(scalars([a, -K / L, c, d]), jnp.asarray(K / J), jnp.asarray(duration)))
    assert np.linalg.eigvals(bounded).real.max() * duration < 1.0
    assert np.isfinite(np.linalg.inv(bounded)).all()


def test_the_jacobian_of_a_plain_motor_is_left_as_it_is():
    for matrix in MATRICES.values():
        found = stable(scalars(matrix), jnp.asarray(K / J), jnp.asarray(1.0))
        np.testing.assert_array_equal(array(found), matrix)
