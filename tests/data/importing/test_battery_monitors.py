"""A battery monitor's log has a column for each cell: their mean is a cell, and their sum is the pack."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log, stamps

OFFSETS_V = np.array([0.004, -0.003, 0.0, -0.001])


def monitor(log: pd.DataFrame, cell: str, scale: float, pack: bool = True, spare: bool = False) -> str:
    """A log of a battery monitor: stamps, a current positive on charge, a voltage of each cell."""
    cells = {cell.format(n): scale * (log.voltage_V + by) for n, by in enumerate(OFFSETS_V, start=1)}
    empty = {cell.format(n): 0.0 for n in (5, 6)} if spare else {}
    total = {"Total Voltage(V)": 4.0 * log.voltage_V + OFFSETS_V.sum()} if pack else {}
    columns = {
        "Time": stamps(log, "%Y-%m-%d %H:%M:%S"),
        **total,
        "Current(A)": -log.current_A,
        "SOC(%)": 50,
        **cells,
        **empty,
        "MOS Temp(C)": 55.0,
        "Temp1(C)": log.temperature_degC,
    }
    return pd.DataFrame(columns).to_csv(index=False)


@pytest.mark.parametrize(
    ("cell", "scale", "pack", "spare"),
    [("Cell{}(mV)", 1000.0, True, False), ("cell_voltage_{}", 1.0, False, False), ("Cell {:02d} (V)", 1.0, True, True)],
)
def test_a_cell_is_the_mean_of_those_that_are_there(tmp_path: Path, cell: str, scale: float, pack: bool, spare: bool):
    path, log = tmp_path / "pack.csv", cell_log()
    path.write_text(monitor(log, cell, scale, pack, spare))
    imported = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0)
    columns = imported.runs[0].log.columns
    np.testing.assert_allclose(columns["voltage_V"], log.voltage_V, atol=1e-9)
    np.testing.assert_allclose(columns["current_A"], log.current_A)
    np.testing.assert_allclose(columns["cell_temperature_degC"], log.temperature_degC)
    (found,) = [one for one in imported.findings if one.what == "single cells"]
    assert "mean of the 4 columns" in found.sentence
    assert "differ by 7 mV (median)" in found.sentence
    assert f"'{cell.format(2)}' is the lowest" in found.sentence


def test_a_user_may_name_the_pack_or_one_cell(tmp_path: Path):
    path, log = tmp_path / "pack.csv", cell_log()
    path.write_text(monitor(log, "Cell{}(mV)", 1000.0))
    whole = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0, cells_in_series=4)
    np.testing.assert_allclose(whole.runs[0].log.columns["voltage_V"], log.voltage_V + OFFSETS_V.mean())
    one = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0, columns={"voltage_V": "Cell2(mV)"})
    np.testing.assert_allclose(one.runs[0].log.columns["voltage_V"], log.voltage_V + OFFSETS_V[1])


def test_a_robots_pack_is_the_sum_of_its_cells(tmp_path: Path):
    path, log = tmp_path / "pack.csv", cell_log()
    path.write_text(monitor(log, "Cell{}(mV)", 1000.0, pack=False))
    imported = import_case(path, "robot", ambient=25.0, constants={"duty": 0.5, "incline_deg": 0.0})
    columns = imported.runs[0].log.columns
    np.testing.assert_allclose(columns["pack_voltage_V"], 4.0 * log.voltage_V, atol=1e-9)
    # Its one current is that of the pack, and of no motor.
    assert "motor_current_A" not in columns
    np.testing.assert_allclose(columns["pack_current_A"], -log.current_A)


def test_a_robots_pack_current_that_charges_on_the_whole_is_doubted(tmp_path: Path):
    """A monitor counts discharge as negative; which sign it writes is for the user to say."""
    path, log = tmp_path / "pack.csv", cell_log()
    log = log[: int(np.argmax(log.current_A < 0.0))]
    path.write_text(monitor(log, "Cell{}(mV)", 1000.0))
    driven = {"ambient": 25.0, "constants": {"duty": 0.5, "incline_deg": 0.0}}
    (doubt,) = [one for one in import_case(path, "robot", **driven).findings if one.what == "sign"]
    assert "pack_current_A is negative on the whole" in doubt.sentence
    flipped = import_case(path, "robot", **driven, flip=("pack_current_A",))
    np.testing.assert_allclose(flipped.runs[0].log.columns["pack_current_A"], log.current_A)


def test_a_column_of_stamps_is_a_clock_whatever_it_is_called(tmp_path: Path):
    """Victron's portal exports devices, quantities and units in three lines, and calls its clock by the time zone."""
    path, log = tmp_path / "vrm.csv", cell_log()
    lines = ['"timestamp","Gateway [0]","Battery Monitor [512]","Battery Monitor [512]","Battery Monitor [512]"']
    lines += [
        '"Europe/Amsterdam (+02:00)","Relay 1 state","Voltage","Current","Battery temperature"',
        '"","","V","A","°C"',
    ]
    for stamp, row in zip(stamps(log, "%Y-%m-%d %H:%M:%S"), log.itertuples(), strict=True):
        lines.append(f'"{stamp}","Open","{row.voltage_V}","{-row.current_A}","{row.temperature_degC}"')
    path.write_text("\n".join(lines))
    imported = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0)
    run = imported.runs[0].log
    np.testing.assert_allclose(run.time_s, log.time_s)
    np.testing.assert_allclose(run.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.columns["cell_temperature_degC"], log.temperature_degC)
    assert any("the readings of 'Europe/Amsterdam (+02:00)' look like it" in one.sentence for one in imported.findings)


def test_each_cell_may_be_a_run_of_its_own(tmp_path: Path):
    path, log = tmp_path / "pack.csv", cell_log()
    path.write_text(monitor(log, "Cell{}(mV)", 1000.0, spare=True))
    imported = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0, each_cell=True)
    assert [(run.log.name, run.log.specimen) for run in imported.runs] == [
        (f"pack_cell{n}", f"cell{n}") for n in (1, 2, 3, 4)
    ]
    for run, off in zip(imported.runs, OFFSETS_V, strict=True):
        np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V + off)
        np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)
    assert list(imported.case.specimens) == ["cell1", "cell2", "cell3", "cell4"]


@pytest.mark.parametrize(
    ("kind", "given", "words"),
    [
        ("cell", {}, "no columns hold voltages of single cells"),
        ("cell", {"cells_in_series": 4}, "remove --each-cell or --cells-in-series"),
        ("motor", {}, "cells are parted with --kind cell"),
    ],
)
def test_cells_that_are_not_there_are_refused(tmp_path: Path, kind: str, given: dict, words: str):
    path, log = tmp_path / "one.csv", cell_log()
    log.to_csv(path, index=False)
    with pytest.raises(MeasurementError, match=words):
        import_case(path, kind, ambient=25.0, each_cell=True, **given)
