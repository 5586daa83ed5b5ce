"""What a person may have mistaken about whole columns: mA, degrees Fahrenheit, two columns exchanged, a torque.

Each can be right after all, so that each is a finding, which says what looks odd and what to do; nothing is refused.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from jaxmodel.case.plausible.load import Load, Steady, load_of, number_of_times
from jaxmodel.case.plausible.ranges import LARGEST_CELL_AH
from jaxmodel.data.importing.ambient import THERMOMETERS, first_reading
from jaxmodel.data.importing.charge import Stated
from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.options import Options

SWAPPED = "exchanged columns"
# A cell's voltage is within these [V] and within this factor of itself, of any lithium chemistry (assumed).
_CELL_V, _CELL_V_FACTOR = (1.0, 4.6), 3.0
# A current is at rest below this [A], in at least this share of the rows (assumed).
_NO_CURRENT_A, _RESTS = 0.3, 0.005
# A current that is held keeps within this share of its median, in so many of the rows; a voltage then falls by more.
_HELD, _HELD_ROWS, _FALLS, _FALLS_WITH_TIME = 0.02, 0.9, 0.05, 0.8
# A cell is seldom loaded with more [A] (assumed).
_LARGEST_A = 500.0
# Rooms in degF are 18 to 30 degC (assumed); a cell is seldom measured above the second number [degC] (assumed).
_ROOM_DEGF, _HOT_CELL_DEGC, _HOTTEST_DEGF = (64.4, 86.0), 85.0, 150.0
# A thermometer that begins so near ambient as degF, and so far as degC, in every run.
_NEAR_K, _FAR_K = 3.0, 15.0
# Units by which a load torque differs, by what mends it.
_TORQUES = {1e-3: "mN m", 1e-2: "N cm", 0.0980665: "kgf cm"}


def exchanged(log: Log) -> Finding | None:
    """Return that the current of a cell's log looks like a voltage and its voltage like a current; None otherwise."""
    current, voltage = log.columns.get("current_A"), log.columns.get("voltage_V")
    if current is None or voltage is None:
        return None
    there = np.isfinite(current) & np.isfinite(voltage)
    current, voltage, time_s = current[there], voltage[there], log.time_s[there]
    if current.size < 8:
        return None
    low, high = float(current.min()), float(current.max())
    if not (_CELL_V[0] <= low and high <= min(_CELL_V[1], _CELL_V_FACTOR * low)):
        return None
    rests = float(np.mean(voltage < _NO_CURRENT_A)) >= _RESTS
    if not rests and not (_is_held(voltage) and _falls(current, time_s)):
        return None
    names = {target: column for column, target in log.header.items()}
    one, other = (names.get(target, target) for target in ("voltage_V", "current_A"))
    sentence = (
        f"{log.name}: current_A stays between {low:.3g} and {high:.3g} A as the voltage of a cell does, and voltage_V "
        f"goes from {voltage.min():.3g} to {voltage.max():.3g} V as its current does; if the two are exchanged, state "
        f'--column current_A="{one}" --column voltage_V="{other}" --unit "{one}=A" --unit "{other}=V".'
    )
    return Finding(SWAPPED, log.name, sentence, "warning", "current_A")


def _is_held(values: np.ndarray) -> bool:
    middle = float(np.median(values))
    return float(np.mean(np.abs(values - middle) <= _HELD * abs(middle))) >= _HELD_ROWS


def _falls(values: np.ndarray, time_s: np.ndarray) -> bool:
    if np.ptp(values) < _FALLS * float(np.median(values)) or np.ptp(time_s) == 0.0:
        return False
    return float(np.corrcoef(values, time_s)[0, 1]) < -_FALLS_WITH_TIME


def odd_units(
    runs: Sequence[Log], ambient_degC: Sequence[float | None], capacity: Stated | None, known: bool, options: Options
) -> Iterator[Finding]:  # fmt: skip
    """Yield what in all runs together looks like another unit.

    Args:
        runs: of one piece of hardware.
        ambient_degC: of each; None where it is a column.
        capacity: of a cell, None of other kinds.
        known: whether a full discharge gave that capacity.
        options: decisions of the user.
    """
    if capacity is not None:
        yield from _milliamperes(runs, capacity, known, options)
    yield from _fahrenheit(runs, ambient_degC, capacity is not None, options)
    yield from _torque(runs, options)
    yield from _no_drive(runs)


def _milliamperes(runs: Sequence[Log], capacity: Stated, known: bool, options: Options) -> Iterator[Finding]:
    measured = known and options.capacity_Ah is None  # what was guessed, or stated, is no reason to doubt a current
    sizes = [np.nanmax(np.abs(run.columns["current_A"]), initial=0.0) for run in runs]
    largest = float(max(sizes, default=0.0))
    if largest <= _LARGEST_A and not (measured and capacity.value > LARGEST_CELL_AH):
        return
    run = runs[int(np.argmax(sizes))]
    column = _column(run, "current_A")
    if column in options.units:
        return
    charge = f", and a full discharge gives {capacity.value:.4g} A h" if measured else ""
    few = f"few cells have more than {LARGEST_CELL_AH:g} A h" if measured else f"few cells carry {_LARGEST_A:g} A"
    sentence = (
        f"{run.name}: current_A goes up to {largest:.4g} A{charge}; {few}. If column '{column}' is in mA, state --unit "
        f'"{column}=mA"; if it is of cells in parallel, --parallel-cells N.'
    )
    yield Finding("odd size of the current", "", sentence, "warning", "current_A", numbers={"largest_A": largest})


