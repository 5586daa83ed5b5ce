"""Spread of a run from spread of parameters: closed forms, small spreads on which both ways agree, large where not."""

from __future__ import annotations

import numpy as np
import pytest
import xarray
from scipy.stats import norm

from jaxmodel.base.errors import ParameterError
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import constant
from jaxmodel.sensitivity.propagation import propagate

PROFILE = constant(600.0, 60.0, current_A=5.0, ambient_degC=15.0)
METRICS, OUTPUTS = ("final_soc", "min_voltage_V"), ("voltage_V", "soc")


def spread(sd: dict[str, float], **options) -> xarray.Dataset:
    return propagate(Model("cell"), PROFILE, sd, metrics=METRICS, outputs=OUTPUTS, **options)


@pytest.fixture(scope="module")
def small() -> xarray.Dataset:
    return spread({"capacity_Ah": 0.05, "series_resistance_scale": 0.02})


def test_both_ways_agree_where_the_spread_is_small(small: xarray.Dataset):
    assert small.attrs == {"draws": 512, "out_of_bounds": 0, "failed": 0}
    assert bool(small.metric_agrees.all())
    assert bool(small.output_agrees.all())
    np.testing.assert_allclose(small.metric_sd_sampled, small.metric_sd_gradient, rtol=0.03)
    np.testing.assert_allclose(small.output_sd_sampled[:, 1:], small.output_sd_gradient[:, 1:], rtol=0.03)
    quantiles = (small.metric_quantile - small.metric_value) / small.metric_sd_gradient
    np.testing.assert_allclose(quantiles, np.tile([-1.96, -0.9945, 0.0, 0.9945, 1.96], (2, 1)), atol=0.08)


def test_state_of_charge_spreads_as_the_charge_over_the_capacity(small: xarray.Dataset):
    """Eq. 1: SOC = SOC_0 - q/Q, so that sd = (q/Q) sd_Q/Q, all of it from the capacity."""
    used = small.output_value.sel(output="soc").values
    expected = (used[0] - used) * 0.05 / 5.2
    np.testing.assert_allclose(small.output_sd_gradient.sel(output="soc"), expected, rtol=1e-9, atol=1e-15)
    share = small.metric_share.sel(metric="final_soc")
    np.testing.assert_allclose(share.sel(parameter=["capacity_Ah", "series_resistance_scale"]), [1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(small.metric_share.sum("parameter"), 1.0, rtol=1e-12)


def test_disagreement_is_told_where_the_spread_is_large():
    """1/Q over a log-normal Q: mean of the charge used is larger by exp(s^2/2), which no straight line has."""
    large = spread({"capacity_Ah": 2.6, "series_resistance_scale": 0.0})
    used = float(large.output_value.sel(output="soc")[0] - large.metric_value.sel(metric="final_soc"))
    factor = np.exp(0.5 * 0.5**2)
    mean = float(large.output_value.sel(output="soc")[0] - large.metric_mean.sel(metric="final_soc"))
    assert mean == pytest.approx(used * factor, rel=0.01)
    sd = used * factor * np.sqrt(np.exp(0.25) - 1.0)
    assert float(large.metric_sd_sampled.sel(metric="final_soc")) == pytest.approx(sd, rel=0.05)
    assert not bool(large.metric_agrees.sel(metric="final_soc"))
    assert not bool(large.output_agrees.sel(output="soc")[1:].any())
    assert bool(large.output_agrees.sel(output="soc")[0])  # before anything has happened both are zero


def test_correlated_parameters_that_make_up_for_each_other_leave_no_spread(small: xarray.Dataset):
    """Current and capacity up by as many percent: the state of charge is that of before."""
    sd = {"capacity_Ah": 0.052, "current_A": 0.01}
    together = spread(sd, correlation=np.array([[1.0, 1.0], [1.0, 1.0]]))
    apart = spread(sd, correlation=np.array([[1.0, -1.0], [-1.0, 1.0]]))
    soc = float(apart.metric_sd_gradient.sel(metric="final_soc"))
    assert float(together.metric_sd_gradient.sel(metric="final_soc")) < 1e-9 * soc
    assert float(together.metric_sd_sampled.sel(metric="final_soc")) < 0.02 * soc
    used = float(small.output_value.sel(output="soc")[0] - small.metric_value.sel(metric="final_soc"))
    assert soc == pytest.approx(2.0 * 0.01 * used, rel=1e-9)


def test_draws_out_of_bounds_are_left_out_and_counted():
    """A state of charge of 1.0 +- 0.1 may be 1.1 at most: one draw in six is beyond one sd."""
    one = spread({"initial_soc": 0.1, "series_resistance_scale": 0.0})
    start = float(one.value.sel(parameter="initial_soc"))
    beyond = one.attrs["draws"] * norm.sf((1.1 - start) / 0.1)
    assert one.attrs["out_of_bounds"] == pytest.approx(beyond, abs=3)
    assert float(one.output_quantile.sel(output="soc").max()) < 1.1


@pytest.mark.parametrize(
    ("sd", "correlation", "message"),
    [
        ({"capacity": 0.1}, None, "Did you mean 'capacity_Ah'"),
        ({"capacity_Ah": -0.1}, None, "0 or more"),
        ({"capacity_Ah": 0.1, "cycles": 1.0}, np.array([[1.0, 2.0], [2.0, 1.0]]), "contradict"),
    ],
)
def test_what_cannot_be_used_is_said(sd: dict[str, float], correlation: np.ndarray | None, message: str):
    with pytest.raises(ParameterError, match=message):
        spread(sd, correlation=correlation)


@pytest.mark.parametrize("draws", [-3, 0, 1, 4, 7])
def test_too_few_draws_are_refused_before_anything_is_run(draws: int):
    with pytest.raises(ParameterError, match=f"^uncertain: {draws} draws show no spread; give 8 or more.$"):
        spread({"capacity_Ah": 0.05}, draws=draws)


def test_where_bounds_leave_too_few_draws_more_of_them_help():
    """Of eight draws of a share that is near its bound a few are beyond; of many, enough are within."""
    sd = {"initial_soc": 0.4}
    with pytest.raises(ParameterError, match=r"of 8 draws are outside .* fewer than 8 are left; give more draws, or"):
        spread(sd, draws=8)
    assert spread(sd, draws=64).attrs["out_of_bounds"] > 0
