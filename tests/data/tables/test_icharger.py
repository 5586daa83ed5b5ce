"""Lines of an iCharger have no names; their places are known, and what they do not hold is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

CELLS = 4
OFFSETS_MV = np.array([2, -2, 1, -1])


def rounded(values: pd.Series) -> pd.Series:
    return values.round().astype(int)


def of_card(log: pd.DataFrame, channel: int = 1, warm: bool = True, cells: bool = True) -> list[str]:
    """Lines of a memory card: ms, 10 mA positive on charge, mV, 0.1 degC; ten cells and a check sum."""
    lines = []
    for n, row in enumerate(log.itertuples()):
        millivolts = round(1000 * row.voltage_V)
        single = [*(millivolts + OFFSETS_MV), *[0] * 6] if cells else [0] * 10
        heat = round(10 * row.temperature_degC) if warm else 0
        mode = 1 if row.current_A < 0 else 2
        head = [mode, round(1000 * row.time_s), 1, 0, round(-100 * row.current_A), 24_310, CELLS * millivolts]
        lines.append(f"${channel};" + ";".join(map(str, [*head, -n, 391, heat, *single, n % 64])))
    return lines


def of_port(log: pd.DataFrame) -> list[str]:
    """Lines of the serial port of a charger for six cells: no clock, magnitudes of the current."""
    lines = []
    for n, row in enumerate(log.itertuples()):
        millivolts = round(1000 * row.voltage_V)
        readings = [12_010, CELLS * millivolts, abs(round(100 * row.current_A)), *[millivolts] * CELLS, 0, 0]
        lines.append(f"$1;{1 if row.current_A < 0 else 2};;" + ";".join(map(str, [*readings, 328, 0, n, n % 64])))
    return lines


def write(folder: Path, lines: list[str]) -> Path:
    path = folder / "LiPo[Cycle_12_CH1].txt"
    path.write_text("\n".join(lines) + "\n", encoding="latin-1")
    return path


def test_a_log_of_the_memory_card_is_a_case(tmp_path: Path):
    log = cell_log()
    head = ["@Model:4010DUO; Fireware:V2.20; SN:0 \0\0\0"]
    path = write(tmp_path, [*head, *of_card(log), "$1;128;9000000;543;0;0;0;0;0;0;0;0;0;0;0;45"])
    imported = import_case(path, "cell", ambient=25.0)
    (run,) = imported.runs
    np.testing.assert_allclose(run.log.time_s, log.time_s)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V, atol=1e-3)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"], log.temperature_degC, atol=0.06)
    assert any("1 of 1,023 lines hold no readings" in one.sentence for one in imported.findings)


def test_without_single_cells_the_battery_counts(tmp_path: Path):
    log = cell_log()
    path = write(tmp_path, of_card(log, warm=False, cells=False))
    with pytest.raises(MeasurementError, match="--cells-in-series 4"):
        import_case(path, "cell", ambient=25.0)
    (run,) = import_case(path, "cell", ambient=25.0, cells_in_series=CELLS).runs
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V, atol=1e-3)
    assert "cell_temperature_degC" not in run.log.columns


def test_each_channel_is_a_run(tmp_path: Path):
    log = cell_log()
    both = [line for pair in zip(of_card(log), of_card(log[100:], channel=2), strict=False) for line in pair]
    names = [run.log.name for run in import_case(write(tmp_path, both), "cell", ambient=25.0).runs]
    assert names == ["LiPo[Cycle_12_CH1]-channel1", "LiPo[Cycle_12_CH1]-channel2"]


def test_the_serial_port_has_no_clock_and_a_state_for_its_sign(tmp_path: Path):
    log = cell_log()
    path = write(tmp_path, of_port(log))
    with pytest.raises(MeasurementError, match=r"no column of time.*--seconds-per-row"):
        import_case(path, "cell", ambient=25.0)
    (run,) = import_case(path, "cell", ambient=25.0, seconds_per_row=10.0).runs
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V, atol=1e-3)


def test_other_lines_that_begin_with_a_dollar_are_a_table(tmp_path: Path):
    path = tmp_path / "weather.txt"
    path.write_text("\n".join(f"$1;1;{n};138;227;226;178;222;212;229;59;35;38;49;38;40" for n in range(40)))
    assert read_table(path).format == "text"
