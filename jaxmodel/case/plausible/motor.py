"""A motor's voltage, current, speed and torque held against each other by its own equations, eqs. 11 to 13.

Each relation is a ratio that is about 1 of a right case. A quantity is in another unit, or reversed, where a relation
is far off and mending that quantity brings all of them back.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from jaxmodel.case.plausible.cell import open_circuit
from jaxmodel.case.plausible.finding import Finding, Mend, column, number, place
from jaxmodel.case.plausible.load import Steady, load_of
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import duty_of

MENDS = (
    Mend("speed_rad_s", math.pi / 30.0, "it is in rpm", todo="multiply speed_rad_s by 0.10472 (pi / 30)"),
    Mend("speed_rad_s", math.pi / 180.0, "it is in deg/s", todo="multiply speed_rad_s by 0.017453 (pi / 180)"),
    Mend("speed_rad_s", 2.0 * math.pi, "it is in turns per second", todo="multiply speed_rad_s by 6.2832 (2 pi)"),
    Mend("speed_rad_s", -1.0, "a positive voltage turns the motor forwards"),
    Mend("current", 1e-3, "it is in mA"),
    Mend("current", -1.0, "the current of a driving motor has the sign of its voltage"),
    Mend("voltage_V", 1e-3, "it is in mV"),
    Mend("voltage_V", -1.0, "a positive voltage turns the motor forwards"),
    Mend("load_torque_Nm", 1e-3, "it is in mN m"),
    Mend("load_torque_Nm", 1e-2, "it is in N cm"),
    Mend("k_tau", 1e-3, "it is in mN m/A"),
    Mend("R_0", 1e-3, "it is in mohm"),
    Mend("J", 1e-7, "it is in g cm2"),
    Mend("current", 1e3, "it is in kA"),
    Mend("voltage_V", 1e3, "it is in kV"),
)
# What a relation can be as the readings stand, and must be when they are mended. Of 93 real and made runs the speed has
# 0.94 to 1.05, the current 0.5 to 8.5 (a propeller whose drag is no load), the drop at most 0.72, the inertia 0.05.
_CAN = {
    "speed": (0.25, 4.0),
    "current": (0.02, 50.0),
    "drop": (0.0, 2.0),
    "energy": (0.0, 1.0),
    "inertia": (0.0, 100.0),
}
_MUST = {"speed": (0.5, 2.0), "current": (0.1, 10.0), "drop": (0.0, 1.5), "energy": (0.0, 1.0), "inertia": (0.0, 1.0)}
# Runs of fewer rows show nothing; how much of the power in losses that are not counted may seem to be.
_FEWEST, _UNSURE = 8, 0.2
# Mends whose relations are off by no more than this beside the best are equally good (natural logarithm).
_AS_GOOD = 0.7


@dataclasses.dataclass(frozen=True, eq=False)
class Drive:
    """One run of one motor: what was measured, None where it was not, and its numbers."""

    time_s: np.ndarray
    voltage_V: np.ndarray | None
    current: np.ndarray | None
    speed_rad_s: np.ndarray | None
    load_torque_Nm: np.ndarray | None
    k_tau: float
    R_0: float
    J: float
    tau_0: float

    def mended(self, mend: Mend) -> Drive | None:
        """Return the run with one quantity mended; None where it has none."""
        value = getattr(self, mend.name)
        return None if value is None else dataclasses.replace(self, **{mend.name: mend.apply(value)})

    def relations(self) -> dict[str, float]:
        """Return those ratios that the run has readings for."""
        found: dict[str, float] = {}
        v, i, w, load = self.voltage_V, self.current, self.speed_rad_s, self.load_torque_Nm
        if i is not None and load is not None:
            asked = (_mean(np.abs(load)) + self.tau_0) / self.k_tau
            found["current"] = _mean(np.abs(i)) / asked if asked > 0.0 else 1.0
        if v is None or not np.nanmax(np.abs(v)) > 0.0:
            return found
        if w is not None and (i is not None or load is not None):
            carried = i if i is not None else np.asarray(load) / self.k_tau
            free = (v - self.R_0 * carried) / self.k_tau
            found["speed"] = _mean(w * free) / _mean(free**2)
            steps = np.diff(self.time_s)
            stall = self.k_tau * np.nanmax(np.abs(v)) / self.R_0
            found["inertia"] = float(self.J * np.nanmax(np.abs(np.diff(w) / steps), initial=0.0) / stall)
        if i is not None:
            back = v if w is None else v - self.k_tau * w
            most = np.nanquantile(np.abs(back), 0.99) + 0.5 * np.nanquantile(np.abs(v), 0.99)
            found["drop"] = float(self.R_0 * np.nanquantile(np.abs(i), 0.99) / most)
        if i is not None and w is not None and load is not None:
            given, done = _mean(v * i), _mean(load * w)
            read = w[np.isfinite(w)]
            stored = 0.5 * self.J * float(read[0] ** 2 - read[-1] ** 2) / (self.time_s[-1] - self.time_s[0])
            short = done - given - max(stored, 0.0)
            found["energy"] = 0.0 if short < _UNSURE * (abs(done) + abs(given)) else 2.0
        return found


def drive_of(case: Case, run: Run) -> Drive | None:
    """Return a run's motor: of a robot one track motor, whose voltage is the duty times the pack's (eq. 14)."""
    voltage, current = column(run, "voltage_V"), column(run, "current_A")
    if case.kind == "robot":
        current, pack, duty = column(run, "motor_current_A"), column(run, "pack_voltage_V"), duty_of(run)
        nominal = number(case, "n_series", run) * float(np.median(open_circuit(case)[1]))
        voltage = duty * (nominal if pack is None else pack)
    speed, load = column(run, "speed_rad_s"), column(run, "load_torque_Nm")
    for one in (voltage, current, speed):
        if one is not None and np.sum(np.isfinite(one)) < _FEWEST:
            return None
    k_tau, R_0, J, tau_0 = (number(case, name, run) for name in ("k_tau", "R_0", "J", "tau_0"))
    return Drive(run.measured.time_s, voltage, current, speed, load, k_tau, R_0, J, tau_0)


def wrong_motor(case: Case) -> Iterator[Finding]:
    """Yield, of the first run that is off, what must be mended for a motor's equations to hold."""
    for run in case.runs if case.kind != "cell" else ():
        drive = drive_of(case, run)
        if drive is None:
            continue
        found = drive.relations()
        off = [name for name, ratio in found.items() if not _within(ratio, _CAN[name])]
        if not off:
            continue
        scores: dict[Mend, float] = {}
        for mend in MENDS:
            other = drive.mended(mend)
            ratios = {} if other is None else other.relations()
            if ratios and all(_within(ratio, _MUST[name]) for name, ratio in ratios.items()):
                scores[mend] = sum(abs(math.log(ratios[n])) for n in ("speed", "current") if n in ratios)
        if scores:
            yield _finding(case, run, drive, off, found, scores)
            return


