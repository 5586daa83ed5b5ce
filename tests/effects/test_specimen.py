"""Usual ranges on other specimens: dimensions, ratios that can be said beforehand, and real hardware within them."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.base.errors import EffectError
from jaxmodel.case.build import load_effect_class
from jaxmodel.effects import CATALOGUE
from jaxmodel.effects.curves import CURVES
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.effects.specimen import SIZES, scale_of, shape_grid, usual_range
from jaxmodel.model.declaration import ParameterInfo, describe
from jaxmodel.model.parameters import TABLE

ALL = [info for cls in (CATALOGUE | SHIFTS).values() for info in describe(cls).values()]
LEAF = {"capacity_Ah": 33.0}


def info_of(name: str) -> ParameterInfo:
    effect, _, field = name.partition(".")
    return describe((CATALOGUE | SHIFTS)[effect])[field]


def test_for_the_papers_hardware_a_range_is_as_written():
    for info in ALL:
        assert usual_range(info, {}) == info.typical
        assert shape_grid(info, {name: entry.default for name, entry in TABLE.items()}) == info.shape_grid
    assert all(scale_of(cls.scales, {}) == 1.0 for cls in CURVES.values())


def test_a_range_lies_within_the_bounds_whatever_the_specimen():
    for given in ({"capacity_Ah": 0.02}, {"capacity_Ah": 2000.0}, {"k_tau": 5.0, "R_0": 0.5}, {"k_tau": 1e-3}):
        for info in ALL:
            low, high = usual_range(info, given)
            assert info.lower <= low < high <= info.upper


@pytest.mark.parametrize(
    ("cell", "J_per_K"),
    [
        ({"capacity_Ah": 3.0}, 47.0),  # an 18650: 47 g, about 1,000 J/(kg K)
        ({"capacity_Ah": 2.6}, 78.0),  # a 26650 of iron phosphate, 30 J/K per A h
        (LEAF, 1300.0),
        ({"capacity_Ah": 5.2}, 80.0),
    ],
)
def test_heat_capacities_of_real_cells_are_usual(cell: dict[str, float], J_per_K: float):
    low, high = usual_range(info_of("self_heating.C_th"), cell)
    assert low < J_per_K < high
    # The values that are tried bracket or come near it: within a factor of 2.5.
    assert min(abs(np.log(J_per_K / np.array(shape_grid(info_of("self_heating.C_th"), cell))))) < np.log(2.5)


def test_a_larger_cell_has_less_resistance_and_more_of_everything_else():
    assert scale_of("capacity", LEAF) == pytest.approx(33.0 / 5.2)
    assert scale_of("1/capacity", LEAF) == pytest.approx(5.2 / 33.0)
    assert scale_of("surface", LEAF) == pytest.approx((33.0 / 5.2) ** (2.0 / 3.0))
    # The drop at a set rate, and the time constant of warming by a set rate, are then those of a small cell.
    drop = [
        usual_range(info_of("slow_diffusion.R_3"), cell)[0] * cell["capacity_Ah"]
        for cell in (LEAF, {"capacity_Ah": 1.0})
    ]
    assert drop[0] == pytest.approx(drop[1])
    assert usual_range(info_of("charge_transfer.i_0"), LEAF)[0] == pytest.approx(0.1 * 33.0 / 5.2)


@pytest.mark.parametrize("ratio", [4.3, 156.0])
def test_a_gear_multiplies_torque_and_divides_speed(ratio: float):
    """Seen at its shaft, a motor with a gear has k_tau times the ratio and the same R_0."""
    geared = {"k_tau": 0.0385 * ratio}
    assert scale_of("torque", geared) == pytest.approx(ratio)
    assert scale_of("speed", geared) == pytest.approx(1.0 / ratio)
    assert scale_of("motor_current", geared) == pytest.approx(1.0)
    assert scale_of("torque/speed", geared) == pytest.approx(ratio**2)
    assert scale_of("torque/speed2", geared) == pytest.approx(ratio**3)


def test_another_winding_has_the_same_torque_and_speed_at_its_own_voltage():
    """Half the turns of twice the section: half k_tau, a quarter of R_0, made for half the voltage."""
    other = {"k_tau": 0.0385 / 2.0, "R_0": 0.103 / 4.0, "supply_V": 6 * 3.8 / 2.0}
    assert scale_of("torque", other) == pytest.approx(1.0)
    assert scale_of("speed", other) == pytest.approx(1.0)
    assert scale_of("motor_current", other) == pytest.approx(2.0)
    assert scale_of("supply/motor_current", other) == pytest.approx(0.25)


def test_the_supply_of_a_robot_is_its_packs():
    assert scale_of("supply", {"n_series": 3.0, "nominal_cell_voltage_V": 3.6}) == pytest.approx(10.8 / 22.8)


@pytest.mark.parametrize(
    "known",
    [{"R_0": 2.766, "k_tau": 0.9593, "tau_0": 0.2244}, {"R_0": 10.86, "k_tau": 0.6754, "tau_0": 0.04579}],
    ids=["hobby servo with its gear", "gear motor on a brake"],
)
def test_the_friction_of_real_motors_is_of_the_size_of_the_papers(known: dict[str, float]):
    share = known["tau_0"] / (TABLE["tau_0"].default * scale_of("torque", known))
    assert 0.2 < share < 5.0


@pytest.mark.parametrize(
    ("scales", "part"), [("1/capcity", "Did you mean 'capacity'?"), ("mass", "Sizes are capacity,")]
)
def test_an_unknown_size_is_told(scales: str, part: str):
    with pytest.raises(EffectError, match=f"scales '{scales.removeprefix('1/')}' is no size") as raised:
        scale_of(scales, {})
    assert part in str(raised.value)


def test_an_effect_of_ones_own_may_not_scale_with_what_is_not_there(tmp_path):
    path = tmp_path / "mine.py"
    path.write_text(
        "from jaxmodel.model.declaration import parameter\nfrom jaxmodel.model.ports import Effect\n"
        "class Mine(Effect):\n    name = 'mine'\n    kinds = ('cell',)\n    equation = 'R += r'\n"
        "    r: object = parameter(1.0, unit='ohm', meaning='of mine', null=0.0, typical=(0.5, 2.0), scales='weight')\n"
    )
    with pytest.raises(EffectError, match="scales 'weight' is no size"):
        load_effect_class(f"{path}:Mine")


def test_a_parameter_without_a_usual_range_has_none_to_scale():
    with pytest.raises(EffectError, match="'R_0' of an effect has no usual range"):
        usual_range(TABLE["R_0"], {})
    assert set(SIZES) == {"capacity", "surface", "supply", "speed", "motor_current", "torque"}
