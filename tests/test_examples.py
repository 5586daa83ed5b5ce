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


@pytest.mark.parametrize("example", EXAMPLES, ids=[one.name for one in EXAMPLES])
def test_example_shows_what_it_says(example: doctest.DocTest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(REPOSITORY)
    said: list[str] = []
    flags = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS
    failed, tried = doctest.DocTestRunner(optionflags=flags).run(example, out=said.append)
    assert tried > 0
    assert failed == 0, "".join(said)
