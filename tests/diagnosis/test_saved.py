"""A diagnosis that is written and read again is the same, to the bit."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.remark import Remark
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.advice.next_experiment import Proposal
from jaxmodel.diagnosis.result import Diagnosis, Estimate, RunError
from jaxmodel.diagnosis.saved import DIAGNOSIS, read_diagnosis
from tests.made_up import contact, diagnosis_of, law, ocv_curve, with_additions


@pytest.fixture(scope="module")
def full(diagnosis: Diagnosis) -> Diagnosis:
    """A diagnosis that holds something of every kind, NaN and infinity too."""
    strange = {"odd": Estimate(float("inf"), float("nan"), "V")}
    one = with_additions(diagnosis, estimates=strange, curves=(ocv_curve(), law()), runs=(contact(),))
    by_run = {"voltage_V": {"run-01": RunError(np.int64(61).item(), 0.1, -0.01, 0.3)}}
    base = dataclasses.replace(one.ladder[1], by_run=by_run)
    only_compared = dataclasses.replace(one.ladder[2], predictions={})
    ladder = (one.ladder[0], base, only_compared, *one.ladder[3:])
    proposals = (Proposal("a pulse at -10 degC", 7.0),)
    return dataclasses.replace(one, ladder=ladder, proposals=proposals, rivals=("base",), law_source="law = 1\n")


@pytest.fixture(scope="module")
def written(full: Diagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return full.write(tmp_path_factory.mktemp("saved") / "small", pictures=False)


def same(one: object, other: object, where: str = "") -> None:
    """Hold two results equal, NaN to NaN, in values and types."""
    assert type(one) is type(other), where
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other, where)
    elif isinstance(one, pd.DataFrame):
        pd.testing.assert_frame_equal(one, other)
    elif dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            same(getattr(one, field.name), getattr(other, field.name), f"{where}.{field.name}")
    elif isinstance(one, dict):
        assert list(one) == list(other), where
        for name, value in one.items():
            same(value, other[name], f"{where}.{name}")
    elif isinstance(one, tuple):
        assert len(one) == len(other), where
        for place, (value, again) in enumerate(zip(one, other, strict=True)):
            same(value, again, f"{where}[{place}]")
    elif isinstance(one, Remark):
        same(one.record(), other.record(), where)
    else:
        assert one == other or (one != one and other != other), where


def test_what_is_read_is_what_was_written(full: Diagnosis, written: Path) -> None:
    found = read_diagnosis(written)
    for field in dataclasses.fields(Diagnosis):
        if field.name != "case":
            same(getattr(full, field.name), getattr(found, field.name), field.name)
    assert found.case.name == full.case.name
    assert found.case.parameters == full.case.parameters
    for run, again in zip(full.case.runs, found.case.runs, strict=True):
        pd.testing.assert_frame_equal(run.to_dataframe(), again.to_dataframe(), check_exact=True)
        assert (run.name, run.split, run.label) == (again.name, again.split, again.label)


def test_remarks_are_read_with_their_codes_and_older_ones_as_sentences(full: Diagnosis, tmp_path: Path) -> None:
    odd = Remark("A start is far off.", "far_from_stated", "capacity_Ah", value=float("inf"), stated=float("nan"))
    folder = dataclasses.replace(full, remarks=(*full.remarks, odd)).write(tmp_path / "small", pictures=False)
    found = read_diagnosis(folder).remarks
    assert [(one.code, one.subject) for one in found] == [(one.code, one.subject) for one in (*full.remarks, odd)]
    assert found[0].numbers == full.remarks[0].numbers
    np.testing.assert_equal(dict(found[1].numbers), dict(odd.numbers))

    content = json.loads((folder / DIAGNOSIS).read_text(encoding="utf-8"))
    content["diagnosis"]["remarks"] = [one["text"] for one in content["diagnosis"]["remarks"]]
    (folder / DIAGNOSIS).write_text(json.dumps(content), encoding="utf-8")
    older = read_diagnosis(folder).remarks
    assert older == found
    assert [one.code for one in older] == ["", ""]


def test_what_is_read_says_and_draws_the_same(full: Diagnosis, written: Path) -> None:
    found = read_diagnosis(written)
    assert found.summary() == full.summary()
    assert found.answer() == full.answer()
    assert len(found.plot.run("run-02").axes) == len(full.plot.run("run-02").axes)
    assert found.extended_case().effects == full.extended_case().effects


def test_a_comparison_is_read_too(full: Diagnosis, tmp_path: Path) -> None:
    comparison = dataclasses.replace(full, verdict="", effects=(), ladder=full.ladder[:2])
    found = read_diagnosis(comparison.write(tmp_path, pictures=False))
    assert found.verdict == ""
    assert len(found.ladder) == 2


def test_a_case_from_tables_is_kept_beside(case: Case, tmp_path: Path) -> None:
    frames = {run.name: run.to_dataframe() for run in case.runs}
    stated = {name: (known.value, known.sd) if known.sd else known.value for name, known in case.parameters.items()}
    made = Case.from_dataframes(frames, kind="cell", name="tables", parameters=stated, sensors=case.sensors)
    found = read_diagnosis(dataclasses.replace(diagnosis_of(case), case=made).write(tmp_path, pictures=False))
    assert found.case.name == "tables"
    for name, frame in frames.items():
        (again,) = [run for run in found.case.runs if run.name == name]
        pd.testing.assert_frame_equal(again.to_dataframe(), frame, check_exact=True)


def test_a_run_that_has_changed_is_refused(diagnosis: Diagnosis, case_folder: Path, tmp_path: Path) -> None:
    from jaxmodel.case.reading import read_case

    written = dataclasses.replace(diagnosis, case=read_case(case_folder)).write(tmp_path / "out", pictures=False)
    assert read_diagnosis(written).verdict == diagnosis.verdict
    file = case_folder / "run-02.csv"
    file.write_text(file.read_text().replace("3.", "3.0", 1))
    with pytest.raises(MeasurementError, match="has changed since it was diagnosed"):
        read_diagnosis(written)


@pytest.mark.parametrize("file", ["diagnosis.json", "predictions.parquet"])
def test_what_is_not_whole_is_refused(file: str, written: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(written, tmp_path / "small"))
    content = (folder / file).read_bytes()
    (folder / file).write_bytes(content[: len(content) // 2])
    with pytest.raises(MeasurementError, match="diagnose the case again"):
        read_diagnosis(folder)
    (folder / file).unlink()
    with pytest.raises(MeasurementError):
        read_diagnosis(folder)


def test_the_same_diagnosis_is_written_the_same(full: Diagnosis, written: Path) -> None:
    first = {name: (written / name).read_bytes() for name in ("diagnosis.json", "predictions.parquet")}
    full.write(written, pictures=False)
    assert first == {name: (written / name).read_bytes() for name in first}
