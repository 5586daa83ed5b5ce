"""The odds against each effect before the data, which effects are rare, and which another must precede."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

from jaxmodel.case.build import load_effect_class
from jaxmodel.diagnosis.comparison import is_rare
from jaxmodel.diagnosis.search import Search
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.curves import CURVES
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.fit.candidates import Candidate, make_candidate
from jaxmodel.fit.settings import SETTINGS
from jaxmodel.fit.space import ModelSpace
from tests.diagnosis.made_cases import cache_of, small_cell

KINDS = ("cell", "motor", "robot")
TABLE = """
effect                     cell  motor  robot  rare  needs
arrhenius_resistance       3.74      -   4.37
capacity_temperature       3.74      -   4.37
cell_imbalance                -      -   4.37
charge_transfer            3.74      -   4.37
entropic_ocv               3.74      -   4.37
ocv_hysteresis             3.74      -   4.37
rate_capacity              3.74      -   4.37
resistance_ageing          3.74      -   4.37
self_heating               3.74      -   4.37
slow_diffusion             3.74      -   4.37
bridge_resistance             -      -   4.37
brush_drop                    -   3.70   4.37
constant_power_load           -      -   4.37
friction_temperature          -   3.70   4.37
gear_loss                     -   3.70   4.37
magnet_temperature            -   3.70   4.37
onboard_temperature           -      -   4.37
pwm_ripple                    -      -   4.37
saturation                    -   3.70   4.37
stribeck_friction             -   3.70   4.37
viscous_friction              -   3.70   4.37
windage                       -   3.70   4.37
clock_shift                3.74   3.70   4.37
current_offset             3.74   3.70   4.37
temperature_lag            3.74   3.70   4.37
temperature_offset         3.74   3.70   4.37
voltage_gain               3.74   3.70   4.37
voltage_offset             3.74   3.70   4.37
arrhenius_polarisation     6.74      -   7.37  rare  arrhenius_resistance
capacity_fade              6.74      -   7.37  rare
contact_drift              6.74      -   7.37  rare
contact_heating            6.74      -   7.37  rare
core_temperature           6.74      -   7.37  rare
self_discharge             6.74      -   7.37  rare
bridge_dead_time              -      -   7.37  rare
brush_current_drop            -   6.70   7.37  rare
command_delay                 -   6.70      -  rare
directional_friction          -   6.70   7.37  rare
gear_friction                 -   6.70   7.37  rare
heat_path                     -   6.70   7.37  rare
iron_loss                     -   6.70   7.37  rare
torque_friction               -   6.70   7.37  rare
backlash                      -   6.70      -  rare
compliance                    -   6.70      -  rare
directional_drag              -   6.70   7.37  rare
presliding                    -   6.70   7.37  rare
chamber_offset             6.74   6.70   7.37  rare
current_gain               6.74   6.70   7.37  rare
speed_gain                    -   6.70   7.37  rare
temperature_gain           6.74   6.70   7.37  rare
torque_gain                   -   6.70   7.37  rare
torque_offset                 -   6.70   7.37  rare
"""

OWN = '''
from typing import ClassVar
from jaxmodel import CellContext, Effect, Scalar, parameter

class Creep(Effect):
    """A resistance of its own."""
    name: ClassVar[str] = "creep"
    kinds: ClassVar[tuple[str, ...]] = ("cell",)
    equation: ClassVar[str] = "R += r"
    {more}
    r: Scalar = parameter(0.01, unit="ohm", meaning="resistance", null=0.0, typical=(0.001, 0.02))

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        return value + self.r
'''


def of_catalogue(kind: str) -> dict[str, Candidate]:
    """Return the candidates of a kind, a sensor fault in one column each."""
    found = [make_candidate(cls()) for cls in CATALOGUE.values() if kind in cls.kinds and cls.is_candidate]
    return {one.effect.name: one for one in found}


def searching(candidates: Mapping[str, Candidate]) -> Search:
    """Return a search among some candidates, of no case."""
    search = object.__new__(Search)
    search.cache = SimpleNamespace(settings=SETTINGS, space=SimpleNamespace(candidates=candidates))
    return search


def table_of_odds() -> str:
    """Return a line for each effect: the log odds against it in each kind, with a sensor fault in one column each."""
    of_kind = {kind: of_catalogue(kind) for kind in KINDS}
    lines = [f"{'effect':24}{'cell':>7}{'motor':>7}{'robot':>7}  rare  needs"]
    for name, cls in [(name, cls) for name, cls in CATALOGUE.items() if cls.is_candidate]:
        odds = [
            f"{searching(of_kind[kind]).odds_of(of_kind[kind][name]):7.2f}" if kind in cls.kinds else f"{'-':>7}"
            for kind in KINDS
        ]
        lines.append(f"{name:24}{''.join(odds)}  {'rare' if cls.rare else '':4}  {', '.join(cls.needs)}".rstrip())
    return "\n".join(lines)


def test_odds_are_those_of_the_table():
    print(table_of_odds())
    assert table_of_odds() == TABLE.strip()


def test_a_rare_effect_needs_the_evidence_that_the_settings_say():
    of_cell = of_catalogue("cell")
    search = searching(of_cell)
    rare, common = (
        {search.odds_of(one) for one in of_cell.values() if is_rare(one) is which} for which in (True, False)
    )
    assert len(rare) == len(common) == 1
    assert abs(rare.pop() - common.pop() - SETTINGS.rare_odds) < 1e-12


def test_what_an_effect_needs_is_there_and_needs_nothing():
    declared = {**CATALOGUE, **CURVES, **SHIFTS}
    assert {name: cls.needs for name, cls in declared.items() if cls.needs and name not in CATALOGUE} == dict.fromkeys(
        ("convection_curve", "short_heat", "long_heat"), ("self_heating",)
    )
    for cls in declared.values():
        assert all(need in CATALOGUE and not CATALOGUE[need].needs for need in cls.needs), cls.name


def own_effect(folder: Path, file: str, more: str = ""):
    (folder / file).write_text(OWN.format(more=more), encoding="utf-8")
    return load_effect_class(f"{folder / file}:Creep")


def test_the_name_of_a_file_makes_no_effect_rare(tmp_path: Path):
    cls = own_effect(tmp_path, "further_losses.py")
    case = dataclasses.replace(small_cell(), own_effects={"creep": cls})
    competing = ModelSpace(case).candidates
    search = searching(competing)
    odds = {name: search.odds_of(one) for name, one in competing.items()}
    assert odds["creep"] == odds["self_heating"] < odds["contact_drift"]


def test_an_effect_of_ones_own_may_be_rare_and_wait_for_another(tmp_path: Path):
    more = 'rare: ClassVar[bool] = True\n    needs: ClassVar[tuple[str, ...]] = ("self_heating", "not_in_this_case")'
    cls = own_effect(tmp_path, "losses.py", more)
    search = Search(cache_of(dataclasses.replace(small_cell(), own_effects={"creep": cls}), "creep", "self_heating"))
    competing = search.cache.space.candidates
    difference = search.odds_of(competing["creep"]) - search.odds_of(competing["self_heating"])
    assert abs(difference - SETTINGS.rare_odds) < 1e-12
    assert not search.may_enter((), "creep")
    assert search.may_enter((), "self_heating")
    assert search.may_enter(("self_heating",), "creep")
