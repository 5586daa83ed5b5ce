"""The model of a case as an FMU: what a compiler and FMPy make of it does what the model does."""

from __future__ import annotations

import ctypes
import io
import json
import shutil
import subprocess
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel import Case, Profile, case_model, read_case, run_profile, simulate, with_values
from jaxmodel.base.errors import ParameterError
from jaxmodel.export import fmu
from tests.export.other_python import run_by
from tests.export.test_c_model import EFFECTS, WARNINGS, made_up
from tests.export.test_mujoco import servo

# Each brings another rule of steps: growing ones, those of a kink, of saturation, of a resonance, of a winding that
# warms while a heavy rotor starts, and of one with a kink too.
MOTORS = {
    "growing": ({}, {}),
    "kink": ({"brush_drop": {}, "presliding": {}}, {}),
    "saturation": ({"saturation": {}, "magnet_temperature": {}}, {}),
    "resonance": ({"flexible_shaft": {"J_l": 1e-5, "k": 0.5}}, {}),
    "heavy": ({}, {"J": 2e-3}),
    "heavy, kink": ({"brush_drop": {}}, {"J": 2e-3}),
}
# Of the largest number of its kind. FMUs, like JAX, take the same steps; what is left is rounding.
MOST = 1e-11


def files_of(content: str | bytes) -> dict[str, bytes]:
    assert isinstance(content, bytes)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def variables_of(files: Mapping[str, bytes]) -> dict[str, dict[str, str]]:
    """Return the attributes of each variable by its name, of either version."""
    root = ElementTree.fromstring(files["modelDescription.xml"])
    variables = root.find("ModelVariables")
    assert variables is not None
    return {
        one.attrib["name"]: one.attrib | {k: v for kind in one for k, v in kind.attrib.items()} for one in variables
    }


class Fmu2:
    """An instance of an FMU of FMI 2, by its binary."""

    def __init__(self, folder: Path, content: str | bytes) -> None:
        files = files_of(content)
        self.variables = variables_of(files)
        (name,) = (name for name in files if name.startswith("binaries/"))
        (folder / "model.so").write_bytes(files[name])
        self.library = ctypes.CDLL(str(folder / "model.so"))
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        token = ElementTree.fromstring(files["modelDescription.xml"]).attrib["guid"]
        self.instance = ctypes.c_void_p(self.library.fmi2Instantiate(b"one", 1, token.encode(), b"", None, 0, 0))
        assert self.instance

    def call(self, name: str, *given) -> None:
        passed = [ctypes.c_double(one) if isinstance(one, float) else one for one in given]
        assert getattr(self.library, f"fmi2{name}")(self.instance, *passed) == 0

    def start(self, parameters: Mapping[str, float], inputs: Mapping[str, float]) -> None:
        self.set(parameters)
        self.call("EnterInitializationMode")
        self.set(inputs)
        self.call("ExitInitializationMode")

    def _references(self, names):
        return (ctypes.c_uint * len(names))(*(int(self.variables[name]["valueReference"]) for name in names))

    def set(self, values: Mapping[str, float]) -> None:
        count = ctypes.c_size_t(len(values))
        self.call("SetReal", self._references(list(values)), count, (ctypes.c_double * len(values))(*values.values()))

    def get(self, *names: str) -> list[float]:
        found = (ctypes.c_double * len(names))()
        self.call("GetReal", self._references(names), ctypes.c_size_t(len(names)), found)
        return list(found)


def rows_of(profile: Profile) -> Iterator[dict[str, float]]:
    for values in zip(*profile.inputs.values(), strict=True):
        yield dict(zip(profile.inputs, map(float, values), strict=True))


def simulated(fmu2: Fmu2, profile: Profile, parameters: Mapping[str, float]) -> dict[str, np.ndarray]:
    """Return the readings of an FMU at the rows of a profile."""
    names = [name for name, one in fmu2.variables.items() if one["causality"] == "output" and name != "valid"]
    rows = list(rows_of(profile))
    fmu2.start(parameters, rows[0])
    found = [fmu2.get(*names)]
    for k in range(1, len(rows)):
        fmu2.set(rows[k])
        fmu2.call("DoStep", float(profile.time_s[k - 1]), float(profile.time_s[k] - profile.time_s[k - 1]), 0)
        found.append(fmu2.get(*names))
    return dict(zip(names, np.transpose(found), strict=True))


def assert_alike(found: Mapping[str, np.ndarray], ours: Mapping[str, np.ndarray]) -> None:
    assert set(found) == set(ours)
    for name, values in found.items():
        np.testing.assert_allclose(values, ours[name], rtol=0, atol=MOST * np.abs(ours[name]).max() + 1e-300)


