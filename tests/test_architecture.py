"""The house rules that a machine can hold: who may import whom, how large a module is, what no file may contain."""

from __future__ import annotations

import ast
import fnmatch
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest

REPOSITORY = Path(__file__).parents[1]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))

MAY_IMPORT = {
    "jaxmodel": set(),
    "sweeps": {"jaxmodel"},
    "sensitivity": {"jaxmodel", "sweeps"},
    "discrepancy": {"jaxmodel", "sensitivity"},
    "operation": {"jaxmodel", "sweeps", "sensitivity"},
    "plots": {"jaxmodel", "sweeps", "sensitivity", "discrepancy", "operation"},
    "workbench": {"jaxmodel", "sweeps", "sensitivity", "discrepancy", "operation", "plots"},
}
# The parts of `discrepancy`, low to high: each may import those of lower levels, and none beside it.
DISCREPANCY = [
    {"settings", "plotting"},
    {"result", "residuals"},
    {"wording", "answer"},
    {"preparation", "decision"},
    {"noise"},
    {"fitting"},
    {"screening"},
    {"evidence"},
    {"workings"},
    {"gates"},
    {"policy", "rungs", "advice", "findings", "tolerances", "extended", "names"},
    {"summary", "investigation", "identification"},
    {"diagnosis"},
    {"__init__"},
]
WITHOUT_FRONT_END = ["jaxmodel", "sweeps", "sensitivity", "operation"]
FRONT_END = set(
    "altair bokeh click dash fastapi flask jinja2 matplotlib plotly rich seaborn starlette streamlit textual tornado "
    "tqdm typer uvicorn".split()
)
FRONT_END_OF_PYTHON = set("argparse curses http optparse socketserver tkinter webbrowser wsgiref".split())
MOST_LINES = 400
FORBIDDEN_TEXT = {
    "absolute path": re.compile(r"(?<![\w.:/~-])/(home|root|work|Users)/\w"),
    "registry host": re.compile(r"\b(pypi\.org|pythonhosted\.org|anaconda\.org|npmjs\.(org|com))\b"),
}


def modules_of(room: str) -> list[Path]:
    return sorted((REPOSITORY / room).rglob("*.py"))


def imports_of(path: Path, within: type | None = None) -> Iterator[tuple[str, int]]:
    """The top-level package of every absolute import, wherever in the module it stands or only at its top, its line."""
    module = ast.parse(path.read_text(encoding="utf-8"), str(path))
    for node in module.body if within is ast.Module else ast.walk(module):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0], node.lineno


def imports_into(room: str) -> Iterator[tuple[str, str]]:
    """Each top-level package that the room imports, with the place of the import.

    `plotting.py` alone may reach for `plots`, inside its functions: a result draws itself when it is asked to.
    """
    for path in modules_of(room):
        at_top = {line for _, line in imports_of(path, ast.Module)}
        for package, line in imports_of(path):
            if package in ("plots", "matplotlib") and path.name == "plotting.py" and line not in at_top:
                continue
            yield package, f"{path.relative_to(REPOSITORY)}:{line}: import of {package}"


def texts_of_project() -> Iterator[tuple[Path, str]]:
    """Every text file that .gitignore does not name; the list is read here because git may be absent."""
    entries = (REPOSITORY / ".gitignore").read_text(encoding="utf-8").splitlines()
    ignored = [".git", *(entry.rstrip("/") for entry in entries if entry and not entry.startswith("#"))]

    def kept(names: list[str]) -> list[str]:
        return [name for name in names if not any(fnmatch.fnmatch(name, pattern) for pattern in ignored)]

    for folder, subfolders, files in os.walk(REPOSITORY):
        subfolders[:] = kept(subfolders)
        for path in (Path(folder, name) for name in kept(files)):
            try:
                yield path.relative_to(REPOSITORY), path.read_text(encoding="utf-8")
            except UnicodeDecodeError:
                continue


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_room_imports_only_the_rooms_it_may(room: str) -> None:
    others = MAY_IMPORT.keys() - MAY_IMPORT[room] - {room}
    assert [place for package, place in imports_into(room) if package in others] == []


