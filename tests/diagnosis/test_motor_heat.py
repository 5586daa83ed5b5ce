"""A motor whose iron loses power, whose case follows its winding, or whose bearings drag: each is named."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, diagnose
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

NOISE = {"current_A": 0.05, "speed_rad_s": 0.5, "winding_temperature_degC": 0.1, "case_temperature_degC": 0.1}
STATED = {"R_wc": 1.2, "R_ca": 3.8, "tau_wc": 71.7, "tau_ca": 1370.0, "tau_0": 0.01}


def made_case(name: str, numbers: dict[str, float]) -> Case:
    """Three runs of half an hour, voltage and load in levels of a minute, the last one held out."""
    effects = (CATALOGUE[name](**numbers),) if name else ()
    rng, frames = np.random.default_rng(4), {}
    for run in "abc":
        time = np.arange(0.0, 1801.0, 3.0)
        levels, loads = (np.repeat(rng.uniform(low, 1.0, 31), 20)[: time.size] for low in (0.15, 0.0))
        inputs = {"voltage_V": 24.0 * levels, "load_torque_Nm": 0.25 * loads, "ambient_degC": 0.0 * time + 22.0}
        read = simulate(Model("motor", effects=effects), Profile(time, inputs)).readings
        noisy = {column: np.asarray(read[column]) + rng.normal(0.0, sd, time.size) for column, sd in NOISE.items()}
        frames[run] = pd.DataFrame({"time_s": time, **inputs, **noisy})
    parameters = {name: (value, 0.2 * value) for name, value in STATED.items()}
    parameters |= {"R_0": (0.103, 0.005), "k_tau": (0.0385, 0.001)}
    return Case.from_dataframes(
        frames, kind="motor", load="measured", check=["c"], parameters=parameters, sensors=NOISE
    )


@pytest.mark.slow("-numbers3", "heat_path-numbers1", "viscous_friction-numbers2")
@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("iron_loss", {"T_h": 0.012, "w_e": 200.0}),
        ("heat_path", {"s": 1.0}),
        ("viscous_friction", {"b": 6e-5}),
        ("", {}),
    ],
)
def test_what_warms_which_part_is_named_with_its_size(name: str, numbers: dict[str, float]):
    """Iron loss and viscous friction drag alike; where their heat goes tells them apart."""
    found = diagnose(made_case(name, numbers), progress=False)
    assert [one.label for one in found.effects] == ([name] if name else [])
    assert found.verdict == ("missing_effect" if name else "adequate")
    for field, value in numbers.items():
        parameter = found.effects[0].parameters[field]
        assert abs(parameter.value - value) < max(4.0 * parameter.sd, 0.01 * value), field
