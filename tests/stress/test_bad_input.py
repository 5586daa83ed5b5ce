"""A spoilt file of any form is read as it is written, or refused in one sentence with place and mend."""

from __future__ import annotations

import copy
import json
import os
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxmodel.base import toml
from jaxmodel.base.errors import UserError
from jaxmodel.case.forms import check_case
from jaxmodel.operation.state_of_charge import read_tunings
from jaxmodel.sweeps.study import Study
from tests.stress.readers import READERS
from tests.stress.seeds import CASE, DRIVE, STUDY
from tests.stress.trial import faults, read, trial

TRIALS = 7


@pytest.mark.parametrize("name", READERS)
def test_a_good_file_is_read(name: str, tmp_path: Path) -> None:
    ended = read(READERS[name], dict(READERS[name].files()), tmp_path)
    assert (ended.how, ended.what) == ("read", "")


@pytest.mark.parametrize("name", READERS)
def test_a_spoilt_file_breaks_no_reader(name: str, tmp_path: Path) -> None:
    ends = [trial(name, seed, tmp_path) for seed in range(TRIALS)]
    assert [ended.what for ended in ends if ended.how == "broke"] == []
    assert {ended.how for ended in ends} & {"refused", "read"}


# What broke a reader once, found by `tests.stress.fuzz`: by the reader, the file that it takes and a number.
BROKE = sorted((Path(__file__).parent / "broke").iterdir())


@pytest.mark.parametrize("path", BROKE, ids=lambda path: path.name)
def test_what_broke_a_reader_once_does_so_no_more(path: Path, tmp_path: Path) -> None:
    name, file, _ = path.name.split("--")
    reader = READERS[name.replace("_", " ") if name not in READERS else name]
    ended = read(reader, dict(reader.files()) | {file: path.read_bytes()}, tmp_path)
    assert ended.how in ("read", "refused"), ended.what


_LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.dates() | st.datetimes()
_VALUES = st.recursive(_LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner))
_GOOD = {name: tomllib.loads(text) for name, text in (("case", CASE), ("study", STUDY), ("drive", DRIVE))}


def _places(content: Any) -> list[tuple[Any, Any]]:
    """Every table and list of a file's content, with each of its keys."""
    keys = list(content) if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else []
    return [(content, key) for key in keys] + [place for key in keys for place in _places(content[key])]


def _said(read: Callable[[], object]) -> str | None:
    """The sentence of a reader; None where it refuses nothing."""
    try:
        read()
    except UserError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", _GOOD)
@settings(max_examples=150)
@given(data=st.data())
def test_any_value_at_any_place_is_taken_or_refused_in_a_sentence(name: str, data: st.DataObject) -> None:
    content = copy.deepcopy(_GOOD[name])
    table, key = data.draw(st.sampled_from(_places(content)))
    table[key] = data.draw(_VALUES)
    said = _said(lambda: check_case(content, "case.toml") if name == "case" else Study(**content))
    assert said is None or faults(f"{name}.toml: {said}", [f"{name}.toml"]) == ""


@given(text=st.text() | st.text(alphabet="[]{}.=\"'\\na1-:, \t#\\\\ux"))
def test_any_text_is_toml_or_refused_in_a_sentence(text: str) -> None:
    said = _said(lambda: toml.parsed(text, "a.toml"))
    assert said is None or faults(said, ["a.toml"]) == ""