def test_parts_of_the_diagnosis_import_only_lower_ones() -> None:
    level = {part: number for number, parts in enumerate(DISCREPANCY) for part in parts}
    upward = []
    for path in modules_of("discrepancy"):
        own = path.relative_to(REPOSITORY / "discrepancy").with_suffix("").parts[0]
        module = ast.parse(path.read_text(encoding="utf-8"), str(path))
        # What a result can do for its user (summary, write, plot) is imported when it is called.
        for node in module.body if own in ("result", "plotting") else ast.walk(module):
            if not isinstance(node, ast.ImportFrom) or (node.module or "").split(".")[0] != "discrepancy":
                continue
            _, *inside = (node.module or "").split(".")
            for other in inside[:1] or [alias.name for alias in node.names]:
                if other != own and level[other] >= level[own]:
                    upward.append(f"{path.relative_to(REPOSITORY)}:{node.lineno}: {own} imports {other}")
    assert upward == []
    # Those named are all there are.
    assert set(level) == {path.stem for path in (REPOSITORY / "discrepancy").iterdir() if path.stem != "__pycache__"}


@pytest.mark.parametrize("room", WITHOUT_FRONT_END)
def test_room_imports_no_plotting_web_or_command_line(room: str) -> None:
    front_end = FRONT_END | FRONT_END_OF_PYTHON
    assert [place for package, place in imports_into(room) if package in front_end] == []


@pytest.mark.parametrize("room", WITHOUT_FRONT_END)
def test_importing_every_module_of_room_loads_no_front_end(room: str) -> None:
    """The other packages we use could load one behind our back."""
    modules = [path.relative_to(REPOSITORY).with_suffix("") for path in modules_of(room)]
    names = [".".join(module.parts).removesuffix(".__init__") for module in modules]
    program = f"import importlib, sys; [importlib.import_module(name) for name in {names}]; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, timeout=120
    )
    assert result.returncode == 0, result.stderr
    loaded = set(result.stdout.split())
    assert room in loaded
    assert loaded & FRONT_END == set()


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_room_imports_only_declared_dependencies(room: str) -> None:
    """A room that leans on a package of the test extra would work here and fail for a user."""
    project = PROJECT["project"]
    declared = project["dependencies"] + project["optional-dependencies"]["cluster"]
    known = {re.split(r"\W", requirement)[0] for requirement in declared} | {"pydantic_core"}  # half of pydantic
    known |= sys.stdlib_module_names | MAY_IMPORT.keys()
    assert [place for package, place in imports_into(room) if package not in known] == []


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_room_says_in_one_docstring_what_it_is(room: str) -> None:
    module = ast.parse((REPOSITORY / room / "__init__.py").read_text(encoding="utf-8"))
    assert ast.get_docstring(module)


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_every_package_of_room_is_installed(room: str) -> None:
    packages = {".".join(path.parent.relative_to(REPOSITORY).parts) for path in modules_of(room)}
    listed = {name for name in PROJECT["tool"]["setuptools"]["packages"] if name.split(".")[0] == room}
    assert packages == listed


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_module_is_read_in_one_sitting(room: str) -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules_of(room)}
    assert {str(path.relative_to(REPOSITORY)): lines for path, lines in lengths.items() if lines > MOST_LINES} == {}


def test_tests_mirror_the_rooms() -> None:
    tested = {path.parent.relative_to(REPOSITORY / "tests").parts[:1] for path in REPOSITORY.glob("tests/**/test_*.py")}
    with_code = {(room,) for room in MAY_IMPORT if len(modules_of(room)) > 1}
    # tests/independent is the referee: a second simulator, tested like the product.
    assert tested - {(), ("independent",), ("examples",)} == with_code


def test_constraints_pin_exact_versions() -> None:
    lines = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert pins
    assert [line for line in pins if not re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.]*", line)] == []


@pytest.mark.parametrize("what", FORBIDDEN_TEXT)
def test_no_file_contains(what: str) -> None:
    """The project is the same wherever it lies and wherever its packages come from."""
    assert [
        f"{path}:{number}: {line.strip()[:100]}"
        for path, text in texts_of_project()
        for number, line in enumerate(text.splitlines(), start=1)
        if FORBIDDEN_TEXT[what].search(line)
    ] == []


def test_annotations_are_checked_while_tests_run() -> None:
    """Without the import hook every other test would still pass, and check less."""
    from jaxmodel.errors import nearest

    with pytest.raises(jaxtyping.TypeCheckError):
        nearest(3, ["a name"])
