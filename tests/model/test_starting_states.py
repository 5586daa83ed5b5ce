"""How a run starts: temperatures and the hysteresis loop where the run says, and as before where it says nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.known import Known
from jaxmodel.case.reading import read_case
from jaxmodel.effects import CATALOGUE
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import constant
from tests.model.runs import readings

REST = constant(100.0, 1.0, current_A=0.0, ambient_degC=20.0)
STILL = constant(100.0, 1.0, voltage_V=0.0, load_torque_Nm=0.0, ambient_degC=20.0)


def test_a_warm_cell_cools_from_where_it_starts():
    """At rest T - T_amb = rise e^(-t hA/C_th)."""
    heating = CATALOGUE["self_heating"](C_th=60.0, hA=0.5)
    found = readings(Model("cell", Parameters(initial_temperature_rise_K=8.0), effects=(heating,)), REST)
    expected = 20.0 + 8.0 * np.exp(-REST.time_s * 0.5 / 60.0)
    np.testing.assert_allclose(found["cell_temperature_degC"], expected, rtol=1e-12)


@pytest.mark.parametrize("loop", [-1.0, 0.4])
def test_a_loop_stays_at_rest_where_it_starts(loop: float):
    hysteresis = CATALOGUE["ocv_hysteresis"](M_V=0.03)
    shifted, middle = (
        readings(Model("cell", Parameters(initial_hysteresis=start), effects=(hysteresis,)), REST)["voltage_V"]
        for start in (loop, 0.0)
    )
    np.testing.assert_allclose(middle - shifted, 0.03 * loop, rtol=0.0, atol=1e-14)


def test_a_warm_motor_cools_from_where_it_starts():
    """Each stage decays with its own time constant, eq. 15."""
    start = Parameters(initial_winding_rise_K=15.0, initial_case_rise_K=30.0)
    found = readings(Model("motor", start), STILL)
    case = 20.0 + 30.0 * np.exp(-STILL.time_s / 1370.0)
    np.testing.assert_allclose(found["case_temperature_degC"], case, rtol=1e-12)
    np.testing.assert_allclose(
        found["winding_temperature_degC"], case + 15.0 * np.exp(-STILL.time_s / 71.7), rtol=1e-12
    )


def test_a_run_that_says_nothing_starts_at_ambient_in_the_middle_of_the_loop():
    names = ("initial_temperature_rise_K", "initial_hysteresis", "initial_winding_rise_K", "initial_case_rise_K")
    assert [float(getattr(Parameters(), name)) for name in names] == [0.0] * 4


def write_case(folder: Path, kind: str, line: str) -> Path:
    header = {
        "cell": "time_s,current_A,ambient_degC,voltage_V\n0,2,20,3.9\n1,2,20,3.9\n",
        "motor": "time_s,voltage_V,load_torque_Nm,ambient_degC,current_A\n0,1,0,20,0\n1,1,0,20,1\n",
    }[kind]
    (folder / "run-01.csv").write_text(header)
    path = folder / "case.toml"
    path.write_text(f'kind = "{kind}"\n[[runs]]\nfile = "run-01.csv"\nsplit = "fit"\n{line}\n')
    return path


@pytest.mark.parametrize(
    ("line", "known"),
    [
        ("initial_cell_temperature_degC = { value = 24.1, sd = 0.3 }", Known(24.1, 0.3)),
        ("initial_cell_temperature_degC = -5", Known(-5.0, None)),
        ("", None),
    ],
)
def test_a_run_may_state_the_cells_first_temperature(tmp_path: Path, line: str, known: Known | None):
    run = read_case(write_case(tmp_path, "cell", line)).runs[0]
    assert run.initial_cell_temperature == known
    assert run.overrides == {}


def test_starting_states_may_be_overrides_of_a_run(tmp_path: Path):
    run = read_case(write_case(tmp_path, "cell", "initial_hysteresis = { value = -1, sd = 0.2 }")).runs[0]
    assert run.overrides == {"initial_hysteresis": Known(-1.0, 0.2)}


@pytest.mark.parametrize(
    ("kind", "line", "part"),
    [
        ("motor", "initial_cell_temperature_degC = 20", "a motor has no cell; remove it"),
        ("cell", "initial_cell_temperature_degC = 293.15", "if this is kelvin, subtract 273.15."),
        (
            "cell",
            "initial_cell_temperature_degC = 20\ninitial_temperature_rise_K = 1",
            "states the same quantity; keep one",
        ),
        ("cell", "initial_hysteresis = 2", "outside its range -1 to 1"),
    ],
)
def test_a_start_that_cannot_be_is_one_sentence(tmp_path: Path, kind: str, line: str, part: str):
    with pytest.raises(ParameterError, match=r"the run of run-01\.csv") as raised:
        read_case(write_case(tmp_path, kind, line))
    assert part in str(raised.value)
