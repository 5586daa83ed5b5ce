"""Remarks of a diagnosis."""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxmodel.base.remark import Remark
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.advice.remarks import (
    Strained,
    badly_started,
    better_as_stated,
    extrapolated,
    formulas_of_the_paper,
    noise_remarks,
    not_converged,
    nothing_held_out,
    nothing_moves,
    outside_fitted,
    starts_moving,
    stated_model_stays,
    strained,
    unusual,
)
from jaxmodel.diagnosis.result import ChannelError, Rung
from jaxmodel.diagnosis.usual import in_usual_range
from jaxmodel.effects import CATALOGUE
from jaxmodel.fit.candidates import make_candidate
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.likelihood import ChannelWeight, Likelihood
from jaxmodel.fit.linearisation import Gram, Linearisation
from jaxmodel.fit.noise.contract import noise_of_case
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.space import ModelSpec
from tests.diagnosis.made_cases import case_of, run_of


def test_a_parameter_far_from_its_stated_value_is_remarked_on_with_both() -> None:
    far = Strained("capacity_Ah", 2.21, -5.0, 2.6, 0.078)
    (said,) = strained([far, dataclasses.replace(far, pull=2.9)])
    assert said == (
        "capacity_Ah = 2.21 is 5.0 sd below what the case states (2.6 ± 0.078): correct it, or it stands in for "
        "something that the model lacks."
    )
    assert (said.code, said.subject) == ("far_from_stated", "capacity_Ah")
    assert said.numbers == {"value": 2.21, "stated": 2.6, "stated_sd": 0.078, "off_sd": -5.0}
    assert strained([]) == ()


def test_a_start_far_from_its_stated_value_compensates_for_an_error() -> None:
    start = Strained("initial_soc", 0.87, 7.0, 0.8, 0.01, "run-04")
    own = Strained("capacity_Ah", 2.9, 3.5, 2.6, 0.078, "run-02")
    first, second = strained([own, start])
    assert first.startswith(
        "The start of run-04 was moved to compensate for an error: initial_soc = 0.87 is 7.0 sd above"
    )
    assert (first.code, first.subject, first.numbers["off_sd"]) == ("start_moved", "initial_soc@run-04", 7.0)
    assert (second.code, second.subject) == ("far_from_stated", "capacity_Ah@run-02")
    assert "of run-02" in second
    assert "lacks in that run." in second


def test_noise_that_is_contradicted_or_not_stated_is_remarked_on() -> None:
    wrong = NoiseModel(
        6e-3, 0.0, "the readings show 0.006: the stated sd is wrong (0.001)", stated=1e-3, contradicts=True
    )
    good = NoiseModel(1e-3, 0.0, "stated (0.001)", stated=1e-3)
    untold = NoiseModel(0.2, 0.0, "estimated from the readings")
    small = dataclasses.replace(wrong, sd=2.5e-4)
    said = noise_remarks({"voltage_V": wrong, "soc": good, "cell_temperature_degC": untold, "current_A": small})
    assert [(one.code, one.subject) for one in said] == [
        ("noise_contradicted", "voltage_V"),
        ("noise_not_stated", "cell_temperature_degC"),
        ("noise_contradicted", "current_A"),
    ]
    assert said[0].numbers == {"sd": 6e-3, "stated_sd": 1e-3}
    (filtered,) = noise_remarks({"voltage_V": dataclasses.replace(good, is_filtered=True)})
    assert (filtered.code, filtered.numbers) == ("readings_filtered", {"stated_sd": 1e-3})
    assert said[0].startswith("The readings of voltage_V scatter by 0.006, 6 times the stated sd of 0.001")
    assert said[1].startswith("The noise of cell_temperature_degC is not stated; taken as 0.2")
    assert "1/4 of the stated sd" in said[2]


def fitted(promise: float, slope: float) -> Fit:
    """A model of two unknowns, the second of them a curve with a narrow prior, and of three readings."""
    spec = ModelSpec((), {}, {}, (0, 1), np.array([1.0, 100.0]), np.zeros(0), np.zeros((0, 0)), False)
    gram = Gram(np.full((2, 2), 3.0 * slope**2), np.zeros(2), 0.0, 3)
    weights = Likelihood({"voltage_V": ChannelWeight(1.0, 1.0, 3)})
    linear = Linearisation(np.zeros(2), {0: {"voltage_V": gram}}, {0: 0})
    return Fit(spec, (), np.zeros(2), np.zeros(3), weights, linear, 300.0, promise)


