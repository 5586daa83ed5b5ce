"""Project rules that are tested: which package imports which, module size, and forbidden text."""

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
    "importing": {"jaxmodel"},
    "sweeps": {"jaxmodel"},
    "sensitivity": {"jaxmodel", "sweeps"},
    "discrepancy": {"jaxmodel", "sensitivity"},
    "operation": {"jaxmodel", "sweeps", "sensitivity"},
    "parameterisation": {"jaxmodel"},
    "plots": {"jaxmodel", "importing", "sweeps", "sensitivity", "discrepancy", "operation", "parameterisation"},
    "workbench": {
        "jaxmodel",
        "importing",
        "sweeps",
        "sensitivity",
        "discrepancy",
        "operation",
        "parameterisation",
        "plots",
    },
}
# The parts of `discrepancy`, from low to high: each may import only parts of lower levels.
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
    {"finishing"},
    {"__init__"},
]
WITHOUT_FRONT_END = ["jaxmodel", "importing", "sweeps", "sensitivity", "operation", "parameterisation"]
FRONT_END = set(
    "altair bokeh click dash fastapi flask jinja2 matplotlib nicegui plotly rich seaborn starlette streamlit textual "
    "tornado tqdm typer uvicorn".split()
)
FRONT_END_OF_PYTHON = set("argparse curses http optparse socketserver tkinter webbrowser wsgiref".split())
MOST_LINES = 400
FORBIDDEN_TEXT = {
    "absolute path": re.compile(r"(?<![\w.:/~-])/(home|root|work|Users)/\w"),
    "registry host": re.compile(r"\b(pypi\.org|pythonhosted\.org|anaconda\.org|npmjs\.(org|com))\b"),
}


def modules_of(package: str) -> list[Path]:
    return sorted((REPOSITORY / package).rglob("*.py"))


def imports_of(path: Path, within: type | None = None) -> Iterator[tuple[str, int]]:
    """The top-level package and line of every absolute import, anywhere in a module or only at its top level."""
    module = ast.parse(path.read_text(encoding="utf-8"), str(path))
    for node in module.body if within is ast.Module else ast.walk(module):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split(".")[0], node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0], node.lineno


def imports_into(package: str) -> Iterator[tuple[str, str]]:
    """Each top-level package that a package imports, with the place of the import.

    Only `plotting.py` may import `plots`, inside its functions: a result draws itself on request.
    """
    for path in modules_of(package):
        at_top = {line for _, line in imports_of(path, ast.Module)}
        for imported, line in imports_of(path):
            if imported in ("plots", "matplotlib") and path.name == "plotting.py" and line not in at_top:
                continue
            yield imported, f"{path.relative_to(REPOSITORY)}:{line}: import of {imported}"


def texts_of_project() -> Iterator[tuple[Path, str]]:
    """Every text file that .gitignore does not name; read here because git may be absent."""
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


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_package_imports_only_the_packages_it_may(package: str) -> None:
    others = MAY_IMPORT.keys() - MAY_IMPORT[package] - {package}
    assert [place for imported, place in imports_into(package) if imported in others] == []


def test_parts_of_the_diagnosis_import_only_lower_ones() -> None:
    level = {part: number for number, parts in enumerate(DISCREPANCY) for part in parts}
    upward = []
    for path in modules_of("discrepancy"):
        own = path.relative_to(REPOSITORY / "discrepancy").with_suffix("").parts[0]
        module = ast.parse(path.read_text(encoding="utf-8"), str(path))
        # Methods of results (summary, write, plot) import what they need when called.
        for node in module.body if own in ("result", "plotting") else ast.walk(module):
            if not isinstance(node, ast.ImportFrom) or (node.module or "").split(".")[0] != "discrepancy":
                continue
            _, *inside = (node.module or "").split(".")
            for other in inside[:1] or [alias.name for alias in node.names]:
                if other != own and level[other] >= level[own]:
                    upward.append(f"{path.relative_to(REPOSITORY)}:{node.lineno}: {own} imports {other}")
    assert upward == []
    # The list is complete.
    assert set(level) == {
        path.stem for path in (REPOSITORY / "discrepancy").iterdir() if path.suffix in ("", ".py")
    } - {"__pycache__"}


@pytest.mark.parametrize("package", WITHOUT_FRONT_END)
def test_package_imports_no_plotting_web_or_command_line(package: str) -> None:
    front_end = FRONT_END | FRONT_END_OF_PYTHON
    assert [place for imported, place in imports_into(package) if imported in front_end] == []


def test_importing_every_module_without_a_front_end_loads_none() -> None:
    """Other dependencies could load a front end indirectly."""
    modules = [path.relative_to(REPOSITORY).with_suffix("") for p in WITHOUT_FRONT_END for path in modules_of(p)]
    names = [".".join(module.parts).removesuffix(".__init__") for module in modules]
    program = f"import importlib, sys; [importlib.import_module(name) for name in {names}]; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, timeout=120
    )
    assert result.returncode == 0, result.stderr
    loaded = set(result.stdout.split())
    assert set(WITHOUT_FRONT_END) <= loaded
    assert loaded & FRONT_END == set()


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_package_imports_only_declared_dependencies(package: str) -> None:
    """A package that needs a dependency of the test extra would work here and fail for a user."""
    project = PROJECT["project"]
    extras = project["optional-dependencies"]
    declared = project["dependencies"] + extras["cluster"] + extras["s3"] + extras["matlab"] + extras["workbench"]
    known = {re.split(r"[^\w-]", requirement)[0].replace("-", "_") for requirement in declared}
    known |= {"pydantic_core"}  # half of pydantic
    known |= sys.stdlib_module_names | MAY_IMPORT.keys()
    assert [place for imported, place in imports_into(package) if imported not in known] == []


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_package_says_in_one_docstring_what_it_is(package: str) -> None:
    module = ast.parse((REPOSITORY / package / "__init__.py").read_text(encoding="utf-8"))
    assert ast.get_docstring(module)


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_every_package_of_package_is_installed(package: str) -> None:
    packages = {".".join(path.parent.relative_to(REPOSITORY).parts) for path in modules_of(package)}
    listed = {name for name in PROJECT["tool"]["setuptools"]["packages"] if name.split(".")[0] == package}
    assert packages == listed


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_module_is_short(package: str) -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules_of(package)}
    assert {str(path.relative_to(REPOSITORY)): lines for path, lines in lengths.items() if lines > MOST_LINES} == {}


