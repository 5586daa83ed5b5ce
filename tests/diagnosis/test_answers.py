"""Answers side by side: what changed between two, and the history of a case."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.remark import Remark
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.answer import data_digests
from jaxmodel.diagnosis.answers import history
from jaxmodel.diagnosis.changes import compare_answers
from jaxmodel.diagnosis.result import Diagnosis
from tests.made_up import diagnosis_of


@pytest.fixture(scope="module")
def later(diagnosis: Diagnosis) -> Diagnosis:
    """Another diagnosis of the case: one name is possible only, a number has moved, an error has doubled."""
    final = diagnosis.final
    capacity = final.estimates["capacity_Ah"]
    moved = dataclasses.replace(capacity, value=capacity.value + 2.0 * capacity.sd)
    final = dataclasses.replace(final, estimates=final.estimates | {"capacity_Ah": moved})
    errors = diagnosis.errors.copy()
    of_one = (errors["model"] == "final") & (errors["run"] == "run-02") & (errors["channel"] == "voltage_V")
    errors.loc[of_one, "rms"] *= 2.0
    return dataclasses.replace(
        diagnosis,
        verdict="undecided",
        effects=diagnosis.effects[:1],
        ladder=(*diagnosis.ladder[:-1], final),
        errors=errors,
    )


def test_the_answer_has_each_remark_as_a_sentence_and_as_a_finding(diagnosis: Diagnosis) -> None:
    odd = Remark("The fit did not reach a minimum.", "no_minimum", promise=1.0 / 3.0, objective=float("nan"))
    said = dataclasses.replace(diagnosis, remarks=(*diagnosis.remarks, odd)).answer()
    assert [one["text"] for one in said["findings"]] == said["remarks"]
    assert said["findings"][-1] == {
        "code": "no_minimum",
        "subject": "",
        "numbers": {"promise": 0.333333, "objective": None},
        "text": "The fit did not reach a minimum.",
    }
    assert json.loads(json.dumps(said["remarks"])) == [str(one) for one in said["remarks"]]


def test_an_answer_beside_itself_has_no_change(diagnosis: Diagnosis) -> None:
    changes = compare_answers(diagnosis, diagnosis)
    assert changes.is_empty
    assert changes.summary().startswith("The same verdict, names, numbers, errors and data.")


def test_what_changed_is_told(diagnosis: Diagnosis, later: Diagnosis) -> None:
    changes = compare_answers(diagnosis, later)
    assert not changes.is_empty
    assert changes.verdict == ("missing_effect", "undecided")
    names = changes.names.set_index("name")
    assert tuple(names.loc["arrhenius_resistance", ["before", "after"]]) == ("named", "possible")
    assert tuple(names.loc["self_heating", ["before", "after"]]) == ("named", "named")
    assert changes.parameters["name"][changes.parameters["moved"]].tolist() == ["capacity_Ah"]
    rows = changes.errors[changes.errors["run"] == "run-02"].set_index("channel")
    assert rows["after"]["voltage_V"] == pytest.approx(2.0 * rows["before"]["voltage_V"], rel=1e-5)
    assert rows["change"]["cell_temperature_degC"] == 0.0
    assert "The error of voltage is larger by more than a tenth in run-02." in changes.summary()
    assert "arrhenius_resistance: named before, possible now." in changes.summary()


def test_a_name_that_comes_and_one_that_goes(diagnosis: Diagnosis) -> None:
    answer = diagnosis.answer()
    without = answer | {"effects": answer["effects"][1:], "model": answer["model"][1:]}
    gone = compare_answers(answer, without).names.set_index("name").loc["self_heating"]
    assert (gone["before"], gone["after"]) == ("named", "absent")
    assert np.isnan(gone["probability_after"])
    came = compare_answers(without, answer)
    assert "self_heating: named now, not in the model before." in came.summary()


def test_errors_are_those_of_the_answers(diagnosis: Diagnosis, later: Diagnosis) -> None:
    errors = compare_answers(diagnosis, later).errors.set_index(["channel", "run"])
    for channel, one in diagnosis.final.errors.items():
        assert errors["before"][channel, "all fit runs"] == pytest.approx(one.fit, rel=1e-5)
        assert errors["before"][channel, "all check runs"] == pytest.approx(one.check, rel=1e-5)
    assert errors["unit"]["cell_temperature_degC", "run-01"] == "K"


def test_a_changed_file_is_told(diagnosis: Diagnosis, case_folder: Path) -> None:
    file = case_folder / "run-02.csv"
    file.write_text(file.read_text().replace("3.", "3.0", 1))
    changed = dataclasses.replace(diagnosis, case=read_case(case_folder))
    changes = compare_answers(diagnosis, changed)
    assert changes.data.set_index("file")["what"].to_dict() == {
        "case.toml": "same",
        "run-01.csv": "same",
        "run-02.csv": "changed",
        "run-03.csv": "same",
    }
    assert "Data: run-02.csv changed." in changes.summary()


def test_runs_without_files_have_digests_of_their_numbers(case: Case) -> None:
    def digests(factor: float) -> dict[str, str]:
        frames = {run.name: run.to_dataframe() for run in case.runs}
        frames["run-01"] = frames["run-01"].assign(voltage_V=factor * frames["run-01"]["voltage_V"])
        return data_digests(Case.from_dataframes(frames, kind="cell"))

    same, other = digests(1.0), digests(1.001)
    assert digests(1.0) == same
    assert len(same) == len(case.runs)
    assert [name for name in same if other[name] != same[name]] == [next(iter(same))]


def test_every_diagnosis_stays_in_the_history(diagnosis: Diagnosis, later: Diagnosis, tmp_path: Path) -> None:
    for one in (diagnosis, later, diagnosis):
        one.write(tmp_path, pictures=False)
    table = history(tmp_path)
    assert table["verdict"].tolist() == ["missing_effect", "undecided", "missing_effect"]
    assert table["possible"].tolist() == ["", "arrhenius_resistance", ""]
    assert table["voltage_V"][0] == pytest.approx(diagnosis.final.errors["voltage_V"].check, rel=1e-5)
    assert table["data"].nunique() == 1
    files = sorted((tmp_path / "history").iterdir())
    assert not compare_answers(files[0], files[1]).is_empty
    assert compare_answers(files[0], tmp_path).is_empty
    # What programs read stays the same to the byte: what is of the moment is in the history alone.
    assert json.loads((tmp_path / "answer.json").read_text()) == {"schema": 1} | diagnosis.answer()


def test_a_file_of_the_history_that_is_damaged_takes_no_other_with_it(diagnosis: Diagnosis, tmp_path: Path) -> None:
    diagnosis.write(tmp_path, pictures=False)
    (tmp_path / "history" / "0.json").write_text("{")
    assert len(history(tmp_path)) == 1


def test_an_answer_without_origin_is_compared(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """As one of a version that wrote none."""
    old = {key: value for key, value in diagnosis.answer().items() if key not in ("possible", "model", "parameters")}
    (tmp_path / "answer.json").write_text(json.dumps(old))
    changes = compare_answers(tmp_path, diagnosis)
    assert changes.verdict == ("missing_effect", "missing_effect")
    assert changes.data.empty
    assert "is not known" in changes.summary()
    assert changes.to_dict()["origin"][0] == {"what": "case", "before": "not known", "after": "small"}


@pytest.mark.parametrize(
    ("content", "said"),
    [("[1]", "is no answer"), ("{", "is no JSON"), ('{"verdict": ""}', "is no answer"), (None, "No")],
)
def test_what_is_no_answer_is_refused(content: str | None, said: str, tmp_path: Path, diagnosis: Diagnosis) -> None:
    file = tmp_path / "answer.json"
    if content is not None:
        file.write_text(content)
    with pytest.raises(MeasurementError, match=said):
        compare_answers(diagnosis, file)


def test_a_folder_without_an_answer_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match=r"holds no answer\.json"):
        compare_answers(tmp_path, tmp_path)
    with pytest.raises(MeasurementError, match="no history"):
        history(tmp_path)


def test_a_comparison_has_no_answer(diagnosis: Diagnosis, tmp_path: Path) -> None:
    """It is calibrated only: what it writes is no answer, and the history has no line for it."""
    dataclasses.replace(diagnosis, verdict="", effects=()).write(tmp_path, pictures=False)
    assert not (tmp_path / "history").exists()


def test_the_possible_effects_of_an_answer_are_those_of_its_model(case: Case) -> None:
    one = diagnosis_of(case)
    final = dataclasses.replace(
        one.final, added=(*one.final.added, "voltage_offset:voltage_V", "series_resistance@run-02")
    )
    answer = dataclasses.replace(one, ladder=(*one.ladder[:-1], final)).answer()
    assert answer["possible"] == ["voltage_offset:voltage_V"]
    assert answer["parameters"]["capacity_Ah"]["unit"] == "A h"
