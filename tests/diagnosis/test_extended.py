"""The case that a diagnosis ends with: accepted by every reader, and the same model to the last digit."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.known import Known, Table, Tolerance
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.case.writing import write_case
from jaxmodel.diagnosis.extended.case import extended_case
from jaxmodel.diagnosis.result import CurveFound, Diagnosis, Estimate, RunFound
from jaxmodel.effects.curves import CURVES, SOC_KNOTS, TEMPERATURE_KNOTS
from jaxmodel.model.simulation import simulate
from tests.made_up import contact, factor_curve, law, ocv_curve, with_additions


def of(diagnosis: Diagnosis) -> tuple[Case, list[str]]:
    return extended_case(diagnosis.case, diagnosis.final, diagnosis.curves, diagnosis.runs)


@pytest.fixture
def written(diagnosis: Diagnosis, tmp_path: Path) -> Case:
    folder = tmp_path / "somewhere" / "else"
    folder.mkdir(parents=True)
    write_case(diagnosis.extended_case(), folder / "extended.toml", ["a comment"])
    return read_case(folder / "extended.toml")


def read_back(diagnosis: Diagnosis, folder: Path) -> tuple[Case, list[str]]:
    case, notes = of(diagnosis)
    write_case(case, folder / "extended.toml", notes)
    return read_case(folder / "extended.toml"), notes


def test_extended_case_holds_the_final_model(diagnosis: Diagnosis, written: Case) -> None:
    estimates = diagnosis.final.estimates
    assert written.parameters["capacity_Ah"].value == estimates["capacity_Ah"].value
    assert written.effects == {"self_heating": {"C_th": 82.0, "hA": 0.11}, "arrhenius_resistance": {"E_a": 9000.0}}
    assert written.effect_sd == {"self_heating": {"C_th": 3.0, "hA": 0.01}, "arrhenius_resistance": {"E_a": 700.0}}
    assert {name: known.sd for name, known in written.parameters.items()} == {
        name: estimates[name].sd if known.sd else None for name, known in diagnosis.case.parameters.items()
    }
    assert [run.initial_soc for run in written.runs] == [
        Known(estimates[f"initial_soc[{run.name}]"].value, estimates[f"initial_soc[{run.name}]"].sd)
        for run in written.runs
    ]
    assert [run.source for run in written.runs] == [run.source for run in diagnosis.case.runs]
    assert (written.title, written.sensors) == (diagnosis.case.title, diagnosis.case.sensors)
    assert written.tolerance == diagnosis.case.tolerance == {"voltage_V": Tolerance(0.01, 0.03)}


def test_extended_case_predicts_what_the_diagnosis_predicted(diagnosis: Diagnosis, written: Case) -> None:
    for outcome in simulate_case(written):
        for channel, predicted in diagnosis.final.predictions[outcome.run.name].items():
            np.testing.assert_allclose(outcome.table[channel], predicted, rtol=1e-12)


def test_effects_that_the_case_had_are_refitted_too(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A number of an effect that the case states to an sd is calibrated like any other."""
    case = dataclasses.replace(
        diagnosis.case,
        effects={"voltage_offset": {"c": 0.02, "column": "voltage_V"}, "rate_capacity": {"p": 1.05}},
        effect_sd={"voltage_offset": {"c": 0.01}},
    )
    changed = with_additions(
        dataclasses.replace(diagnosis, case=case), estimates={"voltage_offset:voltage_V.c": Estimate(0.013, 0.002, "V")}
    )
    written, notes = read_back(changed, tmp_path)
    assert notes == []
    assert written.effects["voltage_offset"] == {"c": 0.013, "column": "voltage_V"}
    assert written.effect_sd["voltage_offset"] == {"c": 0.002}
    assert written.effects["rate_capacity"] == {"p": 1.05}
    assert "rate_capacity" not in written.effect_sd


