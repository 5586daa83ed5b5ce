"""A measured speed that drives the model: its noise is in the readings, and a motor that stands does not brake."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel.case.records import Case
from jaxmodel.fit.noise.contract import noise_of_case
from jaxmodel.fit.noise.of_speed import speed_sd, with_noise_of_speed
from jaxmodel.fit.preparation.held_inputs import at_rest, with_held_inputs
from jaxmodel.model.parameters import Parameters

R, K = float(Parameters().R_0), float(Parameters().k_tau)
TIME_S = np.arange(0.0, 400.0, 1.0)
SPEED = np.where(TIME_S < 100.0, 0.0, 200.0 + 50.0 * np.sin(0.05 * TIME_S))


def case(speed_noise: float, **sensors: float) -> Case:
    random = np.random.default_rng(7)
    frame = pd.DataFrame({"time_s": TIME_S, "voltage_V": np.where(TIME_S < 100.0, 0.0, K * SPEED + 0.4)})
    speed = SPEED + random.normal(0.0, speed_noise, TIME_S.size)
    current = np.where(TIME_S < 100.0, 0.0, 0.4 / R) + random.normal(0.0, 0.02, TIME_S.size)
    frame = frame.assign(speed_rad_s=speed, current_A=current, ambient_degC=20.0)
    return Case.from_dataframes({"a": frame}, kind="motor", load="unknown", sensors={"current_A": 0.02, **sensors})


def test_the_noise_of_the_speed_is_that_of_its_back_emf_in_the_current():
    made = case(0.5, speed_rad_s=0.5)
    found = with_noise_of_speed(made, noise_of_case(made))
    assert found["current_A"].sd == pytest.approx(np.hypot(0.02, K * 0.5 / R), rel=0.1)
    assert "speed_rad_s" in found["current_A"].source


def test_an_exact_speed_adds_nothing():
    made = case(0.0, speed_rad_s=1e-6)
    assert with_noise_of_speed(made, noise_of_case(made))["current_A"].sd == pytest.approx(0.02, rel=1e-3)


def test_a_noise_that_is_not_stated_is_read_off_the_rows():
    assert speed_sd(case(0.5)) == pytest.approx(0.5, rel=0.2)


def test_a_motor_that_stands_has_no_speed_at_all():
    held = with_held_inputs(case(0.5, speed_rad_s=0.5)).runs[0].measured.inputs["speed_rad_s"]
    assert np.all(held[:100] == 0.0)
    assert np.all(held[100:] > 100.0)


def test_a_passage_through_zero_is_no_rest():
    speed = np.array([-9.0, -3.0, 0.1, 3.0, 9.0])
    np.testing.assert_array_equal(at_rest(speed, 0.1), speed)
