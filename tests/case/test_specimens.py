"""Several motors or cells in one case: what they share, what each has of its own, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import EffectError, MeasurementError, ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.known import Known
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.case.specimens import in_words

TIME_S = np.arange(0.0, 5.0, 0.1)
FRAME = pd.DataFrame(
    {"time_s": TIME_S, "voltage_V": 12.0, "load_torque_Nm": 0.02, "ambient_degC": 20.0, "current_A": 1.0}
)


def two(specimens=None, runs=None, **more) -> Case:
    runs = {"a": {"specimen": "left"}, "b": {"specimen": "right"}} if runs is None else runs
    return Case.from_dataframes(
        {"a": FRAME, "b": FRAME}, kind="motor", name="two", runs=runs, specimens=specimens, **more
    )


def resistances(case: Case) -> list[float]:
    models = [case_model(case, run) for run in case.runs]
    return [float(model.parameters.R_0) for model in models]


def test_runs_of_one_hardware_have_no_specimen():
    case = two(runs={})
    assert ([run.specimen for run in case.runs], case.specimens) == (["", ""], {})


def test_a_parameter_of_its_own_holds_in_its_runs_alone_and_one_of_a_run_comes_first():
    case = two({"right": {"R_0": (0.2, 0.01)}}, parameters={"R_0": 0.1})
    assert resistances(case) == [0.1, 0.2]
    assert case.specimens["right"].parameters == {"R_0": Known(0.2, 0.01)}
    runs = {"a": {"specimen": "left"}, "b": {"specimen": "right", "R_0": 0.3}}
    assert resistances(two({"right": {"R_0": 0.2}}, runs, parameters={"R_0": 0.1})) == [0.1, 0.3]


def test_a_difference_of_one_is_at_its_null_in_the_others():
    case = two({"right": {"effects": {"resistance_difference": {"s": 0.3}}}})
    effects = [case_model(case, run).effects for run in case.runs]
    assert [[(one.label, float(one.s)) for one in some] for some in effects] == [
        [("resistance_difference", 0.0)],
        [("resistance_difference", 0.3)],
    ]
    speeds = [one.table["speed_rad_s"].to_numpy()[-1] for one in simulate_case(case, progress=False)]
    alone = simulate_case(two(runs={}), progress=False)[0].table["speed_rad_s"].to_numpy()[-1]
    assert speeds[0] == pytest.approx(alone, rel=1e-9)
    assert speeds[1] < alone - 0.3


def test_a_case_of_several_is_read_as_it_was_written(tmp_path: Path):
    own = {
        "k_tau": (0.04, 0.001),
        "effects": {
            "resistance_difference": {"s": (0.3, 0.02)},
            "thermometer_difference": {"column": "winding_temperature_degC", "c": 2.0},
        },
    }
    case = two({"right": own})
    again = read_case(case.write(tmp_path / "case"))
    assert [run.specimen for run in again.runs] == ["left", "right"]
    for name, specimen in case.specimens.items():
        assert vars(again.specimens[name]) == vars(specimen)


@pytest.mark.parametrize(
    ("specimens", "runs", "error", "words"),
    [
        ({"middle": {}}, None, MeasurementError, "specimens.middle is of no run"),
        ({"rigth": {}}, None, MeasurementError, "Did you mean 'right'?"),
        ({}, {"a": {"specimen": "left"}}, MeasurementError, "some runs state their specimen and others do not"),
        ({"left": {"R_O": 1.0}}, None, MeasurementError, "knows no 'R_O'. Did you mean 'R_0'?"),
        ({"left": {"R_0": -1.0}}, None, ParameterError, "outside its range"),
        ({"left": {"effects": {"windage": {}}}}, None, MeasurementError, "effects knows no 'windage'"),
        ({"left": {"effects": {"resistance_difference": {"r": 1}}}}, None, MeasurementError, "no parameter 'r'"),
        ({"left": {"effects": {"thermometer_difference": {"c": 1}}}}, None, EffectError, "needs a column"),
        ({"left": {"effects": {"capacity_difference": {"s": 1}}}}, None, EffectError, "not to kind 'motor'"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(specimens, runs, error, words: str):
    with pytest.raises(error) as found:
        two(specimens, runs)
    assert words in str(found.value)


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("motor", "left", "the left motor"),
        ("motor", "front_left", "the front left motor"),
        ("motor", "motor2", "motor 2"),
        ("motor", "m0", "motor m0"),
        ("cell", "B07", "cell B07"),
        ("cell", "cell_3", "cell 3"),
    ],
)
def test_a_specimen_has_a_name_in_words(kind: str, name: str, words: str):
    assert in_words(kind, name) == words
