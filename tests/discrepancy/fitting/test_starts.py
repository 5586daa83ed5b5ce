"""Starts of fits: over the ridges of an amplitude with many local optima, beyond a standstill, from another's end."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np

from discrepancy import starts
from discrepancy.calibrate import fit
from discrepancy.hypothesis import Hypothesis
from discrepancy.problem import BASE, Start
from discrepancy.starts import over_the_ridges
from jaxmodel.build import case_model, run_profile
from jaxmodel.cases import Known
from jaxmodel.simulate import simulate
from tests.discrepancy.made_cases import case_of, made_cell, run_of, with_candidates

DELAY_S = -7.7
OFFSET_V = 0.09


def test_a_fit_between_the_wrong_ridges_is_led_over_them(tmp_path):
    session = with_candidates(made_cell(tmp_path, {"clock_shift": {"d": DELAY_S}}).case, "clock_shift")
    candidate = session.candidates["clock_shift"]
    problem, layout = session.problem_of(("clock_shift",))
    delay, resampled = candidate.coordinates
    # As if the logger had sampled the true course, which it did not: it draws straight lines between rows.
    begin = {BASE: np.zeros(layout.base), "clock_shift": np.array([delay.at(DELAY_S - 4.0), resampled.at(0.0)])}
    stuck = fit(problem, layout.at(begin))
    places = layout.of_effect["clock_shift"]
    readings = float(np.sum(np.asarray(problem.readings.fit)))
    assert stuck.chi2 > 10.0 * readings, "the fit is to be led out of a poor place, and is in none"

    led = over_the_ridges(problem, candidate, places, layout.own(("clock_shift",)), stuck)
    assert led.chi2 < 1.1 * readings
    assert abs(delay.number(led.x[places[0]]) - DELAY_S) < 3.0 * delay.slope(0.0) * led.sd[places[0]]


def test_a_valley_narrower_than_from_look_to_look_is_found(tmp_path):
    """A sharp sensor: with straight lines between rows only delays within some milliseconds are better than none."""
    sharp, delay_s = {"sensors": {"voltage_V": 2e-5}}, 14.9497
    session = with_candidates(made_cell(tmp_path, {"clock_shift": {"d": delay_s}}, **sharp).case, "clock_shift")
    candidate = session.candidates["clock_shift"]
    problem, layout = session.problem_of(("clock_shift",))
    delay, resampled = candidate.coordinates
    begin = {BASE: np.zeros(layout.base), "clock_shift": np.array([delay.at(15.09), resampled.at(0.0)])}
    stuck = fit(problem, layout.at(begin))
    places, own = layout.of_effect["clock_shift"], layout.own(("clock_shift",))
    looks = np.repeat(stuck.x[None], 2, axis=0)
    looks[:, places[1]] = resampled.at(1.0)
    looks[:, places[0]] = delay.at(delay_s) + candidate.reach / 64 * np.array([1.0, -1.0])
    assert np.all(starts.objectives(problem, looks) > stuck.objective), "looks are to see no better place"

    led = over_the_ridges(problem, candidate, places, own, stuck)
    assert led.chi2 < 0.1 * stuck.chi2
    assert abs(delay.number(led.x[places[0]]) - delay_s) < 0.01


def test_how_a_logger_reads_is_looked_at_within_its_range_and_held_while_its_clock_is_set(tmp_path, monkeypatch):
    """A logger that goes five times beyond straight lines makes up for any delay, and leaves a fit in a long valley."""
    session = with_candidates(made_cell(tmp_path, {"clock_shift": {"d": DELAY_S}}).case, "clock_shift")
    problem, layout = session.problem_of(("clock_shift",))
    delay, way = layout.of_effect["clock_shift"]
    stuck = session.hypothesis().fitted
    stuck = dataclasses.replace(stuck, x=layout.at({"clock_shift": np.array([0.3, 4.8])}))
    seen, freed = [], []

    def looked(_, looks):
        seen.append(looks)
        return np.arange(len(looks), dtype=float) - (2.0 + 1e9 * (len(seen) == 1))

    def fitted(_, start, free, **__):
        freed.append(list(free))
        return dataclasses.replace(stuck, x=start)

    monkeypatch.setattr(starts, "objectives", looked)
    monkeypatch.setattr(starts, "fit", fitted)
    own = layout.own(("clock_shift",))
    over_the_ridges(problem, session.candidates["clock_shift"], (delay, way), own, stuck)
    assert all(looks[:, way].min() >= 0.0 and looks[:, way].max() <= 1.0 for looks in seen)
    assert freed[:2] == [[number for number in own if number != way], own]


def test_an_offset_beyond_a_standstill_is_found():
    """A motor at rest whose voltage reads too much turns in the model: no slope there says that it stands still."""
    voltage = np.repeat([0.0, 9.0, 0.0, 12.0, 0.0], [100, 6, 100, 6, 100])
    acting = {"voltage_V": voltage, "load_torque_Nm": 0.0 * voltage, "ambient_degC": 20.0 + 0.0 * voltage}
    true = {"R_0": Known(0.118), "k_tau": Known(0.0387), "tau_0": Known(0.0105)}
    bench = case_of("motor", true, [run_of(1, acting, {"speed_rad_s": 0.0 * voltage}, step_s=1.5)])
    readings = simulate(case_model(bench), run_profile(bench.runs[0])).readings
    rng, noise = np.random.default_rng(3), {"current_A": 0.02, "speed_rad_s": 0.5}
    outputs = {name: np.asarray(readings[name]) + sd * rng.standard_normal(voltage.size) for name, sd in noise.items()}
    reported = acting | {"voltage_V": voltage + OFFSET_V}
    stated = {"R_0": Known(0.116, 0.0035), "k_tau": Known(0.0385, 0.001), "tau_0": Known(0.01, 0.0015)}
    label = "voltage_offset:voltage_V"
    case = case_of("motor", stated, [run_of(1, reported, outputs, step_s=1.5)], noise)
    session = with_candidates(case, "voltage_offset")
    candidate = session.candidates[label]
    offset = candidate.coordinates[0]

    problem, layout = session.problem_of((label,))
    stuck = fit(problem, layout.at({BASE: session.hypothesis().fitted.x, label: np.array([offset.at(0.3)])}))
    counted = float(np.sum(np.asarray(problem.readings.fit)))
    assert stuck.chi2 > 3.0 * counted, "the fit is to be led out of a poor place, and is in none"

    place = layout.of_effect[label]
    led = over_the_ridges(problem, candidate, place, layout.own((label,)), stuck)
    assert led.chi2 < 1.2 * counted
    assert abs(offset.number(led.x[place[0]]) - OFFSET_V) < 3.0 * offset.slope(0.0) * led.sd[place[0]]


class _BesideAnother(Hypothesis):
    """A model with an effect that the one fitted again does not have."""

    @property
    def start(self) -> Start:
        return {**super().start, "an effect of the other": np.ones(1)}


def test_a_model_is_fitted_again_from_where_another_ended(plain_session):
    """What settled in a poor place is replaced, and all that was read off it; what is no better is not."""
    session = copy.copy(plain_session)
    found = session.hypothesis()
    poor = dataclasses.replace(found, fitted=fit(found.problem, found.fitted.x + 1.0, steps=1))
    session.__dict__.update(_hypotheses={(): poor}, _rungs={}, _screens={})
    left = session.rung("", session.hypothesis()).errors["voltage_V"].fit
    better = session.again([()], _BesideAnother(**vars(found)))[0]
    assert better.fitted.objective < poor.fitted.objective
    assert session.hypothesis() is better
    assert session.rung("", better).errors["voltage_V"].fit < left
    assert session.again([()], poor)[0] is better
