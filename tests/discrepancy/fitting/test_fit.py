"""Calibration: the minimum is one, its standard deviations are those of repeated measurements."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.stats import chi2, multivariate_normal

from discrepancy.calibrate import Fit, fit
from discrepancy.diagnose import compare
from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import at, predict, residuals
from discrepancy.problem import Problem
from discrepancy.session import Session
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Known
from jaxmodel.simulate import simulate
from tests.discrepancy.closed_form import ClosedForm, closed_form
from tests.discrepancy.made_cases import case_of, run_of

DRAWS = 40


@pytest.fixture(scope="module")
def base(plain_session: Session) -> Hypothesis:
    return plain_session.hypothesis()


@pytest.fixture(scope="module")
def problem(base: Hypothesis) -> Problem:
    return base.problem


def residual_at(problem: Problem, x: np.ndarray) -> np.ndarray:
    return residuals(problem, [at(problem, x)])[0]


def measured_anew(problem: Problem, x: np.ndarray, generator: np.random.Generator) -> Problem:
    """Replace every reading by the model's own at x, with noise."""
    readings = problem.readings
    clean = predict(problem, x).reshape(-1)[np.asarray(readings.index)]
    noise = np.asarray(readings.sd) * generator.standard_normal(clean.size)
    return eqx.tree_at(lambda p: p.readings.value, problem, jnp.asarray(clean + noise))


def test_information_is_that_of_central_differences(problem: Problem, base: Hypothesis) -> None:
    x, step = base.fitted.x, 1e-4
    counted = np.asarray(problem.readings.fit) > 0.0
    columns = []
    for number in range(x.size):
        away = step * np.eye(x.size)[number]
        columns.append((residual_at(problem, x + away) - residual_at(problem, x - away))[counted] / (2.0 * step))
    jacobian = np.stack(columns, axis=1)
    expected = jacobian.T @ jacobian + np.eye(x.size)
    scale = np.sqrt(np.diag(expected))
    # What the solver kept is the Jacobian of its last step, at the same place within its tolerance.
    outer = np.outer(scale, scale)
    np.testing.assert_allclose(base.fitted.information / outer, expected / outer, atol=1e-3)
    left = residual_at(problem, x)[counted]
    assert base.fitted.chi2 == pytest.approx(np.sum(left**2), rel=1e-9)
    assert base.fitted.prior == pytest.approx(np.sum(x**2))
    assert np.max(np.abs(jacobian.T @ left + x) / scale) < 1e-3
    assert base.fitted.greatest_score < 1e-3


def test_all_starts_end_at_the_same_minimum(problem: Problem, base: Hypothesis) -> None:
    generator = np.random.default_rng(1)
    for _ in range(3):
        again = fit(problem, 1.5 * generator.standard_normal(base.fitted.x.size))
        assert again.objective == pytest.approx(base.fitted.objective, abs=0.01)
        np.testing.assert_allclose(again.x, base.fitted.x, atol=0.02)


def test_estimates_scatter_about_the_truth_as_their_sd_says(problem: Problem) -> None:
    """Truths drawn from the priors: then (x - truth) is normal with the posterior's covariance."""
    generator = np.random.default_rng(2)
    size = len(problem.unknowns.names)
    deviations, wholes = [], []
    for _ in range(DRAWS):
        truth = generator.standard_normal(size)
        found = fit(measured_anew(problem, truth, generator), np.zeros(size))
        assert found.converged
        deviations.append((found.x - truth) / found.sd)
        wholes.append((found.x - truth) @ found.information @ (found.x - truth))
    low, high = chi2.interval(0.9999, DRAWS * size)
    assert low < np.sum(wholes) < high
    low, high = chi2.interval(1.0 - 1e-4 / size, DRAWS)
    scatter = np.sum(np.square(deviations), axis=0)
    assert np.all((low < scatter) & (scatter < high))


def test_what_is_not_free_stays_and_only_its_split_counts(problem: Problem, base: Hypothesis) -> None:
    own = [number for number, run in enumerate(base.layout.runs) if run == 3]
    assert [base.layout.names[number] for number in own] == ["initial_soc"]
    assert base.fitted.x[own] == pytest.approx([0.0], abs=1e-6)  # the fit runs say nothing of it
    found = fit(problem, base.fitted.x, own, "check")
    others = np.delete(np.arange(found.x.size), own)
    np.testing.assert_array_equal(found.x[others], base.fitted.x[others])
    of_check = residual_at(problem, found.x)[np.asarray(problem.readings.check) > 0.0]
    assert found.chi2 == pytest.approx(np.sum(of_check**2))
    assert found.prior == pytest.approx(np.sum(found.x[own] ** 2))
    assert found.sd[own][0] < 0.1


class LinearProblem(ClosedForm):
    """Readings that are linear in the unknowns."""

    matrix: Array

    def readings_at(self, x: Array) -> Array:
        return x @ self.matrix.T


