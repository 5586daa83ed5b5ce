"""A run that goes where nothing can be has a status of its own in each of the three ways in which a run is computed."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel import Cutoff, Status
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.pieces import run_in_pieces
from jaxmodel.model.possible import LIMITS, possible
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

TIME_S = np.arange(0.0, 601.0, 10.0)


def profile(**inputs: float) -> Profile:
    return Profile(TIME_S, {name: np.full(TIME_S.size, value) for name, value in inputs.items()})


@pytest.mark.parametrize("name", LIMITS)
def test_limits_are_possible_and_what_is_beyond_is_not(name: str):
    low, high = LIMITS[name]
    values = np.array([low - 1e-3, low + 1e-3, high - 1e-3, high + 1e-3, np.nan])
    assert possible({name: values}).tolist() == [False, True, True, False, False]


def test_voltages_are_not_looked_at():
    assert possible({"voltage_V": 1e9}) is True


@pytest.mark.parametrize(
    ("kind", "inputs", "status"),
    [
        ("motor", {"voltage_V": 14.0, "load_torque_Nm": 0.1}, Status.COMPLETE),
        ("motor", {"voltage_V": 14.0, "load_torque_Nm": 100.0}, Status.IMPOSSIBLE),
        ("cell", {"current_A": 5.0}, Status.COMPLETE),
        ("cell", {"current_A": 60.0}, Status.IMPOSSIBLE),  # 10 A h out of a cell of 4.3 A h
        ("cell", {"current_A": -60.0}, Status.IMPOSSIBLE),
    ],
)
def test_status_says_what_cannot_be(kind: str, inputs: dict[str, float], status: Status):
    given = profile(ambient_degC=20.0, **inputs)
    assert int(simulate(Model(kind), given).status) == status
    assert run_in_pieces(Model(kind), given).status == status


def test_a_run_that_ends_before_is_not_impossible():
    given, cutoff = profile(ambient_degC=20.0, current_A=60.0), Cutoff(soc=0.5)
    assert int(simulate(Model("cell"), given, cutoff).status) == Status.REACHED_CUTOFF
    assert run_in_pieces(Model("cell"), given, cutoff).status == Status.REACHED_CUTOFF
