"""A remark is a sentence, with what a program acts on beside it."""

from __future__ import annotations

import ast
import copy
import json
import pickle
import re
from pathlib import Path

import jaxmodel
from jaxmodel.base.remark import CODES, Remark

SAID = Remark("The noise is not stated.", "noise_not_stated", "voltage_V", sd=0.002)
PACKAGE = Path(jaxmodel.__file__).parent


def made() -> list[tuple[str, set[str]]]:
    """The code and the names of the numbers of every remark that the package makes; "" for `**numbers`."""
    calls = [
        node
        for path in sorted(PACKAGE.rglob("*.py"))
        if path.name != "saved.py"  # it reads remarks
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Remark"
    ]
    return [(ast.literal_eval(call.args[1]), {keyword.arg or "" for keyword in call.keywords}) for call in calls]


def test_a_remark_is_used_as_its_sentence() -> None:
    assert SAID == "The noise is not stated."
    assert {SAID: 1}["The noise is not stated."] == 1
    assert f"Note: {SAID}" == "Note: The noise is not stated."
    assert repr(SAID) == repr(str(SAID))
    assert json.dumps([SAID]) == '["The noise is not stated."]'
    assert type(str(SAID)) is str


def test_copies_and_pickles_are_remarks() -> None:
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(SAID, protocol))
        assert (type(again), again.record()) == (Remark, SAID.record())
    for again in (copy.copy(SAID), copy.deepcopy(SAID)):
        assert (type(again), again.record()) == (Remark, SAID.record())


def test_a_number_may_have_any_name() -> None:
    assert Remark("One.", "impossible", "run-01", code=1.0, subject=2.0, sentence=3.0).numbers == {
        "code": 1.0,
        "subject": 2.0,
        "sentence": 3.0,
    }


def test_every_code_is_listed_and_every_listed_one_is_used() -> None:
    assert {code for code, _ in made()} == CODES.keys()
    assert all(re.fullmatch(r"[a-z]+(_[a-z]+)*", code) for code in CODES)


def test_numbers_are_those_that_are_listed() -> None:
    for code, names in made():
        listed = set(CODES[code].numbers)
        assert names - {""} <= listed, code
        if "" not in names:
            assert names == listed, code
