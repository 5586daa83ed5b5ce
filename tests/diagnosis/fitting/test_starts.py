"""Starts of fits: an amplitude with many local optima, and the other side of a standstill."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known
from jaxmodel.diagnosis.fitting import starts
from jaxmodel.diagnosis.fitting.candidates import make_candidate
from jaxmodel.diagnosis.fitting.fit import fit
from jaxmodel.diagnosis.fitting.layout import BASE
from jaxmodel.diagnosis.fitting.starts import best_local_optimum, negligible
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.effects.battery import ChargeTransfer, OcvHysteresis
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import case_of, investigation_of, made_cell, run_of

DELAY_S = -7.7
OFFSET_V = 0.09


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Investigation:
    """A cell whose logger is late."""
    made = made_cell(tmp_path_factory.mktemp("cells") / "late", {"clock_shift": {"d": DELAY_S}})
    return investigation_of(made.case, "clock_shift")


def test_a_fit_at_a_wrong_local_optimum_reaches_the_best_one(late: Investigation):
    candidate, layout, scale = late.space.candidates["clock_shift"], late.space.layout, late.first_scale
    setting = late.space.setting(["clock_shift"])
    delay, resampled = candidate.coordinates
    # As if the logger had sampled the true trajectory; in fact it interpolates linearly between rows.
    begin = {BASE: np.zeros(layout.base), "clock_shift": np.array([delay.at(DELAY_S - 10.0), resampled.at(0.0)])}
    stuck = fit(scale.view, setting, scale.weights, layout.at(begin))
    assert stuck.chi2 > 2.0 * scale.view.readings.count, "the fit is to be led out of a poor place, and is in none"
    led = best_local_optimum(scale.view, setting, scale.weights, candidate, stuck)
    assert led.chi2 < 1.1 * scale.view.readings.count
    place = layout.of["clock_shift"][0]
    sd = delay.slope(0.0) * led.sd()[led.free.index(place)]
    assert abs(delay.number(led.x[place]) - DELAY_S) < 3.0 * sd


def test_shape_parameters_are_searched_within_their_range_and_held_at_first(
    late: Investigation, monkeypatch: pytest.MonkeyPatch
):
    """An extrapolating logger could compensate for any delay, and would leave the fit in a long valley."""
    layout, scale, setting = late.space.layout, late.first_scale, late.space.setting(["clock_shift"])
    _, way = layout.of["clock_shift"]
    stuck = fit(scale.view, setting, scale.weights, layout.at({"clock_shift": np.array([0.3, 4.8])}), steps=1)
    stuck = dataclasses.replace(stuck, x=layout.at({"clock_shift": np.array([0.3, 4.8])}))
    seen, freed = [], []

    def looked(*arguments):
        seen.append(arguments[-1])
        return np.arange(len(seen[-1]), dtype=float) - (2.0 + 1e9 * (len(seen) == 1))

    def fitted(view, model, weights, start, free=None, **__):
        freed.append(list(model.free if free is None else free))
        return dataclasses.replace(stuck, x=start)

    monkeypatch.setattr(starts, "objectives", looked)
    monkeypatch.setattr(starts, "fit", fitted)
    best_local_optimum(scale.view, setting, scale.weights, late.space.candidates["clock_shift"], stuck)
    assert all(looks[:, way].min() >= 0.0 and looks[:, way].max() <= 1.0 for looks in seen)
    own = list(setting.free)
    assert freed[:2] == [[number for number in own if number != way], own]


def test_an_offset_beyond_a_standstill_is_found():
    """With a voltage reading that is too high the motor turns in the model: no gradient leads to standstill."""
    voltage = np.repeat([0.0, 9.0, 0.0, 12.0, 0.0], [100, 6, 100, 6, 100])
    acting = {"voltage_V": voltage, "load_torque_Nm": 0.0 * voltage, "ambient_degC": 20.0 + 0.0 * voltage}
    true = {"R_0": Known(0.118), "k_tau": Known(0.0387), "tau_0": Known(0.0105)}
    space = case_of("motor", true, [run_of(1, acting, {"speed_rad_s": 0.0 * voltage}, step_s=1.5)])
    readings = simulate(case_model(space), run_profile(space.runs[0])).readings
    rng, noise = np.random.default_rng(3), {"current_A": 0.02, "speed_rad_s": 0.5}
    outputs = {name: np.asarray(readings[name]) + sd * rng.standard_normal(voltage.size) for name, sd in noise.items()}
    reported = acting | {"voltage_V": voltage + OFFSET_V}
    stated = {"R_0": Known(0.116, 0.0035), "k_tau": Known(0.0385, 0.001), "tau_0": Known(0.01, 0.0015)}
    label = "voltage_offset:voltage_V"
    inv = investigation_of(case_of("motor", stated, [run_of(1, reported, outputs, step_s=1.5)], noise), label)
    scale, setting, candidate = inv.first_scale, inv.space.setting([label]), inv.space.candidates[label]
    offset = candidate.coordinates[0]
    base, layout = inv.space.setting([]), inv.space.layout
    without = fit(scale.view, base, scale.weights, np.zeros(layout.size)).x[: layout.base]
    stuck = fit(scale.view, setting, scale.weights, layout.at({BASE: without, label: np.array([offset.at(0.0)])}))
    assert stuck.chi2 > 3.0 * scale.view.readings.count, "the fit is to be led out of a poor place, and is in none"
    led = best_local_optimum(scale.view, setting, scale.weights, candidate, stuck)
    assert led.chi2 < 1.2 * scale.view.readings.count
    place = layout.of[label][0]
    sd = offset.slope(0.0) * led.sd()[led.free.index(place)]
    assert abs(offset.number(led.x[place]) - OFFSET_V) < 3.0 * sd


def test_an_effect_can_be_negligible():
    """Far below its usual size, on whichever side its parameter fades."""
    small, large = make_candidate(OcvHysteresis()), make_candidate(ChargeTransfer())
    assert small.coordinates[0].number(negligible(small)[0]) < 0.2 * small.coordinates[0].number(0.0)
    assert large.coordinates[0].number(negligible(large)[0]) > 5.0 * large.coordinates[0].number(0.0)
