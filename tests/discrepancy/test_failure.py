"""Where a calibrated model fails: a hidden Arrhenius law shows in the cold run and in a resistance that shifts."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.failure import Failure, failure
from discrepancy.session import Session
from discrepancy.where import Regressor, map_over_two
from tests.discrepancy.made_cases import made_cell


@pytest.fixture(scope="module")
def cold_resistance(tmp_path_factory: pytest.TempPathFactory) -> Failure:
    """A cell whose resistance follows Arrhenius, under a model whose resistance does not."""
    case = made_cell(tmp_path_factory.mktemp("failing"), {"arrhenius_resistance": {"E_a": 15e3}}).case
    session = Session(case)
    return failure(session, session.hypothesis())


def test_right_model_fails_nowhere(plain_session: Session) -> None:
    found = failure(plain_session, plain_session.hypothesis())
    assert found.floor["voltage_V"].ratio == pytest.approx(1.0, abs=0.06)
    assert found.sentences == ()
    assert found.shift_sentence() == ""
    assert not any(cell.is_biased for cells in found.maps["voltage_V"].values() for cell in cells)
    assert all(test.p_holm > 1e-3 for test in found.memory)


def test_wrong_model_is_above_the_floor_and_remembers(cold_resistance: Failure) -> None:
    assert not cold_resistance.floor["voltage_V"].is_at_floor
    assert min(test.p_holm for test in cold_resistance.memory) < 1e-6


def test_shares_of_a_condition_add_to_one(cold_resistance: Failure) -> None:
    shares: dict[str, float] = {}
    for cell in cold_resistance.cells["voltage_V"]:
        shares[cell.regressor] = shares.get(cell.regressor, 0.0) + cell.share
    assert {"run", "soc", "current_A", "time_since_load_changed_s"} <= set(shares)
    assert list(shares.values()) == pytest.approx([1.0] * len(shares))


def test_resistance_would_have_to_change_with_temperature(cold_resistance: Failure) -> None:
    """The runs at 0, 20 and 40 degC want less and less series resistance, and the sentence says so."""
    shift = next(one for one in cold_resistance.shifts if one.parameter == "series_resistance_scale")
    wanted = [shift.wanted[f"run-{number:02d}"] for number in (1, 2, 3)]
    assert wanted[0] > wanted[1] > wanted[2]
    assert wanted[0] - wanted[2] > 5.0 * max(shift.sd.values())
    assert shift.goes_with == "ambient_degC"
    assert "in the order of ambient_degC" in cold_resistance.shift_sentence()


def test_conditions_that_say_the_same_are_asked_once(cold_resistance: Failure) -> None:
    """Without self-heating the cell's temperature is the ambient's."""
    names = {cell.regressor for cell in cold_resistance.cells["voltage_V"]}
    assert "ambient_degC" in names
    assert "cell_temperature_degC" not in names


def test_map_finds_the_planted_corner() -> None:
    rng = np.random.default_rng(3)
    soc, current = rng.uniform(0.0, 1.0, 4000), rng.uniform(-5.0, 5.0, 4000)
    planted = (soc < 0.3) & (current > 2.0)
    w = rng.standard_normal(4000) + 1.5 * planted
    x, y = Regressor("soc", "", soc), Regressor("current_A", "A", current)
    for cell in map_over_two(w, x, y, np.arange(4000) // 10):
        inside = cell.x[1] < 0.3 and cell.y[0] > 2.0
        outside = cell.x[0] > 0.3 or cell.y[1] < 2.0
        assert not inside or (cell.is_biased and cell.bias == pytest.approx(1.5, abs=0.4))
        assert not outside or abs(cell.bias) < 0.5
