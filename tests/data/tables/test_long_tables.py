"""A log with one reading per line is the table of its signals, whatever its columns are called."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log, stamps

HEADS = {
    "bus": ("timestamp,can_id,signal,value,unit", ",", "."),
    "historian": ("Zeit;Kanal;Wert;Einheit", ";", ","),
    "database": (",result,table,_time,_value,_field", ",", "."),
}


def one_per_line(log: pd.DataFrame, form: str) -> str:
    """The readings of a log one below the other: current and voltage in each row, the temperature in each third."""
    head, delimiter, decimal = HEADS[form]
    dates = stamps(log, "%Y-%m-%dT%H:%M:%SZ")
    lines = [head]
    for n, row in enumerate(log.itertuples()):
        readings = [("pack_current", row.current_A, "A"), ("pack_voltage", row.voltage_V, "V")]
        for name, value, unit in [*readings, *([("cell_temp", row.temperature_degC, "degC")] if n % 3 == 0 else [])]:
            time = f"{row.time_s:.1f}"
            fields = {
                "bus": [time, "0x355", name, str(value), unit],
                "historian": [time, name, str(value), unit],
                "database": ["", "_result", "0", dates[n], str(value), name],
            }[form]
            lines.append(delimiter.join(field.replace(".", decimal) for field in fields))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("form", HEADS)
def test_one_reading_per_line_is_a_case(tmp_path: Path, form: str):
    path, log = tmp_path / "log.csv", cell_log()
    path.write_text(one_per_line(log, form))
    (run,) = import_case(path, "cell", ambient=25.0, capacity_Ah=3.0).runs
    np.testing.assert_allclose(run.log.time_s, log.time_s, atol=1e-6)
    np.testing.assert_allclose(run.log.columns["current_A"], log.current_A)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V)
    third = slice(None, None, 3)
    np.testing.assert_allclose(run.log.columns["cell_temperature_degC"][third], log.temperature_degC[third])


def test_readings_that_are_words_are_left_out_and_counted(tmp_path: Path):
    path = tmp_path / "history.csv"
    readings = [
        ("sensor.current", 1.5),
        ("sensor.voltage", 3.7),
        ("sensor.mode", "on"),
        ("sensor.current", "unavailable"),
    ]
    lines = [f"{name},{value},2026-01-01T00:00:{n:02d}.500Z" for n in range(20) for name, value in readings]
    path.write_text("entity_id,state,last_changed\n" + "\n".join(lines))
    table = read_table(path)
    assert [*table.frame] == ["Time (s)", "sensor.current", "sensor.voltage"]
    np.testing.assert_allclose(np.diff(table.frame["Time (s)"]), 1.0)
    assert table.losses == ("40 of 80 lines have no number or no time and were left out.",)


def test_a_log_that_is_sorted_by_signal(tmp_path: Path):
    path = tmp_path / "sorted.csv"
    lines = [f"{name},{scale * n},{n}.0" for name, scale in (("current", 1.0), ("voltage", 0.01)) for n in range(1000)]
    path.write_text("name,value,time\n" + "\n".join(lines))
    table = read_table(path).frame
    np.testing.assert_allclose(table["voltage"], 0.01 * table["current"])


def test_a_log_of_changes_holds_a_reading_until_the_next(tmp_path: Path):
    path = tmp_path / "changes.csv"
    times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 500.0, 501.0, 502.0]
    current = [f"{time},current,{n}" for n, time in enumerate(times)]
    path.write_text(
        "time,signal,value\n" + "\n".join([*current, "0,voltage,4.0", "4.5,voltage,3.9", "400,voltage,3.5"])
    )
    table = read_table(path)
    np.testing.assert_array_equal(table.frame["voltage"], [4.0] * 5 + [3.9] + [3.5] * 3)
    assert any("held" in remark for remark in table.remarks)


def test_a_table_with_a_column_of_names_stays_a_table(tmp_path: Path):
    """A cycler names its channel and state in each row; current and voltage have columns of their own."""
    path = tmp_path / "wide.csv"
    rows = [f"{n},{'ab'[n % 2]},{n % 3},{0.1 * n},{4.0 - 0.01 * n}" for n in range(30)]
    path.write_text("time,channel,state,current,voltage\n" + "\n".join(rows))
    assert [*read_table(path).frame] == ["time", "channel", "state", "current", "voltage"]


def test_a_list_without_times_gets_one_sentence(tmp_path: Path):
    path = tmp_path / "log.csv"
    path.write_text("time,signal,value\n" + "\n".join(f"soon,{'ab'[n % 2]},{n}" for n in range(20)))
    with pytest.raises(MeasurementError, match=r"column 'time' holds no times; export the readings with their times\."):
        read_table(path)
