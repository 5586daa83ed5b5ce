"""The whole diagnosis on measurements made by another path: the same equations through diffrax at tight tolerance."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from discrepancy.best_model import BestModel
from discrepancy.diagnose import OF_ANOTHER_FORM, _no_form, _verdict, diagnose
from discrepancy.result import VERDICTS, Diagnosis, answer
from discrepancy.session import Session
from jaxmodel.build import load_effect_class
from jaxmodel.cases import Case
from jaxmodel.errors import EffectError
from tests.discrepancy.made_cases import NOISE_V, TRUE, MadeCell, all_but, made_cell, made_cell_with_unknown_law
from workbench.wording import verdict_sentence

HIDDEN = {
    "ocv_hysteresis": {"M_V": 0.02, "g": 60.0},
    "arrhenius_resistance": {"E_a": 12e3},
}


@pytest.fixture(scope="module", params=list(HIDDEN))
def found(request, tmp_path_factory) -> tuple[str, Diagnosis]:
    """One hidden effect and its diagnosis."""
    name = request.param
    return name, diagnose(made_cell(tmp_path_factory.mktemp(name), {name: HIDDEN[name]}).case)


def test_hidden_effect_is_named_with_its_parameters(found):
    """The effect is the only one named, and its true parameters lie within four standard deviations."""
    name, diagnosis = found
    assert diagnosis.verdict == "missing_effect"
    assert [effect.name for effect in diagnosis.effects] == [name]
    for parameter, true in HIDDEN[name].items():
        estimate = diagnosis.effects[0].parameters[parameter]
        assert abs(estimate.value - true) < 4.0 * estimate.sd


def test_error_on_the_held_out_run_falls_to_the_noise(found):
    """Before, the check run is missed by more than the noise; after, by the noise."""
    _, diagnosis = found
    assert diagnosis.base.errors["voltage_V"].check > 1.1 * NOISE_V
    assert diagnosis.final.errors["voltage_V"].check == pytest.approx(NOISE_V, rel=0.07)


def test_base_parameters_are_recovered_too(found):
    """With the effect in the model, nothing has to stand in for it."""
    _, diagnosis = found
    for name in ("capacity_Ah", "series_resistance_scale", "rc_resistance_scale"):
        estimate = diagnosis.final.estimates[name]
        assert abs(estimate.value - TRUE[name]) < 4.0 * estimate.sd


def test_answer_keeps_the_contract(found):
    """The answer has the keys of the contract, and probabilities that are probabilities."""
    _, diagnosis = found
    said = answer(diagnosis)
    keys = {"verdict", "effects", "candidates", "unexplained", "blind_to", "error"}
    assert set(said) == keys
    assert said["verdict"] in VERDICTS
    assert 0.0 < said["effects"][0]["probability"] <= 0.99
    assert sum(candidate["probability"] for candidate in said["candidates"]) < 1.05
    assert set(said["error"]["voltage_V"]) == {"noise_floor", "before", "after"}


def test_nothing_hidden_nothing_named(tmp_path):
    """A model that is right is adequate."""
    diagnosis = diagnose(made_cell(tmp_path, {}).case)
    assert diagnosis.verdict == "adequate"
    assert diagnosis.effects == ()
    assert np.isclose(diagnosis.base.errors["voltage_V"].check, NOISE_V, rtol=0.07)


def _with_voltage(case: Case, number: int, voltage: Callable[[np.ndarray], np.ndarray]) -> Case:
    """The case with the voltage of one run changed."""
    run = case.runs[number]
    measured = dataclasses.replace(run.measured, outputs={"voltage_V": voltage(run.measured.outputs["voltage_V"])})
    runs = [dataclasses.replace(run, measured=measured) if run is one else one for one in case.runs]
    return dataclasses.replace(case, runs=tuple(runs))


def test_a_lost_reading_at_0_V_changes_nothing_and_is_told(tmp_path):
    lost = diagnose(
        _with_voltage(made_cell(tmp_path, {}).case, 2, lambda v: np.where(np.arange(v.size) == 137, 0.0, v))
    )
    assert lost.verdict == "adequate"
    assert any(said.startswith("1 reading of voltage_V left out as glitch") for said in lost.remarks)
    assert np.isclose(lost.base.errors["voltage_V"].fit, NOISE_V, rtol=0.07)


def test_what_only_a_run_held_out_shows_is_not_called_adequate(tmp_path):
    sags = diagnose(_with_voltage(made_cell(tmp_path, {}).case, 3, lambda v: v - np.linspace(0.0, 0.03, v.size)))
    assert sags.verdict == "undecided"
    assert sags.unexplained is not None
    assert "times that on fit runs" in sags.unexplained
    assert verdict_sentence(sags).endswith(sags.unexplained)


def test_sensor_fault_is_not_sold_as_physics(tmp_path):
    """An offset of the current sensor is called what it is, with the share of belief that goes with it."""
    fault = {"current_offset": {"column": "current_A", "c": 0.08}}
    diagnosis = diagnose(made_cell(tmp_path, fault).case)
    assert diagnosis.verdict == "sensor_fault"
    assert [(effect.name, effect.column) for effect in diagnosis.effects] == [("current_offset", "current_A")]
    assert diagnosis.effects[0].probability > 0.5


@pytest.fixture(scope="module")
def unknown(tmp_path_factory) -> Diagnosis:
    """Of a resistance that grows below half charge."""
    return diagnose(made_cell_with_unknown_law(tmp_path_factory.mktemp("unknown"), ohm_per_soc=0.1).case)


def test_law_in_no_catalogue_is_unknown(unknown):
    """It is called so, and the sentence says where it acts."""
    diagnosis = unknown
    assert diagnosis.verdict == "unknown_effect"
    assert diagnosis.unexplained is not None
    assert "voltage_V" in diagnosis.unexplained
    assert "soc" in diagnosis.unexplained


def test_the_law_found_takes_the_error_away(unknown, tmp_path):
    """Written, and given back as an effect: where it was fitted the model is nearly as good as the sensor.

    The held-out run goes on to lower charge, where the law is held at its last value.
    """
    assert unknown.law is not None
    assert unknown.law_source is not None
    path = tmp_path / "found_law.py"
    path.write_text(unknown.law_source)
    own = {"found_law": load_effect_class(f"{path}:FoundLaw")}
    others = all_but(unknown.case, "ocv_hysteresis", "charge_transfer")
    second = diagnose(unknown.case, extra_effects=own, without=others)
    assert second.effects[0].name == "found_law"
    assert second.effects[0].parameters["s"].value == pytest.approx(1.0, abs=0.2)
    assert unknown.base.errors["voltage_V"].fit > 3.0 * NOISE_V
    assert second.final.errors["voltage_V"].fit < 1.15 * NOISE_V
    assert second.final.errors["voltage_V"].check < 0.5 * unknown.base.errors["voltage_V"].check


def test_an_effect_of_another_form_is_named_and_what_its_form_lacks_is_told(tmp_path):
    """A hysteresis that turns faster than the catalogue's takes 96 % of the excess error; a law stands out."""
    case = made_cell(tmp_path, {"ocv_hysteresis": HIDDEN["ocv_hysteresis"] | {"other": 1.0}}).case
    diagnosis = diagnose(case, without=all_but(case, "ocv_hysteresis", "charge_transfer", "slow_diffusion"))
    assert (diagnosis.verdict, [effect.name for effect in diagnosis.effects]) == ("missing_effect", ["ocv_hysteresis"])
    assert diagnosis.candidates[0] == ("ocv_hysteresis", OF_ANOTHER_FORM)
    assert diagnosis.unexplained is not None
    assert diagnosis.unexplained in verdict_sentence(diagnosis)
    assert diagnosis.law_source is not None


