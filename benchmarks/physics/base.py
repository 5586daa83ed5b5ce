"""What a bench makes of a cell at 25 degC before anything is diagnosed: capacity, open-circuit table, two RC pairs.

V = U(SOC) - R_0 i - V_S - V_L,   tau_x dV_x/dt = R_x i - V_x,   R_0, R_x and C_x over SOC
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from scipy.optimize import nnls

from benchmarks.physics.draw import REFERENCE_DEGC, Recipe
from benchmarks.physics.reality import FULL, NotSimulated, Reality
from benchmarks.real.least_squares import relaxed

SLOW_RATE = 1.0 / 50.0
SLOW_ROWS_S = 120.0
# Closer where open-circuit curves bend, as in the cases dfn-*.
OCV_SOC = np.round(np.hstack([np.linspace(0.0, 0.1, 21), np.linspace(0.11, 1.0, 90)]), 4)
RESISTANCE_SOC = np.round(np.linspace(0.0, 1.0, 21), 4)
# The pulse test, assumed: at every twentieth of the charge a pulse of two and a half minutes at C/2 and its rest.
PULSE_RATE, PULSE_SOC, PULSE_REST_S = 0.5, 0.02, 900.0
STEP_SOC, STEP_REST_S = 0.05, 1800.0
LEAST_PULSES = 0.7  # of those planned: a cell whose voltage gives way before is no cell of this bench
SHORT_TAU_S = np.geomspace(3.0, 30.0, 8)
LONG_TAU_S = np.geomspace(50.0, 400.0, 8)
LEAST_OHM_AH = 1e-6  # times one over the capacity: a table needs a resistance above zero


@dataclasses.dataclass(frozen=True, eq=False)
class Base:
    """The base model.

    Attributes:
        capacity_Ah: of the C/50 discharge.
        ocv_V: at OCV_SOC.
        ohm: R_ints, R_TS and R_TL at RESISTANCE_SOC.
        farad: C_TS and C_TL at RESISTANCE_SOC.
        pulse_rms_V: what the two pairs leave of the pulse test.
    """

    capacity_Ah: float
    ocv_V: np.ndarray
    ohm: dict[str, np.ndarray]
    farad: dict[str, np.ndarray]
    pulse_rms_V: float

    def open_V(self, soc: np.ndarray) -> np.ndarray:
        """Return the open-circuit voltage at states of charge."""
        return np.interp(soc, OCV_SOC, self.ocv_V)

    def soc_of_set(self, soc: float, capacity_of_set_Ah: float) -> float:
        """Return a state of charge as the parameter set counts it, between its limits of the open-circuit voltage."""
        return FULL - (1.0 - soc) * self.capacity_Ah / capacity_of_set_Ah


def measure(reality: Reality, recipe: Recipe) -> Base:
    """Return the base model of a cell, from tests of the same cell at 25 degC without noise.

    A cell with a loop is charged slowly too, and its table is the middle of both branches.

    Raises:
        NotSimulated: a test failed.
    """
    branch = _slow(reality, recipe, SLOW_RATE, FULL, "charge")
    capacity = branch[0][-1]
    ocv = np.interp(OCV_SOC, *_ascending(1.0 - branch[0] / capacity, branch[1]))
    if recipe.hysteresis != "none":
        least = FULL - capacity / recipe.capacity_Ah
        charged, voltage = _slow(reality, recipe, -SLOW_RATE, max(least, 0.002), "discharge")
        ocv = 0.5 * (ocv + np.interp(OCV_SOC, *_ascending(-charged / capacity, voltage)))
    return _pulse_test(reality, recipe, capacity, ocv)


def _slow(reality: Reality, recipe: Recipe, rate: float, first: float, after: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the charge taken out (A h) and the voltage of a slow run until a limit."""
    time_s = np.arange(0.0, 1.05 * 3600.0 / abs(rate), SLOW_ROWS_S)
    current = np.full(time_s.size, rate * recipe.capacity_Ah)
    trace = reality.run(time_s, current, first, REFERENCE_DEGC, at_reference=True, after=after)
    if trace.time_s.size == time_s.size:
        raise NotSimulated("the slow run did not reach a limit of the voltage")
    return trace.time_s * current[0] / 3600.0, trace.voltage_V


