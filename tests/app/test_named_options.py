"""`jaxmodel start` takes every option that a message names: whoever follows the advice is not refused."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

import jaxmodel
from jaxmodel.app.cli import app

ROOMS = ("data", "case", "parameterisation", "diagnosis", "fit")
# Options of other commands, named only to who gave them there, and of other programs.
OF_OTHERS = {"--parameter": "identify", "--format": "mavlogdump", "--types": "mavlogdump"}


def options_of(command: str) -> set[str]:
    group = typer.main.get_command(app)
    assert isinstance(group, typer.core.TyperGroup)
    return {name for parameter in group.commands[command].params for name in parameter.opts if name.startswith("--")}


def modules() -> Iterator[Path]:
    for room in ROOMS:
        yield from (Path(jaxmodel.__file__).parent / room).rglob("*.py")


def named(source: str) -> set[str]:
    """Return the options that the strings of a module name, docstrings left out."""
    tree = ast.parse(source)
    bodies = [node.body for node in ast.walk(tree) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)]
    said = {id(body[0].value) for body in bodies if body and isinstance(body[0], ast.Expr)}
    texts = [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in said
    ]
    return set(re.findall(r"(?<![\w-])--[a-z][a-z-]*\w", " ".join(texts)))


def test_names_are_found_in_messages_and_not_in_docstrings():
    source = '"""Of --this."""\nraise E(f"{name}: give --that-one N, or --other." "--third")\n'
    assert named(source) == {"--that-one", "--other", "--third"}


def test_start_takes_every_option_that_a_message_names():
    known = options_of("start")
    missing = {
        (name, path.name)
        for path in modules()
        for name in named(path.read_text(encoding="utf-8")) - known - OF_OTHERS.keys()
        if name != "--force"  # of import; the same sentence names the --again of start
    }
    assert not missing


def test_start_takes_every_decision_of_an_import_and_of_a_diagnosis():
    own = {"--answer-only", "--force"}  # start writes all pages; --again is its --force
    assert options_of("import") | options_of("diagnose") <= options_of("start") | own


@pytest.mark.parametrize("name", [name for name, command in OF_OTHERS.items() if command == "identify"])
def test_an_option_of_another_command_is_one(name: str):
    assert name in options_of(OF_OTHERS[name])
