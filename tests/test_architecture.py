"""Project rules that are tested: which room imports which, module size, and forbidden text."""

from __future__ import annotations

import ast
import fnmatch
import importlib
import inspect
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest

from tests.import_graph import FLOORS, NAME, Graph, arrows_down, graph_of, imported_names, room_of

REPOSITORY = Path(__file__).parents[1]
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
GRAPH = graph_of(REPOSITORY)
ROOMS = [room for rooms in FLOORS for room in rooms]
WITHOUT_FRONT_END = [room for room in ROOMS if room not in ("plots", "app")]
FRONT_END = set(
    "altair bokeh click dash fastapi flask jinja2 matplotlib nicegui plotly rich seaborn starlette streamlit textual "
    "tornado tqdm typer uvicorn".split()
)
FRONT_END_OF_PYTHON = set("argparse curses http optparse socketserver tkinter webbrowser wsgiref".split())
MOST_LINES = 600
FORBIDDEN_TEXT = {
    "absolute path": re.compile(r"(?<![\w.:/~-])/(home|root|work|Users)/\w"),
    "registry host": re.compile(r"\b(pypi\.org|pythonhosted\.org|anaconda\.org|npmjs\.(org|com))\b"),
}


def modules_of(room: str) -> list[Path]:
    return [path for module, path in GRAPH.paths.items() if room_of(module) == room]


def files_of(folder: str) -> list[Path]:
    return sorted((REPOSITORY / folder).rglob("*.py"))


def place(path: Path) -> str:
    return path.relative_to(REPOSITORY).as_posix()


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imports_into(room: str) -> Iterator[tuple[str, str]]:
    """Each top-level package that a room imports, with the place of the import.

    `plotting.py` may name a type of matplotlib, in an `if TYPE_CHECKING`: the pictures of a record return figures.
    """
    for path in modules_of(room):
        tree = tree_of(path)
        if path.name == "plotting.py":
            tree.body = [node for node in tree.body if not (isinstance(node, ast.If) and "TYPE" in ast.dump(node.test))]
        for name, line in imported_names(tree):
            yield name.split(".")[0], f"{place(path)}:{line}: import of {name}"


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


def test_imports_go_up_only() -> None:
    """A room imports from lower floors alone, and nothing imports the root."""
    assert arrows_down(GRAPH) == []


def test_no_modules_import_each_other() -> None:
    """Not in a function and not for a type either: a circle is one thing in two files."""
    assert GRAPH.circles() == []


def test_every_module_is_imported_by_one_name() -> None:
    """`sweeps.study` beside `jaxmodel.sweeps.study` would be a second module, with classes of its own."""
    by_another_name = re.compile(r"^ *(from|import) (sweeps|sensitivity)\.\w+", re.MULTILINE)
    paths = [path for top in (NAME, "sweeps", "sensitivity", "tests", "benchmarks") for path in files_of(top)]
    assert [place(path) for path in paths if by_another_name.search(path.read_text(encoding="utf-8"))] == []


# Trees that someone could make, each with what is wrong with it.
ALLOWED = {"base/a": "", "model/b": "from jaxmodel.base import a", "model/c": "from jaxmodel.model.b import a"}
DOWN = {
    "at the top": {"base/a": "from jaxmodel.model.b import f"},
    "of a module": {"base/a": "from jaxmodel.model import b"},
    "in a function": {"base/a": "def f():\n    import jaxmodel.model.b"},
    "for a type": {"base/a": "if TYPE_CHECKING:\n    from jaxmodel.model.b import B"},
    "of the root": {"model/c": "from jaxmodel import simulate"},
    "of a folder at the top": {"model/c": "from sweeps.study import Study", "sweeps/study": ""},
    "across": {"diagnosis/a": "from jaxmodel.parameterisation.b import f", "parameterisation/b": ""},
    "of a facade": {"base/a": "from jaxmodel.plots import ladder", "plots/__init__": ""},
    "of a room without a floor": {"cellar/a": "import os"},
    "of a module beside the rooms": {"attic": "import os"},
}
CIRCLES = {
    "in a function": {"model/b": "def f():\n    from jaxmodel.model.c import g"},
    "for a type": {"model/b": "if TYPE_CHECKING:\n    from jaxmodel.model.c import C"},
    "through a third": {"model/b": "import jaxmodel.model.d", "model/d": "from jaxmodel.model import c"},
    "through a facade": {"model/b": "from jaxmodel.model import d", "model/__init__": "import jaxmodel.model.b"},
}