def _fahrenheit(
    runs: Sequence[Log], ambient_degC: Sequence[float | None], of_cells: bool, options: Options
) -> Iterator[Finding]:  # fmt: skip
    warmth = [
        float(np.nanmedian(run.columns["ambient_degC"])) if constant is None else constant
        for run, constant in zip(runs, ambient_degC, strict=True)
    ]
    firsts = [first_reading(run) for run in runs]
    rooms = all(_ROOM_DEGF[0] <= degrees <= _ROOM_DEGF[1] for degrees in warmth)
    if rooms or (of_cells and _HOT_CELL_DEGC < max(warmth, default=0.0) <= _HOTTEST_DEGF):
        hottest = int(np.argmax(warmth))
        run, degrees = runs[hottest], warmth[hottest]
        if options.ambient is None and any(
            _column(run, name) in options.units for name in ("ambient_degC", *THERMOMETERS)
        ):
            return  # the user has stated its unit
        rarely = f"cells are seldom measured above {_HOT_CELL_DEGC:g} degC" if not rooms else "a room is colder"
        sentence = (
            f"{run.name}: the ambient temperature is {degrees:.4g} degC, and {rarely}; {_celsius(degrees)}, and then "
            f"{_how(run, options)}."
        )
        yield Finding("odd temperature", "", sentence, "warning", "ambient_degC", numbers={"degC": degrees})
        return
    apart = [(first, at) for first, at in zip(firsts, warmth, strict=True) if first is not None]
    far = all(abs(first - at) >= _FAR_K for first, at in apart)
    if apart and far and all(abs(_as_celsius(first) - at) < _NEAR_K for first, at in apart):
        run = next(run for run, first in zip(runs, firsts, strict=True) if first is not None)
        name = next(name for name in THERMOMETERS if name in run.columns)
        first, at = apart[0]
        sentence = (
            f"{run.name}: {name} begins with {first:.4g} degC at an ambient temperature of {at:.4g} degC, and in every "
            f"run that is the same in degF; if column '{_column(run, name)}' is in degF, state --unit "
            f'"{_column(run, name)}=degF".'
        )
        yield Finding("odd temperature", "", sentence, "warning", name, numbers={"degC": first})


def _no_drive(runs: Sequence[Log]) -> Iterator[Finding]:
    """Yield that a motor turns though its voltage is 0 throughout, as of a channel that nothing was connected to."""
    for run in runs:
        voltage, speed = run.columns.get("voltage_V"), run.columns.get("speed_rad_s")
        if voltage is None or speed is None or np.any(np.nan_to_num(voltage)):
            continue
        fastest = float(np.nanmax(np.abs(speed), initial=0.0))
        if fastest == 0.0:
            continue
        sentence = (
            f"{run.name}: voltage_V is 0 in every row, and speed_rad_s goes up to {fastest:.3g} rad/s; if nothing was "
            'connected to that channel, name another with --column voltage_V="NAME", or leave the run out.'
        )
        yield Finding("no drive", run.name, sentence, "warning", "voltage_V")


def _as_celsius(degF: float) -> float:
    return (degF - 32.0) / 1.8


def _celsius(degF: float) -> str:
    return f"in degF it would be {_as_celsius(degF):.3g} degC"


def _how(run: Log, options: Options) -> str:
    """Return how to say that the ambient temperature of a run is in degF."""
    if options.ambient is not None:
        return f"state --ambient {_as_celsius(options.ambient):.3g}"
    source = next((name for name in ("ambient_degC", *THERMOMETERS) if name in run.columns), "")
    if source and _column(run, source):
        return f'state --unit "{_column(run, source)}=degF"'
    return "state --ambient DEGC"


def _torque(runs: Sequence[Log], options: Options) -> Iterator[Finding]:
    names = ("voltage_V", "current_A", "speed_rad_s", "load_torque_Nm")
    read = [run for run in runs if all(name in run.columns for name in names)]
    found: Load | None = load_of(Steady(run.time_s, *(run.columns[name] for name in names)) for run in read)
    if found is None or found.possible:
        return
    column = _column(read[0], "load_torque_Nm")
    factor = 0.0 if found.mend is None else found.mend.factor
    small = found.ratio > 1.0
    size = (
        f"{number_of_times(found.ratio)} times too small"
        if small
        else f"{number_of_times(1.0 / found.ratio)} times too large"
    )
    mends = f'--unit "{column}={_TORQUES[factor]}"' if factor in _TORQUES else f'--unit "{column}=UNIT"'
    if small and factor:
        mends = f'--column load_torque_Nm="{factor:g} * {column}"'
    sentence = (
        f"load_torque_Nm looks {size}: {found.sentence()}. Correct it with {mends}, or give the torque at the shaft of "
        "the motor if a gear is between."
    )
    yield Finding("odd size of the torque", "", sentence, "warning", "load_torque_Nm", numbers={"ratio": found.ratio})


def _column(run: Log, target: str) -> str:
    """Return the column of the file that became a column of the case."""
    return next((column for column, became in run.header.items() if became == target), target)
