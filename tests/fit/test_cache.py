"""The numbers of a model do not depend on what was fitted before it, and what cannot be calibrated is said."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.base.errors import EffectError, FitError
from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known, Table
from jaxmodel.case.records import Tolerance
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import calibrate
from jaxmodel.fit.likelihood import from_tolerances
from jaxmodel.model.simulation import simulate
from tests.diagnosis.made_cases import SMALL_KEPT, cache_of, case_of, run_of, small_cell

HEATING = {"self_heating": {"C_th": 60.0, "hA": 0.1}}
BOTH = ("self_heating", "ocv_hysteresis")


@pytest.fixture(scope="module")
def warm() -> FitCache:
    return cache_of(small_cell(HEATING, seed=1), *SMALL_KEPT)


def test_a_model_is_fitted_once(warm: FitCache):
    assert warm.fit(BOTH) is warm.fit(BOTH[::-1])
    assert warm.base is warm.fit(())
    assert warm.scores(BOTH) is warm.scores(BOTH[::-1])


def test_numbers_do_not_depend_on_what_was_fitted_before(warm: FitCache):
    """Here the larger model first and all on the way to it later; there the smaller ones, in another order."""
    large = warm.fit(BOTH)
    other = cache_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
    for labels in (("arrhenius_resistance",), ("ocv_hysteresis",), ("self_heating",), BOTH):
        other.fit(labels)
    np.testing.assert_array_equal(other.fit(BOTH).x, large.x)
    assert other.fit(BOTH).likelihood == large.likelihood
    np.testing.assert_array_equal(other.fit(("ocv_hysteresis",)).x, warm.fit(("ocv_hysteresis",)).x)


def test_what_is_hidden_is_found(warm: FitCache):
    fit = warm.fit(("self_heating",))
    layout = warm.space.layout
    numbers = [layout.coordinates[place].number(fit.x[place]) for place in layout.of["self_heating"]]
    assert numbers == pytest.approx([60.0, 0.1], rel=0.15)
    before, after = warm.base.mean_squares(warm.view), fit.mean_squares(warm.view)
    assert after["cell_temperature_degC"] < 0.05 * before["cell_temperature_degC"]
    assert fit.added == ("self_heating",)
    assert max(warm.scores(()).gains(), key=lambda one: one.log_evidence).label == "self_heating"


def test_curves_belong_to_a_model(warm: FitCache):
    assert warm.calibrated.spec.labels == ()
    assert warm.curves_of((), "none") == ()
    assert warm.curves_of(()) == ("ocv_curve", "series_resistance_curve")


def test_effects_are_calibrated_without_curves_too(warm: FitCache):
    """As `identify` does: the scores that start the fit are those of the model with its curves."""
    fit = warm.fit(("self_heating",), "none")
    assert fit.spec.labels == ("self_heating",)
    assert fit.converged
    assert fit.mean_squares(warm.view) == pytest.approx(warm.fit(("self_heating",)).mean_squares(warm.view), rel=0.05)


def test_curves_of_no_table_and_of_heat_come_where_they_belong():
    cache = FitCache(small_cell())
    rare = {name for name, cls in CURVES.items() if cls.is_rare}
    assert rare
    assert not set(cache.curves_of(())) & rare
    assert rare & set(cache.curves_of((), "all")) == {name for name in rare if "cell" in CURVES[name].kinds}
    heat = {name for name, cls in CURVES.items() if "self_heating" in cls.needs}
    assert heat
    assert not heat & set(cache.curves_of(()))
    assert heat <= set(cache.curves_of(("self_heating",)))


@pytest.mark.parametrize(("sd", "is_base"), [(1e-4, True), (None, False)])
def test_a_stated_table_that_may_be_wrong_has_its_curve_in_every_model(sd: float | None, is_base: bool):
    case = small_cell()
    table = Table(np.array([0.0, 1.0]), np.zeros(2), None, sd)
    cache = FitCache(dataclasses.replace(case, tables={**case.tables, "dU_dT": table}))
    assert ("entropy_curve" in cache.curves_of(())) == is_base
    assert ("entropy_curve" in cache.of_no_table) != is_base


def test_slow_errors_that_the_weights_of_noise_would_remove_do_not_stay(warm: FitCache):
    wide = {name: Tolerance(1e3, 1e4) for name in warm.noise}
    cache = cache_of(dataclasses.replace(warm.case, tolerance=wide), *SMALL_KEPT)
    fit = cache.fit(("self_heating",))
    loose = from_tolerances(cache.view.data, dict.fromkeys(cache.noise, 1e3), inflation=100.0)
    poor = calibrate(cache.view, fit.spec, np.zeros_like(fit.x), cache.tolerances, loose, rounds=0)
    before, reached = (one.mean_squares(cache.view)["cell_temperature_degC"] for one in (poor, fit))
    assert before > 4.0 * reached
    better, stay = cache._quieter(poor, {})
    assert better.mean_squares(cache.view)["cell_temperature_degC"] < 1.5 * reached
    assert stay == {}
    assert cache._quieter(fit, {})[0] is fit, "what leaves noise is not calibrated again"
    in_vain = dict.fromkeys(cache.noise, 0.0)
    assert cache._quieter(poor, in_vain) == (poor, in_vain), "the model before was left with as much in vain"


def test_where_every_start_gives_up_a_channel_the_weights_of_the_simpler_model_stay(
    warm: FitCache, monkeypatch: pytest.MonkeyPatch
):
    """A temperature at its noise counts as thousands of readings: 17 mV were missed where 3 were possible.

    Four times the error of the voltage is within its tolerance here, and no reason to take it.
    """
    simpler, held = warm.fit(("self_heating",)), []
    poorer = simpler.errors.copy()
    for rows in warm.view.data.by_channel["voltage_V"]:
        poorer[rows] *= 4.0
    assert np.std(poorer[warm.view.data.by_channel["voltage_V"][0]]) < warm.tolerances["voltage_V"]

    def calibrated(view, spec, start, tolerances, likelihood=None, **options):
        held.append(options.get("held"))
        return simpler if options.get("held") else dataclasses.replace(simpler, errors=poorer)

    monkeypatch.setattr("jaxmodel.fit.cache.calibrate", calibrated)
    starts = [(simpler.spec, simpler.x, simpler.likelihood), (simpler.spec, simpler.x, None)]
    assert warm._best_of(starts, simpler) is simpler
    assert [one and set(one) for one in held] == [None, None, set(warm.noise)]


def test_tolerances_are_stated_or_assumed(warm: FitCache):
    settings = warm.settings
    assert warm.tolerances["cell_temperature_degC"] == settings.assumed_temperature_K
    voltages = np.concatenate([run.measured.outputs["voltage_V"] for run in warm.case.runs])
    assert warm.tolerances["voltage_V"] == pytest.approx(settings.assumed_voltage * np.ptp(voltages))
    stated = dataclasses.replace(small_cell(), tolerance={"voltage_V": Tolerance(0.004, 0.02)})
    assert cache_of(stated, "self_heating").tolerances["voltage_V"] == 0.004


def test_a_motor_stated_to_stall_is_calibrated_from_another_start() -> None:
    """At the stated friction no torque starts the motor, and no unknown moves the readings."""
    voltage = np.repeat([0.0, 1.0, 0.6, 1.2, 0.8], 20)
    inputs = {"voltage_V": voltage, "load_torque_Nm": 0.0 * voltage, "ambient_degC": 20.0 + 0.0 * voltage}
    run = run_of(1, inputs, {"speed_rad_s": 0.0 * voltage}, step_s=0.1)
    truth = case_of("motor", {"R_0": Known(1.2), "k_tau": Known(0.038), "tau_0": Known(0.01)}, [run])
    speed = np.asarray(simulate(case_model(truth), run_profile(run)).readings["speed_rad_s"])
    speed = speed + 0.05 * np.random.default_rng(2).standard_normal(speed.size)
    run = run_of(1, inputs, {"speed_rad_s": speed}, step_s=0.1)
    known = {"R_0": Known(1.0, 0.3), "k_tau": Known(0.04, 0.004), "tau_0": Known(0.06, 0.03)}
    cache = cache_of(case_of("motor", known, [run], {"speed_rad_s": 0.05}), "viscous_friction")
    fit = cache.calibrated
    stalled = cache.space.predicted(fit.spec, np.zeros(fit.x.size))[run.name]["speed_rad_s"]
    assert np.max(np.abs(stalled)) < 1e-3
    assert fit.converged
    assert np.sqrt(fit.mean_squares(cache.view)["speed_rad_s"]) < 0.075


def test_what_cannot_be_calibrated_is_said():
    case = small_cell()
    checks = tuple(dataclasses.replace(run, split="check") for run in case.runs)
    with pytest.raises(FitError, match='set split = "fit" for at least one run'):
        FitCache(dataclasses.replace(case, runs=checks))
    with pytest.raises(EffectError, match="'self_heatin' is not a candidate of this case"):
        FitCache(case, without=["self_heatin"])
