"""The noise of measured inputs, as it reaches the readings: against simulations with that noise drawn at random."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
import pytest

from discrepancy.contract import noise_of_case
from discrepancy.input_noise import row_of_step
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Known
from jaxmodel.simulate import simulate, track
from tests.discrepancy.made_cases import case_of, run_of

CURRENT_SD = 0.02


def test_current_noise_reaches_the_voltage_through_resistance_and_relaxation() -> None:
    """One draw of noise a row, a hundred times: the voltage scatters as said, by more than the resistance alone."""
    rows = 200
    current = np.where((np.arange(rows) // 25) % 2 == 0, 2.0, 0.5)
    inputs = {"current_A": current, "ambient_degC": np.full(rows, 20.0)}
    run = run_of(1, inputs, {"voltage_V": np.linspace(4.0, 3.9, rows)}, step_s=10.0)
    case = case_of("cell", {"capacity_Ah": Known(4.0, 0.1)}, [run], {"voltage_V": 1e-3, "current_A": CURRENT_SD})
    said = noise_of_case(case)["voltage_V"].from_inputs

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
    course = track(case_model(case, run), run_profile(run))
    several = jax.tree.map(lambda leaf: leaf[None], course)
    np.testing.assert_array_equal(row_of_step(several)[0][np.asarray(course.at_rows)], np.arange(rows))
