"""Text of LabVIEW is the table that was measured, in each of the forms that its writer has."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log
from tests.data.tables.made_logs import LVM_CURRENT, LVM_TIME_S, LVM_VOLTAGE, lvm


@pytest.mark.parametrize(
    ("x_columns", "separator", "decimal", "segments"),
    [("One", "\t", ".", 1), ("No", "\t", ",", 1), ("Multi", "\t", ".", 1), ("One", ",", ".", 3), ("No", "\t", ".", 2)],
)
def test_every_form_holds_the_same_table(tmp_path: Path, x_columns: str, separator: str, decimal: str, segments: int):
    path = tmp_path / "bench.lvm"
    path.write_text(lvm(x_columns, separator, decimal, segments))
    table = read_table(path)
    assert list(table.frame) == ["Time (s)", "Voltage", "Current"]
    assert dict(table.units) == {"Time (s)": "s", "Voltage": "Volts", "Current": "Amps"}
    np.testing.assert_allclose(
        table.frame.to_numpy(), np.column_stack([LVM_TIME_S, LVM_VOLTAGE, LVM_CURRENT]), atol=1e-9
    )
    assert table.losses == ()


def test_a_channel_with_a_clock_of_its_own_is_read_at_the_times_of_the_other(tmp_path: Path):
    """A thermometer of a slower clock is interpolated: its ramp stays a ramp."""
    rows = [
        f"{t:.3f}\t{u:.6f}\t{4.0 * t:.3f}\t{20.0 + 4.0 * t:.3f}" for t, u in zip(LVM_TIME_S, LVM_VOLTAGE, strict=True)
    ]
    head = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\n\n"
    head += "Channels\t2\n***End_of_Header***\n"
    path = tmp_path / "bench.lvm"
    path.write_text(head + "X_Value\tVoltage\tX_Value\tTemperature\tComment\n" + "\n".join(rows))
    frame = read_table(path).frame
    np.testing.assert_allclose(frame["Voltage"], LVM_VOLTAGE, atol=1e-6)
    inside = LVM_TIME_S >= 4.0 * LVM_TIME_S[0]
    np.testing.assert_allclose(frame["Temperature"][inside], 20.0 + LVM_TIME_S[inside], atol=1e-9)
    assert np.isnan(frame["Temperature"][~inside]).all()


def test_a_cell_measured_by_labview_is_a_case(tmp_path: Path):
    log = cell_log()
    lines = ["LabVIEW Measurement", "Separator\tTab", "X_Columns\tNo", "***End_of_Header***", "", "Channels\t2"]
    lines += ["X0\t0.0\t0.0", "Delta_X\t10.0\t10.0", "***End_of_Header***", "X_Value\tVoltage\tCurrent\tComment"]
    lines += [f"\t{row.voltage_V}\t{row.current_A}" for row in log.itertuples()]
    path = tmp_path / "bench.lvm"
    path.write_text("\n".join(lines))
    (run,) = import_case(path, "cell", ambient=25.0).runs
    np.testing.assert_allclose(run.log.time_s, log.time_s)
    np.testing.assert_allclose(run.log.columns["voltage_V"], log.voltage_V)


def test_a_header_without_rows_is_said(tmp_path: Path):
    path = tmp_path / "bench.lvm"
    path.write_text(
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\t\nChannels\t2\n***End_of_Header***\n"
    )
    with pytest.raises(
        MeasurementError, match="header of LabVIEW and no rows of readings; export the measurement again"
    ):
        read_table(path)


@pytest.mark.parametrize("described", [True, False])
def test_readings_without_names_are_named_by_the_description(tmp_path: Path, described: bool):
    head = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t.", "X_Columns\tOne"]
    head += ["Description\tClolumns are: time, Current, and Voltage"] if described else []
    rows = [f"{t:.3f}\t{i:.4f}\t{u:.6f}" for t, i, u in zip(LVM_TIME_S, LVM_CURRENT, LVM_VOLTAGE, strict=True)]
    path = tmp_path / "bench.txt"
    path.write_text("\n".join([*head, "***End_of_Header***\t", "\t", *rows]))
    frame = read_table(path).frame
    assert list(frame) == (["time", "Current", "Voltage"] if described else ["column 1", "column 2", "column 3"])
    np.testing.assert_allclose(frame.iloc[:, 2], LVM_VOLTAGE, atol=1e-6)
    assert len(frame) == LVM_TIME_S.size, "the first row is one of readings"
