"""Studies derived from studies: at a point, with arguments replaced, with effects of the user's own."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, Status
from jaxmodel.base.errors import SweepError, UserError
from jaxmodel.case.build import load_effect_class
from jaxmodel.effects import CATALOGUE
from jaxmodel.sensitivity import stated_sd
from jaxmodel.sweeps import Study, read_study, run

EXAMPLES = Path(__file__).parents[2] / "examples"
OWN_EFFECT = f"{EXAMPLES / 'my_effects.py'}:HotContact"


@pytest.fixture(scope="module")
def sampled() -> Study:
    return Study(
        kind="cell",
        metrics=["final_soc"],
        profile={"duration_s": 40, "step_s": 10, "current_A": 2.0, "ambient_degC": 20.0},
        sample={"count": 4, "ranges": {"capacity_Ah": (2.0, 4.0), "current_A": (1.0, 2.0)}},
    )


def test_point_may_lie_in_a_range(sampled: Study) -> None:
    """Of an input and of a parameter; the other ranges stay, and without any range there is no sample."""
    moved = sampled.at({"current_A": 1.7})
    assert moved.prepared.profile.inputs["current_A"].tolist() == [1.7] * 5
    assert moved.varied == ("current_A", "capacity_Ah")
    both = sampled.at({"current_A": 1.7, "capacity_Ah": 2.2})
    assert both.sample is None
    assert both.size == 1
    assert float(both.prepared.model.parameters.capacity_Ah) == 2.2
    assert sampled.prepared.profile.inputs["current_A"].tolist() == [1.5] * 5  # the study itself is as it was


def test_point_of_a_measured_profile(tmp_path: Path) -> None:
    """Steps of a CSV are its rows: the copy does not state step_s either."""
    (tmp_path / "drive.csv").write_text("time_s,current_A\n0,1\n60,2\n", encoding="utf-8")
    study = Study(kind="cell", folder=tmp_path, profile={"csv": "drive.csv"}, axes={"ambient_degC": [0.0, 30.0]})
    moved = study.at({"ambient_degC": 10.0})
    assert moved.prepared.profile.inputs["ambient_degC"].tolist() == [10.0, 10.0]
    assert moved.prepared.profile.inputs["current_A"].tolist() == [1.0, 2.0]


def test_point_has_no_factors(sampled: Study) -> None:
    with pytest.raises(SweepError, match=r"at scale\.current_A: a point has parameters and inputs"):
        sampled.at({"scale.current_A": 2.0})


def test_replaced_arguments_are_checked(sampled: Study) -> None:
    assert sampled.replace(store=["voltage_V"], store_every=2).prepared.stored_time_s.tolist() == [0.0, 20.0, 40.0]
    with pytest.raises(SweepError, match="Did you mean 'voltage_V'"):
        sampled.replace(store=["voltag_V"])


def test_effects_of_the_user_are_known_to_their_study_alone() -> None:
    cls = load_effect_class(OWN_EFFECT)
    fields = {
        "kind": "cell",
        "profile": {"duration_s": 40, "step_s": 10, "current_A": 2.0, "ambient_degC": 20.0},
        "effects": {cls.name: {}},
        "axes": {f"{cls.name}.R_c": [0.0, 0.05]},
        "metrics": ["min_voltage_V"],
    }
    with pytest.raises(UserError, match=cls.name):
        Study(**fields)
    study = Study(**fields, own_effects=[cls])
    without, with_contact = run(study)["min_voltage_V"].to_numpy()
    assert with_contact < without - 2.0 * 0.05 * 0.9
    assert study.replace(title="again").prepared.model.effects[0].name == cls.name
    assert cls.name not in CATALOGUE


def test_effects_of_the_user_are_given_to_the_reader_of_a_file() -> None:
    cls = load_effect_class(OWN_EFFECT)
    file = EXAMPLES.parent / "docs" / "own_effect" / "study.toml"
    with pytest.raises(UserError, match="hot_contact"):
        read_study(file)
    assert read_study(file, own_effects=[cls]).prepared.model.effects[0].label == "hot_contact"


def test_case_in_memory_is_that_of_its_file(tmp_path: Path) -> None:
    """Its parameters, tables, effects and cut-off; the manifest holds them as numbers."""
    frame = pd.DataFrame({"time_s": [0.0, 10.0], "current_A": 1.0, "ambient_degC": 20.0, "voltage_V": 3.9})
    case = Case.from_dataframes(
        {"1C": frame},
        kind="cell",
        parameters={"capacity_Ah": (3.0, 0.03)},
        tables={"ocv": {"soc": [0.0, 1.0], "voltage_V": [3.0, 4.2]}},
        effects={"ocv_hysteresis": {"M_V": 0.02}},
        cutoff={"voltage_V": 3.2},
    )
    case.write(tmp_path / "written")
    fields = {
        "profile": {"duration_s": 7200, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0},
        "axes": {"current_A": [1.0, 2.0]},
    }
    in_memory = run(Study(case=case, **fields))
    of_file = run(Study(case=str(tmp_path / "written"), **fields))
    for name in of_file.data_vars:
        np.testing.assert_array_equal(in_memory[name], of_file[name])
    assert of_file["status"].values.tolist() == [Status.REACHED_CUTOFF] * 2  # that of the case
    content = json.loads(in_memory.attrs["manifest"])["study"]["case"]
    assert content["parameters"] == {"capacity_Ah": 3.0}
    assert content["tables"]["ocv"]["values"] == [3.0, 4.2]
    other = dataclasses.replace(case, cutoff={})
    assert Study(case=case, **fields).digest != Study(case=other, **fields).digest
    assert stated_sd(Study(case=case, **fields)) == {"capacity_Ah": 0.03}
