"""Records say themselves in a line, and in a notebook as a table whose text cannot be markup."""

from __future__ import annotations

import dataclasses
from html.parser import HTMLParser
from typing import Any

import jax
import numpy as np
import pytest

from jaxmodel import Cutoff, Known, Model, Parameters, Table, constant, operation, simulate, sweeps
from jaxmodel.base.in_short import InShort, text_of
from jaxmodel.case.records import Case
from jaxmodel.effects import CATALOGUE

PROFILE = constant(60.0, 1.0, current_A=2.0, ambient_degC=20.0)
MODEL = Model("cell", Parameters(capacity_Ah=2.5), effects=(CATALOGUE["current_offset"](column="current_A"),))
STUDY = sweeps.Study(
    kind="cell",
    title="a <b>study</b>",
    profile={"duration_s": 10.0, "step_s": 1.0, "current_A": 2.0},
    axes={"ambient_degC": [10.0, 20.0]},
    metrics=["final_soc"],
)
RECORDS = {
    "profile": (PROFILE, "<Profile: 61 rows, 0 to 60 s, current_A, ambient_degC>"),
    "model": (MODEL, "<Model: cell, current_offset:current_A, capacity_Ah=2.5>"),
    "parameters": (Parameters(), "<Parameters: all by default>"),
    "effect": (CATALOGUE["self_heating"](), "<SelfHeating: C_th=80, hA=0.3>"),
    "cutoff": (Cutoff(soc=0.1), "<Cutoff: soc=0.1>"),
    "known": (Known(2.0, 0.1), "Known(value=2.0, sd=0.1)"),
    "table": (
        Table(np.array([0.0, 1.0]), np.array([3.0, 4.0])),
        "<Table: soc=2 values, 0 to 1, values=2 values, 3 to 4>",
    ),
    "study": (STUDY, "<Study: a <b>study</b>, 2 lanes of a cell over ambient_degC>"),
    "limits": (operation.Limits(), "Limits(soc=0.1, cell_V=3.0, winding_degC=125.0)"),
    "tuning": (operation.Tuning(scale_sd=0.1), "<Tuning: scale_sd=0.1>"),
}


class Text(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: set[str] = set()
        self.text = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.add(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize(("record", "said"), RECORDS.values(), ids=list(RECORDS))
def test_a_record_says_itself(record: Any, said: str) -> None:
    assert repr(record) == said
    shown = Text(record._repr_html_())
    assert shown.tags == {"p", "b", "table", "tbody", "tr", "th", "td"}
    assert said.strip("<>") in shown.text


def test_results_say_themselves(case: Case) -> None:
    trajectory = simulate(MODEL, PROFILE)
    assert repr(trajectory).startswith("<Trajectory: 61 rows of ")
    assert "61 values, 0 to 60" in Text(trajectory._repr_html_()).text
    assert "61 values" in Text(case.runs[0]._repr_html_()).text


def test_a_record_says_itself_inside_a_transformation() -> None:
    said = []

    def lane(x: jax.Array) -> jax.Array:
        said.append(repr(Parameters(capacity_Ah=x)))
        return x

    jax.vmap(lane)(np.ones(3))
    assert "capacity_Ah=" in said[0]


def test_what_is_long_is_cut() -> None:
    @dataclasses.dataclass(repr=False)
    class Long(InShort):
        values: np.ndarray
        names: tuple[str, ...]
        others: dict[str, int]

    names = tuple(f"name {number}" for number in range(40))
    one = Long(np.array([np.nan, 1.0, 2.0]), names, dict.fromkeys(names, 1))
    assert len(repr(one)) < 130
    assert text_of(one.values) == "3 values, 1 to 2"
    assert text_of(one.names) == "name 0, name 1, name 2, name 3 and 36 more"
