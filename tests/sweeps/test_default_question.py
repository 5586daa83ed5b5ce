"""What a study of the paper's robot is asked for first: how long it drives, how far, at which cost per metre."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jaxmodel import Status, read_case, sweeps

REPOSITORY = Path(__file__).parents[2]
PROFILE = {"duration_s": 14_400, "step_s": 2, "duty": 0.3, "ambient_degC": 20.0}
LOADS = [0.1, 0.2, 0.3]


@pytest.fixture(scope="module")
def driven():
    return sweeps.run(sweeps.Study(kind="robot", profile=PROFILE, axes={"load_torque_Nm": LOADS}))


def test_the_robot_drives_until_its_pack_is_at_its_cut_off(driven):
    """2.7 V of each of six cells; a larger load gets there sooner."""
    assert set(driven["status"].values.tolist()) == {Status.REACHED_CUTOFF}
    assert np.all(np.diff(driven["time_to_cutoff_s"]) < 0.0)
    np.testing.assert_allclose(driven["min_pack_voltage_V"], 6 * 2.7, rtol=0.01)
    assert float(driven["min_pack_voltage_V"].max()) < 6 * 2.7


def test_distance_and_cost_are_those_of_the_time_that_it_drives(driven):
    """Way = mean speed x time x r / G; energy per metre = energy / way. A larger load costs more."""
    metres = driven["mean_speed_rad_s"] * driven["time_to_cutoff_s"] * 0.1 / 156.0
    np.testing.assert_allclose(driven["distance_m"], metres, rtol=1e-9)
    joules = 3600.0 * driven["delivered_energy_Wh"]
    np.testing.assert_allclose(driven["energy_per_metre_J"], joules / metres, rtol=1e-9)
    assert np.all(np.diff(driven["energy_per_metre_J"]) > 0.0)


def test_a_way_back_counts_too():
    mission = [
        {"duration_s": 60, "duty": 0.3, "load_torque_Nm": 0.1},
        {"duration_s": 60, "duty": -0.3, "load_torque_Nm": -0.1},
    ]
    found = sweeps.run(
        sweeps.Study(kind="robot", profile={"mission": mission, "ambient_degC": 20.0}, axes={"cycles": [0.0]})
    )
    one_way = sweeps.run(
        sweeps.Study(kind="robot", profile={"mission": mission[:1], "ambient_degC": 20.0}, axes={"cycles": [0.0]})
    )
    assert abs(float(found["mean_speed_rad_s"][0])) < 2.0  # it starts once and turns once
    assert float(found["distance_m"][0]) == pytest.approx(2.0 * float(one_way["distance_m"][0]), rel=0.02)


@pytest.mark.parametrize(
    ("fields", "ends"),
    [
        ({"kind": "cell"}, 2.7),
        ({"kind": "cell", "cutoff": {}}, None),
        ({"kind": "cell", "cutoff": {"voltage_V": 3.3}}, 3.3),
        ({"kind": "cell", "preset": "k2_lfp_26650"}, None),
    ],
    ids=["of the paper", "none asked for", "its own", "a preset without one"],
)
def test_where_a_lane_ends(fields: dict[str, Any], ends: float | None):
    profile = {"duration_s": 60, "step_s": 10, "ambient_degC": 20.0}
    made = sweeps.Study(**fields, profile=profile, axes={"current_A": [1.0]})
    for one in (made, made.replace(title="a copy"), made.at({"cycles": 3.0})):
        cutoff = one.prepared.cutoff
        assert (cutoff is None) if ends is None else (cutoff is not None and float(cutoff.voltage_V) == ends)


def test_a_case_ends_only_where_it_says():
    case = read_case(REPOSITORY / "examples" / "samsung_30q")
    profile = {"duration_s": 60, "step_s": 10, "ambient_degC": 20.0}
    assert sweeps.Study(case=case, profile=profile, axes={"current_A": [1.0]}).prepared.cutoff is None
