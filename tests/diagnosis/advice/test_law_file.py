"""The effect class written for a fitted law gives the same simulation as the law."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.case.build import load_effect_class
from jaxmodel.diagnosis.advice.law_file import law_file
from jaxmodel.fit.candidates import Candidate, laws
from jaxmodel.fit.laws import no_laws
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.ports import Effect
from jaxmodel.model.profile import Profile
from tests.diagnosis.made_cases import case_of
from tests.model.runs import readings, staircase

SIZES = {
    "load_torque": 0.02,
    "torque_constant": 1e-3,
    "motor_loss": 2.0,
    "bridge_voltage": 0.5,
    "overpotential": 0.02,
    "counted_current": 0.1,
    "cell_heat": 1.0,
    "current_A": 5.0,
    "load_torque_Nm": 0.05,
}
RANGES = {
    "current_A": (-5.0, 5.0),
    "speed_rad_s": (-300.0, 300.0),
    "load_torque_Nm": (0.0, 0.05),
    "time_s": (0.0, 120.0),
    "soc": (0.2, 1.0),
    "cell_temperature_degC": (10.0, 30.0),
}
SHAPE = np.array([0.5, -0.3, 0.8, 1.0, -1.0, 0.4, 0.2, -0.6, 0.9])


def law(kind: str, label: str) -> Candidate:
    found = laws(case_of(kind, {}, []), RANGES, SIZES)
    return next(one for one in found if one.label == label)


def in_the_slot(kind: str, one: Candidate, values: np.ndarray) -> Effect:
    assert one.law is not None
    place, own = one.law
    of_all, settings = np.zeros((len(no_laws(kind)), values.size)), no_laws(kind)
    of_all[place], settings[place] = values, own
    slots = (jnp.asarray(of_all), jnp.asarray(settings))
    return eqx.tree_at(lambda e: (e.values, e.settings), one.effect, slots)


def drive(kind: str) -> Profile:
    rows = np.arange(120.0)
    ambient = np.full(120, 20.0)
    if kind == "cell":
        return Profile(rows, {"current_A": staircase(2, 120, 5.0), "ambient_degC": ambient})
    voltage, load = staircase(1, 120, 12.0), np.abs(staircase(3, 120, 0.05))
    return Profile(rows, {"voltage_V": voltage, "load_torque_Nm": load, "ambient_degC": ambient})


@pytest.mark.parametrize(
    ("kind", "label", "channel"),
    [
        ("motor", "load_torque(time_s)", "speed_rad_s"),
        ("motor", "load_torque(speed_rad_s) x load_torque_Nm", "speed_rad_s"),
        ("cell", "overpotential(soc) x current_A", "voltage_V"),
    ],
)
def test_the_file_does_what_the_law_did(kind: str, label: str, channel: str, tmp_path: Path) -> None:
    one = law(kind, label)
    assert one.law is not None
    values = SIZES[one.port] * SHAPE
    own = one.law[1]
    source = law_file(
        one, values * (own[-1] if one.multiplier else 1.0), np.linspace(own[-4], own[-3], 9), kind, "bench"
    )
    assert source is not None
    path = tmp_path / "found_law.py"
    path.write_text(source)
    effect = load_effect_class(f"{path}:FoundLaw")()
    found = readings(Model(kind, effects=(effect,)), drive(kind))[channel]
    expected = readings(Model(kind, effects=(in_the_slot(kind, one, values),)), drive(kind))[channel]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7)
    assert np.max(np.abs(found - readings(Model(kind), drive(kind))[channel])) > 1e-3


def test_what_no_port_can_carry_has_no_file() -> None:
    one = law("motor", "load_torque(speed_rad_s)")
    at = np.linspace(-300.0, 300.0, 9)
    assert law_file(dataclasses.replace(one, port="series_resistance"), SHAPE, at, "motor", "bench") is None
    assert law_file(dataclasses.replace(one, over="soc"), SHAPE, at, "motor", "bench") is None
    assert law_file(dataclasses.replace(one, port="motor_loss", over="load_torque_Nm"), SHAPE, at, "motor", "b") is None


def test_every_law_of_every_kind_has_a_file_that_loads(tmp_path: Path) -> None:
    for kind in ("cell", "motor", "robot"):
        sizes = SIZES | {"onboard_current": 0.1}
        for number, one in enumerate(laws(case_of(kind, {}, []), RANGES | {"duty": (-1.0, 1.0)}, sizes)):
            assert one.law is not None
            source = law_file(one, SHAPE, np.linspace(one.law[1][-4], one.law[1][-3], 9), kind, "bench")
            assert source is not None, one.label
            path = tmp_path / f"law_{kind}_{number}.py"
            path.write_text(source)
            assert load_effect_class(f"{path}:FoundLaw").kinds == (kind,)
