"""Which module imports which, from the sources alone: arrows that go down, and circles.

Every import counts, wherever it stands: at the top of a module, inside a function, or under TYPE_CHECKING. One thing
does not: Python runs the `__init__` of every package around a module before the module itself. An `__init__` is a node
like any other, with what it imports; an arrow leads to it only from a module that names it.

`python -m tests.import_graph` prints the floors, arrows and circles of the project.
"""

from __future__ import annotations

import ast
import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

NAME = "jaxmodel"
AT_THE_TOP = ("sweeps", "sensitivity")  # rooms that are folders of the repository; links lead to them
# From the bottom. Rooms of one floor do not import each other. The root, `jaxmodel/__init__.py`, is above all: it lists
# what users import, and nothing imports it. So is `jaxmodel/__main__.py`, which begins the command line.
FLOORS = (
    ("base",),
    ("lanes",),
    ("model",),
    ("effects",),
    ("case",),
    ("sweeps",),
    ("sensitivity",),
    ("data",),
    ("fit",),
    ("diagnosis", "parameterisation"),
    ("operation",),
    ("export",),
    ("plots",),
    ("app",),
)


@dataclasses.dataclass(frozen=True)
class Graph:
    """Modules by name, and by module the modules that it imports, each with the lines that do.

    `sweeps.study`, the module that a folder at the top holds, is `jaxmodel.sweeps.study`.
    """

    paths: Mapping[str, Path]
    arrows: Mapping[str, Mapping[str, Sequence[int]]]

    def circles(self) -> list[list[str]]:
        """Return the sets of modules each of which imports the others, by whatever way (Tarjan's algorithm)."""
        number: dict[str, int] = {}
        lowest: dict[str, int] = {}
        open_, found = [], []

        def visit(module: str) -> None:
            number[module] = lowest[module] = len(number)
            open_.append(module)
            for other in self.arrows[module]:
                if other not in number:
                    visit(other)
                    lowest[module] = min(lowest[module], lowest[other])
                elif other in open_:
                    lowest[module] = min(lowest[module], number[other])
            if lowest[module] == number[module]:
                start = open_.index(module)
                if len(open_) - start > 1:
                    found.append(sorted(open_[start:]))
                del open_[start:]

        for module in self.paths:
            if module not in number:
                visit(module)
        return sorted(found)

    def above(self, module: str) -> set[str]:
        """Return every module that imports this one, directly or through others."""
        found, new = set[str](), {module}
        while new:
            new = {one for one, imported in self.arrows.items() if new & imported.keys()} - found
            found |= new
        return found


def room_of(module: str) -> str:
    """Return the room of a module; "" for the root."""
    return [*module.split("."), ""][1]


def modules_of(repository: Path) -> dict[str, Path]:
    """Return every module of the package by its name, those of rooms at the top by their name inside it."""
    inside = [path for path in (repository / NAME).iterdir() if not path.is_symlink() and path.is_dir()]
    at_the_root = {path.stem: path for path in sorted((repository / NAME).glob("*.py"))}
    found = {f"{NAME}.{stem}".removesuffix(".__init__"): path for stem, path in at_the_root.items()}
    for folder in sorted([*inside, *(repository / room for room in AT_THE_TOP if (repository / room).is_dir())]):
        for path in sorted(folder.rglob("*.py")):
            parts = (NAME, folder.name, *path.relative_to(folder).with_suffix("").parts)
            found[".".join(parts).removesuffix(".__init__")] = path
    return found


def imported_names(tree: ast.AST) -> Iterator[tuple[str, int]]:
    """Yield everything that is imported anywhere in a module, as "package.module.name", with its line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                raise AssertionError(f"line {node.lineno}: a relative import; name the module in whole")
            yield from ((f"{node.module}.{alias.name}", node.lineno) for alias in node.names)


def graph_of(repository: Path) -> Graph:
    """Return the import graph of a repository."""
    paths = modules_of(repository)
    arrows: dict[str, dict[str, list[int]]] = {module: {} for module in paths}
    for module, path in paths.items():
        for name, line in imported_names(ast.parse(path.read_text(encoding="utf-8"), str(path))):
            other = f"{NAME}.{name}" if name.split(".")[0] in AT_THE_TOP else name
            while other and other not in paths:  # a name of a module, or of another package
                other = other.rpartition(".")[0]
            if other and other != module:
                arrows[module].setdefault(other, []).append(line)
    return Graph(paths, arrows)


def arrows_down(graph: Graph, floors: Sequence[Sequence[str]] = FLOORS) -> list[str]:
    """Return every import of another room that is not on a lower floor, with its file and line."""
    floor = {room: number for number, rooms in enumerate(floors) for room in rooms} | {
        "": len(floors),
        "__main__": len(floors),
    }
    wrong = [f"{module}: its room has no floor" for module in graph.paths if room_of(module) not in floor]
    for module, imported in graph.arrows.items():
        for other, lines in imported.items():
            own, others = room_of(module), room_of(other)
            if own != others and own in floor and floor.get(others, len(floors)) >= floor[own]:
                wrong.append(f"{graph.paths[module].name}:{lines[0]}: {module} imports {other}")
    return wrong


def main() -> None:
    """Print the floors from the bottom with their modules and lines, arrows that go down, and circles."""
    graph = graph_of(Path(__file__).parents[1])
    for rooms in FLOORS:
        for room in rooms:
            own = [path for module, path in graph.paths.items() if room_of(module) == room]
            lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in own)
            print(f"{room:18}{len(own):4} modules {lines:7} lines")
    arrows = sum(len(imported) for imported in graph.arrows.values())
    print(f"{len(graph.paths)} modules, {arrows} arrows")
    print("arrows down:", *(arrows_down(graph) or ["none"]), sep="\n  ")
    print("circles:", *(graph.circles() or ["none"]), sep="\n  ")


if __name__ == "__main__":
    main()
