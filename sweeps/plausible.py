"""What is odd in the numbers of a study: a torque in mN m, a current in mA, an inertia in g cm2, and what mends it.

The numbers are held against each other by the equations of the model. A study has no readings, so that nothing is
certain: each oddity is a remark, and the study runs.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from jaxmodel.base.errors import RemarkWarning
from jaxmodel.base.units import unit_of
from jaxmodel.case.plausible.finding import Mend
from jaxmodel.case.plausible.ranges import LARGEST_CELL_AH
from jaxmodel.model.parameters import TABLE
from jaxmodel.sweeps.prepare import SCALE
from jaxmodel.sweeps.study import Study

# A load of more than this many stall torques only drives the motor backwards (assumed: at one it stands still).
_MOST_STALLS = 2.0
# No small brushed motor turns faster: 200,000 1/min in rad/s (assumed; the fastest sold turn 100,000 1/min).
_MOST_SPEED = 2.1e4
# A rotor alone settles in 1 to 100 ms (maxon and Faulhaber, data sheets), with what it drives up to minutes (assumed).
_SETTLING_S = (1e-5, 1e3)
# A cell for racing is emptied in 36 s at 100 times its capacity per hour (assumed to be the most).
_MOST_RATE = 100.0

Ends = Mapping[str, tuple[float, float]]


@dataclasses.dataclass(frozen=True)
class Relation:
    """What numbers of a study give together, which should lie between limits.

    Attributes:
        kinds: of model.
        ratio: its two extreme values over all lanes, from the least and greatest size of each number; None where the
            study lacks one of them.
        limits: that it should keep.
        words: what it is, with "{value}" and the limit that it passes, "{limit}".
        mends: mistakes of unit that may explain it.
    """

    kinds: tuple[str, ...]
    ratio: Callable[[Ends], tuple[float, float] | None]
    limits: tuple[float, float]
    words: str
    mends: tuple[Mend, ...]

    def off(self, ends: Ends) -> float | None:
        """Return the value that is beyond the limits; None if none is."""
        extremes = self.ratio(ends)
        if extremes is None:
            return None
        low, high = self.limits
        return extremes[1] if extremes[1] > high else extremes[0] if extremes[0] < low else None


def _stalls(ends: Ends) -> tuple[float, float] | None:
    if not {"load_torque_Nm", "voltage_V"} <= ends.keys() or ends["voltage_V"][1] == 0.0:
        return None
    stall = ends["k_tau"][1] * ends["voltage_V"][1] / ends["R_0"][0]
    return 0.0, ends["load_torque_Nm"][1] / stall


def _free_speed(ends: Ends) -> tuple[float, float] | None:
    return (0.0, ends["voltage_V"][1] / ends["k_tau"][0]) if "voltage_V" in ends else None


def _settling(ends: Ends) -> tuple[float, float] | None:
    def of(end: int) -> float:
        return ends["R_0"][end] * ends["J"][end] / ends["k_tau"][1 - end] ** 2

    return of(0), of(1)


def _rate(ends: Ends) -> tuple[float, float] | None:
    return (0.0, ends["current_A"][1] / ends["capacity_Ah"][0]) if "current_A" in ends else None


def _capacity(ends: Ends) -> tuple[float, float] | None:
    return ends["capacity_Ah"]


_DRIVES, _CELLS = ("motor", "robot"), ("cell", "robot")
RELATIONS = (
    Relation(
        _DRIVES,
        _stalls,
        (0.0, _MOST_STALLS),
        "that is {value:.3g} times the torque at which this motor stands still, k_tau V / R_0",
        (
            Mend("load_torque_Nm", 1e-3, "it is in mN m"),
            Mend("load_torque_Nm", 1e-2, "it is in N cm"),
            Mend("k_tau", 1e3, "it is in kN m/A"),
        ),
    ),
    Relation(
        ("motor",),
        _free_speed,
        (0.0, _MOST_SPEED),
        "that turns this motor without load at V / k_tau = {value:.3g} rad/s",
        (Mend("voltage_V", 1e-3, "it is in mV"),),
    ),
    Relation(
        _DRIVES,
        _settling,
        _SETTLING_S,
        "with that the motor settles within R_0 J / k_tau^2 = {value:.3g} s",
        (
            Mend("J", 1e-7, "it is in g cm2"),
            Mend("J", 1e-4, "it is in kg cm2"),
            Mend("k_tau", 1e-3, "it is in mN m/A"),
            Mend("R_0", 1e-3, "it is in mohm"),
        ),
    ),
    Relation(
        ("cell",),
        _rate,
        (0.0, _MOST_RATE),
        "that empties the cell {value:.3g} times in an hour",
        (
            Mend("current_A", 1e-3, "it is in mA"),
            Mend("capacity_Ah", 1e3, "it is in kA h"),
        ),
    ),
    Relation(
        _CELLS,
        _capacity,
        (0.0, LARGEST_CELL_AH),
        "few cells hold more than {limit:g} A h",
        (Mend("capacity_Ah", 1e-3, "it is in mA h"),),
    ),
)


def odd_values(study: Study) -> Iterator[str]:
    """Yield a sentence for each number of a study that looks as if it were in another unit.

    Only what the study itself states is spoken of, and by the name under which it stands there.

    Args:
        study: to be run.
    """
    ends, said = _ends(study), set()
    kind = study.prepared.model.kind
    for relation in RELATIONS:
        value = relation.off(ends) if kind in relation.kinds else None
        if value is None:
            continue
        stated = {mend.name: where for mend in relation.mends if (where := _where(study, mend.name))}
        fitting = [mend for mend in relation.mends if mend.name in stated and relation.off(_mended(ends, mend)) is None]
        name = fitting[0].name if fitting else next(iter(stated), "")
        if not name or name in said:
            continue
        said.add(name)
        unit = TABLE[name].unit if name in TABLE else unit_of(name)
        limit = relation.limits[1] if value > relation.limits[1] else relation.limits[0]
        least, most = ends[name]
        seen = f"{most:.6g} {unit}" if value > relation.limits[1] or least == 0.0 else f"{least:.6g} {unit}"
        todo = "; or ".join(mend.sentence() for mend in fitting if mend.name == name) or "correct its value or unit"
        yield f"{stated[name]}: {seen}, and {relation.words.format(value=value, limit=limit)}; {todo}."


def warn_of_odd_values(study: Study) -> None:
    """Warn of each number of a study that looks as if it were in another unit.

    Warns:
        RemarkWarning: for each.
    """
    for sentence in odd_values(study):
        warnings.warn(sentence, RemarkWarning, stacklevel=3)


def _ends(study: Study) -> dict[str, tuple[float, float]]:
    """Return the least and the greatest size of each number over all lanes and rows.

    Of a robot `voltage_V` is that of its motors, the duty times the pack's nominal voltage.
    """
    prepared = study.prepared
    sizes = {name: np.abs(values) for name, values in prepared.profile.inputs.items()}
    ends = {name: (float(values.min()), float(values.max())) for name, values in sizes.items()}
    ends |= {name: _sizes(float(getattr(prepared.model.parameters, name))) for name in TABLE}
    varied = {name: _sizes(*map(float, study.range_of(name))) for name in study.varied}
    ends |= {name: span for name, span in varied.items() if name in ends}
    for name, (low, high) in varied.items():
        column = name.removeprefix(SCALE)
        if column != name:
            ends[column] = (ends[column][0] * low, ends[column][1] * high)
    if "V_set" in ends:  # eq. 22: 2.5 V is rest
        ends["duty"] = (0.0, 1.0)
    if "duty" in ends:
        pack = [ends["n_series"][end] * ends["nominal_cell_voltage_V"][end] for end in (0, 1)]
        ends["voltage_V"] = (ends["duty"][0] * pack[0], ends["duty"][1] * pack[1])
    return ends


def _sizes(*values: float) -> tuple[float, float]:
    sizes = [abs(value) for value in values]
    return min(sizes), max(sizes)


def _mended(ends: Ends, mend: Mend) -> Ends:
    low, high = ends[mend.name]
    return {**ends, mend.name: (low * mend.factor, high * mend.factor)}


def _where(study: Study, name: str) -> str:
    """Return where a study states a number, "" where it does not."""
    for one in (SCALE + name, name):
        if one in study.varied:
            return f"axes.{one}" if one in study.axes else f"sample.ranges.{one}"
    if name in study.parameters:
        return f"parameters.{name}"
    return f"profile.{name}" if name in study.prepared.profile.inputs else ""
