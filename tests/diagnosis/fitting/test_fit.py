"""Calibration: fits reach a minimum, and standard deviations are those of repeated measurements."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.diagnosis.fitting.fit import Fit, errors_at, fit, objectives, whitened_errors_and_jacobian
from jaxmodel.diagnosis.fitting.model import ModelSpace, Setting, View
from jaxmodel.diagnosis.fitting.readings import Weights
from jaxmodel.diagnosis.fitting.starts import best_random_start
from jaxmodel.diagnosis.noise.model_error import NONE
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import SMALL_TRUE, case_of, investigation_of, run_of

DRAWS = 30


@pytest.fixture(scope="module")
def base(small_space: ModelSpace) -> Setting:
    return small_space.setting([])


@pytest.fixture(scope="module")
def fitted(small_space: ModelSpace, small_view: View, small_weights: Weights, base: Setting) -> Fit:
    return fit(small_view, base, small_weights, np.zeros(small_space.layout.size))


def measured_anew(view: View, setting: Setting, x: np.ndarray, rng: np.random.Generator) -> View:
    """Return the view of readings that the model itself makes at x, with noise."""
    clean = view.readings.value - errors_at(view, view.space.problem(setting), setting, x[None])[:, 0]
    value = clean + view.readings.sd * rng.standard_normal(clean.size)
    return View(view.space, dataclasses.replace(view.readings, value=value))


def test_a_fit_ends_at_a_minimum(
    small_view: View, small_weights: Weights, base: Setting, fitted: Fit, small_space: ModelSpace
) -> None:
    assert fitted.converged
    rows, jacobian = whitened_errors_and_jacobian(small_view, small_space.problem(base), base, small_weights, fitted.x)
    np.testing.assert_allclose(rows, fitted.rows)
    slope = jacobian.T @ rows + fitted.x[list(base.free)]
    assert np.max(np.abs(slope) * fitted.sd()) < 0.1
    others = fitted.x + 0.3 * np.random.default_rng(0).standard_normal((16, fitted.x.size))
    assert np.all(objectives(small_view, base, small_weights, others) > fitted.objective)
    assert fitted.chi2 == pytest.approx(small_view.readings.count, rel=0.2)


def test_numbers_are_found_within_their_standard_deviations(fitted: Fit, small_space: ModelSpace) -> None:
    for name, true in SMALL_TRUE.items():
        place = small_space.layout.names.index(name)
        coordinate = small_space.layout.coordinates[place]
        sd = coordinate.slope(fitted.x[place]) * fitted.sd()[place]
        assert coordinate.number(fitted.x[place]) == pytest.approx(true, abs=4.0 * sd), name


def test_standard_deviations_are_those_of_repeated_measurements(
    small_view: View, small_weights: Weights, base: Setting
) -> None:
    rng = np.random.default_rng(1)
    own = list(base.free)
    away, objective = [], []
    for _ in range(DRAWS):
        truth = np.zeros(base.prior_sd.size)
        truth[own] = rng.standard_normal(len(own))
        anew = measured_anew(small_view, base, truth, rng)
        found = fit(anew, base, Weights(anew.readings, NONE), truth)
        away.append((found.x[own] - truth[own]) / found.sd())
        objective.append(found.objective)
    spread = np.sum(np.square(away), axis=0)
    low, high = chi2.interval(1.0 - 1e-3 / len(own), DRAWS)
    assert np.all((spread > low) & (spread < high))
    # Of all rows, the priors among them, each is standard normal, and each unknown takes one.
    assert np.sum(objective) == pytest.approx(DRAWS * small_view.readings.count, rel=0.03)


def test_what_is_not_free_stays_and_only_free_numbers_move(
    small_view: View, small_weights: Weights, base: Setting
) -> None:
    start = 0.2 * np.ones(base.prior_sd.size)
    found = fit(small_view, base, small_weights, start, free=[1])
    np.testing.assert_array_equal(np.delete(found.x, 1), np.delete(start, 1))
    assert found.free == (1,)
    assert found.jacobian.shape == (small_view.readings.count, 1)


def test_a_narrow_prior_holds_a_curve_back(small_view: View, small_weights: Weights, small_space: ModelSpace) -> None:
    drops = []
    for amplitude in (0.01, 1.0):
        setting = small_space.setting(["ocv_curve"], {"ocv_curve": amplitude})
        found = fit(small_view, setting, small_weights, np.zeros(small_space.layout.size))
        drops.append(np.max(np.abs(found.x[list(small_space.layout.of["ocv_curve"])])))
        assert found.pulls.size == len(setting.free)
    assert drops[0] < 0.05
    assert drops[0] < drops[1]


class LinearView(View):
    """Readings that are linear in the unknowns, whose errors are white."""

    matrix: np.ndarray

    def at(self, problem, lanes):
        return np.stack([self.matrix @ np.asarray(lane.x) for lane in lanes])


def test_linear_readings_have_their_known_solution_and_evidence(
    small_view: View, small_space: ModelSpace, base: Setting
) -> None:
    rng = np.random.default_rng(3)
    own, readings = list(base.free), small_view.readings
    alone = dataclasses.replace(base, free=tuple(p for p in own if small_space.layout.runs[p] < 0))
    size = len(alone.free)
    matrix = np.zeros((readings.count, small_space.layout.size))
    matrix[:, list(alone.free)] = readings.sd[:, None] * rng.standard_normal((readings.count, size)) * 0.05
    data = matrix @ rng.standard_normal(matrix.shape[1]) + readings.sd * rng.standard_normal(readings.count)
    view = LinearView(small_space, dataclasses.replace(readings, value=data))
    view.matrix = matrix
    found = fit(view, alone, Weights(view.readings, NONE), np.zeros(matrix.shape[1]))
    white, seen = matrix[:, list(alone.free)] / readings.sd[:, None], data / readings.sd
    information = white.T @ white + np.eye(size)
    np.testing.assert_allclose(found.information, information, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.x[list(alone.free)], np.linalg.solve(information, white.T @ seen), atol=1e-2)
    np.testing.assert_allclose(found.sd(), np.sqrt(np.diag(np.linalg.inv(information))), rtol=1e-6)
    marginal = multivariate_normal(np.zeros(seen.size), np.eye(seen.size) + white @ white.T)
    constant = 0.5 * seen.size * np.log(2.0 * np.pi)
    assert found.log_evidence == pytest.approx(marginal.logpdf(seen) + constant, abs=0.02)


def test_an_invalid_model_has_a_large_error_and_raises_nothing(
    small_view: View, small_weights: Weights, base: Setting, fitted: Fit
) -> None:
    largest_increase = fitted.x.copy()
    largest_increase[0] = -1e4  # a capacity that the first second uses up
    found = fit(small_view, base, small_weights, largest_increase)
    assert np.isfinite(found.objective)
    assert found.objective > fitted.objective


def test_a_motor_stated_to_stall_is_calibrated_from_another_start() -> None:
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
    inv = investigation_of(case, "viscous_friction")
    scale, setting = inv.first_scale, inv.space.setting([])
    stalled = inv.space.predicted(setting, np.zeros(inv.space.layout.size))
    assert np.max(np.abs(stalled[run.name]["speed_rad_s"])) < 1e-3
    start = best_random_start(scale.view, setting, scale.weights)
    assert objectives(scale.view, setting, scale.weights, start[None])[0] < 0.1 * np.sum(speed**2) / 0.05**2
    assert inv.base.fitted.converged
    assert inv.base.fitted.chi2 < 1.5 * speed.size
