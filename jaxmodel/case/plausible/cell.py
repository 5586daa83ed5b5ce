"""A cell's time, current, capacity and voltage held against each other: which one is in another unit, or reversed.

The readings are held against the simplest cell there is: V = OCV(SOC_0 - charge / capacity) - R I, with SOC_0 free, R
free within what cells have, and the capacity free within a factor of two. As they stand they get more: the capacity
is free within a factor of six, and the open-circuit voltage within a fifth where none is stated. What even then stays
far off, and fits as soon as one quantity is mended, is a wrong unit or sign.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator

import jax
import numpy as np

from jaxmodel.case.plausible.finding import Finding, Mend, column, number, place
from jaxmodel.case.records import Case, Run
from jaxmodel.model.curves import CellCurves

MENDS = (
    Mend("current_A", -1.0, "currents are positive on discharge"),
    Mend("current_A", 1e-3, "it is in mA"),
    Mend("capacity_Ah", 1e-3, "it is in mA h"),
    Mend("R_ints.ohm", 1e-3, "it is in mohm"),
    Mend("time_s", 60.0, "it is in minutes"),
    Mend("time_s", 3600.0, "it is in hours"),
    Mend("time_s", 1e-3, "it is in ms"),
    Mend("current_A", 1e3, "it is in kA"),
)
# RMS error as it stands over that mended. Of all runs together, and of one run by itself, what is certain; of all, what
# is likely. Of 42 real and made cases of 208 runs none has more than 0.75, and no run more than 1; with a wrong
# capacity or open-circuit voltage, none more than 1.3. A reversed current gives more than 2.1, mA more than 1000.
CERTAIN, CERTAIN_OF_ONE, LIKELY = 2.0, 3.0, 1.5
# Mends whose errors are within this factor are equally good.
_AS_GOOD = 1.3
# A mended error below this share of the open-circuit voltage counts as this share: less is luck.
_FLOOR = 0.008
# Runs of fewer readings show nothing of the kind; of each run so many readings are looked at.
_FEWEST, _MOST = 8, 100
_CAPACITIES = (0.5, 0.7, 1.0, 1.4, 2.0)
_ANY_CAPACITY = (0.15, 0.25, 0.35, *_CAPACITIES, 2.8, 4.0, 6.0)
_OFFSETS = (-0.2, -0.1, 0.0, 0.1, 0.2)
# Share of the stated resistance that is possible; where none is stated, resistance times capacity [ohm A h] of cells.
_OF_STATED = (0.1, 10.0)
_OF_CELLS = (0.01, 4.0)
_STARTS = np.linspace(0.0, 1.0, 26)
# Beyond empty and full by so much, a cell's voltage runs away by so many open-circuit voltages per unit of SOC.
_BEYOND, _RUNS_AWAY = 0.1, 2.0
# A capacity whose sd is so large a share of it is a guess (an import writes such a one where the files tell none).
_GUESSED = 0.45
# No cell gives more than so many capacities in one run, however badly the capacity is known.
_MOST_MOVED = 10.0


@dataclasses.dataclass(frozen=True, eq=False)
class Loop:
    """One run of a cell, or of a robot's pack as that of one cell.

    Attributes:
        run: which.
        time_s: of every row, shape (rows,).
        current_A: over the interval that ends at each row, positive on discharge.
        voltage_V: of one cell, NaN where it was not read.
        capacity_Ah: as stated.
        soc: of the open-circuit voltage, shape (points,).
        ocv_V: the open-circuit voltage there.
        ocv_stated: whether it is the case's own.
        resistance_ohm: as stated, None where it is not.
    """

    run: Run
    time_s: np.ndarray
    current_A: np.ndarray
    voltage_V: np.ndarray
    capacity_Ah: float
    soc: np.ndarray
    ocv_V: np.ndarray
    ocv_stated: bool
    resistance_ohm: float | None

    @property
    def nominal_V(self) -> float:
        """The middle of the open-circuit voltage."""
        return float(np.median(self.ocv_V))

    def moved(self, mend: Mend | None = None) -> np.ndarray:
        """Return the charge taken out as a share of the capacity, one quantity mended."""
        factor = 1.0 if mend is None else 1.0 / mend.factor if mend.name == "capacity_Ah" else mend.factor
        if mend is not None and mend.name == "R_ints.ohm":
            factor = 1.0
        steps = np.diff(self.time_s, prepend=self.time_s[0])
        return factor * np.cumsum(self.current_A * steps) / (3600.0 * self.capacity_Ah)

    def error(self, mend: Mend | None = None) -> float:
        """Return the RMS error in V of the best simple cell, one quantity mended."""
        factor = {} if mend is None else {mend.name: mend.factor}
        read = np.flatnonzero(np.isfinite(self.voltage_V))
        read = read[np.linspace(0, read.size - 1, min(read.size, _MOST)).astype(int)]
        current = factor.get("current_A", 1.0) * self.current_A[read]
        capacities = np.array(_ANY_CAPACITY if mend is None else _CAPACITIES)
        soc = _STARTS[:, None, None, None] - self.moved(mend)[read] / capacities[:, None, None]
        away = np.maximum(soc - 1.0 - _BEYOND, 0.0) + np.minimum(soc + _BEYOND, 0.0)
        left = self.voltage_V[read] - np.interp(soc, self.soc, self.ocv_V) - _RUNS_AWAY * self.nominal_V * away
        if mend is None and not self.ocv_stated:
            left = left + self.nominal_V * np.array(_OFFSETS)[:, None]
        power = float(current @ current)
        if power > 0.0:
            if self.resistance_ohm is None:
                limits = np.array(_OF_CELLS) / (factor.get("capacity_Ah", 1.0) * self.capacity_Ah)
            else:
                limits = np.array(_OF_STATED) * factor.get("R_ints.ohm", 1.0) * self.resistance_ohm
            resistance = np.clip(-(left @ current) / power, *limits)
            left = left + resistance[..., None] * current
        return float(np.sqrt(np.min(np.mean(left**2, axis=-1))))


def open_circuit(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return states of charge and the open-circuit voltage there, as stated or as the paper's."""
    if "ocv" in case.tables:
        table = case.tables["ocv"]
        return table.soc, np.median(np.atleast_2d(table.values), axis=0)
    return _of_the_paper()


