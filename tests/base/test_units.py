from __future__ import annotations

import pytest

from jaxmodel.base.units import ending_of, unit_of
from jaxmodel.case.measurements import KINDS


@pytest.mark.parametrize(
    ("column", "ending", "unit"),
    [
        ("speed_rad_s", "rad_s", "rad/s"),  # not seconds
        ("time_s", "s", "s"),
        ("load_torque_Nm", "Nm", "N m"),
        ("V_set", "set", "V"),
        ("soc", "", ""),
        ("duty", "", ""),
    ],
)
def test_a_unit_is_told_by_the_whole_end_of_a_name(column, ending, unit):
    assert (ending_of(column), unit_of(column)) == (ending, unit)


def test_every_column_but_the_pure_numbers_has_a_unit():
    columns = {name for kind in KINDS.values() for name in (*kind.required_inputs, *kind.outputs)}
    assert {name for name in columns if not unit_of(name)} <= {"soc", "duty"}
