"""Missions: torque and duty of a segment, the three limits, and the messages for a wrong file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.base.errors import SweepError, UserError
from jaxmodel.case.build import preset_model
from jaxmodel.model.cell import storage_factor
from jaxmodel.operation.compensation import Compensation, Reference, Runs
from jaxmodel.operation.mission import (
    LIMITS,
    NOT_REACHED,
    Limits,
    Mission,
    Segment,
    drive,
    endurance,
    mission_profile,
    read_mission,
    run_mission,
)

MODEL = preset_model("paper", "robot")
STEP_S = 60.0


def steady(speed_m_s: float = 0.1) -> Mission:
    return Mission(step_s=STEP_S, segment=[Segment(duration_s=600, speed_m_s=speed_m_s)])


def test_torque_is_that_of_eq_18() -> None:
    torque, _ = drive(Segment(duration_s=60, speed_m_s=0.1, surface="gravel", incline_deg=20.0), MODEL)
    angle = np.deg2rad(20.0)
    force = 40.0 * 9.81 * (0.6 * np.cos(angle) + np.sin(angle))
    assert torque == pytest.approx(force * 0.1 / (156.0 * 0.94), rel=1e-9)


def test_robot_at_rest_asks_for_nothing_of_its_motors() -> None:
    assert drive(Segment(duration_s=60, incline_deg=30.0), MODEL) == (0.0, 0.0)


def test_segments_follow_each_other_round_after_round() -> None:
    plan = Mission(step_s=10, segment=[Segment(duration_s=30, speed_m_s=0.1), Segment(duration_s=20)])
    profile = mission_profile(plan, MODEL, 2)
    moving = profile.inputs["duty"] > 0.0
    assert profile.time_s[-1] == 100.0
    # Row 0 is the start; the inputs of a row hold since the row before.
    assert moving.tolist() == [True, *([True] * 3 + [False] * 2) * 2]


@pytest.fixture(scope="module")
def profile():
    return mission_profile(steady(), MODEL, 24)


def test_charge_ends_it_when_the_pace_says_so(profile) -> None:
    """At a constant draw: (1 - 0.1) Q / i, with i of eqs. 12, 14 and 21."""
    p = MODEL.parameters
    torque, duty = drive(steady().segment[0], MODEL)
    draw = float(2.0 * duty * (torque + p.tau_0) / p.k_tau + p.onboard_current_A)
    lanes = {"ambient_degC": np.array([20.0, 40.0]), "capacity_Ah": np.full(2, 5.2)}
    result = run_mission(MODEL, profile, lanes, Limits(cell_V=0.0, winding_degC=1e3))
    assert [LIMITS[limit] for limit in result.limit] == ["charge", "charge"]
    expected = 0.9 * 5.2 * 3600.0 * float(storage_factor(p.storage_months, p.storage_temperature_degC)) / draw
    assert np.all((result.time_s >= expected) & (result.time_s <= expected + 1.5 * STEP_S))
    # The duty holds the speed at the nominal voltage: under load the pack is below it, more so where it is colder.
    speed = result.distance_m / result.time_s
    assert 0.08 < speed[0] < speed[1] < 0.1


def test_earliest_limit_is_named(profile) -> None:
    lanes = {"ambient_degC": np.array([20.0, 90.0]), "capacity_Ah": np.full(2, 5.2)}
    by_winding = run_mission(MODEL, profile, lanes, Limits(cell_V=0.0, winding_degC=91.0))
    assert [LIMITS[limit] for limit in by_winding.limit] == ["charge", "winding"]
    assert by_winding.time_s[1] == by_winding.each_s["winding"][1] < by_winding.each_s["charge"][0]
    by_voltage = run_mission(MODEL, profile, lanes, Limits(cell_V=3.7, winding_degC=1e3))
    assert LIMITS[by_voltage.limit[0]] == "voltage"
    assert by_voltage.time_s[0] < by_winding.time_s[0]


def test_mission_that_nothing_ends_is_not_ended(profile) -> None:
    lanes = {"ambient_degC": np.array([20.0, 20.0]), "capacity_Ah": np.array([5.2, 500.0])}
    result = run_mission(MODEL, profile, lanes)
    assert result.limit[0] != NOT_REACHED
    assert result.limit[1] == NOT_REACHED
    assert result.time_s[1] == profile.time_s[-1]
    assert all(np.isinf(times[1]) for times in result.each_s.values())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[segment]]\nduration_s = 10\nsurface = "gravle"\n', "gravel"),
        ("[[segment]]\nspeed_m_s = 0.1\n", "duration_s"),
        ("title = 3", "m.toml"),
        ("title = ", "valid TOML"),
    ],
)
def test_wrong_mission_is_said_in_a_sentence(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    with pytest.raises(UserError, match=said):
        read_mission(tmp_path / "m.toml")


def test_segment_that_is_too_fast_is_refused() -> None:
    with pytest.raises(SweepError, match="duty of"):
        mission_profile(steady(speed_m_s=2.0), MODEL, 1)


def test_segment_between_steps_is_refused(tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text("step_s = 60\n[[segment]]\nduration_s = 20\n", encoding="utf-8")
    with pytest.raises(SweepError, match="segment 1 lasts 20 s, no whole number of steps of 60 s"):
        read_mission(tmp_path / "m.toml")


def test_endurance_over_ambient_and_age_is_that_of_each_lane(profile) -> None:
    ages = {"new": (0.0, 0.0), "old": (36.0, 200.0)}
    data = endurance(MODEL, steady(), np.array([0.0, 40.0]), ages, longest_h=4.0)
    alone = run_mission(
        MODEL,
        profile,
        {"ambient_degC": np.array([40.0]), "storage_months": np.array([36.0]), "cycles": np.array([200.0])},
    )
    lane = data.sel(ambient_degC=40.0, age="old")
    assert float(lane["time_s"]) == alone.time_s[0] < float(data["time_s"].sel(ambient_degC=40.0, age="new"))
    assert str(lane["ended_by"].item()) == LIMITS[alone.limit[0]]
    assert float(lane[f"until_{lane['ended_by'].item()}_s"]) == float(lane["time_s"])
    assert float(lane["distance_m"]) == alone.distance_m[0]


def test_duty_held_down_to_a_map_lasts_longer_and_drives_slower() -> None:
    """A map of half the duty that the mission drives with: the draw of the motors is halved (eq. 14)."""
    torque, duty = drive(steady().segment[0], MODEL)
    ambient, torques = np.array([0.0, 40.0]), np.array([0.5, 2.0]) * torque
    runs = Runs(np.ones((2, 2)), np.ones((2, 2)))
    half = Compensation(Reference(), -2e-4, ambient, torques, np.full((2, 2), 0.5 * duty), runs, runs)
    limits = Limits(cell_V=0.0, winding_degC=1e3)
    plain, held = (
        endurance(MODEL, steady(), np.array([20.0]), limits=limits, compensation=map_, longest_h=12.0)
        for map_ in (None, half)
    )
    p = MODEL.parameters
    motors = float(2.0 * duty * (torque + p.tau_0) / p.k_tau)
    ratio = float((motors + p.onboard_current_A) / (0.5 * motors + p.onboard_current_A))
    assert float(held["time_s"][0, 0] / plain["time_s"][0, 0]) == pytest.approx(ratio, rel=0.02)
    assert float(held["distance_m"][0, 0] / held["time_s"][0, 0]) < 0.06
    assert plain["age"].values.tolist() == [f"{float(p.storage_months):g} months, {float(p.cycles):g} cycles"]


@pytest.mark.parametrize(
    ("age", "message"),
    [((-1.0, 0.0), "age 'wrong': .*storage_months"), ((1e4, 0.0), "age 'wrong': .*outside its range")],
)
def test_age_that_leaves_no_pack_is_a_mistake(age: tuple[float, float], message: str) -> None:
    with pytest.raises(UserError, match=message):
        endurance(MODEL, steady(), np.array([20.0]), {"wrong": age})
