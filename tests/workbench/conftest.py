"""What the tests of the workbench share: a small case on disk, its made-up diagnosis, and the command line."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from discrepancy.result import Diagnosis
from jaxmodel.cases import Case, read_case
from tests.workbench.made_up import diagnosis_of, write_case
from workbench.cli import app

Run = Callable[..., Result]


@pytest.fixture
def run() -> Run:
    """Run the command line with arguments of any kind; returns exit code, stdout and stderr."""
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.fixture(scope="session")
def made_case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small case, to be read only."""
    return write_case(tmp_path_factory.mktemp("cases") / "small")


@pytest.fixture(scope="session")
def case(made_case: Path) -> Case:
    return read_case(made_case)


@pytest.fixture
def case_folder(made_case: Path, tmp_path: Path) -> Path:
    """A copy of the small case, to be spoilt."""
    return Path(shutil.copytree(made_case, tmp_path / "small"))


@pytest.fixture(scope="session")
def diagnosis(case: Case) -> Diagnosis:
    return diagnosis_of(case)
