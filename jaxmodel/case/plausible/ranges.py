"""What single columns and tables can hold, whatever the others say."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from jaxmodel.case.measurements import AMBIENT_RANGE_DEGC
from jaxmodel.case.plausible.cell import open_circuit
from jaxmodel.case.plausible.finding import Finding, Mend, column, number, place
from jaxmodel.case.records import Case, Run

Limits = Callable[[Case, Run], tuple[float, float]]


@dataclasses.dataclass(frozen=True)
class Rule:
    """What a column can hold.

    Attributes:
        channel: the column.
        limits: its least and largest possible value, from the case's own numbers.
        because: whose limits these are, with "{low}" and "{high}".
        mends: tried in order: (factor, offset, when, todo).
        every: every value must be within (an input outside its domain); else the median, so that a sensor that failed
            for a while is left to the diagnosis, and only where a mend brings it inside.
    """

    channel: str
    limits: Limits
    because: str
    mends: tuple[Mend, ...]
    every: bool = False


def _fixed(low: float, high: float) -> Limits:
    return lambda case, run: (low, high)


def _cell_voltage(case: Case, run: Run) -> tuple[float, float]:
    """Between a failing and a hard charged cell: 0.3 and 2 times the median open-circuit voltage (assumed)."""
    middle = float(np.median(open_circuit(case)[1]))
    return 0.3 * middle, 2.0 * middle


def _pack_voltage(case: Case, run: Run) -> tuple[float, float]:
    low, high = _cell_voltage(case, run)
    count = number(case, "n_series", run)
    return count * low, count * high


def _scaled(name: str, symbol: str) -> tuple[Mend, Mend]:
    return Mend(name, 1e-3, f"it is in m{symbol}"), Mend(name, 1e3, f"it is in k{symbol}")


def _celsius(name: str) -> tuple[Mend, Mend]:
    return (
        Mend(name, 1.0, "it is in kelvin", -273.15, f"subtract 273.15 from {name}"),
        Mend(name, 1.0 / 1.8, "it is in degF", -32.0, f"subtract 32 from {name} and divide by 1.8"),
    )


_TEMPERATURE = "temperatures are in degC, here {low:g} to {high:g}"
_DUTY = "a duty is {low:g} to {high:g}"
# The hottest winding: insulation of the best class lives to 220 degC.
RULES = (
    Rule("ambient_degC", _fixed(*AMBIENT_RANGE_DEGC), _TEMPERATURE, _celsius("ambient_degC"), every=True),
    Rule("cell_temperature_degC", _fixed(-90.0, 200.0), _TEMPERATURE, _celsius("cell_temperature_degC")),
    Rule("winding_temperature_degC", _fixed(-90.0, 250.0), _TEMPERATURE, _celsius("winding_temperature_degC")),
    Rule("case_temperature_degC", _fixed(-90.0, 250.0), _TEMPERATURE, _celsius("case_temperature_degC")),
    *(
        Rule(name, _fixed(-1.0, 1.0), _DUTY, (Mend(name, 0.01, "it is in percent"),), every=True)
        for name in ("duty", "flipper_duty", "arm_duty")
    ),
    Rule("V_set", _fixed(0.0, 5.0), "the set voltage of eq. 22 is {low:g} to {high:g} V", _scaled("V_set", "V"), True),
    Rule(
        "incline_deg",
        _fixed(-90.0, 90.0),
        "an incline is {low:g} to {high:g} degrees",
        (),
        every=True,
    ),
    Rule(
        "soc",
        _fixed(-0.5, 1.5),
        "a state of charge is a fraction, {low:g} to {high:g} with its errors",
        (Mend("soc", 0.01, "it is in percent"),),
        every=True,
    ),
    Rule(
        "voltage_V",
        _cell_voltage,
        "a cell of this open-circuit voltage has {low:.3g} to {high:.3g} V",
        _scaled("voltage_V", "V"),
    ),
    Rule(
        "pack_voltage_V",
        _pack_voltage,
        "a pack of these cells has {low:.3g} to {high:.3g} V",
        _scaled("pack_voltage_V", "V"),
    ),
)
RULE_OF = {rule.channel: rule for rule in RULES}


def mend_into(channel: str, value: float, low: float, high: float) -> Mend | None:
    """Return the mistake of unit that explains why a value of a column is outside its limits; None if none does."""
    mends = RULE_OF[channel].mends if channel in RULE_OF else ()
    return next((mend for mend in mends if low <= float(mend.apply(value)) <= high), None)


# More hold few: those of stationary stores have 280 to 314 A h, some of the newest more (assumed) [A h]. What is beyond
# may be, and is said.
LARGEST_CELL_AH = 400.0
# Resistance of a new cell times its capacity: it drops 150 mV at 1C. Assumed.
USUAL_OHM_AH = 0.15
# A single cell, or a pack that is taken for one, has no more [V]; mV of any chemistry are more.
_MOST_OCV = 1000.0


def wrong_columns(case: Case, run: Run) -> Iterator[Finding]:
    """Yield every column of a run that holds what cannot be."""
    for rule in RULES:
        values = column(run, rule.channel)
        if values is None or (rule.channel == "voltage_V" and case.kind != "cell"):
            continue
        there = np.isfinite(values)
        low, high = rule.limits(case, run)
        middle = float(np.median(values[there])) if there.any() else low
        outside = there & ((values < low) | (values > high))
        if not (outside.any() if rule.every else not low <= middle <= high):
            continue
        mends = [*rule.mends, *_cells_in_series(case, run, rule.channel, middle)]
        typical = float(np.median(values[outside])) if rule.every else middle
        mends = [mend for mend in mends if low <= float(mend.apply(typical)) <= high][:1]
        if not rule.every and not mends:
            continue
        row = int(outside.argmax())
        seen = f"{values[row]:.6g} at time_s = {run.measured.time_s[row]:g}" if rule.every else f"{middle:.6g} (median)"
        possible = rule.because.format(low=low, high=high)
        yield Finding(place(case, run, rule.channel), seen, possible, tuple(mends))


def _cells_in_series(case: Case, run: Run, channel: str, middle: float) -> Iterator[Mend]:
    """Yield the mend of a pack's voltage given as a cell's, or the other way round."""
    nominal = float(np.median(open_circuit(case)[1]))
    if channel == "voltage_V":
        count = round(middle / nominal)
        if count > 1 and 0.85 < middle / (count * nominal) < 1.1:
            todo = f"divide {channel} by the number of cells, or state the open-circuit voltage of this cell"
            yield Mend(channel, 1.0 / count, f"it is that of {count} cells in series", todo=todo)
    elif channel == "pack_voltage_V":
        count = number(case, "n_series", run)
        yield Mend(channel, count, "it is that of one cell", todo=f"multiply {channel} by n_series = {count:g}")


def wrong_tables(case: Case) -> Iterator[Finding]:
    """Yield an open-circuit voltage that no cell has."""
    if "ocv" in case.tables and (middle := float(np.median(case.tables["ocv"].values))) > _MOST_OCV:
        run = case.runs[0]
        mend = Mend("ocv.voltage_V", 1e-3, "it is in mV")
        yield Finding(
            place(case, run, mend),
            f"ocv.voltage_V has {middle:.6g} (median)",
            f"no cell has more than {_MOST_OCV:g} V",
            (mend,),
        )


def fahrenheit(case: Case) -> Iterator[Finding]:
    """Yield temperatures that begin at ambient only if they are in degF: one run may begin warm, all do not."""
    for channel in ("cell_temperature_degC", "winding_temperature_degC", "case_temperature_degC"):
        starts = []
        for run in case.runs:
            read, ambient = column(run, channel), column(run, "ambient_degC")
            if read is not None and ambient is not None and np.isfinite(read).any():
                starts.append((float(read[np.isfinite(read)][0]), float(ambient[0])))
        mend = _celsius(channel)[1]
        if not starts or any(abs(start - ambient) < 15.0 for start, ambient in starts):
            continue
        if all(abs(float(mend.apply(start)) - ambient) < 3.0 for start, ambient in starts):
            run = next(run for run in case.runs if column(run, channel) is not None)
            first = next(iter(starts))
            yield Finding(
                place(case, run, channel),
                f"{first[0]:.4g} at the first row",
                f"ambient_degC is {first[1]:.4g} there, as in every run the same temperature in degF",
                (mend,),
                certain=len({round(ambient) for _, ambient in starts}) > 1,
            )