@pytest.fixture(scope="module")
def hysteresis(tmp_path_factory) -> MadeCell:
    return made_cell(tmp_path_factory.mktemp("overruled"), {"ocv_hysteresis": HIDDEN["ocv_hysteresis"]})


def test_what_the_user_rules_out_is_not_named(hysteresis):
    """Without the true effect the answer is another one or none, and it is worse."""
    ruled_out = all_but(hysteresis.case, "slow_diffusion", "charge_transfer", "self_discharge", "voltage_offset")
    assert "ocv_hysteresis" in ruled_out
    diagnosis = diagnose(hysteresis.case, without=ruled_out)
    assert "ocv_hysteresis" not in {effect.name for effect in diagnosis.effects}
    assert diagnosis.candidates
    assert not any("ocv_hysteresis" in name for name, _ in diagnosis.candidates)
    assert diagnosis.verdict != "adequate"


def test_what_the_user_adds_is_in_the_model_and_does_not_look_better_than_it_is(hysteresis):
    """A wrong effect is fitted as asked; the verdict still says that something is missing."""
    diagnosis = diagnose(hysteresis.case, add=["self_discharge"])
    assert [effect.name for effect in diagnosis.effects] == ["self_discharge"]
    assert diagnosis.final.added == ("self_discharge",)
    assert diagnosis.verdict == "unknown_effect"
    right = diagnose(hysteresis.case, add=["ocv_hysteresis"])
    assert right.verdict == "missing_effect"
    assert right.final.errors["voltage_V"].fit < 0.9 * diagnosis.final.errors["voltage_V"].fit


def test_a_name_that_is_no_candidate_is_one_sentence(hysteresis):
    with pytest.raises(EffectError, match=r"'ocv_hysteresys'.*[Dd]id you mean.*ocv_hysteresis"):
        diagnose(hysteresis.case, without=["ocv_hysteresys"])
    with pytest.raises(EffectError, match="'windage'"):  # of a motor
        diagnose(hysteresis.case, add=["windage"])


def test_what_all_likely_models_have_in_common_is_named(plain_session: Session) -> None:
    """Whether a second effect is there may stay open where the first is in every likely model."""
    best = dataclasses.replace(plain_session.hypothesis(), labels=("self_discharge",))
    open_second = {"self_discharge": 0.4, "rate_capacity+self_discharge": 0.35, "self_discharge+slow_diffusion": 0.25}
    assert _verdict(plain_session, best, {"base": 0.0} | open_second, None) == "missing_effect"
    either = {"self_discharge": 0.4, "rate_capacity": 0.35, "base": 0.25}
    assert _verdict(plain_session, best, either, None) == "undecided"


def test_what_is_far_from_noise_and_follows_no_law_is_said(plain_session: Session) -> None:
    model = BestModel(plain_session, plain_session.hypothesis(), ("voltage_V",))
    said = _no_form(model)
    assert said is not None
    assert "in voltage_V, in the form of no law" in said
    assert _no_form(dataclasses.replace(model, far=())) is None