def test_a_fit_that_did_not_converge_or_has_no_sensitivity_is_remarked_on() -> None:
    assert not_converged(fitted(0.01, 1.0)) == ()
    (said,) = not_converged(fitted(30.0, 1.0))
    assert "promises 30 of 300" in said
    assert (said.code, said.numbers) == ("no_minimum", {"promise": 30.0, "objective": 300.0})
    assert nothing_moves(fitted(0.0, 1.0)) == ()
    assert [one.code for one in nothing_moves(fitted(0.0, 1e-5))] == ["nothing_moves"]


def test_an_effect_far_from_its_usual_size_may_stand_in_for_another() -> None:
    candidate = make_candidate(CATALOGUE["ocv_hysteresis"]())
    usual = [coordinate.number(0.0) for coordinate in candidate.coordinates]
    assert unusual(candidate, usual) == ()
    (said,) = unusual(candidate, [100.0 * usual[0], *usual[1:]])
    assert said.startswith(f"{candidate.coordinates[0].name} = ")
    assert (said.code, said.subject) == ("outside_usual_range", candidate.coordinates[0].name)
    assert said.numbers["low"] < said.numbers["high"] < said.numbers["value"]
    name = candidate.coordinates[0].name.rpartition(".")[2]
    assert unusual(candidate, [100.0 * usual[0], *usual[1:]], {name: (50.0 * usual[0], 200.0 * usual[0])}) == ()


def test_usual_ranges_have_soft_ends() -> None:
    assert in_usual_range(15.0, 20.0, 2000.0)
    assert in_usual_range(4000.0, 20.0, 2000.0)
    assert not in_usual_range(1.0, 20.0, 2000.0), "a resistance is strong where it is small"
    assert not in_usual_range(1e5, 20.0, 2000.0)
    assert in_usual_range(-0.011, -0.01, 0.01)
    assert not in_usual_range(-0.02, -0.01, 0.01)


def test_a_motor_that_turns_when_its_file_begins_is_remarked_on() -> None:
    rows = np.full(40, 12.0)
    inputs = {"voltage_V": rows, "load_torque_Nm": 0.0 * rows, "ambient_degC": rows}
    speeds = [np.linspace(start, 300.0, 40) for start in (0.2, -150.0)]
    runs = [run_of(number, inputs, {"speed_rad_s": speed}) for number, speed in enumerate(speeds, start=1)]
    case = case_of("motor", {}, runs, {"speed_rad_s": 0.3})
    noise = noise_of_case(case)

    def said(*starts: float) -> tuple[Remark, ...]:
        predicted = zip(case.runs, starts, strict=True)
        return starts_moving(case, noise, {run.name: {"speed_rad_s": start + 0.0 * rows} for run, start in predicted})

    (remark,) = said(0.0, 0.0)
    assert remark.endswith("if it did turn, give initial_speed_rad_s = -150 to run-02.")
    assert (remark.code, remark.numbers) == ("start_speed_missing", {"run-02": -150.0})
    assert said(0.0, -150.0) == ()
    stated = dataclasses.replace(case.runs[1], overrides={"initial_speed_rad_s": Known(-120.0)})
    case = dataclasses.replace(case, runs=(case.runs[0], stated))
    (told,) = said(0.0, -120.0)
    assert told.startswith("speed_rad_s of run-02 is -150 at the first row, and initial_speed_rad_s is stated as -120:")
    assert (told.code, told.subject) == ("start_speed_contradicted", "speed_rad_s@run-02")
    assert told.numbers == {"value": -150.0, "stated": -120.0}
    assert starts_moving(case, {}, {}) == ()


def test_a_case_that_holds_nothing_out_is_told_how_to() -> None:
    fitted, check = cell_run(1, 1.0, 20.0), cell_run(2, 1.0, 20.0, split="check")
    assert nothing_held_out(case_of("cell", {}, [fitted, check], {})) == ()
    (alone,) = nothing_held_out(case_of("cell", {}, [fitted], {}))
    assert alone.code == "nothing_held_out"
    assert "cannot be judged; record another run" in alone
    (two,) = nothing_held_out(case_of("cell", {}, [fitted, dataclasses.replace(check, split="fit")], {}))
    assert 'set split = "check" for one of them' in two


def test_a_check_run_with_a_wrong_start_is_remarked_on() -> None:
    (said,) = badly_started({"run-03": 1.9, "run-04": -5.9})
    assert said.startswith("The start of run-04 is wrong: its first readings require a start 5.9 sd")
    assert "limited to 2 sd;" in said
    assert (said.code, said.subject, said.numbers) == ("start_wrong", "run-04", {"off_sd": -5.9, "limit_sd": 2.0})


def cell_run(number: int, current_A: float, ambient_degC: float, split: str = "fit", **own: Known) -> Run:
    """1,200 s at one current, from full: 5 A take 0.83 of 2 A h."""
    rows = np.ones(401)
    inputs = {"current_A": current_A * rows, "ambient_degC": ambient_degC * rows}
    warms = {"cell_temperature_degC": ambient_degC + np.linspace(0.0, current_A, 401)}
    return run_of(number, inputs, warms, initial_soc=Known(1.0), split=split, **own)


