"""Cells that a cycler charges and discharges without a rest, of any size, keep their capacity and their start."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.case.presets import read_preset
from jaxmodel.data.importing import import_case

STEP_S = 60.0


def cycled(capacity_Ah: float, cycles: int = 2) -> pd.DataFrame:
    """A cell at rest near empty, then charged to 4.3 V and discharged to 3.0 V at C/5 in turn; 5 ohm A h."""
    current = capacity_Ah / 5.0
    half = int(0.94 * 5.0 * 3600.0 / STEP_S)
    amperes = np.concatenate([np.zeros(10), np.tile(np.repeat([-current, current], half), cycles), np.zeros(5)])
    soc = 0.05 - np.cumsum(amperes) * STEP_S / 3600.0 / capacity_Ah
    voltage = 3.0 + 1.2 * soc - 0.03 / capacity_Ah * amperes
    noise = np.random.default_rng(3).normal(0.0, 2e-4, amperes.size)
    return pd.DataFrame(
        {"time_s": np.arange(amperes.size) * STEP_S, "current_A": amperes, "voltage_V": np.round(voltage + noise, 4)}
    )


@pytest.mark.parametrize("capacity_Ah", [5.0, 2e-3, 3e-5])
def test_a_full_cell_is_the_end_of_a_charge_where_none_rests(tmp_path: Path, capacity_Ah: float):
    path = tmp_path / "cycled.csv"
    cycled(capacity_Ah).to_csv(path, index=False)
    imported = import_case(path, "cell", ambient=25.0)
    assert imported.case.parameters["capacity_Ah"].value == pytest.approx(0.94 * capacity_Ah, rel=0.02)
    (run,) = imported.case.runs
    assert run.initial_soc.value == pytest.approx(0.0, abs=0.03)
    assert run.initial_soc.sd is not None
    assert run.initial_soc.sd > 0.01


def partly_drawn(capacity_Ah: float = 3.0) -> pd.DataFrame:
    """A full cell of which half is drawn in steps with dips: it never comes near a cut-off."""
    amperes = np.concatenate([np.zeros(20), np.tile(np.repeat([0.5, 3.0, 0.0], 10), 3)])
    soc = 1.0 - np.cumsum(amperes) * STEP_S / 3600.0 / capacity_Ah
    voltage = np.round(3.0 + 1.2 * soc - 0.03 * amperes, 4)
    return pd.DataFrame({"time_s": np.arange(amperes.size) * STEP_S, "current_A": amperes, "voltage_V": voltage})


def test_the_lowest_voltage_of_a_log_is_no_cut_off_above_what_makers_state(tmp_path: Path):
    path = tmp_path / "drive.csv"
    partly_drawn().to_csv(path, index=False)
    assumed = import_case(path, "cell", ambient=25.0)
    assert "assumed" in str(assumed.capacity)
    assert any(one.what == "capacity" for one in assumed.findings)


def test_a_capacity_that_files_do_not_give_is_that_of_the_preset(tmp_path: Path):
    path = tmp_path / "drive.csv"
    partly_drawn().to_csv(path, index=False)
    imported = import_case(path, "cell", ambient=25.0, preset="samsung_30q")
    of_preset = read_preset("samsung_30q").parameters["capacity_Ah"].value
    assert imported.case.parameters["capacity_Ah"].value == of_preset
    assert imported.capacity is not None
    assert "samsung_30q" in imported.capacity.why
    assert not any(one.what == "capacity" for one in imported.findings)
