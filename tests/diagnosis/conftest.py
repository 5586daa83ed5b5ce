"""Cells made once for all tests of a worker, whose programs are compiled once."""

from __future__ import annotations

import pytest

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.investigation import Investigation
from tests.diagnosis.made_cases import SMALL_KEPT, MadeCell, investigation_of, made_cell, small_cell

HEATING = {"self_heating": {"C_th": 60.0, "hA": 0.1}}


@pytest.fixture(scope="session")
def plain_cell(tmp_path_factory: pytest.TempPathFactory) -> MadeCell:
    """The cell in which nothing is hidden."""
    return made_cell(tmp_path_factory.mktemp("cells") / "plain", {})


@pytest.fixture(scope="session")
def small() -> Case:
    """A small cell in which nothing is hidden."""
    return small_cell()


@pytest.fixture(scope="session")
def plain_small(small: Case) -> Investigation:
    """It under investigation."""
    return investigation_of(small, *SMALL_KEPT)


@pytest.fixture(scope="session")
def warm_small() -> Investigation:
    """One that heats itself under investigation."""
    return investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