@pytest.mark.parametrize(("effects", "parameters"), MOTORS.values(), ids=MOTORS)
def test_a_motor_takes_the_steps_of_a_simulation(effects: dict, parameters: dict, tmp_path: Path, cc: str) -> None:
    case = made_up("motor", effects=effects, parameters=parameters)
    profile = run_profile(case.runs[0])
    # Rows with a jump of the inputs and without, short ones and long ones.
    time_s = np.concatenate([[0.0, 0.002], np.arange(1.0, 20.0)])
    profile = Profile(time_s, {name: np.repeat(values, 3)[: time_s.size] for name, values in profile.inputs.items()})
    ours = simulate(case_model(case), profile)
    found = simulated(Fmu2(tmp_path, case.export("fmu").content), profile, {})
    assert_alike(found, ours.readings)


@pytest.mark.parametrize("kind", ["cell", "robot"])
def test_a_model_with_effects_is_that_of_a_simulation(kind: str, tmp_path: Path, cc: str) -> None:
    case = made_up(kind, effects=EFFECTS[kind])
    profile = run_profile(case.runs[0])
    assert_alike(
        simulated(Fmu2(tmp_path, case.export("fmu").content), profile, {}),
        simulate(case_model(case), profile).readings,
    )


def test_a_servo_takes_the_steps_of_its_loop(tmp_path: Path, cc: str) -> None:
    """At rows ten times as long as the loop needs them; the servo begins at the position that its case states."""
    case = servo()
    measured = run_profile(case.runs[0])
    profile = Profile(measured.time_s[::50], {name: values[::50] for name, values in measured.inputs.items()})
    model = case_model(case, case.runs[0])
    instance = Fmu2(tmp_path, case.export("fmu").content)
    start = {"gravity_load.initial_position_rad": 0.1, "longest_step_s": 1e6}
    assert_alike(simulated(instance, profile, start), simulate(model, profile).readings)


def test_parameters_are_set(tmp_path: Path, cc: str) -> None:
    """Each changes the FMU as it changes the model: one of the start, one of the base model, one of an effect."""
    case = made_up("cell", effects={"self_heating": {}})
    values = {"initial_soc": 0.6, "capacity_Ah": 2.5, "self_heating.hA": 0.02}
    profile = run_profile(case.runs[0])
    instance = Fmu2(tmp_path, case.export("fmu").content)
    assert instance.variables["initial_soc"]["variability"] == "fixed"
    assert instance.variables["self_heating.hA"]["variability"] == "tunable"
    changed = with_values(case_model(case), {name: jnp.asarray(value) for name, value in values.items()})
    assert_alike(simulated(instance, profile, values), simulate(changed, profile).readings)


def test_steps_follow_the_parameters_that_are_set(tmp_path: Path, cc: str) -> None:
    """A motor of another inertia and inductance starts in other steps."""
    case, values = made_up("motor"), {"J": 2e-3, "L_a": 1e-3, "R_0": 0.2}
    profile = run_profile(case.runs[0])
    changed = with_values(case_model(case), {name: jnp.asarray(value) for name, value in values.items()})
    found = simulated(Fmu2(tmp_path, case.export("fmu").content), profile, values)
    assert_alike(found, simulate(changed, profile).readings)


def test_a_step_that_fails_changes_nothing(tmp_path: Path, cc: str) -> None:
    case = made_up("cell")
    instance = Fmu2(tmp_path, case.export("fmu").content)
    instance.start({}, {"current_A": 2.0, "ambient_degC": 20.0})
    instance.call("DoStep", 0.0, 10.0, 0)
    before = instance.get("soc", "voltage_V")
    capacity = float(instance.variables["capacity_Ah"]["start"])
    instance.set({"capacity_Ah": 0.0})
    error = 3
    assert instance.library.fmi2DoStep(instance.instance, ctypes.c_double(10.0), ctypes.c_double(1.0), 0) == error
    instance.set({"capacity_Ah": capacity})
    assert instance.get("soc", "voltage_V") == before
    instance.call("DoStep", 10.0, 1.0, 0)


def test_an_fmu_of_another_case_is_not_this_one(tmp_path: Path, cc: str) -> None:
    instance = Fmu2(tmp_path, made_up("cell").export("fmu").content)
    other = files_of(made_up("robot").export("fmu", binary="no").content)
    token = ElementTree.fromstring(other["modelDescription.xml"]).attrib["guid"]
    assert not instance.library.fmi2Instantiate(b"two", 1, token.encode(), b"", None, 0, 0)


