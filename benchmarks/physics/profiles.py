"""The runs of a bench: discharges, pulses, loops and drive cycles as steps of current, and the ambients they run at.

A plan says what is wanted in units of the capacity. A step holds its current until its end, and rows are as far apart
as the plan says.
"""

from __future__ import annotations

import dataclasses

import numpy as np

# All that follows is assumed: what a bench with one channel and a chamber does in a week.
COLD_DEGC, WARM_DEGC, BETWEEN_DEGC = (5.0, 15.0), (32.0, 42.0), (16.0, 30.0)
SLOW_RATE, FAST_RATE = (0.3, 0.6), (0.7, 1.2)
PULSE_RATE, DRIVE_RATE = (0.6, 1.2), (0.8, 1.6)
BETWEEN_SOC, BETWEEN_RATE, CHARGED = 0.12, 0.6, 0.6  # what is drawn before each pair of pulses; the charge's size
REST_S, START_S = 900.0, 60.0
DRIVE_S = 2400.0
DRIVE_MEAN = 0.25  # of the largest current of a drive cycle
LOWEST_SOC = 0.1


@dataclasses.dataclass(frozen=True)
class Plan:
    """One run.

    Attributes:
        kind: "pulses", "discharge", "loop" or "drive".
        split: "fit" or "check".
        ambient_degC: of the chamber.
        first_soc: where it begins.
        rate: its largest current over the one-hour current.
        every_s: seconds between rows.
        seed: of what else is drawn in it.
    """

    kind: str
    split: str
    ambient_degC: float
    first_soc: float
    rate: float
    every_s: float
    seed: int


def draw_plans(rng: np.random.Generator, several: bool, reference_degC: float) -> tuple[Plan, ...]:
    """Return the runs of a cell.

    Args:
        rng: the source of what is drawn.
        several: whether they are at several ambients; else all are at the reference.
        reference_degC: of the base's tests.
    """
    cold, warm, between, other = (
        float(np.round(rng.uniform(*span))) for span in (COLD_DEGC, WARM_DEGC, BETWEEN_DEGC, BETWEEN_DEGC)
    )
    ambients = [reference_degC, cold, warm, rng.choice((cold, warm, reference_degC)), between, other]
    kinds = [("pulses", PULSE_RATE), ("discharge", SLOW_RATE), ("drive", DRIVE_RATE), ("loop", SLOW_RATE)]
    checks = [("drive", DRIVE_RATE), ("discharge", FAST_RATE)]
    rng.shuffle(kinds)
    found = []
    for place, (kind, span) in enumerate([*kinds, *checks]):
        found.append(
            Plan(
                kind=kind,
                split="fit" if place < len(kinds) else "check",
                ambient_degC=float(ambients[place]) if several else reference_degC,
                first_soc=float(np.round(rng.uniform(0.85, 0.95), 3)),
                rate=float(np.round(rng.uniform(*span), 3)),
                every_s=5.0 if kind in ("discharge", "loop") else 2.0,
                seed=int(rng.integers(2**31)),
            )
        )
    return tuple(found)


def steps(plan: Plan, capacity_Ah: float) -> list[tuple[float, float]]:
    """Return the steps of a run: seconds that each lasts, and its current (A, positive on discharge)."""
    rng, one_hour = np.random.default_rng(plan.seed), capacity_Ah
    make = {"pulses": _pulses, "discharge": _discharge, "loop": _loop, "drive": _drive}[plan.kind]
    return [(float(np.ceil(seconds)), float(rate * one_hour)) for seconds, rate in make(plan, rng)]


def rows_of_steps(parts: list[tuple[float, float]], every_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (s) and currents (A) at rows; a current holds over the step that ends at its row.

    A step that does not end at a multiple of `every_s` has a row at its end too.
    """
    ends = np.cumsum([seconds for seconds, _ in parts])
    time_s = np.union1d(np.arange(0.0, ends[-1] + 1e-9, every_s), ends)
    current = np.array([ampere for _, ampere in parts])
    return time_s, np.where(time_s > 0.0, current[np.searchsorted(ends, time_s)], 0.0)


def _pulses(plan: Plan, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Pulses of both signs at states of charge from the first downwards."""
    found = [(START_S, 0.0)]
    for _ in range(6):
        seconds = rng.uniform(10.0, 40.0)
        found += [(BETWEEN_SOC * 3600.0 / BETWEEN_RATE, BETWEEN_RATE), (rng.uniform(200.0, REST_S), 0.0)]
        found += [(seconds, plan.rate), (rng.uniform(40.0, 120.0), 0.0), (seconds, -CHARGED * plan.rate)]
        found += [(rng.uniform(60.0, 180.0), 0.0)]
    return found


def _discharge(plan: Plan, rng: np.random.Generator) -> list[tuple[float, float]]:
    """A constant current down to a low state of charge, and a rest."""
    seconds = (plan.first_soc - LOWEST_SOC) * 3600.0 / plan.rate
    return [(START_S, 0.0), (seconds, plan.rate), (REST_S, 0.0)]


def _loop(plan: Plan, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Out, charge and back, with rests."""
    swings = (rng.uniform(0.4, 0.6), -rng.uniform(0.2, 0.4), rng.uniform(0.15, 0.3), -rng.uniform(0.1, 0.25))
    found = [(START_S, 0.0)]
    for swing in swings:
        found += [(abs(swing) * 3600.0 / plan.rate, np.sign(swing) * plan.rate), (REST_S, 0.0)]
    return found


def _drive(plan: Plan, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Pull away, cruise, brake and stand, over and over, the mean a set share of the largest current."""
    found, lasted = [(START_S, 0.0)], START_S
    while lasted < DRIVE_S:
        hard = rng.uniform(0.3, 1.0)
        phases = [
            (rng.uniform(5.0, 20.0), hard),
            (rng.uniform(20.0, 80.0), rng.uniform(0.1, 0.5) * hard),
            (rng.uniform(5.0, 15.0), -rng.uniform(0.1, 0.5) * hard),
            (rng.uniform(5.0, 60.0), 0.0),
        ]
        found += phases
        lasted += sum(seconds for seconds, _ in phases)
    charge = sum(seconds * share for seconds, share in found)
    scale = plan.rate * min(1.0, DRIVE_MEAN * lasted / charge)
    return [(seconds, share * scale) for seconds, share in found]
