"""The steepness of the open-circuit voltage: 1 on the plain, the ratio of slopes where the cell is nearly empty."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from jaxmodel.case.records import Case, Table
from jaxmodel.diagnosis.noise.steepness import steepness


@pytest.fixture(scope="module")
def bent(case: Case) -> Case:
    """A cell whose OCV falls by 0.5 V below SOC 0.1 and by 0.5 V above."""
    table = Table(soc=np.array([0.0, 0.1, 1.0]), values=np.array([3.0, 3.5, 4.0]))
    return dataclasses.replace(case, tables={"ocv": table}, effects={})


def test_is_the_ratio_of_the_slope_to_the_average_slope(bent: Case):
    soc = [np.array([0.05, 0.11, 0.14, 0.5, 0.9, np.nan])] * len(bent.runs)
    found = steepness(bent, soc, 0.02)
    assert found.keys() == {("voltage_V", number) for number in range(len(bent.runs))}  # not the temperature
    np.testing.assert_allclose(found["voltage_V", 0], [5.0, 5.0, 1.0, 1.0, 1.0, 1.0])


def test_outside_the_table_is_that_at_its_end(bent: Case):
    found = steepness(bent, [np.array([-0.3, 1.2])] * len(bent.runs), 0.02)
    np.testing.assert_allclose(found["voltage_V", 0], [5.0, 1.0])


def test_a_flat_voltage_has_none(bent: Case):
    flat = dataclasses.replace(bent.tables["ocv"], values=np.array([3.5, 3.5, 3.5]))
    found = steepness(dataclasses.replace(bent, tables={"ocv": flat}), [np.array([0.05])] * len(bent.runs), 0.02)
    np.testing.assert_array_equal(found["voltage_V", 0], [1.0])
