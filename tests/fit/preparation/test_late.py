"""A voltage that is late in one run is moved to its current; what is late in all runs, or slow, is not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmodel.fit.preparation import prepared
from jaxmodel.fit.preparation.late import delay, without_delays
from tests.diagnosis.made_cases import case_of, run_of

ROWS, VOLTAGE = 900, "voltage_V"


def pulses(number: int, late_s: float = 0.0, step_s: float = 1.0, tau_s: float = 40.0, noise: float = 1e-3):
    """A cell of a resistance and an RC pair under steps of some 30 rows, its voltage read late between rows."""
    rng = np.random.default_rng(number)
    current = np.repeat(rng.choice([0.0, 1.0, 2.0, 4.0], ROWS // 30), 30)
    slow = lfilter([step_s / tau_s], [1.0, step_s / tau_s - 1.0], 0.02 * current)
    clean = 3.7 - 0.03 * current - slow
    time_s = step_s * np.arange(ROWS)
    read = np.interp(time_s - late_s, time_s, clean) + noise * rng.standard_normal(ROWS)
    inputs = {"current_A": current, "ambient_degC": np.full(ROWS, 25.0)}
    return run_of(number, inputs, {VOLTAGE: read}, step_s=step_s)


@pytest.mark.parametrize(("late_s", "step_s"), [(5.0, 1.0), (-3.0, 1.0), (20.0, 10.0), (7.5, 1.0)])
def test_a_run_that_is_late_alone_is_moved_and_named(late_s: float, step_s: float) -> None:
    on_time = [pulses(1, 0.0, step_s), pulses(3, 0.0, step_s)]
    moved, (remark,) = without_delays(case_of("cell", {}, [on_time[0], pulses(2, late_s, step_s), on_time[1]]))
    assert (remark.code, remark.subject) == ("voltage_late", "voltage_V@run-02")
    assert remark.numbers["value"] == pytest.approx(late_s, abs=0.25 * step_s)
    right, there = pulses(2, 0.0, step_s, noise=0.0).measured.outputs[VOLTAGE], moved.runs[1].measured.outputs[VOLTAGE]
    read = np.isfinite(there)
    assert np.sum(~read) <= abs(late_s) / step_s + 1
    assert np.sqrt(np.mean((there - right)[read] ** 2)) < 0.2 * np.sqrt(
        np.mean((pulses(2, late_s, step_s).measured.outputs[VOLTAGE] - right) ** 2)
    )


def test_runs_that_are_all_late_are_left_to_an_effect() -> None:
    case = case_of("cell", {}, [pulses(1, 5.0), pulses(2, 5.0), pulses(3, 5.0)])
    assert without_delays(case) == (case, ())


@pytest.mark.parametrize("tau_s", [3.0, 10.0, 200.0])
def test_a_slow_pair_is_no_delay(tau_s: float) -> None:
    found = delay(pulses(4, tau_s=tau_s))
    assert found is not None
    assert found.rows < 1.0


def test_noise_and_a_steady_current_tell_no_delay() -> None:
    assert delay(pulses(5, noise=0.5)) is None
    steady = run_of(6, {"current_A": np.ones(ROWS), "ambient_degC": np.full(ROWS, 25.0)}, {VOLTAGE: np.full(ROWS, 3.6)})
    assert delay(steady) is None


def test_a_diagnosis_says_it() -> None:
    _, remarks = prepared(case_of("cell", {}, [pulses(1), pulses(2, 5.0), pulses(3)]))
    (said,) = [one for one in remarks if one.code == "voltage_late"]
    assert "voltage_V in run-02 comes 5 s after its current, by" in said
