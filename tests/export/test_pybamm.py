"""A cell as parameter values of PyBaMM: the numbers of the file, and what PyBaMM makes of them."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel import Case, Profile, case_model, read_case, run_profile, simulate
from jaxmodel.base.errors import ParameterError
from jaxmodel.export.thevenin import thevenin
from jaxmodel.model.cell import evaluate
from jaxmodel.model.curves import Table
from tests.export.other_python import run_by
from tests.export.test_c_model import made_up

WARM = {"self_heating": {"C_th": 45.0, "hA": 0.15}, "arrhenius_resistance": {}}


@pytest.fixture(scope="module")
def case() -> Case:
    return read_case("examples/samsung_30q")


def test_the_tables_of_the_circuit_are_those_of_the_model(case: Case) -> None:
    circuit, curves = thevenin(case), case_model(case).curves
    for name, curve in (
        ("R0_ohm", curves.R_ints),
        ("R1_ohm", curves.R_TS),
        ("C2_F", curves.C_TL),
        ("ocv_V", curves.ocv),
    ):
        assert isinstance(curve, Table)
        expected = np.interp(circuit.soc, curve.soc, curve.values[0])
        np.testing.assert_allclose(circuit.elements[name], expected[None], rtol=1e-12)
    assert circuit.capacity_Ah == pytest.approx(2.996)


def test_an_element_between_breakpoints_is_on_the_line() -> None:
    """Of formulas, and of an effect of temperature, which both bend."""
    case = made_up("cell", effects={"arrhenius_resistance": {}})
    circuit, model = thevenin(case), case_model(case)
    for soc, celsius in ((0.013, -7.3), (0.371, 23.7), (0.93, 41.1)):
        state = {"soc": jnp.asarray(soc), "v_ts_V": jnp.zeros(()), "v_tl_V": jnp.zeros(())}
        truth = evaluate(model.parameters, model.curves, model.effects, state, jnp.asarray(celsius)).context
        rows = [np.interp(soc, circuit.soc, row) for row in circuit.elements["R0_ohm"]]
        found = np.interp(celsius, circuit.temperature_degC, rows)
        assert found == pytest.approx(float(truth.series_resistance_ohm), rel=5e-4)


def test_what_the_circuit_has_not_is_said(case: Case) -> None:
    more = {"ocv_hysteresis": {}, "charge_transfer": {}, "arrhenius_resistance": {}}
    found = dataclasses.replace(case, effects=more).export("pybamm")
    (sentence,) = [one for one in found.left_out if "ocv_hysteresis" in one]
    assert "charge_transfer" in sentence
    assert "arrhenius_resistance" not in sentence
    comment = " ".join(found.content.split('"""')[1].split())
    assert all(one in comment for one in found.left_out)


def test_a_motor_is_refused() -> None:
    with pytest.raises(ParameterError, match="of a motor"):
        made_up("motor").export("pybamm")


def test_the_file_has_the_numbers_of_the_cell(case: Case) -> None:
    text = dataclasses.replace(case, effects=WARM).export("pybamm").content
    numbers = dict(re.findall(r'"([^"]+)": ([\d.]+),', text))
    assert float(numbers["Cell thermal mass [J/K]"]) == 45.0
    assert float(numbers["Cell-jig heat transfer coefficient [W/K]"]) == 0.15
    assert float(numbers["Cell capacity [A.h]"]) == pytest.approx(2.996)
    assert float(numbers["Initial SoC"]) == case.runs[0].initial_soc.value


@pytest.mark.parametrize(("effects", "most_mV"), [({}, 0.01), (WARM, 0.2)], ids=["tables", "warm"])
def test_pybamm_simulates_a_shipped_discharge_alike(case: Case, effects: dict, most_mV: float, tmp_path: Path) -> None:
    case = dataclasses.replace(case, effects=effects)
    run = case.runs[-1]
    profile: Profile = run_profile(run)
    ours = simulate(case_model(case, run), profile).readings
    case.export("pybamm", tmp_path / "cell.py")
    given = {"time_s": profile.time_s, **profile.inputs}
    start = {"cell_degC": float(ours["cell_temperature_degC"][0]), "initial_soc": run.initial_soc.value}
    text = json.dumps({name: values.tolist() for name, values in given.items()} | start)
    (tmp_path / "run.json").write_text(text, encoding="utf-8")
    found = run_by("pybamm", "by_pybamm.py", tmp_path / "cell.py", tmp_path / "run.json")
    error_mV = 1e3 * np.abs(np.array(found["voltage_V"]) - np.asarray(ours["voltage_V"]))
    assert found["stopped"] == "final time"
    assert error_mV.max() < most_mV
    assert np.abs(np.array(found["cell_degC"]) - np.asarray(ours["cell_temperature_degC"])).max() < 0.01
