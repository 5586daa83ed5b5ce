"""The form of the workbench asks for what the command line takes, and both are read by one reader."""

from __future__ import annotations

import dataclasses

import pytest
import typer

from jaxmodel.app.cli import app
from jaxmodel.app.import_form import FIELDS, KINDS, shown
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import Options
from jaxmodel.data.importing.written import option_of, options_of

# What a page has in another place: files, kind and columns; and what it always or never does.
ELSEWHERE = {"--kind", "--column", "--out", "--answer-only", "--force", "--help"}


def options_of_the_command() -> set[str]:
    group = typer.main.get_command(app)
    assert isinstance(group, typer.core.TyperGroup)
    return {name for one in group.commands["import"].params for name in one.opts if name.startswith("--")}


def test_every_option_of_an_import_is_on_a_form():
    on_forms = {option_of(field.name) for kind in KINDS for usual in (True, False) for field in shown(kind, usual, ALL)}
    assert on_forms | ELSEWHERE >= options_of_the_command()
    assert on_forms <= options_of_the_command()


ALL = {"load": "gravity", "controller": "position"}


def test_every_field_is_one_of_the_options_and_says_which():
    known = {field.name for field in dataclasses.fields(Options)}
    for field in FIELDS:
        assert field.name in known
        assert field.hint.startswith(option_of(field.name))


def test_choices_are_those_that_an_import_knows():
    from jaxmodel.data.importing.agreement import checked

    kinds = {"sign": "cell", "split_at": "cell"}
    gains = {"controller": {"controller_numbers": "k_p=1"}}
    for field in FIELDS:
        for value in field.choices or ():
            if value:
                given = {field.name: value} | gains.get(field.name, {})
                checked(options_of(given), kinds.get(field.name, "motor"))  # pyrefly: ignore[bad-argument-type]


def test_gains_are_asked_for_where_there_is_a_controller():
    assert not any(field.name == "controller_numbers" for field in shown("motor", True, {}))
    assert any(field.name == "controller_numbers" for field in shown("motor", True, {"controller": "speed"}))


def test_texts_of_a_form_are_options():
    found = options_of(
        {
            "ambient": "22,5", "load": "gravity", "load_numbers": "mass_kg=0.5, arm_m=0.1", "motors": "left, right",
            "specimens": "A=m1_*, B=m2_*", "check": "a, b", "each_cell": "yes", "cells_in_series": "3",
            "controller": "position:k_p=10,limit=3", "constants": "load_torque_Nm=0", "title": None,
        }
    )  # fmt: skip
    assert found == Options(
        ambient=22.5, load="gravity", load_numbers={"mass_kg": 0.5, "arm_m": 0.1}, motors=("left", "right"),
        specimens={"A": "m1_*", "B": "m2_*"}, check=("a", "b"), each_cell=True, cells_in_series=3,
        controller="position", controller_numbers={"k_p": 10.0, "limit": 3.0}, constants={"load_torque_Nm": 0.0},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"ambient": "warm"}, "--ambient: 'warm' is not a number"),
        ({"capacity_Ah": "3 Ah"}, "--capacity: '3 Ah' is not a number"),
        ({"cells_in_series": "2.5"}, "--cells-in-series: 2.5 is a count"),
        ({"specimens": "m1_*"}, "--specimen m1_*: give NAME=PATTERN"),
        ({"controller_numbers": "10"}, "--controller 10: give position:NAME=VALUE"),
        ({"units": "I=mA, I=A"}, "--unit: I is given twice"),
    ],
)
def test_a_text_that_cannot_be_read_is_one_sentence(given: dict[str, str], says: str):
    with pytest.raises(MeasurementError) as error:
        options_of(given)
    assert says in str(error.value)
