"""The noise of measured inputs, as it reaches the readings: against simulations with that noise drawn at random."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.fitting.lanes import predictions
from jaxmodel.diagnosis.fitting.noise_propagation import propagated_noise
from jaxmodel.diagnosis.noise.contract import noise_of_case
from jaxmodel.diagnosis.noise.input_noise import MovedInputs, at_most, row_of_step, slow_directions
from jaxmodel.model.simulation import run_track, simulate, track
from tests.diagnosis.made_cases import case_of, investigation_of, run_of, small_cell, space_of

CURRENT_SD = 0.02


def test_current_noise_reaches_the_voltage_through_resistance_and_relaxation() -> None:
    """One draw of noise a row, a hundred times: the voltage scatters as said, by more than the resistance alone."""
    rows = 200
    # It creeps, so that it is not held: the noise of a hold's mean is slow, and tested below.
    current = np.where((np.arange(rows) // 25) % 2 == 0, 2.0, 0.5) + 1e-9 * np.arange(rows)
    inputs = {"current_A": current, "ambient_degC": np.full(rows, 20.0)}
    run = run_of(1, inputs, {"voltage_V": np.linspace(4.0, 3.9, rows)}, step_s=10.0)
    case = case_of("cell", {"capacity_Ah": Known(4.0, 0.1)}, [run], {"voltage_V": 1e-3, "current_A": CURRENT_SD})
    space = space_of(case)
    setting = space.setting(())
    found, _ = propagated_noise(case, noise_of_case(case), space, setting, np.zeros(space.layout.size))
    said = found["voltage_V"].from_inputs

    model, profile = case_model(case, run), run_profile(run)
    rng = np.random.default_rng(0)

    def voltage(noise: np.ndarray) -> np.ndarray:
        moved = dataclasses.replace(profile, inputs=profile.inputs | {"current_A": current + noise})
        return np.asarray(simulate(model, moved).readings["voltage_V"])

    still = voltage(np.zeros(rows))
    scatter = np.array([voltage(CURRENT_SD * rng.standard_normal(rows)) - still for _ in range(100)])
    # What the drift of the charge adds is slow, and no noise of a reading: it is taken out as the mean of 16 rows.
    slow = np.apply_along_axis(lambda one: np.convolve(one, np.ones(16) / 16.0, mode="same"), 1, scatter)
    fast = (scatter - slow)[:, 16:-16]
    assert said == pytest.approx(float(np.sqrt(np.mean(fast**2))), rel=0.06)


def test_each_step_belongs_to_the_row_that_it_ends_in() -> None:
    rows = 12
    inputs = {"current_A": np.linspace(0.0, 1.0, rows), "ambient_degC": np.full(rows, 20.0)}
    run = run_of(1, inputs, {"voltage_V": np.full(rows, 4.0)})
    case = case_of("cell", {"capacity_Ah": Known(4.0, 0.1)}, [run])
    run_steps = track(case_model(case, run), run_profile(run))
    several = jax.tree.map(lambda leaf: leaf[None], run_steps)
    np.testing.assert_array_equal(row_of_step(several)[0][np.asarray(run_steps.at_rows)], np.arange(rows))


def test_slow_noise_is_what_random_noise_moves_over_many_rows() -> None:
    """A charge miscounted stays miscounted: the mean and the trend of the voltage scatter by as much as is said."""
    rows = 320
    inputs = {"current_A": np.where((np.arange(rows) // 25) % 2 == 0, 2.0, 0.5), "ambient_degC": np.full(rows, 20.0)}
    run = run_of(1, inputs, {"voltage_V": np.linspace(4.0, 3.9, rows)}, step_s=10.0)
    case = case_of("cell", {"capacity_Ah": Known(4.0, 0.1)}, [run])
    model = case_model(case, run)
    tracks = jax.tree.map(lambda leaf: leaf[None], track(model, run_profile(run)))
    voltages = jax.jit(
        lambda run_steps: run_track(model, run_steps, jnp.asarray(run.measured.time_s)).readings["voltage_V"]
    )

    def predict(moves: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        run_steps = jax.tree.map(lambda leaf: leaf[0], tracks)
        moved = [
            run_steps.inputs | {name: run_steps.inputs[name] + more[0] for name, more in one.items()} for one in moves
        ]
        return np.stack([np.asarray(voltages(dataclasses.replace(run_steps, inputs=one)))[None] for one in moved])

    answers = MovedInputs(predict, tracks, {"current_A": CURRENT_SD}).to_slow_noise()[:, 0]
    rng, row = np.random.default_rng(0), row_of_step(tracks)
    noise = CURRENT_SD * rng.standard_normal((300, rows))
    scatter = (predict([{"current_A": one[row]} for one in noise]) - predict([{}]))[:, 0]
    for slow in (np.ones(rows), np.linspace(-1.0, 1.0, rows)):
        assert np.std(scatter @ slow) == pytest.approx(np.linalg.norm(answers @ slow), rel=0.12)


def test_residuals_are_white_once_slow_noise_is_taken_out() -> None:
    rng = np.random.default_rng(1)
    run = np.repeat([0, 1, 1, 0], 15)
    answers = rng.standard_normal((4, run.size))
    slow = slow_directions(answers, run)
    together = run[:, None] == run[None, :]
    covariance = np.eye(run.size) + together * (answers.T @ answers)
    white = np.eye(run.size) - slow @ slow.T
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(run.size), atol=1e-9)
    # Negligible directions are ignored.
    assert slow_directions(0.01 * answers, run).shape == (run.size, 0)


def test_a_long_pulsed_run_has_not_more_stretches_than_can_be_held_at_once():
    number = np.repeat(np.arange(1000), 3).reshape(1, -1)
    fewer = at_most(256, number)
    assert fewer.max() + 1 <= 256
    assert np.unique(np.diff(fewer[0])).tolist() == [0, 1], "neighbours stay neighbours, and none is left out"
    few = np.repeat(np.arange(256), 3).reshape(1, -1)
    np.testing.assert_array_equal(at_most(256, few), few)


def with_noisy_current(sd: float, seed: int = 1) -> Case:
    """Return the small cell with a current that was read with noise, and creeps, so that it is not held."""
    rng, small = np.random.default_rng(seed), small_cell(creeping=(0.3, 20.0))

    def read(run: Run) -> Run:
        current = run.measured.inputs["current_A"]
        return run.driven_by(run.measured.inputs | {"current_A": current + sd * rng.standard_normal(current.size)})

    noisy = dataclasses.replace(small, sensors={**small.sensors, "current_A": sd})
    return dataclasses.replace(noisy, runs=tuple(read(run) for run in noisy.runs))


def test_sd_is_the_scatter_of_fits_to_other_draws_of_the_noise() -> None:
    current_sd, draws = 0.03, 64
    inv = investigation_of(with_noisy_current(current_sd), "voltage_offset")
    base = inv.base
    noise = base.scale.noise
    assert noise["voltage_V"].from_inputs > 1e-3
    assert not base.scale.error.sd
    readings, problem = base.scale.view.readings, inv.space.problem(base.setting)
    place, row = (readings.run, readings.row, readings.channel), row_of_step(problem.tracks)
    own_sd = np.array([noise[name].own_sd for name in problem.channels if name in noise])
    assert [problem.channels.index(name) for name in noise] == list(range(own_sd.size))
    still = base.setting.lane(base.fitted.x)
    unmoved, rng, away = predictions(problem, [still])[0], np.random.default_rng(1), []
    for _ in range(draws):
        # As if the current had been read with another noise, and the outputs too: what a Newton step makes of it.
        drawn = current_sd * rng.standard_normal((row.shape[0], row.max() + 1))
        lane = dataclasses.replace(still, added={"current_A": np.take_along_axis(drawn, row, 1)})
        moved = (unmoved - predictions(problem, [lane])[0])[place]
        away.append(moved + own_sd[readings.channel] * rng.standard_normal(readings.count))
    fitted = base.fitted
    white = base.scale.weights.whiten(np.array(away).T)
    moved_by = fitted.covariance @ (fitted.jacobian.T @ white)
    scatter = np.sqrt(np.var(moved_by, axis=1) + np.sum(fitted.covariance**2, axis=1))  # the priors are drawn too
    np.testing.assert_allclose(scatter / fitted.sd(), 1.0, atol=0.25)