@pytest.fixture(scope="module")
def linear(problem: Problem) -> LinearProblem:
    generator = np.random.default_rng(3)
    counted = problem.readings.fit
    size = len(problem.unknowns.names)
    # Few rows say much and some say little; those that do not count would upset everything if they did.
    scale = np.where(np.cumsum(counted) <= 40, 1.0, 0.01)[:, None] * np.geomspace(0.05, 5.0, size)
    matrix = np.where(counted[:, None] > 0.0, scale * generator.standard_normal((counted.size, size)), 1e3)
    data = matrix @ generator.standard_normal(size) + generator.standard_normal(counted.size)
    return closed_form(LinearProblem, problem, data, counted, matrix=jnp.asarray(matrix))


def test_linear_problem_has_its_known_solution_and_evidence(linear: LinearProblem) -> None:
    counted = np.asarray(linear.readings.fit) > 0.0
    matrix, data = np.asarray(linear.matrix)[counted], np.asarray(linear.readings.value)[counted]
    size = matrix.shape[1]
    found = fit(linear, np.zeros(size))
    information = matrix.T @ matrix + np.eye(size)
    np.testing.assert_allclose(found.information, information, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.x, np.linalg.solve(information, matrix.T @ data), atol=1e-3)
    np.testing.assert_allclose(found.sd, np.sqrt(np.diag(np.linalg.inv(information))))
    marginal = multivariate_normal(np.zeros(data.size), np.eye(data.size) + matrix @ matrix.T)
    constant = 0.5 * data.size * np.log(2.0 * np.pi)
    assert found.log_evidence == pytest.approx(marginal.logpdf(data) + constant, abs=1e-3)


def test_evidence_prefers_the_model_that_made_the_readings() -> None:
    """Averaged over data from the smaller of two nested linear models, its evidence is the larger, by the exact sum."""
    generator = np.random.default_rng(4)
    wide = generator.standard_normal((60, 4))
    gain = []
    for _ in range(50):
        data = wide[:, :2] @ generator.standard_normal(2) + generator.standard_normal(60)
        logs = []
        for matrix in (wide[:, :2], wide):
            information = matrix.T @ matrix + np.eye(matrix.shape[1])
            x = np.linalg.solve(information, matrix.T @ data)
            made = Fit(
                x,
                float(np.sum((data - matrix @ x) ** 2)),
                float(x @ x),
                information,
                np.zeros((1, 2, 2)),
                np.zeros((1, 2)),
                0.0,
                1,
            )
            exact = multivariate_normal(np.zeros(60), np.eye(60) + matrix @ matrix.T).logpdf(data)
            assert made.log_evidence - 30.0 * np.log(2.0 * np.pi) == pytest.approx(exact)
            logs.append(made.log_evidence)
        gain.append(logs[0] - logs[1])
    assert np.mean(gain) > 4.0 * np.std(gain) / np.sqrt(50)


def test_model_out_of_its_range_looks_bad_and_breaks_nothing(problem: Problem, base: Hypothesis) -> None:
    worse = base.fitted.x.copy()
    worse[0] = -1e4  # a capacity that the first second uses up
    assert not np.all(np.isfinite(residual_at(problem, worse)))
    found = fit(problem, worse)
    assert np.isfinite(found.objective)
    assert found.objective > base.fitted.objective


def test_a_motor_stated_to_stall_is_calibrated_from_elsewhere() -> None:
    """At the stated friction no torque starts the motor, and no unknown moves the readings."""
    voltage = np.repeat([0.0, 1.0, 0.6, 1.2, 0.8], 20)
    inputs = {"voltage_V": voltage, "load_torque_Nm": 0.0 * voltage, "ambient_degC": 20.0 + 0.0 * voltage}
    known = {"R_0": Known(1.0, 0.3), "k_tau": Known(0.04, 0.004)}
    run = run_of(1, inputs, {"speed_rad_s": 0.0 * voltage}, step_s=0.1)
    truth = case_of("motor", {"R_0": Known(1.2), "k_tau": Known(0.038), "tau_0": Known(0.01)}, [run])
    speed = np.asarray(simulate(case_model(truth), run_profile(run)).readings["speed_rad_s"])
    speed = speed + 0.05 * np.random.default_rng(2).standard_normal(speed.size)
    run = run_of(1, inputs, {"speed_rad_s": speed}, step_s=0.1)
    case = case_of("motor", known | {"tau_0": Known(0.06, 0.03)}, [run], {"speed_rad_s": 0.05})
    base = Session(case).hypothesis()
    stated = predict(base.problem, np.zeros(base.fitted.x.size))
    assert np.max(np.abs(stated[0, :, base.problem.channels.index("speed_rad_s")])) < 1e-3
    assert base.fitted.converged
    assert base.fitted.chi2 < 1.5 * speed.size
    assert not any("No unknown moves" in remark for remark in compare(case).remarks)
    stalled = dataclasses.replace(case, parameters=known | {"tau_0": Known(1.0)})
    assert any("No unknown moves" in remark for remark in compare(stalled).remarks)
