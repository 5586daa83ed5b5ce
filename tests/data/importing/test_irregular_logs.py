"""Logs that are written where something changes: long intervals in them are no gaps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel.data.importing import Imported, import_case


def drive(seed: int, hours: float = 1.0) -> pd.DataFrame:
    """A cell of 2 A h in a vehicle: stretches of one current each, between 2 s and 3 min, in rows of 0.5 s."""
    random = np.random.default_rng(seed)
    rows = int(hours * 7200)
    lengths = np.exp(random.uniform(np.log(4), np.log(360), size=rows // 20)).astype(int)
    current = np.repeat(random.choice([0.0, 0.5, 1.0, 3.0, -0.5], size=lengths.size), lengths)[:rows]
    taken = np.cumsum(current) * 0.5 / 3600.0
    voltage = np.round(4.15 - 0.5 * taken - 0.04 * current + 0.001 * random.standard_normal(rows), 3)
    return pd.DataFrame({"time_s": 0.5 * np.arange(rows), "current_A": current, "voltage_V": voltage})


def where_it_changes(log: pd.DataFrame) -> pd.DataFrame:
    """The rows that a logger writes: for 2 s after a change of the current, and where the voltage moved by 10 mV."""
    kept, last, since = [], np.inf, 0
    for row, (current, voltage) in enumerate(zip(log.current_A, log.voltage_V, strict=True)):
        changed = row == 0 or current != log.current_A[row - 1]
        since = 0 if changed else since + 1
        if since < 4 or abs(voltage - last) > 0.01:
            kept.append(row)
            last = voltage
    return log.iloc[kept].reset_index(drop=True)


def imported(folder: Path, log: pd.DataFrame) -> Imported:
    log.to_csv(folder / "ride.csv", index=False)
    return import_case(
        folder / "ride.csv", "cell", ambient=22.0, capacity_Ah=2.0, sign="discharge-positive", progress=False
    )


@pytest.mark.parametrize("seed", range(4))
def test_a_log_that_is_written_where_something_changes_is_one_run(tmp_path: Path, seed: int):
    log = where_it_changes(drive(seed))
    assert np.diff(log.time_s).max() > 60.0
    one = imported(tmp_path, log)
    assert [run.log.rows for run in one.runs] == [len(log)]


def test_a_pause_far_longer_than_all_others_is_a_gap(tmp_path: Path):
    log = where_it_changes(drive(5))
    half = len(log) // 2
    row = next(row for row in range(half, len(log)) if log.current_A[row] > 0.0 and log.current_A[row - 1] > 0.0)
    late = log.assign(time_s=log.time_s + 7200.0 * (log.index >= row))
    one = imported(tmp_path, late)
    assert [run.log.rows for run in one.runs] == [row, len(log) - row]
