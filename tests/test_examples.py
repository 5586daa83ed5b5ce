"""The examples in the docstrings of public names run, and say what they show."""

from __future__ import annotations

import doctest
import importlib
import inspect
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.public_rooms import PUBLIC

REPOSITORY = Path(__file__).parents[1]


def examples() -> Iterator[doctest.DocTest]:
    """The examples of each public name, each once; what an example needs it imports."""
    finder, seen = doctest.DocTestFinder(recurse=False), set()
    for room in PUBLIC:
        package = importlib.import_module(room)
        for name in package.__all__:
            what = getattr(package, name)
            if id(what) in seen or not (inspect.isclass(what) or inspect.isfunction(what)):
                continue
            seen.add(id(what))
            if ">>>" in (inspect.getdoc(what) or ""):
                yield from finder.find(what, f"{room}.{name}", module=False, globs={})


EXAMPLES = list(examples())
# What has no example: what takes a fit of some minutes or the files of one, and whose pages have blocks that run; and
# what nobody makes, but a model or an analysis gives.
WITHOUT = {
    "jaxmodel": {
        "AnswerChanges", "CellContext", "Diagnosis", "Extraction", "Identification", "Investigation",
        "MotorContext", "Parameterisation", "Scalar", "compare", "compare_answers",
        "conclusion", "diagnose", "finish", "history", "identify", "keep_compiled_programs", "parameterise",
        "read_diagnosis", "write_preset", "write_report",
    },
    "jaxmodel.effects": {"Signal"},
    "jaxmodel.operation": {
        "CellCharge", "Compensation", "Consistency", "Evaluation", "FilterOutput", "PackCharge", "PolynomialEstimator",
        "RunLoad", "SinglePrecision", "Trend", "cells_of_pack", "cost_per_step", "ekf", "estimate_load",
        "evaluate_estimators", "interpolation_error", "paper_rule_error", "read_tunings", "sides", "trend",
    },
    "jaxmodel.plots": {"errors_by_run", "errors_of_models", "pulse_by_pulse"},
    "jaxmodel.sensitivity": {"read_estimates"},
    "jaxmodel.sweeps": {"End", "Moment", "Step"},
}  # fmt: skip


@pytest.mark.parametrize("example", EXAMPLES, ids=[one.name for one in EXAMPLES])
def test_example_shows_what_it_says(example: doctest.DocTest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    said: list[str] = []
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    failed, tried = doctest.DocTestRunner(optionflags=flags).run(example, out=said.append)
    assert tried > 0
    assert failed == 0, "".join(said)


@pytest.mark.parametrize("room", PUBLIC)
def test_every_other_public_name_has_an_example(room: str) -> None:
    package = importlib.import_module(room)
    lacking = {
        name
        for name in package.__all__
        if inspect.isclass(what := getattr(package, name)) or inspect.isfunction(what)
        if ">>>" not in (inspect.getdoc(what) or "")
    }
    assert lacking <= WITHOUT[room]
