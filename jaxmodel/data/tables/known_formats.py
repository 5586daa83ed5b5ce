"""What the makers of logs have fixed for them, by the names of their columns: data."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from typing import Literal


@dataclasses.dataclass(frozen=True)
class KnownFormat:
    """What a format fixes beyond what its names say.

    Attributes:
        name: of the format.
        needs: names of columns that a table of it has, all of them.
        one_of: names of which it has at least one; empty where there is no such list.
        columns: by a pattern of whole names, the plain name of what the column holds and its unit; '' for the plain
            name of a column that holds nothing of a case. The first pattern that fits counts.
        current_positive_on: what the sign of its current means; None where nothing is fixed.
        remark: a sentence on what a user should know of it.
    """

    name: str
    needs: frozenset[str]
    one_of: frozenset[str] = frozenset()
    columns: tuple[tuple[re.Pattern[str], str, str], ...] = ()
    current_positive_on: Literal["charge", "discharge"] | None = None
    remark: str = ""

    def fits(self, names: Iterable[str]) -> bool:
        """Return whether a table of these columns is of the format."""
        known = {_folded(name) for name in names}
        return self.needs <= known and (not self.one_of or bool(self.one_of & known))

    def plain(self, names: Iterable[str]) -> dict[str, tuple[str, str]]:
        """Return plain name and unit of the columns that the format knows, by their names."""
        found = {}
        for name in names:
            fitting = (column[1:] for column in self.columns if column[0].fullmatch(_folded(name)))
            if (column := next(fitting, None)) is not None:
                found[name] = column
        return found


def _folded(name: str) -> str:
    return " ".join(name.split()).lower()


def _all(*names: str) -> frozenset[str]:
    return frozenset(names)


def _columns(**kinds: Mapping[str, str]) -> tuple[tuple[re.Pattern[str], str, str], ...]:
    """Return patterns of names by what they are; `nothing` holds patterns of columns that are nothing of a case."""
    found = []
    for kind, patterns in kinds.items():
        plain = "" if kind == "nothing" else kind.replace("_", " ")
        found += [(re.compile(pattern), plain, unit) for pattern, unit in patterns.items()]
    return tuple(found)


# Of both forms of its lines, under the names of `icharger`.
_OF_ICHARGER = _columns(
    nothing={
        r"supply \[mv\]": "mV",
        r"charger temperature \[degc\]": "degC",
        r"counted charge \[mah\]": "mA h",
    }
)
_POSITIVE_ON_CHARGE = "Battery Data Format: its current is positive on charge."
# Sources: the Battery Data Format's list of labels; VESC Tool's `mobile/` and `vescinterface.cpp`, which write the log;
# the `VescUart` and `PyVESC` libraries, which name the readings of a VESC; the manual of Leaf Spy Pro;
# blackbox-tools' `blackbox_decode.c` and the Blackbox Explorer's `csv-exporter.js`; EdgeTX's `logs.cpp`.
FORMATS = (
    KnownFormat(
        "Battery Data Format",
        _all("test time / s", "current / a", "voltage / v"),
        current_positive_on="charge",
        remark=_POSITIVE_ON_CHARGE,
    ),
    KnownFormat(
        "Battery Data Format",
        _all("test_time_second", "current_ampere", "voltage_volt"),
        current_positive_on="charge",
        remark=_POSITIVE_ON_CHARGE,
    ),
    KnownFormat(
        "VESC Tool",
        _all("ms_today", "input_voltage", "current_in"),
        columns=_columns(
            time={"ms_today": "ms"},
            battery_voltage={"input_voltage": "V"},
            battery_current={"current_in": "A"},
            motor_current={"current_motor": "A"},
            motor_temperature={"temp_motor": "degC"},
            duty_cycle={"duty_cycle": "1"},
            battery_level={"battery_level": "1"},
            discharged={"amp_hours_used": "A h"},
            nothing={
                "temp_mos.*": "degC", "erpm": "", "[dq]_axis_current": "A", "[dq]_axis_voltage": "V",
                "(amp|watt)_hours_.*|.*_setup|battery_wh_tot|.*tacho.*|encoder_position": "",
                "roll|pitch|yaw|(acc|gyro)[xyz]|gnss_.*|ms_today_.*": "",
                "speed_meters_per_sec|num_vescs|fault_code|vesc_id": "",
            },
        ),
        current_positive_on="discharge",
        remark="VESC Tool: the current of its battery is positive on discharge. Its erpm is the speed times the number "
        'of pole pairs: --column speed_rad_s="erpm * 0.10472 / PAIRS". Of a motor, the voltage is '
        '--column voltage_V="duty_cycle * input_voltage".',
    ),
    *(
        KnownFormat(
            "readings of a VESC",
            needs,
            columns=_columns(
                battery_voltage={"inpvoltage|v_in|input_voltage": "V"},
                battery_current={"avg_?input_?current": "A"},
                motor_current={"avg_?motor_?current": "A"},
                motor_temperature={"temp_?motor": "degC"},
                duty_cycle={"duty_?cycle_?now": "1"},
                discharged={"amp_?hours": "A h"},
                nothing={
                    "rpm": "", "temp_?(mosfet|fet|mos)s?|mosfet_?temp": "degC", "amp_?hours_?charged": "A h",
                    "watt_?hours(_?charged)?|tachometer(_?abs)?|avg_i[dq]|fault(_?code)?|error|id": "",
                },
            ),
            current_positive_on="discharge",
            remark="readings of a VESC: the current of its battery is positive on discharge. Its rpm is the speed "
            'times the number of pole pairs: --column speed_rad_s="rpm * 0.10472 / PAIRS". Its duty cycle times the '
            "voltage of the battery is that of the motor.",
        )
        for needs in (
            _all("avgmotorcurrent", "avginputcurrent", "rpm"),
            _all("avg_motor_current", "avg_input_current", "rpm"),
        )
    ),
    KnownFormat(
        "Leaf Spy",
        _all("gids", "pack volts", "pack amps"),
        columns=_columns(
            epoch_time={"epoch time": "s"},
            battery_voltage={"pack volts": "V"},
            battery_current={"pack amps": "A"},
            battery_soc={"soc": "ppm"},
            temperature={"pack t1 c": "degC"},
            nothing={"date/time|12v.*|pack t. f|pack t[2-4] c|ambient|speed.*|torque nm|motor temp|.*pwr.*|ahr": ""},
        ),
        current_positive_on="discharge",
        remark="Leaf Spy: its current is positive on discharge.",
    ),
    KnownFormat(
        "blackbox of Betaflight or INAV",
        _all("loopiteration"),
        _all("vbatlatest (v)", "amperagelatest (a)", "vbatlatest", "amperagelatest", "vbat (v)", "vbat"),
        columns=_columns(
            time={r"time( \(us\))?": "us"},
            battery_voltage={r"vbat(latest)? \(v\)": "V", "vbat(latest)?": "cV"},
            battery_current={r"amperage(latest)? \(a\)": "A", "amperage(latest)?": "cA"},
            discharged={r"energycumulative( \(mah\))?": "mA h"},
            nothing={".*": ""},
        ),
        current_positive_on="discharge",
        remark="blackbox of Betaflight or INAV: its current is positive on discharge. Voltage and current of a table "
        "without units are taken as 0.01 V and 0.01 A, as Betaflight 4 counts them.",
    ),
    KnownFormat(
        "OpenTX or EdgeTX",
        _all("date", "time"),
        _all("txbat(v)", "rxbt(v)", "vfas(v)", "1rss(db)", "rssi(db)", "lsw"),
        columns=_columns(
            battery_voltage={r"vfas\d?\(v\)|batt\(v\)|escv\(v\)|lipo\(v\)": "V"},
            v_batt={r"rxbt\d?\(v\)": "V"},
            battery_current={r"(curr|esca)\d?\(a\)": "A"},
            battery_level={r"bat_?%?\(%\)": "%"},
            discharged={r"(capa|fuel|escc)\d?\(mah\)": "mA h"},
            motor_speed={r"(esc)?rpm\d?\(rpm\)": "rpm"},
            temperature={r"tmp\d\([°@]?c\)": "degC"},
            nothing={
                r"txbat\(v\)|a[1-4]\(v\)|rud|ele|thr|ail|s[a-j]|s[1-4]|ls|rs|p[1-6]|lsw|ch\d+\(us\)|fm|gps|ptch\(.*|"
                r"roll\(.*|yaw\(.*|\d?rss.*|.*\(db\)|.*\(kmh\)|v?spd\(.*|.*\(kts\)|esct\(.*": "",
            },
        ),
        current_positive_on="discharge",
        remark="OpenTX or EdgeTX: its current is positive on discharge.",
    ),
    KnownFormat(
        "iCharger",
        _all("supply [mv]", "charger temperature [degc]", "time [ms]"),
        columns=_OF_ICHARGER,
        current_positive_on="charge",
        remark="iCharger: its current is positive on charge.",
    ),
    KnownFormat(
        "iCharger at its serial port",
        _all("supply [mv]", "charger temperature [degc]", "battery voltage [mv]"),
        columns=_OF_ICHARGER,
        remark="iCharger at its serial port: it sends a line each second or two and no clock (--seconds-per-row).",
    ),
)  # fmt: skip


# Makers whose text says in its head who wrote it, and whose current is positive on charge. Their own manuals.
_HEADS = (
    (re.compile(r"^(EC|BT)-Lab ASCII FILE"), "BioLogic"),
    (re.compile(r"Basytec Battery Test System", re.IGNORECASE), "BaSyTec"),
    (re.compile(r"^Novonix\b", re.IGNORECASE), "Novonix"),
)


def maker_in(head: Iterable[str]) -> str:
    """Return the maker whose current is positive on charge, by the lines above a table; "" for none that is known."""
    return next((maker for line in head for pattern, maker in _HEADS if pattern.search(line)), "")


def known_format(names: Iterable[str]) -> KnownFormat | None:
    """Return the format whose names these columns have, None for none that is known."""
    names = list(names)
    return next((known for known in FORMATS if known.fits(names)), None)
