"""What is written as TOML reads back as it was."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.base import toml

TEXTS = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
SCALARS = st.one_of(st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), TEXTS)
FLAT = st.dictionaries(TEXTS, st.one_of(SCALARS, st.lists(SCALARS, max_size=4)), max_size=4)
TABLES = st.dictionaries(TEXTS, st.one_of(SCALARS, FLAT), max_size=4)
DOCUMENTS = st.dictionaries(TEXTS, st.one_of(SCALARS, TABLES, st.lists(TABLES, min_size=1, max_size=3)), max_size=4)


@given(DOCUMENTS)
def test_document_reads_back_as_it_was(content: dict) -> None:
    assert tomllib.loads(toml.document(content)) == content


def test_long_table_stands_under_its_own_heading() -> None:
    curve = {"soc": list(np.linspace(0.0, 1.0, 40)), "voltage_V": [3.0] * 40}
    text = toml.document({"parameters": {"capacity_Ah": 3.0, "ocv": curve, "short": {"value": 1.0}}})
    assert "[parameters.ocv]" in text
    assert "short = { value = 1.0 }" in text
    assert tomllib.loads(text)["parameters"]["ocv"] == curve


def test_numpy_numbers_are_numbers() -> None:
    assert toml.value(np.float64(0.1)) == "0.1"


def test_what_toml_cannot_hold_is_refused() -> None:
    with pytest.raises(TypeError, match="no value for None"):
        toml.document({"nothing": None})