def test_start_of_a_run_is_kept_as_its_own(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A fitted rise takes the place of a stated temperature: a case file takes one of them."""
    first = dataclasses.replace(
        diagnosis.case.runs[0],
        initial_cell_temperature=Known(12.0, 0.5),
        tolerance={"cell_temperature_degC": Tolerance(0.5)},
    )
    second = dataclasses.replace(diagnosis.case.runs[1], initial_cell_temperature=Known(15.5, 0.5))
    case = dataclasses.replace(diagnosis.case, runs=(first, second, diagnosis.case.runs[2]))
    starts = {
        "initial_temperature_rise_K[run-01]": Estimate(1.7, 0.1, "K"),
        "initial_hysteresis[run-03]": Estimate(0.4, 0.2, ""),
    }
    written, _ = read_back(with_additions(dataclasses.replace(diagnosis, case=case), estimates=starts), tmp_path)
    assert written.runs[0].overrides == {"initial_temperature_rise_K": Known(1.7, 0.1)}
    assert written.runs[0].initial_cell_temperature is None
    assert written.runs[0].tolerance == {"cell_temperature_degC": Tolerance(0.5)}
    assert written.runs[1].initial_cell_temperature == Known(15.5, 0.5)
    assert written.runs[2].overrides == {"initial_hysteresis": Known(0.4, 0.2)}
    started = simulate_case(written)[0].table["cell_temperature_degC"][0]
    assert started == pytest.approx(11.7)


TEMPERATURES = np.array(TEMPERATURE_KNOTS)
SOC = np.array(SOC_KNOTS)
OCV = Table(np.array([0.0, 0.5, 1.0]), np.array([3.0, 3.6, 4.15]), None, 0.005)
R_INTS = Table(np.array([0.0, 1.0]), np.array([[0.09, 0.07], [0.05, 0.04]]), np.array([0.0, 40.0]))


@pytest.mark.parametrize(
    ("curves", "tables", "changed"),
    [
        (
            (ocv_curve(), factor_curve("series_resistance_curve", SOC), factor_curve("rc_resistance_curve", SOC)),
            {"ocv": OCV, "R_ints": R_INTS},
            {"ocv", "R_ints", "R_TS", "R_TL"},
        ),
        (
            (
                ocv_curve(stated=False),
                factor_curve("series_resistance_curve", SOC),
                factor_curve("series_resistance_temperature_curve", TEMPERATURES, "cell_temperature_degC"),
                factor_curve("rc_resistance_temperature_curve", TEMPERATURES, "cell_temperature_degC"),
                factor_curve("rc_capacitance_curve", SOC),
            ),
            {},
            {"ocv", "R_ints", "R_TS", "R_TL", "C_TS", "C_TL"},
        ),
    ],
)
def test_tables_hold_the_curves(
    diagnosis: Diagnosis,
    tmp_path: Path,
    curves: tuple[CurveFound, ...],
    tables: dict[str, Table],
    changed: set[str],
) -> None:
    """The model with the curves as effects, as the diagnosis had it, and the case file with its tables are the same."""
    case = dataclasses.replace(diagnosis.case, tables=tables)
    written, notes = read_back(with_additions(dataclasses.replace(diagnosis, case=case), curves=curves), tmp_path)
    assert notes == []
    assert set(written.tables) == changed
    for name in changed:
        assert written.tables[name].sd is not None
    final = dataclasses.replace(diagnosis.extended_case(), tables=tables)
    effects = tuple(CURVES[curve.label](jnp.asarray(curve.value), tuple(curve.at)) for curve in curves)
    for outcome in simulate_case(written):
        run = next(run for run in final.runs if run.name == outcome.run.name)
        model = case_model(final, run)
        alone = simulate(dataclasses.replace(model, effects=(*model.effects, *effects)), run_profile(run))
        np.testing.assert_allclose(outcome.table["voltage_V"], alone.readings["voltage_V"], atol=2.5e-4)
        np.testing.assert_allclose(
            outcome.table["cell_temperature_degC"], alone.readings["cell_temperature_degC"], atol=0.02
        )


def test_sd_of_a_corrected_table_is_that_of_its_curve(diagnosis: Diagnosis, tmp_path: Path) -> None:
    case = dataclasses.replace(diagnosis.case, tables={"ocv": OCV})
    curve = dataclasses.replace(ocv_curve(), sd=np.full(SOC.size, 0.0012))
    written, _ = read_back(with_additions(dataclasses.replace(diagnosis, case=case), curves=(curve,)), tmp_path)
    assert written.tables["ocv"].sd == pytest.approx(0.0012)
    assert set(OCV.soc) | set(SOC) == set(written.tables["ocv"].soc)


def test_what_a_case_file_cannot_hold_is_in_the_notes(diagnosis: Diagnosis, tmp_path: Path) -> None:
    entropy = dataclasses.replace(ocv_curve(), label="entropy_curve", port="entropy_coefficient", unit="V/K")
    written, notes = read_back(with_additions(diagnosis, curves=(entropy, law()), runs=(contact(),)), tmp_path)
    assert written.tables == {}
    text = "\n".join(notes)
    for said in (
        "entropy_curve is left out: a case file has no table for it",
        "run-02: series resistance differs by +11.20 ± 0.80 mohm from the other runs",
        "give --effect found_law.py:FoundLaw",
    ):
        assert said in text
    assert len(notes) == 3


def test_friction_of_one_run_is_its_own_number(diagnosis: Diagnosis) -> None:
    tight = RunFound("friction_shift@run-02", "run-02", "run-02.csv", "friction_torque_Nm", 0.004, 0.001, "N m", {})
    case, notes = of(with_additions(diagnosis, runs=(tight,)))
    assert notes == []
    default = case_model(diagnosis.case).parameters.tau_0
    assert case.runs[1].overrides["tau_0"].value == pytest.approx(float(default) + 0.004)
    assert case.runs[1].overrides["tau_0"].sd == pytest.approx(0.001)
    assert "tau_0" not in case.runs[0].overrides


def test_tables_overrides_ambient_and_cutoff_survive(case_folder: Path, diagnosis: Diagnosis, tmp_path: Path) -> None:
    toml = case_folder / "case.toml"
    text = toml.read_text().replace(
        'label = "9 A"', 'label = "9 A"\ncycles = { value = 40, sd = 5 }\nambient_degC = 21.5'
    )
    text = text.replace("[sensors]", "ocv = { soc = [0, 1], voltage_V = [3.0, 4.1], sd_V = 0.004 }\n"
                        "R_ints = { soc = [0, 1], temperature_degC = [0, 40], ohm = [[0.05, 0.04], [0.03, 0.02]] }\n"
                        "[cutoff]\nvoltage_V = 2.5\n[sensors]")  # fmt: skip
    toml.write_text(text)
    last = case_folder / "run-03.csv"
    last.write_text("\n".join(",".join(line.split(",")[:2] + line.split(",")[3:]) for line in last.read_text().split()))
    case = read_case(case_folder)
    changed = with_additions(
        dataclasses.replace(diagnosis, case=case), estimates={"cycles[run-03]": Estimate(44.0, 4.0, "")}
    )
    written, _ = read_back(changed, tmp_path)
    assert written.runs[2].overrides["cycles"] == Known(44.0, 4.0)
    assert set(written.runs[2].measured.inputs["ambient_degC"]) == {21.5}
    assert written.cutoff == {"voltage_V": 2.5}
    np.testing.assert_array_equal(written.tables["R_ints"].values, case.tables["R_ints"].values)
    np.testing.assert_array_equal(written.tables["R_ints"].temperature_degC, [0.0, 40.0])
    np.testing.assert_array_equal(written.tables["ocv"].values, [3.0, 4.1])
    assert (written.tables["ocv"].sd, written.tables["R_ints"].sd) == (0.004, None)


def test_second_fault_of_one_kind_is_left_out_and_said(diagnosis: Diagnosis) -> None:
    labels = ("voltage_offset:voltage_V", "voltage_offset:pack_voltage_V")
    estimates = {f"{label}.c": Estimate(0.01, 0.001, "V") for label in labels}
    final = dataclasses.replace(diagnosis.final, added=labels, estimates=estimates)
    two_faults = dataclasses.replace(diagnosis, ladder=(*diagnosis.ladder[:-1], final))
    case, notes = of(two_faults)
    assert case.effects == {"voltage_offset": {"c": 0.01, "column": "voltage_V"}}
    assert case.effect_sd == {"voltage_offset": {"c": 0.001}}
    assert notes == [f"{labels[1]} is left out: a case file holds one effect of each name."]


def test_number_fitted_beyond_its_bounds_is_moved_to_them_and_said(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A wrong model may want a state of charge of 1.2; the file must be readable all the same."""
    far = {"initial_soc[run-02]": Estimate(1.2, 0.001, ""), "self_heating.hA": Estimate(-1.0, 0.1, "W/K")}
    written, notes = read_back(with_additions(diagnosis, estimates=far), tmp_path)
    assert written.runs[1].initial_soc.value == 1.1
    assert {note.split()[0] for note in notes} == set(far)
    assert "# initial_soc[run-02] was fitted as 1.2, outside its range; it is set to 1.1 here.\n" in (
        tmp_path / "extended.toml"
    ).read_text(encoding="utf-8")
