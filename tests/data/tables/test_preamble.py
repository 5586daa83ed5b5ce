"""A table without times has the clock that the lines above it state."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel import read_table
from jaxmodel.data.tables.preamble import interval_of

ROWS = 50
CLOCK_S = 0.02 * np.arange(ROWS)
VOLTS = np.linspace(4.1, 3.9, ROWS)
AMPS = np.where(np.arange(ROWS) > 9, 2.0, 0.0)
PAIRS = [f"{volts:.4f},{amps:.2f}" for volts, amps in zip(VOLTS, AMPS, strict=True)]


@pytest.mark.parametrize(
    ("head", "row", "volts"),
    [
        (["Sampling interval: 20 ms", "", "Voltage[V],Current[A]"], "{pair}", "Voltage[V]"),
        (["Sample Rate,50,Hz", "Start,2026/01/01,00:30:00", "Voltage[V],Current[A]"], "{pair}", "Voltage[V]"),
        (["X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-1.0e-01,2.0e-02,"], "{n},{pair},,,", "CH1"),
        (['"HResolution",0.02,0.02', '"HUnit","s","s"', '"Time","00:30:00"', ""], ",{pair}", "column 2"),
    ],
    ids=["interval", "rate", "increment in the header", "names in the head"],
)
def test_the_clock_of_the_head(tmp_path: Path, head: list[str], row: str, volts: str):
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*head, *(row.format(n=n, pair=pair) for n, pair in enumerate(PAIRS))]))
    table = read_table(path)
    np.testing.assert_allclose(table.frame["Time (s)"], CLOCK_S)
    np.testing.assert_allclose(table.frame[volts], VOLTS, atol=1e-4)
    assert any("0.02 s from row to row" in remark for remark in table.remarks)


@pytest.mark.parametrize(
    "names", ["Time (s),U,I", "Source,CH1,CH2\nSecond,Volt,Ampere", ""], ids=["named", "unit", "looks"]
)
def test_a_column_of_times_comes_before_the_head(tmp_path: Path, names: str):
    path = tmp_path / "log.csv"
    rows = [f"{time:.3f},{pair}" for time, pair in zip(CLOCK_S, PAIRS, strict=True)]
    path.write_text("\n".join(["Sample Interval,0.02", names, *rows]))
    table = read_table(path)
    assert len(table.frame.columns) == 3
    np.testing.assert_allclose(table.frame.iloc[:, 0], CLOCK_S)


@pytest.mark.parametrize(
    ("line", "seconds"),
    [("Abtastrate: 2 kHz", 5e-4), ("Log interval; 1 min", 60.0), ("dt = 0,1", 0.1), ("Scan rate: 5 mV/s", None)],
)
def test_intervals_as_people_write_them(line: str, seconds: float | None):
    assert interval_of([line], (), ()) == (None if seconds is None else pytest.approx(seconds))
