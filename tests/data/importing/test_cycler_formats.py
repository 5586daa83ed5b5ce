"""A cell's log comes out of every cycler's export as it went in, positive on discharge and in the units of a case."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel import read_case
from jaxmodel.data.importing import import_case
from tests.data.importing.benches import CAPACITY_AH, FORMATS, cell_log


def write(folder: Path, name: str, log) -> Path:
    content = FORMATS[name](log)
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize("name", FORMATS)
def test_a_cyclers_export_gives_back_the_log(tmp_path: Path, name: str):
    log = cell_log()
    imported = import_case(write(tmp_path, name, log), "cell", ambient=25.0)
    (run,) = imported.runs
    found = run.log
    np.testing.assert_allclose(found.columns["current_A"], log.current_A, atol=1e-9)
    np.testing.assert_allclose(found.columns["voltage_V"], log.voltage_V, atol=1e-9)
    np.testing.assert_allclose(found.columns["cell_temperature_degC"], log.temperature_degC, atol=1e-9)
    # The layered report has the time of each step only: a step begins when the one before has ended.
    within = 10.0 * log.step.nunique() if name == "neware_layered.csv" else 1e-6
    np.testing.assert_allclose(found.time_s, log.time_s, atol=within)
    assert np.all(np.diff(found.time_s) > 0.0)


@pytest.mark.parametrize("name", FORMATS)
def test_capacity_and_start_are_counted_whatever_the_format(tmp_path: Path, name: str):
    imported = import_case(write(tmp_path, name, cell_log()), "cell", ambient=25.0)
    assert imported.capacity is not None
    emptied = 2 * 60 * 6.0 / 3600.0 + 3500 * 2.9 / 3600.0
    assert imported.capacity.value == pytest.approx(emptied, rel=0.02)
    assert abs(imported.capacity.value - CAPACITY_AH) < 3.0 * (imported.capacity.sd or 0.0)
    assert imported.runs[0].start is not None
    assert imported.runs[0].start.value == pytest.approx(1.0, abs=0.05)


def test_an_imported_case_is_read_again_with_every_reading(tmp_path: Path):
    log = cell_log()
    files = [write(tmp_path, name, log) for name in ("arbin.csv", "neware.csv")]
    imported = import_case(files, "cell", ambient=25.0, out=tmp_path / "case")
    case = read_case(tmp_path / "case")
    assert [run.name for run in case.runs] == ["arbin", "neware"]
    for run, other in zip(case.runs, imported.runs, strict=True):
        np.testing.assert_array_equal(run.measured.time_s, other.log.time_s)
        np.testing.assert_array_equal(run.measured.inputs["current_A"], other.log.columns["current_A"])
        np.testing.assert_array_equal(run.measured.outputs["voltage_V"], other.log.columns["voltage_V"])
    text = (tmp_path / "case" / "case.toml").read_text()
    assert "positive on charge in the files, reversed" in text
    assert (tmp_path / "case" / "import.json").is_file()
