"""What a case says of a load that is not measured: columns, laws, free numbers, and what contradicts itself."""

from __future__ import annotations

from typing import get_args, get_type_hints

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import case_model
from jaxmodel.case.forms import CaseEntry
from jaxmodel.case.load import law_torque
from jaxmodel.case.measurements import COLUMNS_OF_LAWS
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.effects.loads import LAWS
from jaxmodel.model.declaration import describe

TIME_S = np.arange(0.0, 1.0, 0.1)


def test_a_law_has_its_columns_its_torque_and_its_word_in_a_case():
    assert set(COLUMNS_OF_LAWS) == set(LAWS)
    words = get_args(get_args(get_type_hints(CaseEntry)["load"])[0])
    assert set(words) == {"measured", "unknown", *LAWS}
    assert all(law is None or not law.free or law.free in describe(law) for law in LAWS.values())


def made(load: str | None = None, effects=None, kind: str = "motor", **columns) -> Case:
    inputs = {"voltage_V": 12.0} if kind == "motor" else {"current_A": 1.0}
    frame = pd.DataFrame({"time_s": TIME_S, "ambient_degC": 20.0, **inputs, **columns})
    return Case.from_dataframes({"a": frame}, kind=kind, load=load, effects=effects)


def test_a_speed_drives_the_model_where_no_torque_is_measured():
    case = made(speed_rad_s=100.0, current_A=1.0)
    assert set(case.runs[0].measured.inputs) == {"voltage_V", "speed_rad_s", "ambient_degC"}
    assert set(case.runs[0].measured.outputs) == {"current_A"}


def test_a_measured_torque_comes_before_a_speed():
    case = made(speed_rad_s=100.0, load_torque_Nm=0.1)
    assert "load_torque_Nm" in case.runs[0].measured.inputs
    assert "speed_rad_s" in case.runs[0].measured.outputs


def test_a_law_makes_the_speed_a_reading_and_its_number_free():
    case = made("propeller", speed_rad_s=100.0)
    assert "speed_rad_s" in case.runs[0].measured.outputs
    c = case.effects["propeller_load"]["c"]
    assert case.effect_sd["propeller_load"]["c"] == c > 0.0
    assert "propeller_load" in {effect.name for effect in case_model(case).effects}


def test_a_stated_number_is_exact_and_says_the_law():
    case = made(effects={"gravity_load": {"mass_kg": 0.5, "arm_m": 0.1}}, speed_rad_s=0.0, position_rad=0.3)
    assert case.load == "gravity"
    assert case.effect_sd == {}
    (effect,) = case_model(case, case.runs[0]).effects
    assert float(effect.initial_position_rad) == 0.3


def test_a_free_shaft_has_no_load_and_needs_no_column():
    case = made("free", speed_rad_s=100.0)
    assert case.effects == {}
    assert "load_torque_Nm" not in case.runs[0].measured.inputs


def test_the_torque_of_a_law_along_a_run():
    case = made("rolling", speed_rad_s=100.0, incline_deg=5.0)
    torque = law_torque(case, case.runs[0], np.full(TIME_S.size, 100.0), np.zeros(TIME_S.size))
    p = case_model(case).parameters
    slope = np.deg2rad(5.0)
    force = float(p.mass_kg) * 9.81 * (np.sin(slope) + float(p.friction_coefficient) * np.cos(slope))
    assert torque.known == pytest.approx(force * float(p.wheel_radius_m / (p.gear_ratio * p.drive_efficiency)))
    assert torque.per_unit is None


@pytest.mark.parametrize(
    ("arguments", "columns", "parts"),
    [
        ({"load": "free", "kind": "cell"}, {}, ["a cell turns nothing", "remove load"]),
        ({"load": "free", "effects": {"propeller_load": {}}}, {}, ["two laws of one load", "keep one"]),
        ({"load": "wind"}, {}, ["load must be", '"propeller"']),
        ({"load": "measured"}, {"speed_rad_s": 1.0}, ["needs one of the columns 'load_torque_Nm'"]),
        ({"load": "propeller"}, {"position_rad": 1.0}, ["no column 'position_rad'"]),
    ],
)
def test_what_contradicts_itself_is_one_sentence(arguments, columns, parts):
    with pytest.raises(MeasurementError) as error:
        made(**arguments, **columns)
    for part in parts:
        assert part in str(error.value)


def test_a_case_with_a_law_reads_back_as_it_was_written(tmp_path):
    case = made("gravity", {"gravity_load": {"arm_m": 0.2}}, speed_rad_s=0.0, position_rad=0.1)
    case.write(tmp_path / "case")
    again = read_case(tmp_path / "case")
    assert (again.load, again.effects, again.effect_sd) == (case.load, case.effects, case.effect_sd)
