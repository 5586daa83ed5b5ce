"""What the pages show runs: the Python blocks of README and docs, and the cells of the tutorials, page by page."""

from __future__ import annotations

import json
import os
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
PAGES = [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]
NOTEBOOKS = sorted((REPOSITORY / "docs" / "tutorials").glob("*.ipynb"))
# Before a block that stands alone in the page's text and cannot run there: <!-- not run: the reason -->
NOT_RUN = re.compile(r"<!-- not run: (.+?) -->\s*$")
BLOCK = re.compile(r"^( *)```python\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
LARGEST_NOTEBOOK = 1_000_000  # bytes, outputs included


def blocks(page: Path) -> Iterator[tuple[int, str]]:
    """Yield each block of a page that runs, with the number of lines before it."""
    text = page.read_text(encoding="utf-8")
    for block in BLOCK.finditer(text):
        if not NOT_RUN.search(text[: block.start()]):
            yield text.count("\n", 0, block.start(2)), textwrap.dedent(block[2])


def cells(notebook: Path) -> list[dict]:
    return [cell for cell in json.loads(notebook.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that looks like the repository's root: what a page writes stays out of the repository."""
    for path in REPOSITORY.iterdir():
        if not path.name.startswith("."):
            (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(code: str, lines_before: int, file: Path, namespace: dict[str, object]) -> None:
    """Execute code as if it stood at its lines of the file, so that a failure names them."""
    exec(compile("\n" * lines_before + code, str(file), "exec", dont_inherit=True), namespace)


@pytest.mark.slow("discrepancy", "identifiability", "own_loss", "parameterise", "sensitivity", "use_the_extended_model")
@pytest.mark.parametrize("page", [page for page in PAGES if any(blocks(page))], ids=lambda page: page.stem)
def test_blocks_of_page_run_in_order(page: Path, root: Path) -> None:
    namespace: dict[str, object] = {"__name__": f"page_{page.stem}"}
    for lines_before, code in blocks(page):
        run(code, lines_before, page, namespace)


@pytest.mark.slow("cell_that_does_not_fit", "effect_of_your_own")
@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_cells_of_tutorial_run_in_order(notebook: Path, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LANES", "256")
    monkeypatch.chdir(root / os.path.relpath(notebook.parent, REPOSITORY))
    namespace: dict[str, object] = {"__name__": f"tutorial_{notebook.stem}"}
    for number, cell in enumerate(cells(notebook), start=1):
        run("".join(cell["source"]), 0, Path(f"{notebook.name}, cell {number}"), namespace)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda notebook: notebook.stem)
def test_tutorial_is_saved_as_it_ran(notebook: Path) -> None:
    """The site shows the outputs that are saved: each cell has run once, in order, and none has failed."""
    assert [cell["execution_count"] for cell in cells(notebook)] == [*range(1, len(cells(notebook)) + 1)]
    outputs = [output for cell in cells(notebook) for output in cell["outputs"]]
    assert [output for output in outputs if output["output_type"] == "error" or output.get("name") == "stderr"] == []
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert notebook.stat().st_size < LARGEST_NOTEBOOK
