"""The noise contract: sd, correlation and rounding found in simulated readings whose noise is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmodel.diagnosis.advice.remarks import noise_remarks
from jaxmodel.fit.noise.contract import noise_of_case
from jaxmodel.fit.noise.instrument import (
    _distances,
    _windows,
    break_at_jumps,
    channel_noise,
    detect_quantum,
    local_noise,
)
from tests.diagnosis.made_cases import case_of, run_of

ROWS = 2000


def one_run(rows: int) -> np.ndarray:
    """Where chains begin: at the first row."""
    return np.arange(rows) == 0


ONE_RUN = one_run(ROWS)


def ar1(rho: float, seed: int, sd: float = 1.0, rows: int = ROWS) -> np.ndarray:
    innovation = np.random.default_rng(seed).normal(size=rows) * np.sqrt(1.0 - rho**2)
    innovation[0] /= np.sqrt(1.0 - rho**2)
    return sd * lfilter([1.0], [1.0, -rho], innovation)


def pulsed_voltage() -> tuple[np.ndarray, np.ndarray]:
    """A current in steps of 50 rows, and the voltage of a resistance and an RC pair of 20 rows under it."""
    current = np.repeat(np.random.default_rng(5).uniform(0.0, 4.0, ROWS // 50), 50)
    polarisation = lfilter([0.05 * 0.049], [1.0, -0.951], current)
    return current, 4.0 - np.linspace(0.0, 0.3, ROWS) - 0.03 * current - polarisation


@pytest.mark.parametrize("step", [0.001, 0.005, 0.1, 0.02])
def test_quantum_of_rounded_readings(step):
    readings = np.round(np.random.default_rng(0).normal(20.0, 3.0 * step, 500) / step) * step
    assert detect_quantum(readings) == pytest.approx(step, rel=1e-9)


def test_quantum_of_a_converter_that_prints_few_digits():
    bit = 5.0 / 4096.0
    readings = np.round(np.round(np.random.default_rng(0).normal(3.7, 0.02, 2000) / bit) * bit, 4)
    assert detect_quantum(readings) == pytest.approx(bit, rel=0.01)


def test_readings_that_were_not_rounded_have_no_quantum():
    assert detect_quantum(np.random.default_rng(0).normal(size=200)) == 0.0
    assert detect_quantum(np.array([np.nan, 20.0, 20.0, 20.0])) == 0.0


@pytest.mark.parametrize(("rho", "tolerance", "sd_tolerance"), [(0.0, 0.08, 0.04), (0.3, 0.1, 0.08), (0.6, 0.15, 0.2)])
def test_local_noise_ignores_a_slow_misfit_ten_times_the_noise(rho, tolerance, sd_tolerance):
    misfit = 10.0 * np.sin(2.0 * np.pi * np.arange(ROWS) / 300.0)
    found = local_noise(ar1(rho, seed=1) + misfit, ONE_RUN)
    assert found.rho == pytest.approx(rho, abs=tolerance)
    assert found.sd == pytest.approx(1.0, rel=sd_tolerance)
    assert found.is_coloured == (rho > 0.0)


def test_a_known_sd_makes_a_long_correlation_time_measurable():
    found = local_noise(ar1(0.9, seed=2), ONE_RUN, known_sd=1.0)
    assert found.rho == pytest.approx(0.9, abs=0.012)
    assert found.rho_se < 0.01
    assert local_noise(ar1(0.9, seed=2), ONE_RUN).rho_se > 5.0 * found.rho_se


def test_local_noise_does_without_missing_readings_at_unequal_steps():
    generator = np.random.default_rng(6)
    time_s = np.cumsum(generator.uniform(0.7, 3.0, ROWS))
    values = ar1(0.5, seed=6) + 20.0 * np.sin(time_s / 200.0)
    values[generator.random(ROWS) < 0.03] = np.nan
    found = local_noise(values, ONE_RUN, time_s)
    assert found.rho == pytest.approx(0.5, abs=0.15)
    assert found.sd == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("rho", [-0.8, 0.0, 0.5, 0.99])
@pytest.mark.parametrize("window", [12, 48])
def test_windows_have_the_restricted_likelihood_of_their_covariance(window: int, rho: float):
    """Written out with matrices: contrasts orthogonal to any parabola, across missing readings and uneven steps."""
    generator = np.random.default_rng(7)
    rows = 600
    time_s, values = np.cumsum(generator.uniform(0.7, 3.0, rows)), 500.0 + generator.normal(size=rows)
    values[generator.random(rows) < 0.1] = np.nan
    starts = np.isin(np.arange(rows), [0, 5, 40, 41, 220, 300, 309])
    squared, log_determinant = _distances(_windows(values, starts, time_s, window), rho)
    read = np.flatnonzero(np.isfinite(values))
    chains = np.split(read, np.flatnonzero(np.diff(np.cumsum(starts)[read])) + 1)
    parts = [part for chain in chains for part in np.array_split(chain, max(1, round(len(chain) / window)))]
    expected = []
    for part in (part for part in parts if len(part) >= 8):
        basis = np.linalg.qr(np.vander(time_s[part] - time_s[part].mean(), 3), mode="complete")[0][:, 3:]
        covariance = basis.T @ np.float64(rho) ** np.abs(np.subtract.outer(part, part)) @ basis
        contrast = basis.T @ values[part]
        expected.append((contrast @ np.linalg.solve(covariance, contrast), np.linalg.slogdet(covariance)[1]))
    np.testing.assert_allclose(squared, [one for one, _ in expected], rtol=1e-8)
    np.testing.assert_allclose(log_determinant, [one for _, one in expected], atol=1e-8)


def test_readings_alone_show_their_noise_between_the_jumps_of_the_input():
    current, voltage = pulsed_voltage()
    measured_current = current + 0.005 * np.random.default_rng(7).normal(size=ROWS)
    starts = break_at_jumps(ONE_RUN, measured_current)
    jumps = np.flatnonzero(np.abs(np.diff(current)) > 0.1) + 1
    assert starts[jumps].all()
    assert starts.sum() <= 1 + 2 * (ROWS // 50)
    readings = np.round(voltage + 0.002 * np.random.default_rng(8).normal(size=ROWS), 3)
    noise = channel_noise(readings, lambda known_sd: local_noise(readings, starts, known_sd=known_sd))
    assert noise.quantum == pytest.approx(0.001)
    assert noise.sd == pytest.approx(np.hypot(0.002, 0.001 / np.sqrt(12.0)), rel=0.05)
    assert noise.rho == 0.0
    assert "estimated" in noise.source


def test_rounding_that_hides_the_noise_is_taken_for_it():
    readings = np.round(20.0 + 0.4 * np.sin(np.arange(ROWS) / 300.0), 1)
    noise = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd))
    assert noise.sd == pytest.approx(0.1 / np.sqrt(12.0))
    stuck = np.full(ROWS, 20.0)
    assert channel_noise(stuck, lambda sd: local_noise(stuck, ONE_RUN, known_sd=sd)).sd == 0.0


def test_a_stated_sd_is_kept_with_rounding_added():
    readings = np.round(4.0 + ar1(0.6, seed=9, sd=0.002), 3)
    noise = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd), stated_sd=0.002)
    assert noise.sd == pytest.approx(np.sqrt(0.002**2 + 0.001**2 / 12.0))
    assert noise.rho == pytest.approx(0.6, abs=0.08)
    for part in ("stated (0.002)", "rounding to 0.001", "correlation"):
        assert part in noise.source


@pytest.mark.parametrize("stated", [0.5, 2.0])
def test_a_stated_sd_that_the_readings_contradict_is_replaced(stated):
    readings = ar1(0.0, seed=10)
    result = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd), stated_sd=stated)
    assert result.sd == pytest.approx(1.0, rel=0.06)
    assert (result.rho, result.stated, result.contradicts) == (0.0, stated, True)
    assert result.source.endswith(f"the stated sd is wrong ({stated:g})")


@pytest.mark.parametrize("stated", [0.75, 1.0, 1.4])
def test_a_stated_sd_within_a_factor_of_the_scatter_is_used(stated):
    readings = ar1(0.0, seed=10)
    result = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd), stated_sd=stated)
    assert (result.sd, result.stated, result.contradicts) == (stated, stated, False)


def interpolated() -> np.ndarray:
    """A noisy signal logged every 50 rows, and rows between, written with seven decimals."""
    rows = np.arange(ROWS)
    logged = 3.7 + 0.1 * np.sin(rows[::50] / 300.0) + ar1(0.0, seed=13, sd=0.001)[::50]
    return np.round(np.interp(rows, rows[::50], logged), 7)


def test_an_interpolated_log_is_no_better_sensor():
    readings = interpolated()
    result = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd), stated_sd=0.001)
    assert result.sd == pytest.approx(0.001)
    assert (result.is_filtered, result.contradicts) == (True, False)
    assert noise_remarks({"voltage_V": result})[0].code == "readings_filtered"


def test_no_sensor_is_finer_than_a_millionth_of_its_range():
    readings = interpolated()
    result = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd))
    assert result.sd >= 1e-6 * np.ptp(readings)


def test_few_readings_are_no_contradiction():
    readings = ar1(0.0, seed=12, rows=40)
    result = channel_noise(readings, lambda sd: local_noise(readings, one_run(40), known_sd=sd), stated_sd=0.2)
    assert result.sd == 0.2


def test_coloured_noise_below_the_stated_sd_is_no_contradiction():
    """Its larger part may be slower than any window."""
    readings = ar1(0.9, seed=7)
    assert local_noise(readings, ONE_RUN).sd < 1.0 / 1.5
    result = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd), stated_sd=1.0)
    assert (result.sd, result.contradicts) == (1.0, False)
    assert result.rho == pytest.approx(0.9, abs=0.02)


@pytest.mark.parametrize("wrong_sd", [0.8, 1.3, 2.0])
def test_a_wrong_sd_does_not_make_white_noise_coloured(wrong_sd):
    readings = ar1(0.0, seed=11)
    assert local_noise(readings, ONE_RUN, known_sd=wrong_sd).is_coloured
    noise = channel_noise(readings, lambda sd: local_noise(readings, ONE_RUN, known_sd=sd), stated_sd=wrong_sd)
    assert noise.rho == 0.0


def test_white_noise_is_called_coloured_no_more_often_than_promised():
    found = [local_noise(ar1(0.0, seed, rows=400), one_run(400)).is_coloured for seed in range(40)]
    assert sum(found) <= 1


def test_too_few_readings_leave_rounding_alone():
    readings = np.array([20.1, 20.2, 20.1, 20.4, 20.1])
    noise = channel_noise(readings, lambda sd: local_noise(readings, one_run(5), known_sd=sd))
    assert noise.sd == pytest.approx(0.1 / np.sqrt(12.0))
    assert "too few" in noise.source


def test_a_constant_channel_is_left_out():
    run = run_of(1, {"current_A": np.zeros(60), "ambient_degC": np.zeros(60)}, {"voltage_V": np.full(60, 4.0)})
    assert noise_of_case(case_of("cell", {}, [run])) == {}