@given(value=_VALUES)
def test_any_json_is_no_tuning(value: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("tuning") / "tuning.json"
    path.write_text(json.dumps(value, default=str), encoding="utf-8")
    with pytest.raises(UserError, match=r"tuning\.json"):
        read_tunings(path)


def _no_file(place: Path, what: str) -> None:
    """Put something that is no file where a file was."""
    place.unlink()
    match what:
        case "folder":
            place.mkdir()
        case "pipe":
            os.mkfifo(place)
        case "link to a device":
            place.symlink_to("/dev/zero")
        case "link to nothing":
            place.symlink_to("nowhere")
        case "link to itself":
            place.symlink_to(place.name)


@pytest.mark.parametrize("what", ["folder", "pipe", "link to a device", "link to nothing", "link to itself", "nothing"])
@pytest.mark.parametrize(
    ("name", "file"),
    [("case", "case.toml"), ("case", "two.csv"), ("preset", "own.toml"), ("study", "study.toml"),
     ("study of a case", "one.csv"), ("study of a case", "case.toml"), ("mission", "mission.toml"),
     ("tuning", "tuning.json"), ("effect", "effects.py"), ("arbin.csv", "arbin.csv"), ("log.xlsx", "log.xlsx")],
)  # fmt: skip
def test_what_is_no_file_is_said_and_never_read(name: str, file: str, what: str, tmp_path: Path) -> None:
    reader = READERS[name]
    for other, content in reader.files().items():
        (tmp_path / other).write_bytes(content)
    _no_file(tmp_path / file, what)
    with pytest.raises(UserError) as caught:
        reader.read(tmp_path)
    assert faults(str(caught.value), [file]) == ""


@pytest.mark.parametrize(
    ("name", "file", "old", "new", "says"),
    [
        ("study", "study.toml", "duration_s = 60", "duration_s = 6e9", "for which there is no memory"),
        ("study", "study.toml", "duration_s = 60", "duration_s = 1e300", "for which there is no memory"),
        ("study", "study.toml", "step_s = 5", "step_s = 1e-320", "whole number of steps"),
        ("study", "study.toml", "count = 4", "count = 4_000_000_000", "at most 1e+06"),
        ("study", "study.toml", "count = 8", "count = 8_000_000_000", "at most"),
        ("study", "study.toml", "start = 2.0, stop = 5.0, count = 4", "start = 1, stop = 5, step = 1e-9", "raise step"),
        ("study", "study.toml", '"sobol"\ncount = 8', '"latin_hypercube"\ncount = 900_000_000', 'use method = "sobol"'),
        ("study of a case", "study.toml", "repeat = 3", "repeat = 3_000_000", "repeat less"),
        ("drive", "study.toml", "repeat = 2", "repeat = 2_000_000", "for which there is no memory"),
        ("mission", "mission.toml", "step_s = 2", "step_s = 0.0001", "for which there is no memory"),
    ],
)  # fmt: skip
def test_a_number_that_needs_more_memory_than_there_is_is_not_tried(
    name: str, file: str, old: str, new: str, says: str, tmp_path: Path
) -> None:
    files = {other: content.decode() for other, content in READERS[name].files().items()}
    assert old in files[file]
    files[file] = files[file].replace(old, new, 1)
    ended = read(READERS[name], {other: text.encode() for other, text in files.items()}, tmp_path)
    assert ended.how == "refused", ended.what
    assert says in ended.what


@pytest.mark.parametrize(
    ("sentence", "wrong"),
    [
        ("a/case.toml: kind is missing; add it.", ""),
        ("a/case.toml: kind is missing; add it", "does not end"),
        ("kind is missing; add it.", "names no place"),
        ("a/case.toml: kind is missing.", "says nothing to do"),
        ("a/case.toml: Input should be 'cell'; correct it.", "has 'Input should'"),
        ("a/case.toml:\nkind is missing; add it.", "has control characters or line ends"),
        ("a/case.toml: KeyError; correct it.", "has 'KeyError'"),
    ],
)
def test_what_is_no_sentence_for_a_person_is_found(sentence: str, wrong: str) -> None:
    assert faults(sentence, ["case.toml"]) == wrong


def test_a_sentence_is_short_and_on_one_line_whatever_a_file_puts_into_it() -> None:
    said = str(UserError("case.toml: there is no '" + "x\x1b[31m\n" * 5000 + "'; correct it."))
    assert faults(said, ["case.toml"]) == ""
