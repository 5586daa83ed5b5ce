"""Names of curves from what a user wants to correct."""

from __future__ import annotations

import pytest

from jaxmodel.base.errors import EffectError
from jaxmodel.diagnosis import curve
from jaxmodel.effects.curves import CURVES


def test_every_curve_has_one_name_to_ask_for() -> None:
    asked = {(cls.relation or cls.port, cls.over): name for name, cls in CURVES.items()}
    assert len(asked) == len(CURVES)
    assert all(curve(relation, over) == name for (relation, over), name in asked.items())
    assert curve("open_circuit_voltage") == "ocv_curve"
    assert curve("entropic_coefficient", over="soc") == "entropy_curve"


def test_a_curve_that_is_not_there_lists_those_that_are() -> None:
    with pytest.raises(EffectError, match="open_circuit_voltage over soc"):
        curve("open_circuit_volage")
