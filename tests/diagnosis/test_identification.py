"""`identify`: the stated numbers are calibrated, with effects that are added, and nothing of curves."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.base.errors import EffectError, ParameterError
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.identification import Identification, identify
from tests.diagnosis.made_cases import SMALL_TRUE, small_cell

HEATING = {"self_heating": {"C_th": 60.0, "hA": 0.1}}


@pytest.fixture(scope="module")
def warm() -> Case:
    return small_cell(HEATING, seed=1)


@pytest.fixture(scope="module")
def found(warm: Case) -> Identification:
    return identify(warm, profiles=["capacity_Ah"], add=["self_heating"])


def test_numbers_of_the_case_and_of_added_effects_are_found(found: Identification):
    table = found.to_dataframe().set_index("parameter")
    assert {"self_heating.C_th", "self_heating.hA"} < set(table.index)
    assert not any("curve" in name for name in table.index)
    true = SMALL_TRUE | {"self_heating.C_th": 60.0, "self_heating.hA": 0.1}
    for name, value in true.items():
        assert abs(table.loc[name, "value"] - value) < 4.0 * table.loc[name, "sd"], name
        assert table.loc[name, "sd"] < table.loc[name, "sd_before"]
    shares = [name for name in table.columns if name.startswith("share_of_run") or name == "share_known_before"]
    np.testing.assert_allclose(table[[*shares, "share_of_others_known_before"]].sum(axis=1), 1.0)
    assert found.found.misfit == pytest.approx(1.0, abs=0.1)


def test_a_profile_of_a_well_known_number_is_quadratic(found: Identification):
    (profile,) = found.profiles
    place = found.found.place("capacity_Ah")
    low, high = profile.interval
    assert 0.5 * (high - low) == pytest.approx(found.found.sd[place], rel=0.15)
    assert not profile.is_not_quadratic
    assert any(line.startswith("Profile of capacity_Ah:") for line in found.sentences())


def test_a_model_that_lacks_something_says_so(warm: Case):
    """Its temperature is missed by degrees, for minutes: its bounds are wider than those of noise."""
    without = identify(warm)
    assert without.found.misfit > 3.0
    assert without.summary().startswith("The RMS residual is")
    assert "self_heating.C_th" not in without.found.names


def test_what_is_asked_for_is_said(warm: Case, found: Identification, tmp_path: Path):
    assert found.answer("capacity_Ah").startswith(("Yes: ", "In part: "))
    with pytest.raises(ParameterError, match="not among the unknowns"):
        found.answer("R_0")
    with pytest.raises(EffectError, match="is not a candidate"):
        identify(warm, add=["self_heatin"])
    said = json.loads((found.write(tmp_path, pictures=False) / "identify.json").read_text())
    assert [one["parameter"] for one in said["profiles"]] == ["capacity_Ah"]
    assert [one["text"] for one in said["findings"]] == said["remarks"] == list(found.remarks)


def test_an_exact_number_is_made_uncertain(warm: Case):
    asked = identify(warm, ["rc_resistance_scale"])
    assert asked.found.assumed == ("rc_resistance_scale",)
    assert [one.name for one in asked.profiles] == ["rc_resistance_scale"]
