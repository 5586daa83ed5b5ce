"""Conditions take part if they vary materially and are no function of an earlier condition."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.diagnosis.residuals.regimes import MATERIAL_SPANS, cut, is_of_runs, regimes
from jaxmodel.diagnosis.residuals.table import ChannelResiduals
from tests.diagnosis.residuals.made_residuals import constant_currents, pulses


def with_conditions(residuals: ChannelResiduals, **conditions: np.ndarray) -> ChannelResiduals:
    return dataclasses.replace(residuals, conditions={**residuals.conditions, **conditions})


@pytest.fixture(scope="module")
def rates() -> ChannelResiduals:
    return constant_currents(lambda run, number: 0.0)


@pytest.fixture(scope="module")
def temperatures() -> ChannelResiduals:
    return pulses(lambda run, number: 0.0)


def test_a_constant_ambient_temperature_and_time_take_no_part(rates: ChannelResiduals) -> None:
    found = regimes(rates)
    assert {"ambient_degC", "cycles"} <= set(found.idle)
    assert found.names == ("soc", "current_A", "cell_temperature_degC")
    assert found.alias_of == {"time_since_load_changed_s": "time_s"}, "the load changed once, when the clock began"


def test_what_spans_a_single_run_only_takes_no_part(temperatures: ChannelResiduals) -> None:
    alone = np.where(temperatures.run == 2, np.linspace(0.0, 1.0, temperatures.error.size) % 0.7, 0.3)
    assert "duty" in regimes(with_conditions(temperatures, duty=alone)).idle
    assert regimes(temperatures.rows(temperatures.run == 0)).names == ()


def test_an_alias_of_an_earlier_condition_is_left_out(temperatures: ChannelResiduals) -> None:
    current = temperatures.conditions["current_A"]
    found = regimes(
        with_conditions(temperatures, load_torque_Nm=0.05 * current + 1e-4, speed_rad_s=(current - 3.0) ** 2)
    )
    assert found.alias_of["load_torque_Nm"] == "current_A"
    assert found.alias_of["speed_rad_s"] == "current_A", "any function of it says the same, not lines alone"
    assert found.alias_of["ambient_degC"] == "cell_temperature_degC"


def test_two_conditions_of_runs_are_distinguished_by_their_order(temperatures: ChannelResiduals) -> None:
    other = np.array([100.0, 400.0, 0.0, 300.0, 200.0])[temperatures.run]
    same = np.array([0.0, 100.0, 200.0, 300.0, 400.0])[temperatures.run]
    assert is_of_runs(with_conditions(temperatures, cycles=other), "cycles")
    assert "cycles" in regimes(with_conditions(temperatures, cycles=other)).names
    assert "cycles" in regimes(with_conditions(temperatures, cycles=same)).alias_of


def test_conditions_come_in_the_order_of_preference(temperatures: ChannelResiduals) -> None:
    rng = np.random.default_rng(1)
    shuffled = with_conditions(temperatures, speed_rad_s=rng.uniform(0.0, 100.0, temperatures.error.size))
    names = regimes(shuffled).names
    assert names == ("soc", "current_A", "cell_temperature_degC", "speed_rad_s", "time_since_load_changed_s")


def test_the_channel_itself_is_no_condition(temperatures: ChannelResiduals) -> None:
    thermometer = dataclasses.replace(temperatures, channel="cell_temperature_degC", unit="K")
    assert "cell_temperature_degC" not in regimes(thermometer).names


def test_ranges_are_round(rates: ChannelResiduals, temperatures: ChannelResiduals) -> None:
    soc = cut(rates, "soc")
    assert soc.lower.tolist() == [-np.inf, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9]
    currents = cut(rates, "current_A")
    assert currents.are_levels
    assert currents.middle == pytest.approx([3.0, 6.0, 9.0, 12.0], abs=0.01)
    ambient = cut(temperatures, "ambient_degC")
    assert ambient.are_levels
    assert ambient.middle.tolist() == [0.0, 10.0, 20.0, 30.0, 40.0]
    warm = cut(temperatures, "cell_temperature_degC")
    assert not warm.are_levels
    assert set(warm.upper[:-1]) <= {10.0, 20.0, 30.0, 40.0, 50.0}


def test_rest_is_in_the_middle_of_a_range() -> None:
    rng = np.random.default_rng(3)
    still = pulses(lambda run, number: 0.0, charges=True)
    current = np.where(
        rng.random(still.error.size) < 0.2,
        0.002 * rng.standard_normal(still.error.size),
        rng.uniform(-5.0, 9.0, still.error.size),
    )
    bins = cut(with_conditions(still, current_A=current), "current_A")
    resting = np.abs(current) < 0.05
    assert np.unique(bins.code[resting]).size == 1
    assert bins.lower[bins.code[resting][0]] < -0.2


def test_every_reading_is_in_one_range(temperatures: ChannelResiduals) -> None:
    for name in regimes(temperatures).names:
        bins = cut(temperatures, name)
        assert bins.code.min() == 0
        assert bins.code.max() == bins.count - 1
        if not bins.are_levels:
            values = temperatures.conditions[name]
            assert np.all(values >= bins.lower[bins.code])
            assert np.all(values <= bins.upper[bins.code])


def test_every_material_span_has_a_source() -> None:
    assert all(span.source for span in MATERIAL_SPANS.values())
