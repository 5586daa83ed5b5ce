"""Parameter sets of PyBaMM as a virtual bench: what is asked of PyBaMM, and the logs that are made of its answers."""

from __future__ import annotations

import os
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case
from jaxmodel.app.commands.import_files import files_of
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing.virtual_bench import logs_of

HEAT = {
    "Cell volume [m3]": 1e-5,
    "Negative electrode density [kg.m-3]": 1600.0,
    "Positive electrode specific heat capacity [J.kg-1.K-1]": 700.0,
}
LIMITS = {"Lower voltage cut-off [V]": 2.5, "Upper voltage cut-off [V]": 4.2, "Nominal cell capacity [A.h]": 5.0}


class Solution:
    """A step of the current at ten seconds: PyBaMM has a row on either side of it."""

    t = np.array([0.0, 10.0, 10.0 + 1e-9, 11.0, 12.0])
    columns = {  # noqa: RUF012
        "Current [A]": [0.0, 0.0, 5.0, 5.0, 5.0],
        "Voltage [V]": [4.2, 4.2, 4.1, 4.0999999996, 4.09],
        "Volume-averaged cell temperature [C]": [20.0, 20.0, 20.0, 20.01, 20.02],
    }

    def __getitem__(self, name: str) -> Any:
        return types.SimpleNamespace(entries=np.array(self.columns[name]))


@pytest.fixture
def pybamm(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What was asked of a PyBaMM that knows two sets, one without heat."""
    asked: dict[str, Any] = {"options": [], "kelvin": [], "steps": []}
    sets = {"Warm2020": LIMITS | HEAT, "Cold2020": LIMITS}

    class Values(dict):
        def copy(self) -> Values:
            return Values(self)

    def simulation(model: Any, *, parameter_values: Any, experiment: Any, solver: Any) -> Any:
        asked["kelvin"].append(parameter_values["Ambient temperature [K]"])
        asked["steps"].append(experiment)
        return types.SimpleNamespace(solve=lambda initial_soc: Solution())

    module: Any = types.ModuleType("pybamm")
    module.parameter_sets = sets
    module.set_logging_level = lambda level: None
    module.ParameterValues = lambda name: Values(sets[name])
    module.lithium_ion = types.SimpleNamespace(DFN=asked["options"].append)
    module.Experiment, module.IDAKLUSolver, module.Simulation = list, object, simulation
    module.SolverError = ArithmeticError
    module.step = types.SimpleNamespace(current=lambda value, duration, period: (value, duration))
    monkeypatch.setitem(sys.modules, "pybamm", module)
    return asked


def test_a_set_is_tested_as_a_cycler_tests_a_cell(pybamm: dict[str, Any], tmp_path: Path) -> None:
    logs = logs_of("Warm2020", tmp_path / "logs")
    assert [log.stem for log in logs] == [
        "slow_25degC", "pulses_10degC", "pulses_25degC", "pulses_40degC", "discharge_1C_30degC", "drive_20degC",
    ]  # fmt: skip
    assert pybamm["kelvin"] == [298.15, 283.15, 298.15, 313.15, 303.15, 293.15]
    assert pybamm["options"][0] == {"thermal": "lumped"}
    assert "Discharge at C/20 until 2.5 V (2 minute period)" in pybamm["steps"][0]
    _, (profile, lasts) = pybamm["steps"][-1]
    assert lasts >= 2400.0
    assert np.all(np.diff(profile[:, 0]) > 0.0)
    assert profile[:, 1].max() <= 7.5
    assert profile[:, 1].min() < 0.0


def test_a_step_has_one_row_which_ends_it(pybamm: dict[str, Any], tmp_path: Path) -> None:
    log = pd.read_csv(logs_of("Warm2020", tmp_path)[0])
    assert list(log.time_s) == [0.0, 10.0, 11.0, 12.0]
    assert list(log.current_A) == [0.0, 0.0, 5.0, 5.0]
    assert list(log.voltage_V) == [4.2, 4.2, 4.1, 4.09]
    assert set(log.ambient_degC) == {25.0}


def test_a_set_without_heat_has_no_thermometer(pybamm: dict[str, Any], tmp_path: Path) -> None:
    assert "cell_temperature_degC" not in pd.read_csv(logs_of("Cold2020", tmp_path)[0])
    assert pybamm["options"][0] == {"thermal": "isothermal"}


def test_a_set_is_named_in_place_of_files(pybamm: dict[str, Any], tmp_path: Path) -> None:
    found = files_of([Path("pybamm:Warm2020")], tmp_path / "case")
    assert {path.parent for path in found} == {tmp_path / "case_logs"}
    with pytest.raises(MeasurementError, match=r"no such set; it has Cold2020, Warm2020\. Did you mean 'Warm2020'\?"):
        files_of([Path("pybamm:Warm2021")], tmp_path / "case")


def test_without_pybamm_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "pybamm", None)
    with pytest.raises(MeasurementError, match=r"PyBaMM is not installed; install jaxmodel\[pybamm\]\."):
        logs_of("Chen2020", tmp_path)


@pytest.mark.skipif("JAXMODEL_PYTHON_OF_PYBAMM" not in os.environ, reason="no Python with PyBaMM is named")
def test_pybamm_itself_is_tested_and_imported(tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
from jaxmodel.data.importing.virtual_bench import logs_of
logs_of("Prada2013", Path({str(tmp_path / "logs")!r}))
"""
    other = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    subprocess.run([os.environ["JAXMODEL_PYTHON_OF_PYBAMM"], "-c", program], check=True, env=other)
    imported = import_case(sorted((tmp_path / "logs").iterdir()), "cell")
    assert [run.name for run in imported.case.runs if run.split == "check"] == ["drive_20degC"]
    assert imported.case.parameters["capacity_Ah"].value == pytest.approx(2.3, rel=0.05)
