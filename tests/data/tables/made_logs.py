"""Made logs of LabVIEW, ArduPilot and WPILib, as their own writers lay them out."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from tests.data.importing.benches import cell_log

LVM_ROWS = 60
LVM_TIME_S = 0.5 + 0.25 * np.arange(LVM_ROWS)
LVM_VOLTAGE = np.linspace(4.1, 3.2, LVM_ROWS)
LVM_CURRENT = np.linspace(0.0, 2.0, LVM_ROWS)

_STRUCTS = {"n": "4s", "N": "16s", "Z": "64s", "c": "h", "e": "i", "M": "B"}
MESSAGES = {
    128: ("FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
    10: ("UNIT", "QbZ", "TimeUS,Id,Label"),
    11: ("MULT", "Qbd", "TimeUS,Id,Mult"),
    12: ("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    20: ("BAT", "QBffffc", "TimeUS,Inst,Volt,Curr,CurrTot,Res,Temp"),
    21: ("ESC", "QBe", "TimeUS,Instance,RPM"),
    22: ("IMU", "QBf", "TimeUS,I,GyrX"),
    23: ("MSG", "QZ", "TimeUS,Message"),
}
FLIGHT = cell_log().assign(time_s=lambda log: log.time_s / 10.0)

FRC_ROWS = 100
FRC_TIME_S = 3.0 + 0.02 * np.arange(FRC_ROWS)
FRC_VOLTAGE = np.linspace(12.6, 11.0, FRC_ROWS)
FRC_CURRENT = np.linspace(2.0, 80.0, FRC_ROWS)


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
            line("X0", LVM_TIME_S[rows[0]], *between, LVM_TIME_S[rows[0]], ""),
            line("Delta_X", 0.25, *between, 0.25, ""),
            "***End_of_Header***" + separator,
            line("X_Value", *x_names, "Comment"),
        ]
        for n in rows:
            voltage, current = f"{LVM_VOLTAGE[n]:.9f}", f"{LVM_CURRENT[n]:.9f}"
            times = "" if x_columns == "No" else LVM_TIME_S[n]
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
    size = LVM_ROWS // segments
    parts = [segment(range(n * size, (n + 1) * size)) for n in range(segments)]
    return "\n".join([*head, *(text for part in parts for text in part)])


def message(kind: int, *values: object) -> bytes:
    """One message: two bytes of head, its kind, and the fields of its format."""
    letters = MESSAGES[kind][1]
    packed = struct.pack("<" + "".join(_STRUCTS.get(letter, letter) for letter in letters), *values)
    return b"\xa3\x95" + bytes([kind]) + packed


def flight(units: bool = True, cells: int = 4) -> bytes:
    """Two batteries, two motor controllers and a gyroscope; of the second battery a constant voltage."""
    parts = []
    for kind, (name, letters, fields) in MESSAGES.items():
        size = 3 + struct.calcsize("<" + "".join(_STRUCTS.get(letter, letter) for letter in letters))
        parts.append(message(128, kind, size, name.encode(), letters.encode(), fields.encode()))
    if units:
        for letter, unit in {"s": "s", "#": "instance", "v": "V", "A": "A", "a": "Ah", "O": "degC", "q": "rpm"}.items():
            parts.append(message(10, 1, ord(letter), unit.encode()))
        for letter, factor in {"F": 1e-6, "0": 1.0, "C": 1e-3, "B": 1e-2, "-": 0.0}.items():
            parts.append(message(11, 1, ord(letter), factor))
        parts.append(message(12, 1, 20, b"s#vAa-O", b"F-00C-B"))
        parts.append(message(12, 1, 21, b"s#q", b"F-B"))
    parts.append(message(23, 5, b"ArduRover"))
    for row in FLIGHT.itertuples():
        at = round(1e6 * row.time_s) + 7_000_000
        parts.append(message(20, at, 0, cells * row.voltage_V, row.current_A, 1e3 * row.time_s, 0.01, 2550))
        parts.append(message(20, at, 1, 12.0, 0.5, 0.0, 0.01, 2000))
        parts += [message(21, at + 1000, motor, 100 * (3000 + 1000 * motor)) for motor in (0, 1)]
        parts += [message(22, at + 100 * n, 0, 0.1) for n in range(3)]
    return b"".join(parts)


def flight_text(cells: int = 4) -> str:
    """The first battery of such a log as text."""
    lines = ["FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns"]
    lines += ["FMT, 20, 46, BAT, QBffffc, TimeUS,Inst,Volt,Curr,CurrTot,Res,Temp", "PARM, 3, BATT_MONITOR, 4"]
    for row in FLIGHT.itertuples():
        at = round(1e6 * row.time_s) + 7_000_000
        lines.append(f"BAT, {at}, 0, {cells * row.voltage_V:.6f}, {row.current_A}, {1e3 * row.time_s:.3f}, 0.01, 25.50")
    return "\n".join(lines)


def record(entry: int, time_s: float, payload: bytes) -> bytes:
    """One record, its lengths as short as they may be."""
    parts = [entry, len(payload), round(1e6 * time_s)]
    sizes = [max((part.bit_length() + 7) // 8, 1) for part in parts]
    lengths = (sizes[0] - 1) | (sizes[1] - 1) << 2 | (sizes[2] - 1) << 4
    return bytes([lengths]) + b"".join(p.to_bytes(n, "little") for p, n in zip(parts, sizes, strict=True)) + payload


def start(entry: int, name: str, kind: str, metadata: str = "") -> bytes:
    texts = b"".join(struct.pack("<I", len(text)) + text.encode() for text in (name, kind, metadata))
    return record(0, 0.1, struct.pack("<BI", 0, entry) + texts)


def frc() -> bytes:
    """A robot's log: a voltage and a current each 20 ms, a duty on change, texts, and an entry that is finished."""
    parts = [b"WPILOG" + struct.pack("<HI", 0x0100, 5) + b"extra"]
    parts += [
        start(1, "NT:/SystemStats/BatteryVoltage", "double"),
        start(2, "NT:/PowerDistribution/TotalCurrent", "float", '{"unit": "A"}'),
        start(3, "NT:/Drive/DutyCycle", "double"),
        start(4, "messages", "string"),
        start(5, "NT:/Drive/VelocityRadPerSec", "double[]"),
        start(300, "NT:/Pose", "struct:Pose2d"),
    ]
    for n, time_s in enumerate(FRC_TIME_S):
        parts.append(record(1, time_s, struct.pack("<d", FRC_VOLTAGE[n])))
        parts.append(record(2, time_s, struct.pack("<f", FRC_CURRENT[n])))
        parts.append(record(5, time_s, struct.pack("<2d", 10.0 * n, -10.0 * n)))
        parts.append(record(300, time_s, bytes(24)))
        if n in (0, 50):
            parts.append(record(3, time_s, struct.pack("<d", 0.25 + 0.005 * n)))
            parts.append(record(4, time_s, b"enabled"))
    parts.append(record(0, FRC_TIME_S[-1], struct.pack("<BI", 1, 3)))
    return b"".join(parts)