def test_tests_mirror_the_packages() -> None:
    tested = {path.parent.relative_to(REPOSITORY / "tests").parts[:1] for path in REPOSITORY.glob("tests/**/test_*.py")}
    with_code = {(package,) for package in MAY_IMPORT if len(modules_of(package)) > 1}
    # tests/independent is the independent simulator, tested like the product; tests/stress is of every reader.
    assert tested - {(), ("independent",), ("examples",), ("stress",)} == with_code


def test_every_dependency_has_its_reason_and_is_used() -> None:
    project = PROJECT["project"]
    extras = {
        name: listed
        for name, listed in project["optional-dependencies"].items()
        if name not in ("docs", "test", "peers")
    }
    listed = [*project["dependencies"], *(one for extra in extras.values() for one in extra)]
    names = {re.split(r"[><=~ ;\[]", one)[0] for one in listed}
    table = (REPOSITORY / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("| dependency | reason |")[2]
    rows = [line.split("|") for line in table.partition("\n\n")[0].splitlines() if line.startswith("| `")]
    assert {name for row in rows for name in re.findall(r"`([\w-]+)`", row[1].partition("(")[0])} == names
    assert all(row[2].strip() for row in rows)
    sources = "".join(path.read_text(encoding="utf-8") for package in MAY_IMPORT for path in modules_of(package))
    assert [name for name in names if not re.search(rf"\b{name.replace('-', '_')}\b", sources)] == []


def test_constraints_pin_exact_versions() -> None:
    lines = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert pins
    assert [line for line in pins if not re.fullmatch(r"[A-Za-z0-9._-]+==[0-9][A-Za-z0-9.]*", line)] == []


@pytest.mark.parametrize("what", FORBIDDEN_TEXT)
def test_no_file_contains(what: str) -> None:
    """The project does not depend on its folder or on a package registry."""
    assert [
        f"{path}:{number}: {line.strip()[:100]}"
        for path, text in texts_of_project()
        for number, line in enumerate(text.splitlines(), start=1)
        if FORBIDDEN_TEXT[what].search(line)
    ] == []


# Calls that run what they are given, and where one is: each reads only what the user himself has put there.
RUNS_WHAT_IT_IS_GIVEN = {
    "eval", "exec", "compile", "__import__", "os.system", "os.popen", "runpy.run_path", "pickle.load", "pickle.loads",
    "marshal.loads", "yaml.load", "pd.read_pickle", "frame.eval", "spec.loader.exec_module",
}  # fmt: skip
ALLOWED_TO_RUN = {
    ("jaxmodel/data/importing/formulas.py", "frame.eval"),  # of pandas, once the formula has been found to be one
    ("jaxmodel/case/build.py", "spec.loader.exec_module"),  # --effect
    ("jaxmodel/diagnosis/fitting/programs.py", "pickle.loads"),  # from the folder of `jaxmodel.base.cache`
    ("sweeps/cluster.py", "pickle.loads"),  # what this process sent to a worker of its own cluster
}


def calls_of(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """The name of what each call calls, as it is written, and the call."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def test_nothing_runs_what_it_reads_but_where_the_user_has_put_it_there() -> None:
    paths = [path for package in MAY_IMPORT for path in modules_of(package)]
    calls = {(str(path.relative_to(REPOSITORY)), name) for path in paths for name, _ in calls_of(path)}
    assert {call for call in calls if call[1] in RUNS_WHAT_IT_IS_GIVEN} == ALLOWED_TO_RUN


def test_no_shell_is_used_and_no_array_is_a_pickle() -> None:
    flags = {
        f"{path.relative_to(REPOSITORY)}:{call.lineno}: {keyword.arg}"
        for package in MAY_IMPORT
        for path in modules_of(package)
        for _, call in calls_of(path)
        for keyword in call.keywords
        if keyword.arg in ("shell", "allow_pickle")
    }
    assert flags == set()


def test_every_slow_test_that_is_listed_is_there() -> None:
    """A line that names no test leaves nothing out."""
    listed = (REPOSITORY / "tests" / "slow.txt").read_text(encoding="utf-8").splitlines()[1:]
    assert listed == sorted(set(listed))
    for line in listed:
        file, _, test = line.partition("::")
        assert f"def {test.partition('[')[0]}(" in (REPOSITORY / file).read_text(encoding="utf-8"), line


def test_annotations_are_checked_while_tests_run() -> None:
    """Without the import hook every other test would still pass, and check less."""
    from jaxmodel.base.errors import nearest

    with pytest.raises(jaxtyping.TypeCheckError):
        nearest(3, ["a name"])
