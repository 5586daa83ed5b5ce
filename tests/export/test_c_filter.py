"""The filter of the state of charge as C: what a compiler makes of it does what the filter does."""

from __future__ import annotations

import ctypes
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
from jaxmodel.operation.kalman import before_first_reading, corrected_step
from tests.export.test_c_model import WARNINGS, made_up, vectors_of

NAME = "samsung_30q"


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_the_test_vectors_pass(precision: str, tmp_path: Path, cc: str) -> None:
    text = read_case("examples/samsung_30q").export("c-filter", precision=precision).content
    done = vectors_of(text, tmp_path, cc)
    assert done.returncode == 0, done.stdout
    allowed = float(re.search(r"allowed (\S+)", done.stdout)[1])
    assert allowed == 1e-12 if precision == "float64" else 2e-5 <= allowed < 1e-3


def test_a_whole_discharge_is_that_of_the_filter(tmp_path: Path, cc: str) -> None:
    """From a charge that is 0.2 too low, and with readings of the voltage that are missing."""
    case = read_case("examples/samsung_30q")
    case.export("c-filter", tmp_path / "filter.c")
    library = tmp_path / "filter.so"
    subprocess.run(
        [cc, *WARNINGS, "-shared", "-fPIC", str(tmp_path / "filter.c"), "-o", str(library), "-lm"], check=True
    )
    c = ctypes.CDLL(str(library))
    run, start = case.runs[0], case.runs[0].initial_soc.value - 0.2
    columns = run.measured.inputs | run.measured.outputs
    known = np.zeros(run.measured.time_s.size)
    rows = np.stack([columns["current_A"], columns["ambient_degC"], columns["voltage_V"], known], axis=1)
    rows[20::7, 2] = np.nan
    durations = np.diff(run.measured.time_s, prepend=run.measured.time_s[0])

    model, tuning = operation.for_estimation(case_model(case)), operation.Tuning()
    first = tuple(jnp.asarray(rows[0]))
    carried = before_first_reading(model, tuning, first, jnp.asarray(start), jnp.zeros(()))

    def advance(carried: tuple, given: tuple) -> tuple:
        return corrected_step(model, tuning, *carried, given[0], tuple(given[1]))

    _, told = jax.jit(lambda begin: jax.lax.scan(advance, begin, (jnp.asarray(durations), jnp.asarray(rows))))(carried)

    memory, estimate = (ctypes.c_double * 90)(), (ctypes.c_double * 8)()
    double = ctypes.c_double
    c.samsung_30q_filter_start(double(start), double(rows[0, 0]), double(rows[0, 1]), double(0.0), memory)
    found = []
    for duration, row in zip(durations, rows, strict=True):
        c.samsung_30q_filter_step(double(duration), *map(double, row[:3]), memory, estimate)
        found.append(list(estimate))
    found = np.array(found)
    np.testing.assert_allclose(found[:, 0], told[0], atol=1e-9)
    np.testing.assert_allclose(found[:, 1], told[1], rtol=1e-7)
    np.testing.assert_allclose(found[:, 7], told[8], atol=1e-8)
    assert abs(found[0, 0] - start) > 0.1  # the first reading corrects it
    assert np.isnan(found[20, 2])


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