def _ascending(soc: np.ndarray, voltage: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(soc)
    return soc[order], voltage[order]


def _pulse_test(reality: Reality, recipe: Recipe, capacity_Ah: float, ocv_V: np.ndarray) -> Base:
    """Fit one resistance and two pairs to each pulse and the rest after it, their time constants to all together."""
    rate_A = PULSE_RATE * capacity_Ah
    pulse_s, step_s = (share * 3600.0 / PULSE_RATE for share in (PULSE_SOC, STEP_SOC - PULSE_SOC))
    parts = [(pulse_s, rate_A), (PULSE_REST_S, 0.0), (step_s, rate_A), (STEP_REST_S, 0.0)]
    ends = np.cumsum([seconds for seconds, _ in parts])
    cycle = np.concatenate(
        [end - seconds + _closer(seconds)[1:] for end, (seconds, _) in zip(ends, parts, strict=True)]
    )
    drawn = np.repeat([ampere for _, ampere in parts], [_closer(seconds).size - 1 for seconds, _ in parts])
    count = round((1.0 - STEP_SOC) / STEP_SOC)
    time_s = np.concatenate([[0.0], *(number * ends[-1] + cycle for number in range(count))])
    current = np.concatenate([[0.0], np.tile(drawn, count)])
    trace = reality.run(time_s, current, FULL, REFERENCE_DEGC, at_reference=True, after="charge")
    soc = 1.0 - np.append(0.0, np.cumsum(np.diff(trace.time_s) * trace.current_A[1:])) / 3600.0 / capacity_Ah
    drop = np.interp(soc, OCV_SOC, ocv_V) - trace.voltage_V
    fitted = int(np.count_nonzero(cycle <= ends[1] + 1e-6))
    pulses = [slice(first, first + fitted + 1) for first in range(0, trace.time_s.size - fitted, cycle.size)]
    if len(pulses) < LEAST_PULSES * count:
        raise NotSimulated(f"the pulse test ended at the pulse {len(pulses) + 1} of {count}")
    at = np.array([soc[own.start] - 0.5 * PULSE_SOC for own in pulses])[::-1]
    own_time = time_s[: fitted + 1]

    def misfit(taus: tuple[float, float]) -> float:
        return sum(_ohms(own_time, current[own], drop[own], taus)[1] ** 2 for own in pulses)

    taus = min(itertools.product(SHORT_TAU_S, LONG_TAU_S), key=misfit)
    values = np.array([_ohms(own_time, current[own], drop[own], taus)[0] for own in pulses])[::-1]
    least = LEAST_OHM_AH / capacity_Ah
    ohm = [np.maximum(np.interp(RESISTANCE_SOC, at, column), least) for column in values.T]
    return Base(
        capacity_Ah,
        ocv_V,
        dict(zip(("R_ints", "R_TS", "R_TL"), ohm, strict=True)),
        {"C_TS": taus[0] / ohm[1], "C_TL": taus[1] / ohm[2]},
        float(np.sqrt(misfit(taus) / (len(pulses) * fitted))),
    )


def _closer(lasts_s: float) -> np.ndarray:
    """Return times of a step, closer at its beginning."""
    parts = [np.arange(0.0, 20.0), np.arange(20.0, 120.0, 4.0), np.arange(120.0, lasts_s, 20.0), [lasts_s]]
    return np.unique(np.concatenate(parts)[np.concatenate(parts) <= lasts_s])


def _ohms(
    time_s: np.ndarray, current: np.ndarray, drop: np.ndarray, taus: tuple[float, float]
) -> tuple[np.ndarray, float]:
    """Return R_0, R_S and R_L of a pulse from rest, and the norm of what they leave; a constant drop is free."""
    level = np.ones(time_s.size)
    columns = np.column_stack([current, *(relaxed(time_s, current, tau) for tau in taus), level, -level])
    values, norm = nnls(columns[1:], drop[1:])  # the first row is before the pulse
    return values[:3], float(norm)


@dataclasses.dataclass(frozen=True, eq=False)
class Drops:
    """The parts of the base model's voltage, each (rows,): V = open_V - series_V - short_V - long_V."""

    open_V: np.ndarray
    series_V: np.ndarray
    short_V: np.ndarray
    long_V: np.ndarray

    @property
    def voltage_V(self) -> np.ndarray:
        """The voltage."""
        return self.open_V - self.series_V - self.short_V - self.long_V


def drops(
    base: Base,
    time_s: np.ndarray,
    current_A: np.ndarray,
    first_soc: float,
    *,
    capacity_Ah: float | None = None,
    slower: float = 1.0,
) -> Drops:
    """Return what the base model says of a run from rest.

    Args:
        base: the model.
        time_s: (rows,).
        current_A: (rows,); holds over the step that ends at its row.
        first_soc: where it begins.
        capacity_Ah: another than the base's.
        slower: factor of all capacitances.
    """
    counted = np.append(0.0, np.cumsum(np.diff(time_s) * current_A[1:])) / 3600.0
    soc = first_soc - counted / (capacity_Ah or base.capacity_Ah)
    ohm = {name: np.interp(soc, RESISTANCE_SOC, values) for name, values in base.ohm.items()}
    farad = {name: np.interp(soc, RESISTANCE_SOC, values) for name, values in base.farad.items()}
    pairs = []
    for of in ("S", "L"):
        tau = ohm[f"R_T{of}"] * farad[f"C_T{of}"] * slower
        pairs.append(_lagged(time_s, current_A * ohm[f"R_T{of}"], tau))
    return Drops(base.open_V(soc), ohm["R_ints"] * current_A, pairs[0], pairs[1])


def _lagged(time_s: np.ndarray, drive: np.ndarray, tau_s: np.ndarray) -> np.ndarray:
    """Return the first-order response to a drive with a time constant that moves along the rows."""
    kept = np.exp(-np.diff(time_s) / tau_s[1:])
    found = np.zeros(time_s.size)
    for row, share in enumerate(kept, start=1):
        found[row] = share * found[row - 1] + (1.0 - share) * drive[row]
    return found
