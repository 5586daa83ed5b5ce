"""Screening: the differences are derivatives, and every candidate of a group that could act is tried."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.fit.screen import Direction, Screen, screen
from jaxmodel.fit.space import ModelSpace, View


@pytest.fixture(scope="module")
def at(small_space: ModelSpace) -> np.ndarray:
    x = np.zeros(small_space.layout.size)
    x[: small_space.layout.base] = 0.3 * np.random.default_rng(0).standard_normal(small_space.layout.base)
    return x


@pytest.fixture(scope="module")
def screened(small_space: ModelSpace, small_view: View, at: np.ndarray) -> Screen:
    return screen(small_view, small_space.spec([]), at)


def ways(screened: Screen, label: str) -> list[Direction]:
    return [way for way in screened.directions if way.label == label]


def moved(view: View, labels: list[str], x: np.ndarray, switch: float = 1.0) -> np.ndarray:
    spec = view.space.spec(labels)
    spec = dataclasses.replace(spec, switches=switch * spec.switches)
    return view.at(view.space.problem(spec), [spec.lane(x)])[0]


def test_every_candidate_that_could_act_is_tried_at_each_shape(screened: Screen, small_space: ModelSpace):
    tried = {way.label for way in screened.directions}
    groups = {label: one.group for label, one in small_space.candidates.items()}
    assert tried == {label for label, group in groups.items() if group not in ("law", "curve")}
    for label, group in groups.items():
        if group in ("effect", "sensor"):
            assert {way.probe for way in ways(screened, label)} == set(small_space.candidates[label].probes)


@pytest.mark.parametrize("label", ["voltage_offset:voltage_V", "arrhenius_resistance", "self_heating"])
def test_a_direction_is_the_derivative_by_the_switch_or_the_whole_effect(
    screened: Screen, small_view: View, at: np.ndarray, label: str
):
    candidate = small_view.space.candidates[label]
    still = moved(small_view, [], at)
    probe = candidate.probes[0]
    x = at.copy()
    x[list(small_view.space.layout.of[label])] = probe
    slope = (moved(small_view, [label], x, 1e-4) - moved(small_view, [label], x, -1e-4)) / 2e-4
    found = [way.columns[:, 0] for way in ways(screened, label) if way.probe == probe]
    np.testing.assert_allclose(found[0], slope, atol=2e-3 * np.max(np.abs(slope)))
    if len(found) > 1:
        np.testing.assert_allclose(found[1], moved(small_view, [label], x) - still, atol=1e-9)


def test_a_curve_and_a_number_of_a_run_move_the_readings_as_fitted(
    small_space: ModelSpace, small_view: View, at: np.ndarray
):
    found = screen(small_view, small_space.spec([]), at, ("curve", "run"))
    for label, number in (("ocv_curve", 7), ("contact_resistance@run-02", 0)):
        (way,) = ways(found, label)
        assert way.columns.shape[1] == len(small_space.candidates[label].coordinates)
        place = small_space.layout.of[label][number]
        x, y = at.copy(), at.copy()
        x[place], y[place] = 1e-3, -1e-3
        slope = (moved(small_view, [label], x) - moved(small_view, [label], y)) / 2e-3
        np.testing.assert_allclose(way.columns[:, number], slope, atol=1e-5 + 1e-3 * np.max(np.abs(slope)))
    (way,) = ways(found, "contact_resistance@run-02")
    assert not np.any(way.columns[small_view.data.run == 0])


def test_errors_and_sensitivities_are_those_of_the_model(screened: Screen, small_view: View, at: np.ndarray):
    np.testing.assert_allclose(screened.errors, small_view.data.value - moved(small_view, [], at))
    for column, place in enumerate(screened.spec.free[:3]):
        x, y = at.copy(), at.copy()
        x[place], y[place] = x[place] + 1e-3, y[place] - 1e-3
        slope = (moved(small_view, [], x) - moved(small_view, [], y)) / 2e-3
        np.testing.assert_allclose(screened.base[:, column], slope, atol=1e-5 + 2e-3 * np.max(np.abs(slope)))


def test_laws_are_tried_where_they_are_asked_for_and_their_port_is_free(
    small_space: ModelSpace, small_view: View, at: np.ndarray
):
    laws = [one for one in small_space.candidates.values() if one.group == "law"]
    found = screen(small_view, small_space.spec([]), at, groups=("law",))
    assert {way.label for way in found.directions} == {one.label for one in laws}
    beside = screen(small_view, small_space.spec([laws[0].label]), at, groups=("law",))
    assert beside.directions == (), "two laws at one port share its knots"


def test_what_is_in_the_model_is_not_tried_again(small_space: ModelSpace, small_view: View, at: np.ndarray):
    found = screen(small_view, small_space.spec(["voltage_offset:voltage_V"]), at)
    assert not ways(found, "voltage_offset:voltage_V")
    assert ways(found, "self_heating")
