"""Wear of a motor over its runs: found where it is made, and not where it is not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import FitError
from jaxmodel.case.records import Case
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate
from jaxmodel.operation.wear import trend

TIME_S = np.arange(0.0, 20.0, 0.02)
NOISE = {"current_A": 0.05, "speed_rad_s": 0.5}
TRUE = {"k_tau": 0.0385, "J": 5.42e-5}


def frame(seed: int, load: float = 0.0, **changed: float) -> pd.DataFrame:
    inputs = {"voltage_V": 12.0 + 6.0 * np.sin(0.7 * TIME_S), "ambient_degC": np.full(TIME_S.size, 20.0)}
    inputs["load_torque_Nm"] = np.full(TIME_S.size, load)
    read = simulate(Model("motor", Parameters(**changed)), Profile(TIME_S, inputs)).readings
    random = np.random.default_rng(seed)
    noisy = {name: np.asarray(read[name]) + random.normal(0.0, sd, TIME_S.size) for name, sd in NOISE.items()}
    return pd.DataFrame({"time_s": TIME_S, **inputs, **noisy}).iloc[100:]


def case(frames: dict[str, pd.DataFrame], load: str = "measured", **more) -> Case:
    return Case.from_dataframes(frames, kind="motor", load=load, name="motor", parameters=TRUE | more)


def test_a_friction_that_grows_is_told_and_nothing_else_is():
    grown = np.linspace(0.02, 0.03, 8)
    found = trend(case({f"day_{day}": frame(day, tau_0=float(tau)) for day, tau in enumerate(grown)}))
    lines = {one.name: one for one in found.trends}
    assert lines["friction"].told
    assert lines["friction"].slope == pytest.approx((0.03 - 0.02) / 7, rel=0.05)
    assert lines["friction"].points["value"].to_numpy() == pytest.approx(grown, rel=0.05)
    assert not lines["R_0"].told
    assert not lines["k_tau"].told
    assert "friction rises by 4" in found.summary()


def test_a_motor_that_does_not_wear_is_not_said_to():
    told = [
        one.name
        for start in (0, 100, 200)
        for one in trend(case({f"day_{day}": frame(start + day) for day in range(5)})).trends
        if one.told
    ]
    assert told == []


def test_a_resistance_that_rises_is_over_the_cycles_that_are_stated():
    cycles = [0.0, 100.0, 200.0, 400.0, 600.0, 800.0, 900.0, 1000.0]
    frames = {f"at_{n:.0f}": frame(int(n), R_0=0.103 * (1.0 + 5e-4 * n)) for n in cycles}
    runs = {name: {"cycles": n} for name, n in zip(frames, cycles, strict=True)}
    worn = Case.from_dataframes(frames, kind="motor", load="measured", parameters=TRUE, runs=runs)
    (line,) = [one for one in trend(worn).trends if one.name == "R_0"]
    assert line.over == "cycles"
    assert line.told
    assert line.slope == pytest.approx(0.103 * 5e-4, rel=0.1)


def test_under_an_unknown_load_the_friction_is_not_followed():
    frames = {f"day_{day}": frame(day).drop(columns="load_torque_Nm") for day in range(5)}
    found = trend(case(frames, load="unknown"))
    assert "friction" not in {one.name for one in found.trends}
    assert "it needs a current, and a load" in found.missing["friction"]


def test_loads_in_order_are_not_wear():
    """A friction that is a share of the load looks like wear where each run has more load than the one before."""
    frames = {f"load_{n}": frame(n, load=0.02 * n, tau_0=0.01 + 0.004 * n) for n in range(6)}
    (line,) = [one for one in trend(case(frames)).trends if one.name == "friction"]
    assert line.chance < 0.003
    assert line.confounded == "load_torque_Nm"
    assert not line.told
    assert "not told apart" in line.sentence()


def test_a_trend_is_of_one_motor():
    frames = {f"day_{day}_{side}": frame(day) for day in range(4) for side in ("left", "right")}
    runs = {name: {"specimen": name.rpartition("_")[2]} for name in frames}
    both = Case.from_dataframes(frames, kind="motor", load="measured", parameters=TRUE, runs=runs)
    with pytest.raises(FitError, match=r"its runs are of 2 motors \(left, right\)"):
        trend(both)
    assert len(trend(both.of_specimens()["left"]).trends[0].points) == 4


def test_three_runs_tell_no_trend():
    with pytest.raises(FitError, match="3 runs tell no trend"):
        trend(case({f"day_{day}": frame(day) for day in range(3)}))
