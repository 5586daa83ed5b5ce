"""What the files that are read again say of the schema they are written in."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from jaxmodel import read_case, sweeps
from jaxmodel.base import toml
from jaxmodel.base.errors import MeasurementError, UserError
from jaxmodel.base.schema import SCHEMA, with_schema, without_schema
from jaxmodel.operation.mission import read_mission
from jaxmodel.operation.state_of_charge import read_tunings
from jaxmodel.sweeps import Study
from jaxmodel.sweeps.study import read_study
from tests.stress import seeds

NEWER = f"has schema {SCHEMA + 1}, and this version reads up to {SCHEMA}; update with `pip install --upgrade jaxmodel`."


def test_schema_is_no_part_of_what_a_file_holds() -> None:
    assert toml.parsed("schema = 1\na = 2", "a.toml") == {"a": 2} == toml.parsed("a = 2", "a.toml")
    assert without_schema(with_schema({"a": 2}), "a.json") == {"a": 2}


@pytest.mark.parametrize("schema", ["0", "-1", "1.0", "true", '"1"', "[1]"])
def test_schema_is_a_whole_number(schema: str) -> None:
    with pytest.raises(
        MeasurementError, match=r"a\.toml: schema must be a whole number from 1 on; remove it, or write"
    ):
        toml.parsed(f"schema = {schema}", "a.toml")


@pytest.mark.parametrize(
    ("folder", "file", "read"),
    [("case", "case.toml", read_case), ("study", "study.toml", read_study), ("mission", "mission.toml", read_mission)],
)
def test_file_of_a_newer_version_is_refused(folder: str, file: str, read, tmp_path: Path) -> None:
    for name, content in seeds.folders()[folder].items():
        (tmp_path / name).write_bytes(content)
    path = tmp_path / file
    text = path.read_text(encoding="utf-8")
    path.write_text(f"schema = {SCHEMA}\n{text}", encoding="utf-8")
    read(path)
    path.write_text(f"schema = {SCHEMA + 1}\n{text}", encoding="utf-8")
    with pytest.raises(UserError, match=re.escape(NEWER)):
        read(path)


def test_tuning_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "tuning.json"
    path.write_bytes(seeds.folders()["tuning"]["tuning.json"])
    tunings, content = read_tunings(path), json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(with_schema(content)), encoding="utf-8")
    assert read_tunings(path) == tunings
    path.write_text(json.dumps(content | {"schema": SCHEMA + 1}), encoding="utf-8")
    with pytest.raises(MeasurementError, match=re.escape(NEWER)):
        read_tunings(path)


def test_case_that_is_written_states_its_schema(case, tmp_path: Path) -> None:
    assert case.write(tmp_path / "new").read_text(encoding="utf-8").startswith(f"schema = {SCHEMA}\n")


def test_sweep_of_a_newer_version_is_neither_read_nor_continued_and_one_without_schema_is(tmp_path: Path) -> None:
    study = Study(kind="cell", profile={"duration_s": 60, "ambient_degC": 20.0}, axes={"current_A": [1.0, 2.0]})
    sweeps.run(study, out=tmp_path)
    path = tmp_path / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    assert manifest.pop("schema") == SCHEMA
    path.write_text(json.dumps(manifest), encoding="utf-8")
    assert sweeps.load(tmp_path).sizes == sweeps.run(study, out=tmp_path, resume=True).sizes
    path.write_text(json.dumps(manifest | {"schema": SCHEMA + 1}), encoding="utf-8")
    for use in (lambda: sweeps.load(tmp_path), lambda: sweeps.run(study, out=tmp_path, resume=True)):
        with pytest.raises(UserError, match=re.escape(NEWER)):
            use()
