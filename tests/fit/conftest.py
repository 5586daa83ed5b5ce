"""Cells made once for all tests of a worker, whose programs are compiled once."""

from __future__ import annotations

import pytest

from jaxmodel.case.records import Case
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.space import ModelSpace, View
from tests.diagnosis.made_cases import SMALL_KEPT, MadeCell, cache_of, made_cell, small_cell


@pytest.fixture(scope="session")
def plain_cell(tmp_path_factory: pytest.TempPathFactory) -> MadeCell:
    """The cell in which nothing is hidden."""
    return made_cell(tmp_path_factory.mktemp("cells") / "plain", {})


@pytest.fixture(scope="session")
def small() -> Case:
    """A small cell in which nothing is hidden."""
    return small_cell()


@pytest.fixture(scope="session")
def small_cache(small: Case) -> FitCache:
    """Its models; of every group of candidates it has some."""
    return cache_of(small, *SMALL_KEPT)


@pytest.fixture(scope="session")
def small_space(small_cache: FitCache) -> ModelSpace:
    """The space of its models."""
    return small_cache.space


@pytest.fixture(scope="session")
def small_view(small_cache: FitCache) -> View:
    """Its fitted readings."""
    return small_cache.view