def made_up(folder: Path, files: dict[str, str]) -> Graph:
    files = {"__init__": "from jaxmodel.model.b import f", "model/__init__": ""} | files
    for name, text in files.items():
        room = name.split("/")[0]
        file = (folder if room in ("sweeps", "sensitivity") else folder / NAME) / f"{name}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return graph_of(folder)


def test_a_tree_whose_imports_go_up_is_allowed(tmp_path: Path) -> None:
    graph = made_up(tmp_path, ALLOWED)
    assert sum(len(imported) for imported in graph.arrows.values()) == 3
    assert (arrows_down(graph), graph.circles()) == ([], [])


@pytest.mark.parametrize("files", DOWN.values(), ids=list(DOWN))
def test_an_arrow_that_goes_down_is_found(tmp_path: Path, files: dict[str, str]) -> None:
    (found,) = arrows_down(made_up(tmp_path, ALLOWED | files))
    assert next(iter(files)).replace("/", ".") in found


@pytest.mark.parametrize("files", CIRCLES.values(), ids=list(CIRCLES))
def test_a_circle_is_found(tmp_path: Path, files: dict[str, str]) -> None:
    graph = made_up(tmp_path, ALLOWED | files)
    assert arrows_down(graph) == []
    (found,) = graph.circles()
    assert "jaxmodel.model.b" in found


def late_bound_calls() -> Iterator[tuple[str, str, str, ast.Call | None]]:
    """Every `late_bound(name)`: its module, the function that has it, the name, and the call of what it returns."""
    for module, path in GRAPH.paths.items():
        for outer in ast.walk(tree_of(path)):
            for method in outer.body if isinstance(outer, ast.ClassDef) else ():
                if not isinstance(method, ast.FunctionDef):
                    continue
                nodes = list(ast.walk(method))
                calls = [node for node in nodes if isinstance(node, ast.Call)]
                for node in (one for one in calls if ast.unparse(one.func) == "late_bound"):
                    named = {
                        ast.unparse(target)
                        for one in nodes
                        if isinstance(one, ast.Assign) and node in ast.walk(one.value)
                        for target in ast.walk(one.targets[0])
                    }
                    use = next((one for one in calls if one.func is node or ast.unparse(one.func) in named), None)
                    yield module, f"{outer.name}.{method.name}", ast.literal_eval(node.args[0]), use


def test_methods_of_records_are_bound_to_functions_above_them() -> None:
    """What is late bound is the method of a class, stands above its module, is there, and takes these arguments."""
    found = list(late_bound_calls())
    sources = "".join(path.read_text(encoding="utf-8") for path in GRAPH.paths.values())
    definition_and_example = 2
    assert len(found) == len(re.findall(r"late_bound\(", sources)) - definition_and_example
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
    for module, method, name, call in found:
        other, _, function = name.partition(":")
        is_above = floor[room_of(other)] > floor[room_of(module)]
        assert is_above or other in GRAPH.above(module), f"{method}: {other} does not stand above {module}"
        assert call is not None, f"{method}: what {name} returns is not called"
        signature = inspect.signature(getattr(importlib.import_module(other), function))
        signature.bind(*call.args, **{str(keyword.arg): keyword.value for keyword in call.keywords})


@pytest.mark.parametrize("room", WITHOUT_FRONT_END)
def test_room_imports_no_plotting_web_or_command_line(room: str) -> None:
    front_end = FRONT_END | FRONT_END_OF_PYTHON
    assert [where for imported, where in imports_into(room) if imported in front_end] == []


