"""The filter of the state of charge as C: what a compiler makes of it does what the filter does."""

from __future__ import annotations

import ctypes
import functools
import json
import re
import subprocess
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmodel import case_model, operation, read_case
from jaxmodel.base.errors import ParameterError
from jaxmodel.operation.kalman import ekf
from tests.export.test_c_model import WARNINGS, made_up, vectors_of


@functools.cache
def text_of(precision: str) -> str:
    """Return the C of a shipped cell's filter; it takes seconds."""
    return read_case("examples/samsung_30q").export("c-filter", precision=precision).content


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_the_test_vectors_pass(precision: str, tmp_path: Path, cc: str) -> None:
    done = vectors_of(text_of(precision), tmp_path, cc)
    assert done.returncode == 0, done.stdout
    allowed = float(re.search(r"allowed (\S+)", done.stdout)[1])
    assert allowed == 1e-12 if precision == "float64" else 2e-5 <= allowed < 1e-3


class Filter:
    """The filter of a case as a library."""

    def __init__(self, folder: Path, cc: str) -> None:
        (folder / "filter.c").write_text(text_of("float64"), encoding="utf-8")
        library = folder / "filter.so"
        command = [cc, *WARNINGS, "-shared", "-fPIC", str(folder / "filter.c"), "-o", str(library), "-lm"]
        subprocess.run(command, check=True)
        self.library = ctypes.CDLL(str(library))
        self.memory, self.estimate = (ctypes.c_double * 90)(), (ctypes.c_double * 8)()

    def call(self, function: str, *numbers: float, tells: bool = True) -> list[float]:
        places = (self.memory, self.estimate) if tells else (self.memory,)
        getattr(self.library, f"samsung_30q_filter_{function}")(*map(ctypes.c_double, numbers), *places)
        return list(self.estimate)


@pytest.mark.parametrize("first_is_missing", [False, True])
def test_a_whole_discharge_is_that_of_the_filter(first_is_missing: bool, tmp_path: Path, cc: str) -> None:
    """From a charge that is far too low, with readings of the voltage that are missing."""
    c = Filter(tmp_path, cc)
    case = read_case("examples/samsung_30q")
    run, start = case.runs[0], 0.2
    columns = run.measured.inputs | run.measured.outputs
    rows = np.stack([columns["current_A"], columns["ambient_degC"], columns["voltage_V"]], axis=1)
    rows[20::7, 2] = np.nan
    rows[0, 2] = np.nan if first_is_missing else rows[0, 2]

    model, tuning = operation.for_estimation(case_model(case)), operation.Tuning()
    measured = operation.Measured(jnp.asarray(run.measured.time_s), *jnp.asarray(rows.T))
    told = jax.jit(ekf)(model, tuning, measured, jnp.asarray(start), jnp.zeros(()))

    c.call("start", start, *rows[0, :2], 0.0, tells=False)
    found = [c.call("first", *rows[0])]
    for duration, row in zip(np.diff(run.measured.time_s), rows[1:], strict=True):
        found.append(c.call("step", duration, *row))
    found = np.array(found)
    np.testing.assert_allclose(found[:, 0], told.soc, atol=1e-9)
    np.testing.assert_allclose(found[:, 1], told.sd, rtol=1e-7)
    np.testing.assert_allclose(found[:, 7], told.current_offset_A, atol=1e-8)
    assert np.isnan(found[20, 2])
    assert found[0, 0] == start if first_is_missing else abs(found[0, 0] - run.initial_soc.value) < 0.02


def test_the_search_finds_what_a_step_does_not(tmp_path: Path, cc: str) -> None:
    """A step linearises the voltage at the wrong charge, where the curve is steep."""
    c, run = Filter(tmp_path, cc), read_case("examples/samsung_30q").runs[0]
    columns = run.measured.inputs | run.measured.outputs
    row = [float(columns[name][0]) for name in ("current_A", "ambient_degC", "voltage_V")]
    errors = {}
    for function, given in (("first", row), ("step", [0.0, *row])):
        c.call("start", 0.02, *row[:2], 0.0, tells=False)
        errors[function] = abs(c.call(function, *given)[0] - run.initial_soc.value)
    assert errors["first"] < 0.02 < 0.1 < errors["step"]


def test_a_tuning_of_an_evaluation_is_used(tmp_path: Path) -> None:
    values = {name: float(value) for name, value in vars(operation.Tuning(voltage_sd_V=0.0375)).items()}
    tuned = {"filter, with temperature": values, "filter, 25 °C assumed": values}
    (tmp_path / "tuning.json").write_text(json.dumps(tuned), encoding="utf-8")
    found = read_case("examples/samsung_30q").export("c-filter", tuning=tmp_path / "tuning.json")
    assert "t_voltage_sd_V = 0.0375;" in found.content
    assert not any("tuning" in sentence for sentence in found.left_out)


def test_what_is_not_of_a_cell_is_refused() -> None:
    with pytest.raises(ParameterError, match="not of a cell"):
        made_up("motor").export("c-filter")
