"""Unequal motors of one case are told apart, and equal ones are not."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.diagnosis.answer import answer
from jaxmodel.diagnosis.answers import differences_of
from jaxmodel.diagnosis.changes import bands
from jaxmodel.diagnosis.diagnosis import diagnose
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.saved import read_diagnosis
from jaxmodel.diagnosis.wording import specimen_sentences, verdict_sentence, verdict_title
from jaxmodel.fit.candidates import candidates
from jaxmodel.fit.layout import make_layout
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate

TIME_S = np.arange(0.0, 20.0, 0.05)
NOISE = {"current_A": 0.05, "speed_rad_s": 0.5}
STATED = {"R_0": (0.103, 0.02), "k_tau": (0.0385, 0.004), "tau_0": (0.01, 0.005), "J": 5.42e-5}


def frame(seed: int, **own: float) -> pd.DataFrame:
    random = np.random.default_rng(seed)
    phase = random.uniform(0.0, 6.0)
    inputs = {
        "voltage_V": 12.0 + 5.0 * np.sin(0.7 * TIME_S + phase) + 2.0 * np.sign(np.sin(1.9 * TIME_S)),
        "load_torque_Nm": 0.05 + 0.04 * np.sign(np.sin(0.5 * TIME_S + phase)),
        "ambient_degC": np.full(TIME_S.size, 20.0),
    }
    read = simulate(Model("motor", Parameters(**own)), Profile(TIME_S, inputs)).readings
    noisy = {name: np.asarray(read[name]) + random.normal(0.0, sd, TIME_S.size) for name, sd in NOISE.items()}
    return pd.DataFrame({"time_s": TIME_S, **inputs, **noisy})


def motors(own: dict[str, dict[str, float]], seed: int = 0, runs: int = 3) -> Case:
    """The last run of each motor is held out."""
    frames = {
        f"run{run}_{name}": frame(seed + 10 * place + run, **parameters)
        for place, (name, parameters) in enumerate(own.items())
        for run in range(runs)
    }
    named = {name: {"specimen": name.partition("_")[2]} for name in frames}
    check = [name for name in frames if name.startswith(f"run{runs - 1}")]
    return Case.from_dataframes(
        frames, kind="motor", name="several", parameters=STATED, sensors=NOISE, check=check, runs=named
    )


@pytest.fixture(scope="module")
def unequal() -> Diagnosis:
    return diagnose(motors({"left": {}, "right": {"R_0": 1.3 * 0.103}}), progress=False)


def test_a_resistance_that_is_higher_is_told_with_its_motor(unequal: Diagnosis):
    (found,) = unequal.specimens
    assert (found.specimen, found.name, found.others) == ("right", "resistance_difference", ("left",))
    assert abs(np.exp(found.value) - 1.3) < 3.0 * found.sd * 1.3
    assert found.sd < 0.02
    assert found.cannot_tell_apart_from == ()
    assert (unequal.verdict, unequal.effects) == ("adequate", ())
    assert verdict_title(unequal) == "No effect is missing, but the right motor differs"
    (sentence,) = specimen_sentences(unequal, with_errors=False)
    assert sentence.startswith("The right motor differs: its resistance is 29.")
    assert sentence.endswith("% higher than that of the left motor.")
    assert verdict_sentence(unequal).startswith(sentence)
    (longer,) = specimen_sentences(unequal)
    assert "reduces the error of speed by 0.37" in longer
    assert "current" not in longer  # it moves by some uA of 50 mA of noise
    assert sentence in unequal.summary()


def test_the_answer_of_unequal_motors_is_read_and_simulated_again(unequal: Diagnosis, tmp_path: Path):
    unequal.write(tmp_path, pictures=False)
    assert read_diagnosis(tmp_path).specimens == unequal.specimens
    (of_right,) = answer(unequal)["specimens"]
    assert (of_right["specimen"], of_right["unit"]) == ("right", "log of a factor")
    extended = read_case(tmp_path / "extended.toml")
    assert set(extended.specimens["right"].effects) == {"resistance_difference"}
    for one in simulate_case(extended, progress=False):
        for channel, read in one.run.measured.outputs.items():
            left = float(np.sqrt(np.mean((one.table[channel].to_numpy() - read) ** 2)))
            # The start of a check run is adjusted to its first readings, which a case does not hold.
            exact = 1e-6 if one.run.split == "fit" else 2e-2
            assert left == pytest.approx(unequal.final.by_run[channel][one.run.name].rms, rel=exact)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        (
            {"value": np.log(0.8), "sd": 0.01},
            "The right motor differs: its resistance is 20.00 ± 0.80 % lower than that of the left motor.",
        ),
        (
            {"name": "friction_difference", "value": np.log(3.0), "sd": 0.01, "others": ()},
            "The right motor differs: its friction is 3.000 ± 0.030 times as stated.",
        ),
        (
            {"name": "thermometer_difference:winding_temperature_degC", "factor": False, "value": -2.0, "sd": 0.1,
             "unit": "K"},
            "The right motor differs: its winding temperature reads 2.00 ± 0.10 K lower than that of the left motor.",
        ),
        (
            {"specimen": "motor1", "value": 0.1, "sd": 0.05, "others": ("motor2", "motor3", "motor4"),
             "cannot_tell_apart_from": ("friction_difference@motor1", "load_difference@motor1",
                                        "resistance_difference@motor3", "brush_drop")},
            "Motor 1 differs: its resistance is 10.5 ± 5.5 % higher than that of the others; another friction or load, "
            "another resistance of motor 3 or brush_drop would explain it as well.",
        ),
    ],
)  # fmt: skip
def test_a_difference_is_said_in_one_sentence(unequal: Diagnosis, changed: dict, sentence: str):
    found = dataclasses.replace(unequal.specimens[0], **changed)
    assert specimen_sentences(dataclasses.replace(unequal, specimens=(found,)), with_errors=False) == [sentence]


def test_one_of_four_that_rubs_twice_as_much_is_told():
    found = diagnose(motors({"m1": {}, "m2": {}, "m3": {"tau_0": 0.02}, "m4": {}}, runs=2), progress=False)
    (one,) = found.specimens
    assert (one.specimen, one.name, one.others) == ("m3", "friction_difference", ("m1", "m2", "m4"))
    assert abs(np.exp(one.value) - 2.0) < 3.0 * 2.0 * one.sd
    assert "times that of the others" in specimen_sentences(found)[0]


def test_equal_motors_are_not_told_apart():
    found = diagnose(motors({"left": {}, "right": {}}, seed=100), progress=False)
    assert (found.specimens, found.final.added, found.verdict) == ((), (), "adequate")
    assert "specimens" not in answer(found)


def test_a_case_of_one_motor_has_no_candidates_for_specimens():
    one = motors({"left": {}})
    assert not any(candidate.group == "specimen" for candidate in candidates(one, {}))


def test_the_only_run_of_a_motor_has_no_shift_of_its_own():
    labels = {one.label for one in candidates(motors({"left": {}, "right": {}}, runs=2), {})}
    assert "friction_difference@left" in labels
    assert not any(label.startswith("friction_shift@") for label in labels)
    labels = {one.label for one in candidates(motors({"left": {}, "right": {}}), {})}
    assert {"friction_shift@run0_left", "friction_shift@run1_right"} <= labels


def test_unknowns_of_a_specimen_act_in_its_runs_alone():
    case = motors({"left": {}, "right": {}}, runs=2)
    case = Case.from_dataframes(
        case.to_dataframes(),
        kind="motor",
        parameters=STATED,
        runs={run.name: {"specimen": run.specimen} for run in case.runs},
        specimens={"left": {"R_0": (0.11, 0.01), "effects": {"friction_difference": {"s": (0.1, 0.2)}}}},
    )
    layout = make_layout(case, candidates(case, {}))
    acts = dict(zip(map(layout.name_of, range(layout.size)), np.asarray(layout.of_runs(4)).T.tolist(), strict=True))
    left, right = [run.specimen == "left" for run in case.runs], [run.specimen == "right" for run in case.runs]
    assert acts["R_0[left]"] == left
    assert acts["R_0"] == right
    assert acts["friction_difference.s[left]"] == left
    assert acts["friction_difference.s[right]"] == right
    assert acts["k_tau"] == [True] * 4


def test_a_difference_is_in_the_history_and_among_changes(unequal: Diagnosis):
    assert bands(answer(unequal)).keys() == {"resistance_difference@right"}
    assert differences_of(answer(unequal)) == ["resistance_difference@right"]