def test_importing_every_module_without_a_front_end_loads_none() -> None:
    """Other dependencies could load a front end indirectly."""
    names = [module for module in GRAPH.paths if room_of(module) in WITHOUT_FRONT_END]
    program = f"import importlib, sys; [importlib.import_module(name) for name in {names}]; print(*sys.modules)"
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=REPOSITORY, capture_output=True, text=True, timeout=120
    )
    assert result.returncode == 0, result.stderr
    loaded = set(result.stdout.split())
    assert set(names) <= loaded
    assert loaded & FRONT_END == set()


@pytest.mark.parametrize("room", ROOMS)
def test_room_imports_only_declared_dependencies(room: str) -> None:
    """A room that needs a dependency of the test extra would work here and fail for a user."""
    project = PROJECT["project"]
    extras = project["optional-dependencies"]
    declared = (
        project["dependencies"]
        + extras["cluster"]
        + extras["s3"]
        + extras["matlab"]
        + extras["workbench"]
        + extras["pybamm"]
    )
    known = {re.split(r"[^\w-]", requirement)[0].replace("-", "_") for requirement in declared}
    known |= {"pydantic_core"}  # half of pydantic
    known |= sys.stdlib_module_names | {NAME}
    assert [where for imported, where in imports_into(room) if imported not in known] == []


def test_every_package_says_in_its_docstring_what_it_is() -> None:
    packages = {module: path for module, path in GRAPH.paths.items() if path.name == "__init__.py"}
    # A folder without an __init__ would not be in the wheel.
    assert {module.rpartition(".")[0] for module in GRAPH.paths} - {""} <= packages.keys()
    assert [module for module, path in packages.items() if not ast.get_docstring(tree_of(path))] == []


@pytest.mark.parametrize("room", ROOMS)
def test_module_is_short(room: str) -> None:
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in modules_of(room)}
    assert {place(path): lines for path, lines in lengths.items() if lines > MOST_LINES} == {}


def test_tests_mirror_the_rooms() -> None:
    tested = {path.parent.relative_to(REPOSITORY / "tests").parts[:1] for path in REPOSITORY.glob("tests/**/test_*.py")}
    with_code = {(room,) for room in ROOMS if len(modules_of(room)) > 1}
    # tests/stress is of every reader.
    assert tested - {(), ("examples",), ("stress",)} == with_code


def test_benchmarks_do_without_the_tests() -> None:
    """Tests import benchmarks, to test them; the other way a benchmark would need the tests to run."""
    taken = {
        place(path)
        for path in files_of("benchmarks")
        for name, _ in imported_names(ast.parse(path.read_text(encoding="utf-8")))
        if name.partition(".")[0] == "tests"
    }
    assert taken == set()


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
    sources = "".join(path.read_text(encoding="utf-8") for path in GRAPH.paths.values())
    assert [name for name in names if not re.search(rf"\b{name.replace('-', '[-_]')}\b", sources)] == []


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
    ("sweeps/cluster.py", "pickle.loads"),  # what this process sent to a worker of its own cluster
}


def calls_of(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """The name of what each call calls, as it is written, and the call."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def test_nothing_runs_what_it_reads_but_where_the_user_has_put_it_there() -> None:
    calls = {(place(path), name) for path in GRAPH.paths.values() for name, _ in calls_of(path)}
    assert {call for call in calls if call[1] in RUNS_WHAT_IT_IS_GIVEN} == ALLOWED_TO_RUN


def test_no_shell_is_used_and_no_array_is_a_pickle() -> None:
    flags = {
        f"{place(path)}:{call.lineno}: {keyword.arg}"
        for path in GRAPH.paths.values()
        for _, call in calls_of(path)
        for keyword in call.keywords
        if keyword.arg in ("shell", "allow_pickle")
    }
    assert flags == set()


def test_annotations_are_checked_while_tests_run() -> None:
    """Without the import hook every other test would still pass, and check less."""
    from jaxmodel.base.errors import nearest

    with pytest.raises(jaxtyping.TypeCheckError):
        nearest(3, ["a name"])
