"""The model of a case as C: what a compiler makes of it does what the model does."""

from __future__ import annotations

import ctypes
import functools
import re
import subprocess
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, Profile, case_model, read_case, run_profile, simulate, with_values
from jaxmodel.base.errors import ParameterError

WARNINGS = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-pedantic"]
TIME_S = np.arange(0.0, 30.0, 1.0)
WAVE = 1.0 + 0.5 * np.sin(TIME_S / 5.0)
FRAMES = {
    "cell": {"current_A": WAVE, "ambient_degC": 20.0, "voltage_V": 3.7},
    "motor": {"voltage_V": 6.0 * WAVE, "load_torque_Nm": 0.01, "ambient_degC": 20.0, "speed_rad_s": 100.0},
    "robot": {"duty": 0.5 * WAVE, "load_torque_Nm": 0.1, "ambient_degC": 20.0, "pack_voltage_V": 20.0},
}
# Effects that bring what a plain model has not: states, a table, the root of an equation, a branch.
EFFECTS = {
    "cell": {"self_heating": {}, "ocv_hysteresis": {}, "core_temperature": {}, "charge_transfer": {}},
    "motor": {"brush_current_drop": {}, "presliding": {}, "magnet_temperature": {}, "saturation": {}},
    "robot": {"self_heating": {}, "stribeck_friction": {}},
}


def made_up(kind: str, **more) -> Case:
    return Case.from_dataframes(
        {"a": pd.DataFrame({"time_s": TIME_S} | FRAMES[kind])}, kind=kind, name=f"a {kind}", **more
    )


@functools.cache
def text_of(kind: str, precision: str) -> str:
    """Return the C of a model with effects; it takes seconds."""
    return made_up(kind, effects=EFFECTS[kind]).export("c", precision=precision).content


def vectors_of(text: str, folder: Path, cc: str) -> subprocess.CompletedProcess[str]:
    source, program = folder / "model.c", folder / "model"
    source.write_text(text, encoding="utf-8")
    name = re.search(r"#ifdef (\w+_TEST)", text)[1]
    subprocess.run([cc, *WARNINGS, f"-D{name}", str(source), "-o", str(program), "-lm"], check=True)
    return subprocess.run([str(program)], capture_output=True, text=True)


@pytest.mark.slow("motor-float32", "robot-float32")
@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("kind", FRAMES)
def test_the_test_vectors_pass(kind: str, precision: str, tmp_path: Path, cc: str) -> None:
    done = vectors_of(text_of(kind, precision), tmp_path, cc)
    assert done.returncode == 0, done.stdout
    error, allowed = (float(number) for number in re.findall(r"(?:error|allowed) ([^\s,]+)", done.stdout))
    assert error <= allowed
    assert allowed == 1e-12 if precision == "float64" else 2e-5 <= allowed < 0.02


def test_the_test_vectors_fail_where_a_parameter_is_another(tmp_path: Path, cc: str) -> None:
    text = made_up("cell").export("c").content
    changed = re.sub(r"(p_capacity_Ah = )([\d.]+);", lambda found: f"{found[1]}{1.000001 * float(found[2])};", text)
    assert changed != text
    assert vectors_of(changed, tmp_path, cc).returncode == 1


class Shipped:
    """The C of a shipped case as a library, with its structures."""

    def __init__(self, folder: Path, cc: str) -> None:
        self.case = read_case("examples/samsung_30q")
        text = self.case.export("c", folder / "cell.c").content
        subprocess.run(
            [cc, *WARNINGS, "-shared", "-fPIC", str(folder / "cell.c"), "-o", str(folder / "cell.so"), "-lm"],
            check=True,
        )
        self.library = ctypes.CDLL(str(folder / "cell.so"))
        self.state, self.inputs, self.readings = (
            self._structure(text, what) for what in ("state", "inputs", "readings")
        )
        self.library.samsung_30q_step.argtypes = [ctypes.c_void_p, ctypes.c_double, ctypes.c_void_p]
        self.library.samsung_30q_valid.restype = ctypes.c_bool

    @staticmethod
    def _structure(text: str, what: str) -> ctypes.Structure:
        body = re.search(r"typedef struct \{([^}]*)\} samsung_30q_" + what, text)[1]
        names = re.findall(r"double (\w+);", body)
        return type(what, (ctypes.Structure,), {"_fields_": [(name, ctypes.c_double) for name in names]})()

    def call(self, function: str, *given) -> bool:
        passed = [ctypes.byref(one) if isinstance(one, ctypes.Structure) else one for one in given]
        return getattr(self.library, f"samsung_30q_{function}")(*passed)


