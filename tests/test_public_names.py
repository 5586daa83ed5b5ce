"""What a user imports: the public names are there, examples and pages need no others, and a user's files stay apart."""

from __future__ import annotations

import ast
import importlib
import json
import re
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.public_rooms import PUBLIC

REPOSITORY = Path(__file__).parents[1]
NAMES = {room: set(importlib.import_module(room).__all__) for room in PUBLIC}
# Folders of this repository that are no package of a user's, and the two that have a name at the top as well.
OWN = ("jaxmodel", "sweeps", "sensitivity")
# They make the documentation of the code, from the inside of it.
TOOLS = {"docs/make_parameters.py", "docs/site_hooks.py"}
BLOCK = re.compile(r"^( *)```python[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
IMPORT = re.compile(r"^\s*(?:from jaxmodel[\w.]* import [\w, {}()]+|import jaxmodel[\w.]*)", re.MULTILINE)
DOTTED = re.compile(r"`(jaxmodel(?:\.\w+)+)")


def files(pattern: str, *folders: str) -> list[Path]:
    found = {path for folder in folders for path in (REPOSITORY / folder).rglob(pattern)}
    return sorted(path for path in found if "__pycache__" not in path.parts)


def pages() -> list[Path]:
    return [REPOSITORY / "README.md", REPOSITORY / "CONTRIBUTING.md", *files("*.md", "docs", "examples")]


def examples() -> Iterator[tuple[str, str]]:
    """Each piece of code that a user may copy, with its place."""
    for path in files("*.py", "examples", "docs"):
        place = path.relative_to(REPOSITORY).as_posix()
        if place not in TOOLS:
            yield place, path.read_text(encoding="utf-8")
    for path in pages():
        for block in BLOCK.finditer(path.read_text(encoding="utf-8")):
            yield path.relative_to(REPOSITORY).as_posix(), textwrap.dedent(block[2])
    for path in files("*.ipynb", "docs"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        yield path.relative_to(REPOSITORY).as_posix(), "\n".join(code)


def written() -> Iterator[tuple[str, str]]:
    """Each import in a text of the code: the examples of docstrings, and the source that is written for a user."""
    for path in files("*.py", *OWN):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                for line in IMPORT.findall(node.value):
                    code = re.sub(r"\{\w*\}", "", line).strip().rstrip(",")
                    yield f"{path.relative_to(REPOSITORY).as_posix()}:{node.lineno}", code


def private_in(code: str) -> list[str]:
    """What a piece of code takes from the project beside the public names."""
    module = ast.parse(code)
    private, rooms = [], {}
    for node in ast.walk(module):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] in OWN:
                    rooms[alias.asname or alias.name] = alias.name
                    private += [] if alias.name in PUBLIC else [alias.name]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in OWN:
            for alias in node.names:
                if alias.name not in NAMES.get(node.module or "", ()):
                    private.append(f"{node.module}.{alias.name}")
                elif f"{node.module}.{alias.name}" in PUBLIC:
                    rooms[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    for node in ast.walk(module):
        if isinstance(node, ast.Attribute) and (room := rooms.get(ast.unparse(node.value))) in NAMES:
            public = node.attr in NAMES[room] or f"{room}.{node.attr}" in PUBLIC
            private += [] if public else [f"{room}.{node.attr}"]
    return private


def test_examples_pages_and_notebooks_need_public_names_alone() -> None:
    found = list(examples())
    assert len(found) > 40
    assert [f"{place}: {name}" for place, code in found for name in private_in(code)] == []


def test_docstrings_and_written_scripts_need_public_names_alone() -> None:
    found = list(written())
    assert len(found) > 8
    assert [f"{place}: {name}" for place, code in found for name in private_in(code)] == []


@pytest.mark.parametrize(
    ("code", "private"),
    [
        ("from jaxmodel import read_case, sweeps\nsweeps.run(sweeps.Study())", []),
        ("import jaxmodel.plots\njaxmodel.plots.heat_map", []),
        ("from jaxmodel.case.reading import read_case", ["jaxmodel.case.reading.read_case"]),
        ("from jaxmodel import sweeps as s\ns.lane", ["jaxmodel.sweeps.lane"]),
        ("import sweeps", ["sweeps"]),
        ("from sweeps import run", ["sweeps.run"]),
        ("import jaxmodel.case", ["jaxmodel.case"]),
        ("import jaxmodel\njaxmodel.case", ["jaxmodel.case"]),
    ],
)
def test_a_private_name_is_seen(code: str, private: list[str]) -> None:
    assert private_in(code) == private


def test_a_dotted_name_on_a_page_is_public() -> None:
    wrong = []
    for page in (page for page in pages() if page.name != "CONTRIBUTING.md"):
        for name in DOTTED.findall(page.read_text(encoding="utf-8")):
            room = next(room for room in sorted(PUBLIC, key=len, reverse=True) if f"{name}.".startswith(f"{room}."))
            first = name.removeprefix(room).lstrip(".").partition(".")[0]
            wrong += [] if not first or first in NAMES[room] else [f"{page.relative_to(REPOSITORY)}: {name}"]
    assert wrong == []


def test_every_public_name_has_its_place_in_the_reference() -> None:
    """A page of the reference shows what the `__all__` of its room lists."""
    shown = "".join(page.read_text(encoding="utf-8") for page in files("*.md", "docs/reference"))
    assert set(re.findall(r"^::: (\S+)$", shown, re.MULTILINE)) == set(PUBLIC)


def test_every_name_of_the_front_door_is_on_one_page() -> None:
    """The reference of `jaxmodel` is several pages, one for each job."""
    shown = [
        name
        for page in files("*.md", "docs/reference")
        for name in re.findall(r"^        - (\w+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert sorted(shown) == sorted(NAMES["jaxmodel"] - {room.partition(".")[2] for room in PUBLIC})


def output_of(code: str, folder: Path | None = None) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_import_loads_no_more_than_it_needs() -> None:
    loaded = set(output_of("import sys, jaxmodel; print(*sys.modules)").split())
    heavy = {"xarray", "zarr", "scipy", "matplotlib", "pandas", "llvmlite", "plotly", "typer", "pydantic", "equinox"}
    assert loaded & heavy == set()
    assert {name.split(".")[1] for name in loaded if name.startswith("jaxmodel.")} == {"base"}


# Names of modules that a user may well have beside a script, those of our rooms among them.
BESIDE = (
    "plots", "sweeps", "sensitivity", "operation", "workbench", "discrepancy", "effects", "model", "case", "data",
    "base", "lanes", "app", "diagnosis", "parameterisation", "importing", "presets", "examples",
)  # fmt: skip
SCRIPT = """
from jaxmodel import diagnose, effects, operation, parameterise, plots, read_case, sensitivity, simulate_case, sweeps
from jaxmodel.sweeps import Study

PROFILE = {"duration_s": 60, "step_s": 10, "current_A": 1.0, "ambient_degC": 20.0}

case = read_case("case")
print(round(float(simulate_case(case)[0].table["voltage_V"].iloc[-1]), 1))
study = Study(kind="cell", profile=PROFILE, axes={"cycles": [0.0, 100.0]})
print(sweeps.run(study).sizes["cycles"], sweeps.__name__)
print(callable(diagnose), callable(parameterise), callable(sensitivity.local), callable(operation.compensate))
plots.heat_map, effects.CATALOGUE
"""
CASE = """
kind = "cell"

[[runs]]
file = "run.csv"
split = "fit"
"""
STUDY = """
kind = "cell"
profile = { duration_s = 60, step_s = 10, current_A = 1.0, ambient_degC = 20.0 }
axes = { cycles = [0, 100] }
"""


@pytest.fixture
def users_folder(tmp_path: Path) -> Path:
    """A folder of a user with a case, a study, a script, and modules whose names could be ours."""
    for name in BESIDE:
        text = f"raise RuntimeError('the user\\'s own {name}.py was imported')\n"
        (tmp_path / f"{name}.py").write_text(text, encoding="utf-8")
    (tmp_path / "case").mkdir()
    (tmp_path / "case" / "case.toml").write_text(CASE, encoding="utf-8")
    rows = ["time_s,current_A,ambient_degC,voltage_V", *(f"{10 * row},1.0,20.0,4.0" for row in range(7))]
    (tmp_path / "case" / "run.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    return tmp_path


def run_in(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_modules_beside_a_script_are_not_taken_for_ours(users_folder: Path) -> None:
    assert run_in(users_folder, "script.py").split() == ["4.0", "2", "jaxmodel.sweeps", *4 * ["True"]]


@pytest.mark.parametrize(
    "command", [["--help"], ["simulate", "case", "--out", "simulated"], ["sweep", "study.toml", "--out", "swept"]]
)
def test_modules_beside_a_command_are_not_taken_for_ours(command: list[str], users_folder: Path) -> None:
    run_in(users_folder, "-m", "jaxmodel.app.cli", *command)
