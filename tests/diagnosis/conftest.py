"""Cells made once for all tests of a worker, whose programs are compiled once."""

from __future__ import annotations

import pytest

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.fitting.model import ModelSpace, View
from jaxmodel.diagnosis.fitting.readings import Weights, collect
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.noise.contract import noise_of_case
from jaxmodel.diagnosis.noise.model_error import NONE
from tests.diagnosis.made_cases import SMALL_KEPT, MadeCell, investigation_of, made_cell, small_cell, space_of

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
def small_space(small: Case) -> ModelSpace:
    """All that could be missing in it, of every group some."""
    return space_of(small, *SMALL_KEPT)


@pytest.fixture(scope="session")
def small_view(small: Case, small_space: ModelSpace) -> View:
    """Its fitted readings."""
    return View(small_space, collect(small, noise_of_case(small), small_space.coarse.channels, [0, 1]))


@pytest.fixture(scope="session")
def small_weights(small_view: View) -> Weights:
    """The noise of its sensors."""
    return Weights(small_view.readings, NONE)


@pytest.fixture(scope="session")
def plain_small(small: Case) -> Investigation:
    """It under investigation."""
    return investigation_of(small, *SMALL_KEPT)


@pytest.fixture(scope="session")
def warm_small() -> Investigation:
    """One that heats itself under investigation."""
    return investigation_of(small_cell(HEATING, seed=1), *SMALL_KEPT)