def test_a_whole_shipped_discharge_is_that_of_the_model(tmp_path: Path, cc: str) -> None:
    c = Shipped(tmp_path, cc)
    run = c.case.runs[0]
    profile: Profile = run_profile(run)
    model = with_values(case_model(c.case), {"initial_soc": jnp.asarray(run.initial_soc.value)})
    ours = simulate(model, profile).readings["voltage_V"]
    found = []
    for row, time_s in enumerate(profile.time_s):
        c.inputs.current_A = profile.inputs["current_A"][row]
        c.inputs.ambient_degC = profile.inputs["ambient_degC"][row]
        if row == 0:
            c.call("start", c.inputs, c.state)
            c.state.soc = run.initial_soc.value
        else:
            c.call("step", c.inputs, float(time_s - profile.time_s[row - 1]), c.state)
        c.call("read", c.inputs, c.state, c.readings)
        found.append(c.readings.voltage_V)
    np.testing.assert_allclose(found, ours, rtol=1e-12)
    assert c.call("valid", c.inputs, c.state)
    c.state.soc = 1.2
    assert not c.call("valid", c.inputs, c.state)


def test_the_file_keeps_the_plain_rules() -> None:
    """No memory is asked for, nothing jumps, no array has a size of its own, and no function calls itself."""
    code = text_of("motor", "float64").split("#ifdef")[0]
    assert not re.search(r"\b(malloc|calloc|realloc|free|alloca|goto|setjmp|longjmp)\b", code)
    assert all(size.isdigit() for size in re.findall(r"^ *(?:static )?(?:const )?\w+ \w+\[([^\]]*)\] =", code, re.M))
    functions = re.findall(r"^(?:static )?\w+ (\w+)\([^;{]*\)\n\{\n(.*?)\n\}", code, re.M | re.S)
    assert {name for name, _ in functions} >= {"a_motor_start", "a_motor_step", "a_motor_read", "a_motor_valid"}
    names = [name for name, _ in functions]
    assert all(
        not re.search(rf"\b{called}\(", body) for _, body in functions for called in names if called != "look_up"
    )


def test_what_is_left_out_is_said_in_the_file() -> None:
    case = made_up("cell", effects={"voltage_offset": {"column": "voltage_V"}})
    found = case.export("c")
    assert any("voltage_offset" in sentence for sentence in found.left_out)
    comment = " ".join(found.content.split("*/")[0].replace("\n * ", " ").split())
    assert all(sentence in comment for sentence in found.left_out)


def test_a_fault_of_an_input_is_carried(tmp_path: Path, cc: str) -> None:
    case = made_up("cell", effects={"current_offset": {"column": "current_A", "c": 0.1}})
    found = case.export("c")
    assert not any("current_offset" in sentence for sentence in found.left_out)
    assert vectors_of(found.content, tmp_path, cc).returncode == 0
    without = re.sub(r"(p_current_offset_current_A_c) = [\d.]+;", r"\1 = 0.0;", found.content)
    assert without != found.content
    assert vectors_of(without, tmp_path, cc).returncode == 1


def test_a_precision_that_c_has_not_is_refused() -> None:
    with pytest.raises(ParameterError, match="float16"):
        made_up("cell").export("c", precision="float16")
