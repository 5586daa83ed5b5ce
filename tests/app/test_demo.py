"""The demo from end to end on a small sweep: one page that needs nothing else, and the numbers that it prints."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import xarray as xr

from jaxmodel.app.commands import demo as demo_command
from jaxmodel.diagnosis.result import Diagnosis
from tests.app.conftest import Run

STUDY = """
kind = "robot"
metrics = ["soc_gradient", "final_soc", "min_pack_voltage_V", "valid_share"]
[profile]
duration_s = 60
step_s = 10
duty = 0.3
[axes]
ambient_degC = [-20, 20]
load_torque_Nm = [0.175, 0.3]
storage_months = [0, 18]
cycles = [0, 25]
"""


def test_demo_ends_with_one_page(
    run: Run, made_case: Path, diagnosis: Diagnosis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sweep and sensitivities are real here; the diagnosis, which has tests of its own, is made up."""
    (tmp_path / "paper_sweep.toml").write_text(STUDY, encoding="utf-8")
    monkeypatch.setattr(demo_command, "EXAMPLES", tmp_path)
    monkeypatch.setattr(demo_command, "_STORED_EVERY_ROWS", 2)
    monkeypatch.setattr(demo_command, "diagnose", lambda case, **_: diagnosis)
    out = tmp_path / "out"
    result = run("demo", "--case", made_case, "--out", out)
    assert result.exit_code == 0, result.output
    page = (out / "index.html").read_text(encoding="utf-8")
    addresses = re.findall(r'\b(?:src|href)="([^"]{0,40})', page)
    # Of sweep and sensitivities, of the diagnosis and the pulses of one run, and of each run.
    assert len(addresses) == 7 + 6 + len(diagnosis.case.runs)
    assert all(address.startswith("data:image/png;base64,") for address in addresses)

    swept = xr.open_zarr(out / "sweep" / "result.zarr", consolidated=False)
    at_point = swept.sel(ambient_degC=20, load_torque_Nm=0.175, storage_months=18, cycles=25)
    gradient = float(at_point["soc_gradient"])
    assert gradient == pytest.approx(-2.0e-4, rel=0.05)  # the paper's Table 2
    for said in (
        "Swept: 16 lanes at",
        f"{1e4 * gradient:.2f}e-4 per second; the paper's Table 2 has -2.00e-4",
        "Largest elasticity of the discharge: -1.00 by capacity_Ah",
        "self_heating (0.97) and arrhenius_resistance (0.81)",
    ):
        assert said in result.stdout
    errors = diagnosis.base.errors["cell_temperature_degC"], diagnosis.final.errors["cell_temperature_degC"]
    assert f"cell temperature {errors[0].check:.3g} → {errors[1].check:.3g} K" in result.stdout
