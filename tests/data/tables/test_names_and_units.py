"""Names of columns mean what benches mean by them, and units convert as physics has it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from jaxmodel.data.tables.names import matches, of_two_lines, parse_name
from jaxmodel.data.tables.quantities import QUANTITIES
from jaxmodel.data.tables.units import SPELLINGS, conversion


@pytest.mark.parametrize(
    ("column", "quantity", "unit"),
    [
        ("Voltage(V)", "voltage", "V"),
        ("Ewe/V", "voltage", "V"),
        ("<I>/mA", "current", "mA"),
        ("Current / A", "current", "A"),
        ("current_mA", "current", "mA"),
        ("Strom [A]", "current", "A"),
        ("电流(mA)", "current", "mA"),
        ("Test Time / s", "time", "s"),
        ("Test (Sec)", "time", "Sec"),
        ("Step (Sec)", "step_time", "Sec"),
        ("DPt Time", "stamp", ""),
        ("Aux_Temperature_1(C)", "cell_temperature", "C"),
        ("temperature_middle_degC", "cell_temperature", "degC"),
        ("Ambient Temperature / degC", "ambient_temperature", "degC"),
        ("speed_rpm", "speed", "rpm"),
        ("Encoder Speed RPM 1", "speed", ""),
        ("Drehmoment [Nm]", "load_torque", "Nm"),
        ("winding_phaseA_temperature_degC", "winding_temperature", "degC"),
        ("LogTemp001 [°C]", "cell_temperature", "°C"),
        ("Cell [°C]", "cell_temperature", "°C"),
    ],
)
def test_a_name_means_its_quantity(column: str, quantity: str, unit: str):
    assert parse_name(column).unit == unit
    assert matches(column)[0].quantity == quantity


@pytest.mark.parametrize(
    "column",
    [
        "speed_setpoint_rpm",
        "test",
        "Rec#",
        "dV/dt(V/s)",
        "Internal_Resistance(Ohm)",
        "Voltage(A)",
        "eRPM",
        "erpm",
        "Cell",
    ],
)
def test_what_is_wanted_or_counted_or_in_another_unit_is_no_reading(column: str):
    readings = {"voltage", "current", "speed", "time", "cell_temperature", "motor_voltage", "motor_current"}
    assert not readings & {match.quantity for match in matches(column)}


@pytest.mark.parametrize(
    ("names", "above", "whole"),
    [
        (["", "I", "U"], ["Time", "Cell", ""], ["Time", "I", "U"]),  # merged downwards, and across
        (["t", "V", "A", "V"], ["", "Cell 1", "", "Cell 2"], ["t", "Cell 1 V", "A", "Cell 2 V"]),
        (["t", "I", "U"], ["Cell test 12", "", ""], ["t", "I", "U"]),  # a title
        (["t", "I", "U"], ["Time", "Current", "Voltage"], ["t", "I", "U"]),  # names that need none
        (["t", "", "U"], ["operator", "", "JK"], ["t", "", "U"]),  # what is above names no gap
        (["t", "", "U"], [], ["t", "", "U"]),
    ],
)
def test_names_stand_in_two_lines_where_cells_are_merged(names: list[str], above: list[str], whole: list[str]):
    assert of_two_lines(names, above) == whole


@pytest.mark.parametrize(
    ("unit", "target", "value", "converted"),
    [
        ("mA", "A", 1500.0, 1.5),
        ("MA", "A", 1.0, 1e6),
        ("h", "s", 2.0, 7200.0),
        ("min", "s", 1.5, 90.0),
        ("C", "degC", 21.0, 21.0),
        ("K", "degC", 300.0, 26.85),
        ("°F", "degC", 212.0, 100.0),
        ("rpm", "rad/s", 60.0, 2.0 * np.pi),
        ("deg/s", "rad/s", 180.0, np.pi),
        ("Nm", "N m", 1.0, 1.0),
        ("mNm", "N m", 1.0, 1e-3),
        ("%", "", 50.0, 0.5),
        ("mAh", "A h", 2500.0, 2.5),
        ("A*s", "A h", 3600.0, 1.0),
    ],
)
def test_units_convert(unit: str, target: str, value: float, converted: float):
    change = conversion(unit, target)
    assert change is not None
    assert value * change.factor + change.offset == pytest.approx(converted)


@given(st.text(max_size=12))
def test_any_text_is_a_unit_or_none(text: str):
    change = conversion(text, "A")
    assert change is None or np.isfinite(change.factor)


def test_every_spelling_is_known_to_pint():
    import pint

    registry = pint.UnitRegistry()
    for spelling in set(SPELLINGS.values()):
        registry.parse_units(spelling)


def test_every_quantity_is_found_by_each_of_its_own_names():
    for name, quantity in QUANTITIES.items():
        for words in quantity.names:
            if words in quantity.with_unit:
                continue
            found = matches(words)
            assert name in {match.quantity for match in found}, (name, words)
