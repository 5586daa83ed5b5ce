"""The cell in which nothing is hidden, made once for all tests of a worker."""

from __future__ import annotations

import pytest

from discrepancy.session import Session
from tests.discrepancy.made_cases import MadeCell, made_cell


@pytest.fixture(scope="session")
def plain_cell(tmp_path_factory: pytest.TempPathFactory) -> MadeCell:
    return made_cell(tmp_path_factory.mktemp("cells") / "plain", {})


@pytest.fixture(scope="session")
def plain_session(plain_cell: MadeCell) -> Session:
    """The base model calibrated on it."""
    session = Session(plain_cell.case)
    session.hypothesis()
    return session