def test_a_long_step_is_cut_into_usual_ones(tmp_path: Path, cc: str) -> None:
    case = read_case("examples/samsung_30q")
    instance = Fmu2(tmp_path, case.export("fmu").content)
    usual = float(instance.variables["longest_step_s"]["start"])
    assert usual == np.median(np.diff(case.runs[0].measured.time_s))
    inputs = {"current_A": 6.0, "ambient_degC": 23.0}
    time_s = usual * np.arange(301)
    profile = Profile(time_s, {name: np.full(time_s.size, value) for name, value in inputs.items()})
    instance.start({}, inputs)
    instance.call("DoStep", 0.0, float(time_s[-1]), 0)
    expected = simulate(case_model(case), profile).readings["voltage_V"][-1]
    assert instance.get("voltage_V")[0] == pytest.approx(float(expected), rel=1e-12)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_the_sources_compile_without_a_warning(fmi: str, tmp_path: Path, cc: str) -> None:
    files = files_of(made_up("robot").export("fmu", fmi=fmi, binary="no").content)
    for name, content in files.items():
        if name.startswith("sources/"):
            (tmp_path / Path(name).name).write_bytes(content)
    subprocess.run([cc, *WARNINGS, "-c", f"fmi{fmi}.c", "-o", "model.o"], cwd=tmp_path, check=True)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_the_description_has_the_numbers_of_the_case(fmi: str) -> None:
    case = made_up("robot", effects={"voltage_offset": {"column": "pack_voltage_V"}})
    exported = case.export("fmu", fmi=fmi, binary="no")
    files = files_of(exported.content)
    root = ElementTree.fromstring(files["modelDescription.xml"])
    assert root.attrib["fmiVersion"] == f"{fmi}.0"
    assert root.attrib["guid" if fmi == "2" else "instantiationToken"].encode() in files["sources/model.h"]
    assert not any(name.startswith("binaries") for name in files)
    assert any("no binary" in sentence for sentence in exported.left_out)
    assert any("voltage_offset" in sentence for sentence in exported.left_out)
    variables = variables_of(files)
    assert {"duty", "load_torque_Nm", "ambient_degC"} == {n for n, v in variables.items() if v["causality"] == "input"}
    assert float(variables["ambient_degC"]["start"]) == 20.0
    assert float(variables["k_tau"]["start"]) == float(case_model(case).parameters.k_tau)
    assert variables["k_tau"]["unit"] == "N m/A"
    units = {unit.attrib["name"]: unit[0].attrib for unit in root.iter("Unit")}
    assert units["N m/A"] == {"kg": "1", "m": "2", "s": "-2", "A": "-1"}
    assert units["degC"] == {"K": "1", "offset": "273.15"}
    assert units["A h"] == {"s": "1", "A": "1", "factor": "3600.0"}
    # Nothing of the day or the machine is in it.
    assert made_up("robot", effects=case.effects).export("fmu", fmi=fmi, binary="no") == exported


def test_without_a_compiler_it_has_sources_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    exported = made_up("cell").export("fmu")
    assert not any(name.startswith("binaries") for name in files_of(exported.content))
    assert any("no C compiler" in sentence for sentence in exported.left_out)


def test_a_compiler_that_fails_is_said(monkeypatch: pytest.MonkeyPatch, cc: str) -> None:
    monkeypatch.setattr(fmu, "FLAGS", (*fmu.FLAGS, "-no-such-flag"))
    exported = made_up("cell").export("fmu")
    assert any("no-such-flag" in sentence for sentence in exported.left_out)


@pytest.mark.parametrize(("option", "value"), [("fmi", "1"), ("binary", "maybe")])
def test_an_unknown_option_is_refused(option: str, value: str) -> None:
    with pytest.raises(ParameterError, match=value):
        made_up("cell").export("fmu", **{option: value})


@pytest.mark.parametrize("fmi", ["2", "3"])
@pytest.mark.parametrize("folder", ["samsung_30q", "paper_experiment"])
def test_fmpy_simulates_a_shipped_case_alike(folder: str, fmi: str, tmp_path: Path, cc: str) -> None:
    case: Case = read_case(f"examples/{folder}")
    run = case.runs[0]
    profile = run_profile(run)
    case.export("fmu", tmp_path / "model.fmu", fmi=fmi)
    parameters = {"initial_soc": run.initial_soc.value, "longest_step_s": 1e6}
    rows = {name: values.tolist() for name, values in profile.inputs.items()}
    given = {"time_s": profile.time_s.tolist(), "inputs": rows, "parameters": parameters}
    (tmp_path / "run.json").write_text(json.dumps(given), encoding="utf-8")
    found = run_by("fmpy", "by_fmpy.py", tmp_path / "model.fmu", tmp_path / "run.json")
    assert found["problems"] == []
    assert all(found["alike"].values()), found["alike"]
    assert all(found["refused"].values()), found["refused"]
    ours = simulate(case_model(case, run), profile)
    assert_alike(dict(zip(found["names"], np.array(found["readings"]), strict=True)), ours.readings)
    assert found["valid"] == np.asarray(ours.valid).tolist()
    np.testing.assert_allclose(found["simulated"], found["held"], rtol=1e-12)