def odd_load(case: Case) -> Iterator[Finding]:
    """Yield a load torque that the currents of all runs together contradict, of a motor alone."""
    if case.kind != "motor":
        return
    drives = [(run, drive) for run in case.runs if (drive := drive_of(case, run)) is not None]
    read = [
        Steady(d.time_s, d.voltage_V, d.current, d.speed_rad_s, d.load_torque_Nm)
        for _, d in drives
        if d.voltage_V is not None
        and d.current is not None
        and d.speed_rad_s is not None
        and d.load_torque_Nm is not None
    ]
    found = load_of(read)
    if found is None or found.possible:
        return
    mends = () if found.mend is None else (found.mend,)
    largest = max(float(np.nanmax(np.abs(run.load_torque_Nm))) for run in read)
    where = place(case, drives[0][0], "load_torque_Nm")
    yield Finding(where, f"{largest:.4g} (largest)", found.sentence(), mends, certain=False, name="load_torque_Nm")


def _finding(
    case: Case, run: Run, drive: Drive, off: list[str], found: dict[str, float], scores: dict[Mend, float]
) -> Finding:
    least = min(scores.values())
    mends = [_named(case, mend) for mend in sorted(scores, key=scores.__getitem__) if scores[mend] < least + _AS_GOOD]
    value = getattr(drive, next(m for m in scores if scores[m] == least).name)
    read = value if isinstance(value, float) else value[np.nanargmax(np.abs(value))]
    seen = f"{mends[0].name} = {value:g}" if isinstance(value, float) else f"{read:.4g} (largest)"
    said = {
        "speed": f"the speed is {found.get('speed', 0.0):.3g} times that of (voltage - R_0 current) / k_tau",
        "current": f"the current is {found.get('current', 0.0):.3g} times (torque + tau_0) / k_tau",
        "drop": f"R_0 times the current is {found.get('drop', 0.0):.3g} times the voltage there is",
        "energy": "the motor does more work than it is given",
        "inertia": f"to speed J up so takes {found.get('inertia', 0.0):.3g} times the stall torque",
    }
    return Finding(place(case, run, mends[0]), seen, said[off[0]], tuple(mends))


def _named(case: Case, mend: Mend) -> Mend:
    """Return a mend under the column's name of this kind."""
    names = (
        {"current": "current_A"}
        if case.kind == "motor"
        else {"current": "motor_current_A", "voltage_V": "pack_voltage_V"}
    )
    return dataclasses.replace(mend, name=names.get(mend.name, mend.name))


def _within(ratio: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= ratio <= limits[1]


def _mean(values: np.ndarray) -> float:
    return float(np.nanmean(values))
