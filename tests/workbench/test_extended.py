"""The case that a diagnosis ends with: accepted by every reader, and the same model to the last digit."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from discrepancy.ladder import Estimate
from discrepancy.result import Diagnosis
from jaxmodel.cases import Case, Known, read_case
from workbench.extended import extended_case, write_case
from workbench.runs import simulate_case


@pytest.fixture
def written(diagnosis: Diagnosis, tmp_path: Path) -> Case:
    folder = tmp_path / "somewhere" / "else"
    folder.mkdir(parents=True)
    write_case(extended_case(diagnosis)[0], folder / "extended.toml", ["a comment"])
    return read_case(folder / "extended.toml")


def test_extended_case_holds_the_final_model(diagnosis: Diagnosis, written: Case) -> None:
    estimates = diagnosis.final.estimates
    assert written.parameters["capacity_Ah"].value == estimates["capacity_Ah"].value
    assert written.effects == {"self_heating": {"C_th": 82.0, "hA": 0.11}, "arrhenius_resistance": {"E_a": 9000.0}}
    assert {name: known.sd for name, known in written.parameters.items()} == {
        name: estimates[name].sd if known.sd else None for name, known in diagnosis.case.parameters.items()
    }
    assert [run.initial_soc.sd for run in written.runs] == [
        estimates[f"initial_soc[{run.name}]"].sd for run in written.runs
    ]
    assert [run.initial_soc.value for run in written.runs] == [
        estimates[f"initial_soc[{r.name}]"].value for r in written.runs
    ]
    assert [run.source for run in written.runs] == [run.source for run in diagnosis.case.runs]
    assert (written.title, written.sensors) == (diagnosis.case.title, diagnosis.case.sensors)


def test_extended_case_predicts_what_the_diagnosis_predicted(diagnosis: Diagnosis, written: Case) -> None:
    for outcome in simulate_case(written):
        for channel, predicted in diagnosis.final.predictions[outcome.run.name].items():
            np.testing.assert_allclose(outcome.table[channel], predicted, rtol=1e-12)


def test_tables_overrides_ambient_and_cutoff_survive(case_folder: Path, diagnosis: Diagnosis, tmp_path: Path) -> None:
    toml = case_folder / "case.toml"
    text = toml.read_text().replace(
        'label = "9 A"', 'label = "9 A"\ncycles = { value = 40, sd = 5 }\nambient_degC = 21.5'
    )
    text = text.replace("[sensors]", "ocv = { soc = [0, 1], voltage_V = [3.0, 4.1] }\n"
                        "R_ints = { soc = [0, 1], temperature_degC = [0, 40], ohm = [[0.05, 0.04], [0.03, 0.02]] }\n"
                        "[cutoff]\nvoltage_V = 2.5\n[sensors]")  # fmt: skip
    toml.write_text(text)
    last = case_folder / "run-03.csv"
    last.write_text("\n".join(",".join(line.split(",")[:2] + line.split(",")[3:]) for line in last.read_text().split()))
    case = read_case(case_folder)
    fitted = diagnosis.final.estimates | {"cycles[run-03]": Estimate(44.0, 4.0, "")}
    final = dataclasses.replace(diagnosis.final, estimates=fitted)
    changed = dataclasses.replace(diagnosis, case=case, ladder=(*diagnosis.ladder[:-1], final))
    write_case(extended_case(changed)[0], tmp_path / "extended.toml")
    written = read_case(tmp_path / "extended.toml")
    assert written.runs[2].overrides["cycles"] == Known(44.0, 4.0)
    assert set(written.runs[2].measured.inputs["ambient_degC"]) == {21.5}
    assert written.cutoff == {"voltage_V": 2.5}
    np.testing.assert_array_equal(written.tables["R_ints"].values, case.tables["R_ints"].values)
    np.testing.assert_array_equal(written.tables["R_ints"].temperature_degC, [0.0, 40.0])
    np.testing.assert_array_equal(written.tables["ocv"].values, [3.0, 4.1])


def test_second_fault_of_one_kind_is_left_out_and_said(diagnosis: Diagnosis) -> None:
    labels = ("voltage_offset:voltage_V", "voltage_offset:pack_voltage_V")
    estimates = {f"{label}.c": Estimate(0.01, 0.001, "V") for label in labels}
    final = dataclasses.replace(diagnosis.final, added=labels, estimates=estimates)
    two_faults = dataclasses.replace(diagnosis, ladder=(*diagnosis.ladder[:-1], final))
    case, notes = extended_case(two_faults)
    assert case.effects == {"voltage_offset": {"c": 0.01, "column": "voltage_V"}}
    assert notes == [f"{labels[1]} is left out: a case file holds one effect of a name."]


def test_number_fitted_beyond_its_bounds_is_moved_to_them_and_said(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """A wrong model may want a state of charge of 1.2; the file must be readable all the same."""
    far = {"initial_soc[run-02]": Estimate(1.2, 0.001, ""), "self_heating.hA": Estimate(-1.0, 0.1, "W/K")}
    final = dataclasses.replace(diagnosis.final, estimates=diagnosis.final.estimates | far)
    case, notes = extended_case(dataclasses.replace(diagnosis, ladder=(*diagnosis.ladder[:-1], final)))
    write_case(case, tmp_path / "extended.toml", notes)
    assert read_case(tmp_path / "extended.toml").runs[1].initial_soc.value == 1.1
    assert {note.split()[0] for note in notes} == set(far)
    assert "# initial_soc[run-02] was fitted as 1.2, which is outside its range; here it is 1.1.\n" in (
        tmp_path / "extended.toml"
    ).read_text(encoding="utf-8")
