"""A found law becomes an effect in a file, where a port can carry it: what it adds, it adds."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from discrepancy.law_file import law_file
from discrepancy.misfit import Block
from jaxmodel.build import load_effect_class
from jaxmodel.model import Model
from jaxmodel.profile import Profile
from jaxmodel.simulate import simulate
from tests.jaxmodel.runs import staircase


def block(port: str, channel: str, variable: str, multiplier: str = "") -> Block:
    knots = np.array([0.0, 500.0, 1000.0]) if variable == "time_s" else np.array([-400.0, 0.0, 400.0])
    return Block(channel, multiplier, variable, 1e3, 3, 0.0, knots, 0.01 * knots / knots.max(), 1e3, "N m", port)


def drive(**changed: np.ndarray) -> dict[str, np.ndarray]:
    time = np.arange(200.0)
    inputs = {
        "voltage_V": staircase(1, 200, 12.0),
        "load_torque_Nm": np.full(200, 0.05),
        "ambient_degC": 0.0 * time + 20,
    }
    return {"time_s": time, **inputs, **changed}


def run(model: Model, given: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    inputs = {name: values for name, values in given.items() if name != "time_s"}
    return {k: np.asarray(v) for k, v in simulate(model, Profile(given["time_s"], inputs)).readings.items()}


def test_a_torque_that_grows_with_time_is_that_torque(tmp_path):
    source = law_file(block("load_torque", "the torque balance (eq. 13)", "time_s"), "motor", "bench")
    assert source is not None
    path = tmp_path / "found_law.py"
    path.write_text(source)
    effect = load_effect_class(f"{path}:FoundLaw")(s=jnp.asarray(2.0))
    given = drive()
    found = run(Model("motor", effects=(effect,)), given)
    grown = drive(load_torque_Nm=0.05 + 2.0 * 0.01 * (given["time_s"] - 0.5) / 1000.0)  # of the middle of each row
    expected = run(Model("motor"), grown)
    np.testing.assert_allclose(found["speed_rad_s"], expected["speed_rad_s"], rtol=0.0, atol=2e-2)
    np.testing.assert_allclose(found["current_A"], expected["current_A"], rtol=0.0, atol=2e-3)
    assert np.max(np.abs(found["speed_rad_s"] - run(Model("motor"), given)["speed_rad_s"])) > 0.1


@pytest.mark.parametrize(
    ("found", "kind"),
    [
        (block("duty", "the duty of the bridge (eq. 14)", "motor_current_A"), "robot"),  # no port
        (block("", "speed_rad_s", "voltage_V"), "motor"),  # of a channel, so in no equation
        (block("motor_loss", "the winding's heat (eq. 16)", "load_torque_Nm"), "motor"),  # not known at that port
    ],
)
def test_what_no_port_can_carry_has_no_file(found: Block, kind: str):
    assert law_file(found, kind, "bench") is None
