"""What a right answer about a cell names, from its twins: the same runs without one hidden thing.

A hidden thing is material where the difference to its twin, after the numbers that the base calibrates have taken what
they can of it, has an RMS over the fit runs that is larger than the sensor's noise, in any channel. What is material is
expected. What is there and not material is allowed: naming it is neither right nor wrong. Everything else is wrong.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from benchmarks.physics.base import Base, drops
from benchmarks.physics.simulate import Simulated, SimulatedRun
from benchmarks.physics.writing import CAPACITY_SD, COLUMN_OF, OFFSET_SD_V, SCALE_SD, SOC_SD, misread

# Larger than the noise: assumed. A fit of thousands of readings sees a tenth of it, and a user would not miss that.
MATERIAL = 1.0
ALWAYS_ALLOWED = ("charge_transfer", "slow_diffusion")  # true of every cell here, whatever their size
# What names a hidden thing: either of the names; "name:parameter" if that parameter is clearly not zero, and
# "curve:port" if a curve on that port is told.
NAMES = {
    "activation": "arrhenius_resistance|arrhenius_polarisation|charge_transfer:E_i",
    "heat": "self_heating",
    "entropy": "entropic_ocv|curve:entropy_coefficient",
    "hysteresis": "ocv_hysteresis",
}
NUDGE = 0.02  # of an sd, of a difference quotient


@dataclasses.dataclass(frozen=True)
class Truth:
    """What is judged by.

    Attributes:
        expected: what has to be named, each as in `NAMES` or the name of a fault.
        allowed: names that are not wrong, expected ones among them.
        verdicts: that are not wrong.
        sizes: by hidden thing and channel, RMS over fit runs of the difference to the twin ("moves"), what the base's
            numbers leave of it ("left") and the noise ("noise").
    """

    expected: tuple[str, ...]
    allowed: tuple[str, ...]
    verdicts: tuple[str, ...]
    sizes: dict[str, dict[str, dict[str, float]]]


def truth_of(found: Simulated) -> Truth:
    """Return what a right answer about a cell names."""
    recipe, fitted = found.recipe, [run for run in found.runs if run.plan.split == "fit"]
    sizes = {}
    for name in recipe.hidden:
        sizes[name] = _sizes(found, fitted, [_moved_by_twin(run, name, recipe.thermometer) for run in fitted])
    if recipe.fault:
        sizes[recipe.fault] = _sizes(found, fitted, [_moved_by_fault(found, run) for run in fitted])
    return decide(sizes, recipe.fault)


def decide(sizes: dict[str, dict[str, dict[str, float]]], fault: str) -> Truth:
    """Return the truth of a cell from the sizes of what is hidden in it."""
    names = {thing: NAMES.get(thing, thing) for thing in sizes}
    material = [
        thing
        for thing, channels in sizes.items()
        if any(size["left"] > MATERIAL * size["noise"] for size in channels.values())
    ]
    allowed = {*ALWAYS_ALLOWED}
    for either in names.values():
        allowed |= {one.partition(":")[0] for one in either.split("|") if not one.startswith("curve:")}
    if [thing for thing in material if thing != fault]:
        verdicts = ("missing_effect", "unknown_effect", "undecided")
    elif material:
        verdicts = ("sensor_fault", "missing_effect", "undecided")
    else:
        verdicts = ("adequate", "missing_effect", "undecided", *(("sensor_fault",) if fault else ()))
    return Truth(tuple(names[thing] for thing in material), tuple(sorted(allowed)), verdicts, sizes)


def _moved_by_twin(run: SimulatedRun, name: str, thermometer: bool) -> dict[str, np.ndarray]:
    """Return by channel how a hidden thing moves a run, up to where the first of both ended."""
    twin = run.twins[name]
    rows = min(run.trace.time_s.size, twin.time_s.size)
    moved = {"voltage_V": run.trace.voltage_V[:rows] - twin.voltage_V[:rows]}
    if thermometer:
        moved["cell_temperature_degC"] = run.trace.temperature_degC[:rows] - twin.temperature_degC[:rows]
    return moved


def _moved_by_fault(found: Simulated, run: SimulatedRun) -> dict[str, np.ndarray]:
    """Return by channel how a sensor fault moves what a run leaves of the base model."""
    recipe, trace = found.recipe, run.trace
    column = COLUMN_OF[recipe.fault]
    true = {"current_A": trace.current_A, "voltage_V": trace.voltage_V, "cell_temperature_degC": trace.temperature_degC}
    read = misread(recipe.fault, recipe.fault_size, trace.time_s, true[column])
    moved = {"voltage_V": np.zeros(trace.time_s.size)}
    if recipe.thermometer:
        moved["cell_temperature_degC"] = np.zeros(trace.time_s.size)
    if column == "current_A":
        said = [drops(found.base, trace.time_s, current, run.first_soc).voltage_V for current in (true[column], read)]
        return moved | {"voltage_V": said[0] - said[1]}
    return moved | {column: read - true[column]}


def _sizes(
    found: Simulated, fitted: list[SimulatedRun], moved: list[dict[str, np.ndarray]]
) -> dict[str, dict[str, float]]:
    noise = found.recipe.noise
    volts = [one["voltage_V"] for one in moved]
    designs = [_by_numbers(found.base, run)[: each.size] for run, each in zip(fitted, volts, strict=True)]
    left = {"voltage_V": recalibrated(designs, volts, noise["voltage_V"])}
    sizes = {}
    for channel in moved[0]:
        whole = np.concatenate([one[channel] for one in moved])
        rest = left.get(channel, whole)  # the base has no number that moves a temperature
        sizes[channel] = {"moves": _rms(whole), "left": _rms(rest), "noise": noise[channel]}
    return sizes


def _by_numbers(base: Base, run: SimulatedRun) -> np.ndarray:
    """Return how one sd of each number that the base calibrates moves the voltage of a run, shape (rows, 6)."""
    time_s, current, soc = run.trace.time_s, run.trace.current_A, run.first_soc
    plain = drops(base, time_s, current, soc)

    def moved(nudge: float, **changed: Any) -> np.ndarray:
        other = drops(base, time_s, current, changed.pop("soc", soc), **changed)
        return (other.voltage_V - plain.voltage_V) / nudge

    capacity = base.capacity_Ah * (1.0 + NUDGE * CAPACITY_SD)
    return np.column_stack(
        [
            SCALE_SD * plain.series_V,
            SCALE_SD * (plain.short_V + plain.long_V),
            moved(NUDGE, slower=1.0 + NUDGE * SCALE_SD),
            moved(NUDGE, capacity_Ah=capacity),
            np.full(time_s.size, OFFSET_SD_V),
            moved(NUDGE, soc=soc + NUDGE * SOC_SD),
        ]
    )


def recalibrated(designs: list[np.ndarray], moved: list[np.ndarray], noise: float) -> np.ndarray:
    """Return what is left of a change of a channel when numbers with priors have been fitted to it.

    min_x |d - J x|^2 / noise^2 + x'x, the last column of J being of each run alone.

    Args:
        designs: of each run, J (rows, numbers), in sd.
        moved: of each run, d (rows,).
        noise: of the channel.
    """
    shared, runs = designs[0].shape[1] - 1, len(designs)
    blocks = []
    for number, design in enumerate(designs):
        own = np.zeros((design.shape[0], runs))
        own[:, number] = design[:, -1]
        blocks.append(np.hstack([design[:, :shared], own]))
    matrix, target = np.vstack(blocks), np.concatenate(moved)
    square = matrix.T @ matrix / noise**2 + np.eye(shared + runs)
    return target - matrix @ np.linalg.solve(square, matrix.T @ target / noise**2)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
