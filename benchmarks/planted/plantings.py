"""Which fault is planted in which real case, how large, and what tells it: what an engineer can know from such data.

What counts as told:

- A thermometer 1.5 K off in all logs. At rest, cell and chamber differ by 1.5 K, and nothing says which of the two
  thermometers is wrong: `temperature_offset` of the cell, `chamber_offset` of the other sign, or a shift of the same
  size in every fitted run are the same. The cells are not all rested when a log begins (up to 0.8 K), so the size
  may be that over the size in the plain case too, and within a factor of 1.5.
- A thermometer that lags by 90 s in all logs: `temperature_lag`. `core_temperature` does not do the same: there the
  surface, which is read, is on time. A thermocouple that lags already adds its own lag, and a body of two nodes looks
  alike: within a factor of 2. Planted only where it moves readings by more than `SEEN` sd of the sensor.
- A contact of a third of R_0 in one log: the resistance of that run, within a factor of 1.5. The case has three
  fitted logs or more, and the run is one in the middle of the others in current, temperature and age, or has a twin at
  the same ones, so that no smooth dependence does the same. With two logs it is not asked: which of the two
  has the contact is a matter of taste, and two temperatures may differ by their activation energy.
- A thermometer that is stuck from the middle of the load of one log on: the remark of the preparation that names the
  channel and the run. The readings are excluded there, so nothing else may change its name.
- A voltage of one log 5 s late (or two rows, where rows are further apart), in logs with many steps of current: the
  remark of the preparation that names the run, or `clock_shift` of all logs of the right sign, within a factor of 3.
- A current sensor 5 % high in one log of three or more. In one log alone 5 % more current is the same as 5 % more
  capacity and 5 % less resistance. So what is asked is the run: a `gain_shift` of that run tells it; any shift of
  that run, a start of that run that was moved, or a `current_gain` of all logs make it possible. With 5 % in all logs
  nothing could be told: capacity and resistances follow.

Motors have none of these. Their thermometers are not in the measured cases; a contact, a gain of the current or of the
speed are the same as R_0, k_tau and friction of the base model, which are to be calibrated; and steady points have no
clock.
"""

from __future__ import annotations

import dataclasses
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.planted import faults
from benchmarks.planted.faults import CURRENT, THERMOMETER, VOLTAGE

# Sizes, as the task of this benchmark states them; a lag is planted where it is seen.
OFFSET_K, LAG_S, CONTACT_SHARE, STUCK_SHARE, LATE_S, HIGH_SHARE = 1.5, 90.0, 1.0 / 3.0, 0.5, 5.0, 0.05
# A voltage that is late by less than two rows is between rows.
LATE_SPARSE_S = 20.0
# Factors within which a size counts as told. Assumed.
FACTOR, LAG_FACTOR, CLOCK_FACTOR = 1.5, 2.0, 3.0
# The lag of a thermometer that moves its readings by less than so many sd (stated) cannot be asked for. Assumed.
SEEN = 2.0


@dataclasses.dataclass(frozen=True)
class Telling:
    """One way in which a diagnosis may tell a fault.

    Attributes:
        labels: candidates that must all be told: 'effect', 'effect:column' or 'shift:column@run'; none for a remark.
        number: the parameter of an effect that has the size; "" where no size is asked.
        sign: of the size, times that of the fault.
        factor: within which the size must be.
        code: of a remark that tells it, where no label does.
        about: how the subject of that remark ends.
    """

    labels: tuple[str, ...] = ()
    number: str = ""
    sign: float = 1.0
    factor: float = FACTOR
    code: str = ""
    about: str = ""


@dataclasses.dataclass(frozen=True)
class Planting:
    """One fault in one case.

    Attributes:
        case: name of the real case.
        fault: name of the fault.
        put: changes the rows of a run by a size.
        size: of the fault; a contact's is a share of R_0.
        unit: of the size.
        column: that is changed.
        runs: in which; all runs of the case, check runs too, if there are none here.
        told: ways of telling it, of which one is enough.
        partly: ways that leave it possible.
    """

    case: str
    fault: str
    put: Callable[[pd.DataFrame, float], pd.DataFrame]
    size: float
    unit: str
    column: str
    runs: tuple[str, ...] = ()
    told: tuple[Telling, ...] = ()
    partly: tuple[Telling, ...] = ()

    @property
    def name(self) -> str:
        """Return the name of its folder."""
        return "-".join([self.fault.replace(" ", "_"), *self.runs])

    @property
    def labels(self) -> tuple[str, ...]:
        """Return a candidate of each way that tells it."""
        return tuple(one.labels[0] for one in self.told if one.labels)

    def amount(self, folder: Path) -> float:
        """Return the size in its unit: a contact is a share of the case's R_0."""
        return self.size * series_ohm(folder) if self.put is faults.contact else self.size


def series_ohm(folder: Path) -> float:
    """Return the series resistance (ohm) of a case's table at half charge."""
    case = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    table = case["parameters"]["R_ints"]
    return float(np.interp(0.5, table["soc"], table["ohm"]))


