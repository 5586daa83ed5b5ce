"""What every test shares: a compilation cache, repeatable Hypothesis examples, the reference runs."""

from __future__ import annotations

import gc
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import hypothesis
import pytest
from jaxtyping import install_import_hook

if TYPE_CHECKING:  # ours only where they are used: JAX reads its variables, set below, when it is imported
    from jaxmodel.case.records import Case
    from jaxmodel.diagnosis.result import Diagnosis

REPOSITORY = Path(__file__).parents[1]

# Types and shapes are checked at every call of ours. Not of `jaxmodel.lanes`: it writes 50,000 instructions for a
# kernel, and checked each takes 17 times as long.
_ROOMS = [path.stem for path in (REPOSITORY / "jaxmodel").iterdir() if path.stem.strip("_.") == path.stem]
install_import_hook([f"jaxmodel.{room}" for room in _ROOMS if room != "lanes"], "beartype.beartype")

# Compiling the model costs far more than running it, and reading it back compiled a tenth of that. The cache outlives
# the run and serves every worker; through the environment, so that it also serves the programs that tests start.
# Entries are keyed by the program and the version of JAX: an old one is never wrong, only unused.
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(REPOSITORY / ".jax-cache"))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")
# A test's program runs for a moment: passes that make it faster cost more than they save.
os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
# On a machine with a GPU the workers share it; by default the first would take most of its memory.
os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")

# Traces of programs are millions of small objects that live on: collected as often as by default, they take a fifth of
# the time of a test.
gc.set_threshold(200_000, 50, 50)

# The same examples on every run, and no deadline: the first example of a test pays for its compilation.
hypothesis.settings.register_profile("repeatable", derandomize=True, deadline=None)
hypothesis.settings.load_profile("repeatable")


class Wild(Protocol):
    """Finds the logs of a folder of `shared/wild`."""

    def __call__(self, folder: str, pattern: str = "*.csv") -> list[Path]:
        """Return the logs of a folder whose names are of a pattern; the test is skipped where there are none."""
        ...


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for all tests."""
    parser.addoption("--all", action="store_true", help="run the tests that are marked as slow too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the slow tests, unless all are asked for."""
    if config.getoption("--all"):
        return
    slow = [item for item in items if _is_slow(item)]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if item not in slow]


def _is_slow(item: pytest.Item) -> bool:
    """Return whether a test is marked as slow, with its own parameters if the mark names some."""
    marker = item.get_closest_marker("slow")
    of = item.name.partition("[")[2].removesuffix("]")
    return marker is not None and (not marker.args or of in marker.args)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of reference runs and cases that lies beside the repository, where there is one."""
    folder = REPOSITORY.parent / "shared"
    if not folder.is_dir():
        pytest.skip("the reference runs are not beside this copy of the repository")
    return folder


@pytest.fixture(scope="session")
def wild(shared: Path) -> Wild:
    """What finds logs of the kinds that failed, where they lie beside the repository."""

    def files(folder: str, pattern: str = "*.csv") -> list[Path]:
        found = sorted((shared / "wild" / folder).glob(pattern))
        if not found:
            pytest.skip("these logs are not beside this copy of the repository")
        return found

    return files


@pytest.fixture(scope="session")
def made_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small case, to be read only."""
    from tests.made_up import write_case

    return write_case(tmp_path_factory.mktemp("cases") / "small")


@pytest.fixture(scope="session")
def case(made_case: Path) -> Case:
    from jaxmodel.case.reading import read_case

    return read_case(made_case)


@pytest.fixture
def case_folder(made_case: Path, tmp_path: Path) -> Path:
    """A copy of the small case, to be spoilt."""
    return Path(shutil.copytree(made_case, tmp_path / "small"))


@pytest.fixture(scope="session")
def diagnosis(case: Case) -> Diagnosis:
    from tests.made_up import diagnosis_of

    return diagnosis_of(case)