@functools.cache
def _of_the_paper() -> tuple[np.ndarray, np.ndarray]:
    soc = np.linspace(0.0, 1.0, 41)
    # One kept program: each operation alone would be compiled again in every process.
    return soc, np.array(jax.jit(jax.vmap(CellCurves().ocv, (0, None)))(soc, 20.0))


def loop_of(case: Case, run: Run) -> Loop | None:
    """Return time, current and voltage of a run's cell, None where one of them was not measured, or hardly."""
    if case.kind == "cell":
        current, voltage, count = column(run, "current_A"), column(run, "voltage_V"), 1.0
    else:
        current, voltage = column(run, "pack_current_A"), column(run, "pack_voltage_V")
        count = number(case, "n_series", run)
    if current is None or voltage is None:
        return None
    there, time_s = np.isfinite(current), run.measured.time_s
    if min(np.sum(there), np.sum(np.isfinite(voltage))) < _FEWEST or not np.any(current[there]):
        return None
    current = np.interp(time_s, time_s[there], current[there])
    resistance = None
    if "R_ints" in case.tables:
        stated = float(np.median(case.tables["R_ints"].values))
        resistance = number(case, "series_resistance_scale", run) * stated
    capacity = number(case, "capacity_Ah", run)
    return Loop(run, time_s, current, voltage / count, capacity, *open_circuit(case), "ocv" in case.tables, resistance)


def wrong_cell(case: Case) -> Iterator[Finding]:
    """Yield the quantity of a cell or pack that must be mended for its voltage to be that of a cell."""
    if case.kind == "motor":
        return
    if _capacity_is_a_guess(case):  # what nobody measured is not held against the readings
        return
    loops = [loop for run in case.runs if (loop := loop_of(case, run)) is not None]
    if not loops:
        yield from _by_charge_alone(case)
        return
    mends = [mend for mend in MENDS if mend.name != "R_ints.ohm" or loops[0].resistance_ohm is not None]
    before = np.array([loop.error() for loop in loops])
    after = np.array([[loop.error(mend) for loop in loops] for mend in mends])
    if finding := _verdict(case, loops, mends, before, after, CERTAIN):
        yield _as_sure_as_the_capacity(case, finding)
        return
    for one in range(len(loops)):
        if finding := _verdict(case, loops[one:][:1], mends, before[one:][:1], after[:, one:][:, :1], CERTAIN_OF_ONE):
            yield _as_sure_as_the_capacity(case, finding)
            return
    if finding := _verdict(case, loops, mends, before, after, LIKELY):
        yield dataclasses.replace(finding, certain=False)