def _offset(case: str, *fitted: str) -> Planting:
    shifts = [
        Telling(tuple(f"{shift}@{run}" for run in fitted), "c")
        for shift in (f"temperature_shift:{THERMOMETER}", "ambient_shift:ambient_degC")
    ]
    offsets = Telling((f"temperature_offset:{THERMOMETER}",), "c"), Telling(("chamber_offset:ambient_degC",), "c", -1.0)
    return Planting(
        case, "thermometer offset", faults.offset, OFFSET_K, "K", THERMOMETER, told=(*offsets, *shifts)
    )  # fmt: skip


def _lag(case: str) -> Planting:
    told = (Telling((f"temperature_lag:{THERMOMETER}",), "tau", factor=LAG_FACTOR),)
    return Planting(case, "thermometer lag", faults.lag, LAG_S, "s", THERMOMETER, told=told)


def _contact(case: str, run: str) -> Planting:
    told = (Telling((f"contact_resistance@{run}",), "r"),)
    return Planting(case, "contact", faults.contact, CONTACT_SHARE, "ohm", VOLTAGE, (run,), told, _of_run(run))


def _stuck(case: str, run: str) -> Planting:
    told = (Telling(code="sensor_stuck", about=f"{THERMOMETER}@{run}"),)
    return Planting(
        case, "stuck thermometer", faults.stuck, STUCK_SHARE, "of load", THERMOMETER, (run,), told, _of_run(run)
    )


def _clock(case: str, run: str, late_s: float = LATE_S) -> Planting:
    told = (
        Telling(code="voltage_late", about=f"{VOLTAGE}@{run}"),
        Telling(("clock_shift",), "d", factor=CLOCK_FACTOR),
    )
    return Planting(case, "late voltage", faults.late_voltage, late_s, "s", VOLTAGE, (run,), told)


def _current(case: str, run: str) -> Planting:
    told = (Telling((f"gain_shift:{CURRENT}@{run}",), "g"),)
    partly = (Telling((f"current_gain:{CURRENT}",)), *_of_run(run))
    return Planting(case, "high current", faults.high_current, HIGH_SHARE, "", CURRENT, (run,), told, partly)


def _of_run(run: str) -> tuple[Telling, ...]:
    """Return what points to a run without saying what is wrong with it."""
    shifts = (
        "contact_resistance",
        f"voltage_shift:{VOLTAGE}",
        f"temperature_shift:{THERMOMETER}",
        "ambient_shift:ambient_degC",
        "heat_transfer_shift",
    )
    return (*(Telling((f"{one}@{run}",)) for one in shifts), Telling(code="start_moved", about=f"@{run}"))


PLANTINGS = (
    _offset("samsung_30q", "cc1C", "cc2C", "cc3C"),
    _lag("samsung_30q"),
    _contact("samsung_30q", "cc2C"),
    _stuck("samsung_30q", "cc2C"),
    _current("samsung_30q", "cc2C"),
    _offset("lg_mj1", "p28degC", "p20degC"),
    _stuck("lg_mj1", "p20degC"),
    _clock("lg_mj1", "p20degC"),
    _offset("leaf", "cc1C_first", "cc3C"),
    _lag("leaf"),
    _stuck("leaf", "cc3C"),
    _offset("dmegc_18650", "pulse", "cc0p5C", "cc1C"),
    _contact("dmegc_18650", "cc0p5C"),
    _stuck("dmegc_18650", "cc1C"),
    _clock("dmegc_18650", "pulse", LATE_SPARSE_S),
    _current("dmegc_18650", "cc0p5C"),
    _offset("nasa_ageing", "cycle_1", "cycle_22", "cycle_64", "cycle_105"),
    _lag("nasa_ageing"),
    _contact("nasa_ageing", "cycle_64"),
    _stuck("nasa_ageing", "cycle_64"),
    _current("nasa_ageing", "cycle_64"),
    _offset("k2_lfp", "hppc_p30degC", "hppc_p20degC", "cc1C_p30degC", "cc1C_p20degC"),
    _contact("k2_lfp", "hppc_p20degC"),
    _stuck("k2_lfp", "cc1C_p20degC"),
    _clock("k2_lfp", "hppc_p20degC"),
    _current("k2_lfp", "cc1C_p20degC"),
)  # fmt: skip


def plant(folder: Path, planting: Planting, out: Path) -> Path:
    """Write a case with a fault in its measured data; return its folder."""
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    size = planting.amount(folder)
    for path in sorted(folder.iterdir()):
        if path.suffix == ".csv" and (not planting.runs or path.stem in planting.runs):
            planting.put(pd.read_csv(path), size).to_csv(out / path.name, index=False, lineterminator="\n")
        elif path.suffix in (".csv", ".toml"):
            shutil.copy(path, out / path.name)
    return out


def seen(folder: Path, planted: Path, column: str) -> float:
    """Return the RMS by which a planted fault moves a column in the runs it changes, in sd of its stated noise."""
    noise = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))["sensors"][column]
    moved = [
        (pd.read_csv(path)[column] - pd.read_csv(folder / path.name)[column]).dropna().to_numpy()
        for path in sorted(planted.glob("*.csv"))
        if path.read_bytes() != (folder / path.name).read_bytes()
    ]
    moves = np.concatenate(moved or [np.zeros(1)])
    return float(np.sqrt(np.mean(moves**2)) / noise)
