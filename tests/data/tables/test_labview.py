"""Text of LabVIEW is the table that was measured, in each of the forms that its writer has."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from jaxmodel import import_case, read_table
from jaxmodel.base.errors import MeasurementError
from tests.data.importing.benches import cell_log

ROWS = 60
TIME_S = 0.5 + 0.25 * np.arange(ROWS)
VOLTAGE = np.linspace(4.1, 3.2, ROWS)
CURRENT = np.linspace(0.0, 2.0, ROWS)


def lvm(x_columns: str, separator: str = "\t", decimal: str = ".", segments: int = 1, units: bool = True) -> str:
    """A measurement as 'Write To Measurement File' writes it."""

    def line(*fields: object) -> str:
        return separator.join(str(field).replace(".", decimal) for field in fields)

    def segment(rows: Sequence[int]) -> list[str]:
        between = [""] if x_columns == "Multi" else []
        x_names = ["Voltage", *(["X_Value"] if x_columns == "Multi" else []), "Current"]
        lines = [
            line("Channels", 2, "", ""),
            line("Samples", len(rows), len(rows), ""),
            line("Date", "2024/07/22", "2024/07/22", ""),
            *([line("Y_Unit_Label", "Volts", *between, "Amps", "")] if units else []),
            line("X_Dimension", "Time", *between, "Time", ""),
            line("X0", TIME_S[rows[0]], *between, TIME_S[rows[0]], ""),
            line("Delta_X", 0.25, *between, 0.25, ""),
            "***End_of_Header***" + separator,
            line("X_Value", *x_names, "Comment"),
        ]
        for n in rows:
            voltage, current = f"{VOLTAGE[n]:.9f}", f"{CURRENT[n]:.9f}"
            times = "" if x_columns == "No" else TIME_S[n]
            lines.append(
                line(times, voltage, times, current) if x_columns == "Multi" else line(times, voltage, current)
            )
        return [*lines, ""]

    head = [
        "LabVIEW Measurement" + separator,
        line("Writer_Version", 2),
        f"Separator{separator}{'Tab' if separator == chr(9) else 'Comma'}",
        f"Decimal_Separator{separator}{decimal}",
        line("Multi_Headings", "Yes" if segments > 1 else "No"),
        line("X_Columns", x_columns),
        line("Time_Pref", "Relative"),
        f"Time{separator}17:18:18{decimal}938",
        "***End_of_Header***" + separator,
        separator,
    ]
    size = ROWS // segments
    parts = [segment(range(n * size, (n + 1) * size)) for n in range(segments)]
    return "\n".join([*head, *(text for part in parts for text in part)])


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
    np.testing.assert_allclose(table.frame.to_numpy(), np.column_stack([TIME_S, VOLTAGE, CURRENT]), atol=1e-9)
    assert table.losses == ()


def test_a_channel_with_a_clock_of_its_own_is_read_at_the_times_of_the_other(tmp_path: Path):
    """A thermometer of a slower clock is interpolated: its ramp stays a ramp."""
    rows = [f"{t:.3f}\t{u:.6f}\t{4.0 * t:.3f}\t{20.0 + 4.0 * t:.3f}" for t, u in zip(TIME_S, VOLTAGE, strict=True)]
    head = "LabVIEW Measurement\nSeparator\tTab\nX_Columns\tMulti\n***End_of_Header***\n\n"
    head += "Channels\t2\n***End_of_Header***\n"
    path = tmp_path / "bench.lvm"
    path.write_text(head + "X_Value\tVoltage\tX_Value\tTemperature\tComment\n" + "\n".join(rows))
    frame = read_table(path).frame
    np.testing.assert_allclose(frame["Voltage"], VOLTAGE, atol=1e-6)
    inside = TIME_S >= 4.0 * TIME_S[0]
    np.testing.assert_allclose(frame["Temperature"][inside], 20.0 + TIME_S[inside], atol=1e-9)
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
