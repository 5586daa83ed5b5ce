"""From a case to a model: tables, overrides, fidelity, effects, and an effect of the user's own."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.base.errors import EffectError, ParameterError
from jaxmodel.case.build import case_model, load_effect_class, make_effect, run_profile
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.curves import Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import simulate

CASE = """
kind = "cell"
[parameters]
capacity_Ah = { value = 4.1, sd = 0.1 }
R_TS = { soc = [0.0, 1.0], ohm = [0.03, 0.02] }
[effects]
ocv_hysteresis = { M_V = 0.03 }
[[runs]]
file = "run-01.csv"
split = "fit"
initial_soc = 0.8
[[runs]]
file = "run-02.csv"
split = "check"
cycles = 300
"""
OWN_EFFECT = '''
"""A spare resistance that grows as the cell empties."""
from typing import ClassVar
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.ports import CellContext, Effect


class EmptyResistance(Effect):
    name: ClassVar[str] = "empty_resistance"
    kinds: ClassVar[tuple[str, ...]] = ("cell", "robot")
    equation: ClassVar[str] = "R_series += r (1 - SOC)"
    r: Scalar = parameter(0.01, unit="ohm", meaning="at empty", null=0.0, lower=0.0, upper=1.0, typical=(0.001, 0.05))

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        return value + self.r * self._emptiness(context)

    def _emptiness(self, context: CellContext) -> Scalar:
        return 1.0 - context.soc


class NotAnEffect:
    pass
'''


@pytest.fixture
def case(tmp_path: Path) -> Case:
    for run in ("run-01", "run-02"):
        (tmp_path / f"{run}.csv").write_text("time_s,current_A,ambient_degC,voltage_V\n0,2,15,3.96\n1.5,3,15,3.9\n")
    (tmp_path / "case.toml").write_text(CASE)
    return read_case(tmp_path)


def test_a_run_has_its_own_charge_and_overrides(case: Case):
    parameters = [case_model(case, run).parameters for run in case.runs]
    assert [float(p.initial_soc) for p in parameters] == [0.8, 1.0]
    assert [float(p.cycles) for p in parameters] == [25.0, 300.0]
    assert [float(p.capacity_Ah) for p in parameters] == [4.1, 4.1]


def test_the_cases_tables_stand_in_for_formulas_and_for_look_up_tables(case: Case):
    formula, lut = (case_model(case, fidelity=fidelity).curves for fidelity in ("formula", "lut"))
    for curves in (formula, lut):
        np.testing.assert_array_equal(curves.R_TS.values, [[0.03, 0.02]])
    assert not isinstance(formula.R_ints, Table)
    assert lut.R_ints.values.shape == (7, 6)


def test_a_runs_rows_are_the_profile(case: Case):
    profile = run_profile(case.runs[0])
    np.testing.assert_array_equal(profile.time_s, [0.0, 1.5])
    np.testing.assert_array_equal(profile.inputs["current_A"], [2.0, 3.0])


def test_the_effects_of_a_case_are_on(case: Case):
    (effect,) = case_model(case).effects
    assert (effect.name, float(effect.M_V), float(effect.g)) == ("ocv_hysteresis", 0.03, 40.0)


@pytest.mark.parametrize(
    ("line", "error", "sentence"),
    [
        ('preset = "papre"', ParameterError, "no preset is called 'papre'. Did you mean 'paper'?"),
        (
            "viscous_friction = { b = 1e-5 }",
            EffectError,
            "'viscous_friction' applies to motor and robot, not to kind 'cell'",
        ),
        (
            "ocv_histeresis = { M_V = 0.1 }",
            EffectError,
            "no effect is called 'ocv_histeresis'. Did you mean 'ocv_hysteresis'?",
        ),
        (
            "self_discharge = { R_slf = 30 }",
            EffectError,
            "no parameter 'R_slf'. Did you mean 'R_self'?",
        ),
        ("self_discharge = { R_self = 0.1 }", ParameterError, "'R_self' = 0.1 is outside its range 1 to 1e+07 ohm"),
        (
            "voltage_gain = { g = 0.02 }",
            EffectError,
            "'voltage_gain' needs a column, one that ends in _V.",
        ),
        (
            'voltage_gain = { g = 0.02, column = "volt_V" }',
            EffectError,
            "'voltage_gain' cannot act on the column 'volt_V'. Did you mean 'voltage_V'?",
        ),
        (
            'voltage_gain = { g = 0.02, column = "current_A" }',
            EffectError,
            "'voltage_gain' cannot act on the column 'current_A'. Use one of voltage_V.",
        ),
    ],
)
def test_a_mistake_in_a_case_is_told_in_a_sentence(case: Case, line: str, error: type[Exception], sentence: str):
    place = "kind" if line.startswith("preset") else "ocv_hysteresis"
    case.path.write_text(CASE.replace(f"\n{place} =", f"\n{line}\n{place} =", 1))
    with pytest.raises(error) as raised:
        case_model(read_case(case.path))
    assert str(raised.value).startswith(f"{case.path.parent.name}/case.toml")
    assert sentence in str(raised.value)


def test_a_clock_shift_needs_no_column_and_other_sensors_keep_theirs():
    assert make_effect("clock_shift", {"d": 2.0}, "here").column == ""
    assert make_effect("temperature_lag", {"column": "case_temperature_degC"}, "here").column == "case_temperature_degC"


@pytest.fixture
def own_file(tmp_path: Path) -> Path:
    path = tmp_path / "my_effects.py"
    path.write_text(OWN_EFFECT)
    return path


def test_a_users_effect_acts_like_one_of_the_catalogue(own_file: Path):
    cls = load_effect_class(f"{own_file}:EmptyResistance")
    effect = make_effect("empty_resistance", {"r": 0.05}, "here", CATALOGUE | {cls.name: cls})
    profile = constant(10.0, 1.0, current_A=2.0, ambient_degC=20.0)
    base, changed = (simulate(Model("cell", effects=effects), profile).readings for effects in ((), (effect,)))
    np.testing.assert_allclose(base["voltage_V"] - changed["voltage_V"], 2.0 * 0.05 * (1.0 - base["soc"]), atol=1e-14)


def test_a_file_may_keep_its_annotations_as_text(own_file: Path):
    own_file.write_text("from __future__ import annotations\n" + textwrap.dedent(OWN_EFFECT))
    assert load_effect_class(f"{own_file}:EmptyResistance").name == "empty_resistance"


@pytest.mark.parametrize(
    ("reference", "sentence"),
    [
        ("{file}", "give an existing file and a class, as in my_effects.py:MagnetAgeing."),
        ("{file}x:EmptyResistance", "give an existing file and a class"),
        (
            "{file}:EmptyResistence",
            "my_effects.py has no class 'EmptyResistence' derived from jaxmodel.Effect; add it.",
        ),
        ("{file}:NotAnEffect", "my_effects.py has no class 'NotAnEffect' derived from jaxmodel.Effect; add it."),
    ],
)
def test_a_reference_that_names_no_effect_is_refused(own_file: Path, reference: str, sentence: str):
    with pytest.raises(EffectError) as error:
        load_effect_class(reference.format(file=own_file))
    assert sentence in str(error.value)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            ("series_resistance", "serie_resistance"),
            "'serie_resistance' is not a port. Did you mean 'series_resistance'?",
        ),
        (("from typing", "from typping"), "the file does not run (No module named 'typping'); correct it there."),
        (
            ("from typing", "raise SystemExit\nfrom typing"),
            "the file does not run (it ends the program); correct it there.",
        ),
        (("equation: ClassVar", "formula: ClassVar"), "EmptyResistance has no equation"),
        (("typical=", "shape_grid="), "has no usual range of its parameter 'r', as in typical=(0.01, 0.2)"),
    ],
)
def test_a_file_that_is_wrong_says_how(own_file: Path, change: tuple[str, str], sentence: str):
    own_file.write_text(textwrap.dedent(OWN_EFFECT).replace(*change))
    with pytest.raises(EffectError) as error:
        load_effect_class(f"{own_file}:EmptyResistance")
    assert sentence in str(error.value)
