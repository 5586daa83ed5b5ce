"""The thermal stages of a motor whose iron loses power and whose case warms through the winding."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, parameterise
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

EFFECTS = {"heat_path": {"s": 1.0}, "iron_loss": {"T_h": 0.01, "w_e": 200.0}}


def test_stated_paths_of_heat_give_the_stages_back():
    """Two hours of levels of current and speed and one of rest, in rows of 10 s, with 0.05 K of noise."""
    rng = np.random.default_rng(7)
    time = np.arange(0.0, 10_801.0, 10.0)
    current, speed = (np.repeat(rng.uniform(0.2, 1.0, 37), 30)[: time.size] * (time < 7200.0) for _ in range(2))
    inputs = {"current_A": 8.0 * current, "speed_rad_s": 500.0 * speed, "ambient_degC": 0.0 * time + 22.0}
    effects = tuple(CATALOGUE[name](**numbers) for name, numbers in EFFECTS.items())
    found = simulate(Model("motor", Parameters(), effects=effects), Profile(time, inputs)).readings
    names = ("winding_temperature_degC", "case_temperature_degC")
    warm = {name: np.asarray(found[name]) + rng.normal(0.0, 0.05, time.size) for name in names}
    known = {"R_0": 0.103, "k_tau": 0.0385, "tau_0": 0.01}
    frame = pd.DataFrame({"time_s": time, **inputs, **warm})
    true = {"R_wc": 1.2, "R_ca": 3.8, "tau_wc": 71.7, "tau_ca": 1370.0}
    values = []
    for stated in (EFFECTS, {}):
        case = Case.from_dataframes({"run": frame}, kind="motor", load="unknown", parameters=known, effects=stated)
        values.append({one.name: one.value for one in parameterise(case, progress=False).extractions})
    with_paths, without = values
    for name, value in true.items():
        assert with_paths[name] == pytest.approx(value, rel=0.03), name
    assert without["R_ca"] > 1.1 * true["R_ca"]  # the heat of the iron is taken for that of the winding