def _as_sure_as_the_capacity(case: Case, finding: Finding) -> Finding:
    """Return a finding that is uncertain where it rests on a capacity of a cell that nobody stated."""
    reversed_sign = any(mend.factor == -1.0 for mend in finding.mends)
    return finding if reversed_sign or not _capacity_of_the_paper(case) else dataclasses.replace(finding, certain=False)


def _capacity_of_the_paper(case: Case) -> bool:
    """Return whether no capacity of a cell is stated, so that the paper's stands in for it."""
    stated = "capacity_Ah" in case.parameters or any("capacity_Ah" in run.overrides for run in case.runs)
    return case.kind == "cell" and not stated


def _capacity_is_a_guess(case: Case) -> bool:
    stated = case.parameters.get("capacity_Ah")
    return stated is not None and (stated.sd or 0.0) >= _GUESSED * stated.value


def _verdict(
    case: Case, loops: list[Loop], mends: list[Mend], before: np.ndarray, after: np.ndarray, least: float
) -> Finding | None:
    """Return what must be mended where that reduces the error of some runs by a factor of `least`.

    Args:
        case: the case.
        loops: some of its runs.
        mends: those that are tried.
        before: RMS errors in V of the runs as they stand, shape (runs,).
        after: the same with each mend, shape (mends, runs).
        least: the factor.
    """
    as_it_is = float(np.sqrt(np.mean(before**2)))
    mended = np.maximum(np.sqrt(np.mean(after**2, axis=1)), _FLOOR * loops[0].nominal_V)
    best = float(mended.min())
    if as_it_is < least * best:
        return None
    good = [mends[place] for place in np.argsort(mended) if mended[place] < _AS_GOOD * best]
    return _finding(case, loops[int(before.argmax())], good, as_it_is, best)


def _finding(case: Case, loop: Loop, mends: list[Mend], before: float, after: float) -> Finding:
    if case.kind == "robot":
        mends = [dataclasses.replace(m, name="pack_current_A") if m.name == "current_A" else m for m in mends]
    first = mends[0]
    largest_A = float(loop.current_A[np.argmax(np.abs(loop.current_A))])
    capacity = f"capacity_Ah = {loop.capacity_Ah:g}"
    if _capacity_of_the_paper(case):
        capacity += " (the paper's, because none is stated: state it)"
    whole = "it" if first.name == "capacity_Ah" else capacity
    if first.name == "capacity_Ah":
        seen = capacity
    elif first.name == "time_s":
        seen = f"the run lasts {loop.time_s[-1] - loop.time_s[0]:.4g}"
    elif first.name == "R_ints.ohm":
        seen = f"R_ints.ohm has {np.median(case.tables['R_ints'].values):.4g} (median)"
    else:
        seen = f"{largest_A:.4g} (largest)"
    moved = float(np.ptp(loop.moved()))
    if first.factor == -1.0:
        possible = "the voltage moves as if its sign were reversed"
    elif first.name == "R_ints.ohm":
        possible = f"times the current that is up to {loop.resistance_ohm or 0.0:.3g} ohm x {largest_A:.3g} A"
    elif moved > 1.0:
        possible = f"the run moves {moved:.3g} times {whole}, and a cell holds it once"
    else:
        possible = f"the run moves only {moved:.2g} of {whole}, less than the voltage shows"
    possible += (
        f" (a simple cell model misses the voltage by {before:.2g} V RMS, and by {after:.2g} V after the correction)"
    )
    return Finding(place(case, loop.run, first), seen, possible, tuple(mends))


def _by_charge_alone(case: Case) -> Iterator[Finding]:
    """Yield a current whose charge no cell holds, where there is no voltage to tell more."""
    for run in case.runs:
        current = column(run, "current_A" if case.kind == "cell" else "pack_current_A")
        if current is None or not np.isfinite(current).any():
            continue
        current = np.where(np.isfinite(current), current, 0.0)
        steps = np.diff(run.measured.time_s, prepend=run.measured.time_s[0])
        capacity = number(case, "capacity_Ah", run)
        moved = float(np.ptp(np.cumsum(current * steps))) / (3600.0 * capacity)
        if moved > _MOST_MOVED:
            name = "current_A" if case.kind == "cell" else "pack_current_A"
            yield Finding(
                place(case, run, name),
                f"{current[np.argmax(np.abs(current))]:.4g} (largest)",
                f"its charge is {moved:.3g} times capacity_Ah = {capacity:g}, and a cell holds one",
                (Mend(name, 1e-3, "it is in mA"), Mend("time_s", 1e-3, "time_s is in ms")),
            )
            return
