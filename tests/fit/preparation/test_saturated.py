"""A saturated sensor is reported; a quantity that is itself limited is not."""

from __future__ import annotations

import numpy as np

from jaxmodel.fit.preparation.saturated import limits, without_saturated
from tests.diagnosis.made_cases import case_of, run_of

ROWS = 1200


def motor(number: int, end: float = np.inf, noise: float = 0.02):
    rng = np.random.default_rng(number)
    current = 3.0 + 2.5 * np.sin(np.arange(ROWS) / 40.0) + noise * rng.standard_normal(ROWS)
    inputs = {"voltage_V": np.full(ROWS, 12.0), "load_torque_Nm": 0.05 * current, "ambient_degC": np.full(ROWS, 20.0)}
    return run_of(number, inputs, {"current_A": np.round(np.minimum(current, end), 3)})


def test_saturated_readings_are_excluded_and_reported() -> None:
    case = case_of("motor", {}, [motor(1, 5.0), motor(2, 5.0)])
    cleaned, (remark,) = without_saturated(case)
    assert remark.startswith("current_A repeats 5 A in ")
    assert (remark.code, remark.subject, remark.numbers["limit"]) == ("sensor_saturated", "current_A", 5.0)
    assert "of run-01, run-02 and never goes beyond" in remark
    for run, before in zip(cleaned.runs, case.runs, strict=True):
        left, given = run.measured.outputs["current_A"], before.measured.outputs["current_A"]
        assert np.isnan(left).sum() >= 0.95 * np.sum(given == 5.0)
        assert np.array_equal(left[given < 5.0], given[given < 5.0])


def test_a_peak_is_no_saturation() -> None:
    assert limits(case_of("motor", {}, [motor(1), motor(2)]), "current_A") == []
    assert without_saturated(case_of("motor", {}, [motor(1)]))[1] == ()


def test_a_sensor_without_noise_is_not_reported() -> None:
    """A drive that limits its current reads so as well."""
    assert limits(case_of("motor", {}, [motor(1, 5.0, 0.0), motor(2, 5.0, 0.0)]), "current_A") == []


def test_standstill_is_no_saturation() -> None:
    rng = np.random.default_rng(2)
    on = np.sin(np.arange(ROWS) / 30.0) > 0.0
    speed = np.where(on, 200.0 + rng.standard_normal(ROWS), 0.0)
    inputs = {
        "voltage_V": np.where(on, 12.0, 0.0),
        "load_torque_Nm": np.zeros(ROWS),
        "ambient_degC": np.full(ROWS, 20.0),
    }
    assert limits(case_of("motor", {}, [run_of(1, inputs, {"speed_rad_s": speed})]), "speed_rad_s") == []