def cell_case(*check: Run, **parameters: Known) -> Case:
    return case_of(
        "cell", {"capacity_Ah": Known(2.0)} | parameters, [cell_run(1, 3.0, 10.0), cell_run(2, 2.0, 25.0), *check]
    )


def test_a_check_run_within_what_was_fitted_is_no_extrapolation() -> None:
    assert extrapolated(cell_case(cell_run(3, 3.4, 20.0, "check"))) == ()
    assert extrapolated(cell_case(cell_run(3, 2.0, 28.0, "check"))) == (), "3 K are little"


def test_what_lies_outside_is_named_with_both_spans() -> None:
    found = {one.condition: one for one in extrapolated(cell_case(cell_run(3, 5.0, -10.0, "check")))}
    assert set(found) == {"ambient_degC", "cell_temperature_degC", "|current_A|", "soc"}
    assert found["ambient_degC"].span_fitted == (10.0, 25.0)
    assert found["ambient_degC"].span == (-10.0, -10.0)
    np.testing.assert_allclose(found["soc"].span, (1.0 - 5.0 / 6.0, 1.0))
    np.testing.assert_allclose(found["soc"].span_fitted, (0.5, 1.0))
    assert found["soc"].file == "run-03.csv"
    said = outside_fitted(found["ambient_degC"])
    assert said == "run-03.csv is outside the fit runs: ambient_degC is -10; the fit runs cover 10 to 25."
    assert (said.code, said.subject) == ("run_outside_fitted", "ambient_degC@run-03")
    assert said.numbers == {"low": -10.0, "high": -10.0, "low_fit": 10.0, "high_fit": 25.0}


def test_a_run_of_an_older_cell_is_an_extrapolation() -> None:
    (found,) = extrapolated(cell_case(cell_run(3, 2.0, 20.0, "check", cycles=Known(400.0)), cycles=Known(100.0)))
    assert (found.condition, found.span_fitted, found.span) == ("cycles", (100.0, 100.0), (400.0, 400.0))


def test_speed_and_load_count_by_their_size() -> None:
    def motor_run(number: int, speed: float, load: float, split: str) -> Run:
        rows = np.ones(50)
        inputs = {"voltage_V": rows, "load_torque_Nm": load * rows, "ambient_degC": 20.0 * rows}
        return run_of(number, inputs, {"speed_rad_s": speed * rows}, split=split)

    fit = motor_run(1, 100.0, 0.05, "fit")
    assert extrapolated(case_of("motor", {}, [fit, motor_run(2, -110.0, -0.02, "check")])) == ()
    found = extrapolated(case_of("motor", {}, [fit, motor_run(2, -150.0, 0.08, "check")]))
    assert {one.condition for one in found} == {"|speed_rad_s|", "|load_torque_Nm|"}


def rung(**check: float) -> Rung:
    errors = {name: ChannelError(fit=1e-3, check=value) for name, value in check.items()}
    return Rung("", (), {}, (), errors, {}, 0.0, 0, {})


def test_a_final_model_that_predicts_no_better_than_the_stated_one_is_remarked_on() -> None:
    stated = rung(voltage_V=9.0e-3, cell_temperature_degC=0.7)
    (said,) = better_as_stated(stated, rung(voltage_V=9.5e-3, cell_temperature_degC=0.83))
    assert said.startswith(
        "On the check runs the final model is no better than the base model as stated: cell temperature is 0.83 K off, "
        "and 0.7 K as stated."
    )
    assert (said.code, said.subject) == ("better_as_stated", "cell_temperature_degC")
    assert said.numbers == {"cell_temperature_degC": 0.83, "cell_temperature_degC_stated": 0.7}
    assert better_as_stated(stated, rung(voltage_V=5.0e-3, cell_temperature_degC=0.83)) == ()
    assert better_as_stated(stated, stated) == ()
    assert better_as_stated(rung(voltage_V=np.nan), rung(voltage_V=np.nan)) == ()


def test_a_case_that_stays_as_stated_tells_what_was_tried() -> None:
    said = stated_model_stays(["self_heating", "gain:voltage_V"])
    assert (said.code, said.subject) == ("stated_model_stays", "self_heating, gain:voltage_V")


def test_a_cell_with_formulas_of_the_paper_is_told_which() -> None:
    (said,) = formulas_of_the_paper(case_of("cell", {"capacity_Ah": Known(2.0)}, [cell_run(1, 1.0, 20.0)], {}))
    assert said.code == "paper_formulas"
    assert "ocv" in said.subject.split(", ")
    assert formulas_of_the_paper(case_of("motor", {}, [], {})) == ()
