"""The torque of a load from current and speed: against a simulated load, and what its band holds."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.records import Case
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate
from jaxmodel.operation.load import estimate_load, group_of, pooled, sides, smoothed

NOISE = {"current_A": 0.05, "speed_rad_s": 0.5}
TIME_S = np.arange(0.0, 20.0, 0.01)
ASKED = 0.1 + 0.05 * np.sign(np.sin(TIME_S)) + 0.02 * np.sin(5.0 * TIME_S)


def frame(asked: np.ndarray, seed: int, k_tau: float = 0.0385) -> pd.DataFrame:
    inputs = {"voltage_V": 12.0 + 3.0 * np.sin(0.7 * TIME_S), "ambient_degC": np.full(TIME_S.size, 20.0)}
    profile = Profile(TIME_S, inputs | {"load_torque_Nm": asked})
    read = simulate(Model("motor", Parameters(k_tau=k_tau)), profile).readings
    random = np.random.default_rng(seed)
    noisy = {name: np.asarray(read[name]) + random.normal(0.0, sd, TIME_S.size) for name, sd in NOISE.items()}
    return pd.DataFrame({"time_s": TIME_S, **inputs, **noisy})


def case(frames: dict[str, pd.DataFrame], name: str = "motor", **more) -> Case:
    stated = {"k_tau": (0.0385, 0.001)} | more
    return Case.from_dataframes(frames, kind="motor", load="unknown", name=name, parameters=stated, sensors=NOISE)


@pytest.fixture(scope="module")
def left() -> Case:
    return case({"road_1": frame(ASKED, 1), "sand_1": frame(2.0 * ASKED, 2)}, "left")


def test_the_torque_is_that_of_the_load_and_within_its_band(left):
    for run, asked in zip(estimate_load(left).runs, (ASKED, 2.0 * ASKED), strict=True):
        off = (run.table["load_torque_Nm"].to_numpy() - asked)[50:]
        assert np.sqrt(np.mean(off**2)) < 0.1 * np.sqrt(np.mean(asked**2))
        assert np.mean(np.abs(off) < 2.0 * run.table["sd_Nm"].to_numpy()[50:]) > 0.9


def test_a_current_that_was_not_read_is_that_of_the_model(left):
    frames = {name: table.drop(columns="current_A") for name, table in left.to_dataframes().items()}
    without = Case.from_dataframes(
        frames, kind="motor", load="unknown", parameters={"k_tau": (0.0385, 0.001)}, sensors={"speed_rad_s": 0.5}
    )
    torque = estimate_load(without).runs[0].table["load_torque_Nm"].to_numpy()
    assert np.mean(torque[50:]) == pytest.approx(np.mean(ASKED), rel=0.1)


def test_groups_powers_and_energy_per_metre():
    road = case({"road_1": frame(ASKED, 1)}, wheel_radius_m=0.1, gear_ratio=50.0)
    (row,) = estimate_load(road).by_group().to_dict("records")
    table = road.to_dataframes()["road_1"]
    metres = np.trapezoid(table["speed_rad_s"], TIME_S) * 0.1 / 50.0
    energy = np.trapezoid(table["voltage_V"] * table["current_A"], TIME_S)
    assert row["J_per_m"] == pytest.approx(energy / metres, rel=1e-3)
    assert row["work_W"] < row["drawn_W"]
    assert row["torque_Nm"] == pytest.approx(np.mean(ASKED), rel=0.05)


def test_a_side_that_is_worse_is_told(left):
    right = case({"road_1": frame(1.3 * ASKED, 3), "sand_1": frame(2.6 * ASKED, 4)}, "right")
    table = sides([estimate_load(left), estimate_load(right)])
    assert table["ratio"].to_numpy() == pytest.approx(1.3, abs=0.08)
    assert set(table["group"]) == {"road", "sand"}
    mean, sd = pooled(table)
    assert mean == pytest.approx(1.3, abs=0.08)
    assert 0.0 < sd < table["sd"].max()


def test_two_motors_of_one_case_are_compared_by_ground():
    frames = {"road_1_left": frame(ASKED, 1), "road_1_right": frame(1.3 * ASKED, 3)}
    runs = {name: {"specimen": name.rpartition("_")[2]} for name in frames}
    both = Case.from_dataframes(frames, kind="motor", load="unknown", sensors=NOISE, runs=runs)
    parts = both.of_specimens()
    assert list(parts) == ["left", "right"]
    table = sides([estimate_load(one) for one in parts.values()])
    assert table[["group", "motor"]].to_numpy().tolist() == [["road", "right"]]
    assert table["ratio"].to_numpy() == pytest.approx(1.3, abs=0.08)
    assert both.runs[0].specimen == parts["left"].runs[0].specimen == "left"


def test_a_law_of_the_case_does_not_load_what_is_estimated():
    """The torque of a propeller is found whether the case calls it one or not."""
    speed = estimate_load(case({"a": frame(ASKED, 1)})).runs[0].table["load_torque_Nm"]
    tables = {"a": frame(ASKED, 1)}
    lawful = Case.from_dataframes(
        tables, kind="motor", load="propeller", parameters={"k_tau": (0.0385, 0.001)}, sensors=NOISE
    )
    np.testing.assert_allclose(estimate_load(lawful).runs[0].table["load_torque_Nm"], speed)


def test_the_common_share_is_that_of_the_torque_constant(left):
    estimate = estimate_load(left)
    assert estimate.runs[0].common == pytest.approx(0.001 / 0.0385)
    unstated = Case.from_dataframes({"a": frame(ASKED, 1)}, kind="motor", load="unknown")
    assert estimate_load(unstated).runs[0].common == pytest.approx(0.3)


def test_at_standstill_dry_friction_hides_what_it_can():
    standing = pd.DataFrame({"time_s": TIME_S, "voltage_V": 0.02, "current_A": 0.2, "speed_rad_s": 0.0})
    standing.loc[1000:, "speed_rad_s"] = 50.0
    table = estimate_load(case({"a": standing.assign(ambient_degC=20.0)})).runs[0].table
    assert table["sd_Nm"].iloc[:900].min() > 0.01 / 2.0


def test_a_pause_begins_anew():
    time_s = np.append(TIME_S[:1000], TIME_S[:1000] + 5000.0)
    torque = np.repeat([0.1, 0.3], 1000)
    speed = 100.0 + np.random.default_rng(5).normal(0.0, 0.1, 2000)
    found, sd, _ = smoothed(time_s, speed, torque, 0.1, 0.01, 5e-5)
    assert found[990] == pytest.approx(0.1, abs=0.02)
    assert found[1010] == pytest.approx(0.3, abs=0.02)
    assert np.all(np.isfinite(sd))


@pytest.mark.parametrize(("name", "group"), [("asphalt_01", "asphalt"), ("run-3", "run"), ("07", "07"), ("ice", "ice")])
def test_groups_are_names_without_their_numbers(name: str, group: str):
    assert group_of(name) == group


def test_a_case_without_a_speed_is_refused():
    frame = pd.DataFrame({"time_s": TIME_S, "voltage_V": 12.0, "current_A": 1.0, "load_torque_Nm": 0.1})
    no_speed = Case.from_dataframes({"a": frame.assign(ambient_degC=20.0)}, kind="motor")
    with pytest.raises(MeasurementError, match="add the column speed_rad_s"):
        estimate_load(no_speed)
