"""The candidates of a case, and the coordinates in which they are scored and fitted."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case
from jaxmodel.case.specimens import difference_label, runs_of
from jaxmodel.effects.curves import CURVES
from jaxmodel.effects.differences import DIFFERENCES
from jaxmodel.effects.loads import LAW_EFFECTS
from jaxmodel.effects.sensors import ClockShift
from jaxmodel.effects.shifts import SHIFTS
from jaxmodel.effects.specimen import scale_of, usual_range
from jaxmodel.fit.coordinates import Coordinate, effect_coordinate
from jaxmodel.fit.distinguishable import LEAST_SPAN, is_distinguishable
from jaxmodel.fit.laws import PORTS, law_effect, quantities, setting
from jaxmodel.fit.settings import SETTINGS, Settings
from jaxmodel.model.declaration import describe
from jaxmodel.model.ports import Effect, touches

Floats = NDArray[np.float64]

# Distance, in prior sd, within which an amplitude may have a better optimum: between local optima caused by jumps of an
# input, and on the other side of a standstill. Assumed.
_ACROSS_RIDGES = 0.4
_ACROSS_STANDSTILL = 1.0
# Largest distance of a start from the middle of an amplitude's usual range, in prior sd. Assumed.
_FURTHEST_START = 2.5
# Modes of a curve's prior with less than this share of the first mode's variance are dropped. Assumed.
_FAINT_MODE = 1e-3
# Least range of a curve over the state of charge, which does not leave 0 to 1. Assumed.
_LEAST_SOC = 0.05
# A cell that warms rises at least so far (K) in the range of a curve over the rise. No law is over a temperature that
# varies by less: two ambients so far apart tell of an energy (design).
_LEAST_K = 5.0
# Least width of a usual range, as a share of its larger end; ratio of neighbouring shifts of a clock. Assumed.
_LEAST_WIDTH, _NEXT_SHIFT = 1e-6, 2.0
# Correlation length of a law, as a share of its span. Assumed.
_LAW_CORRELATION = 0.25

Group = Literal["effect", "sensor", "curve", "specimen", "run", "law"]
# Groups of a number that differs in some runs alone: its prior is about nothing, and it needs no switch.
SHIFTED = ("specimen", "run")


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One candidate, and how it is scored and fitted.

    Attributes:
        label: its name; 'a:b' with a column, 'a@run' for one run or specimen, 'port(variable)' for an unknown law.
        group: effect, sensor fault, curve, difference of one specimen, shift of one run, or unknown law.
        effect: its effect in the model; candidates may share one.
        coordinates: its unknowns; the first is its amplitude.
        probes: for each variant of its shape, the coordinates at which its direction is computed.
        one_sided: physics allows only one sign of the amplitude.
        null_at_infinity: the effect vanishes as its parameter grows (an exchange current, a leakage resistance).
        amplitude_on_grid: the amplitude has probes on either side, because of many local optima.
        reach: distance from a fit, in prior sd, within which its amplitude may have a better optimum; 0 for one
            optimum.
        has_amplitude: False if no value of the first parameter makes the effect vanish.
        run: index of its run, -1 for all.
        specimen: the motor or cell that differs; "" for none.
        runs: indices of the runs that a shift or difference acts in; empty for all.
        absent: indices of the runs of other specimens.
        is_vector: its unknowns are the coordinates of a curve or a law.
        mix: matrix from all coordinates of the vector to its values.
        offset: index of its first unknown among those of the vector.
        shared: all unknowns of the vector, if it has only some of them.
        law: index of the port and settings of its law; None if it is no law.
        port, over: relation and variable of a curve or law, as in the answer.
        multiplier: of a law.
        stated: the case states the table that this curve corrects.
        largest: largest prior sd of a curve, in units of its usual size.
    """

    label: str
    group: Group
    effect: Effect
    coordinates: tuple[Coordinate, ...]
    probes: tuple[tuple[float, ...], ...] = ()
    one_sided: bool = False
    null_at_infinity: bool = False
    amplitude_on_grid: bool = False
    reach: float = 0.0
    has_amplitude: bool = True
    run: int = -1
    specimen: str = ""
    runs: tuple[int, ...] = ()
    absent: tuple[int, ...] = ()
    is_vector: bool = False
    mix: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)), compare=False)
    offset: int = 0
    shared: tuple[Coordinate, ...] = ()
    law: tuple[int, np.ndarray] | None = dataclasses.field(default=None, compare=False)
    port: str = ""
    over: str = ""
    multiplier: str = ""
    stated: bool = False
    largest: float = 1.0

    @property
    def unknowns(self) -> tuple[Coordinate, ...]:
        """Return the coordinates that it adds to the vector of unknowns."""
        return self.shared or self.coordinates

    @property
    def name(self) -> str:
        """Return its name without column or run."""
        return self.effect.name if self.group in ("effect", "sensor", "run") else self.label

    @property
    def is_switched(self) -> bool:
        """Return True if its effect has a switch; curves and shifts vanish at zero instead."""
        return self.group in ("effect", "sensor")

    @property
    def is_sensor(self) -> bool:
        """Return True for a fault of a sensor."""
        return self.group == "sensor"

    @property
    def bends(self) -> bool:
        """Return True if it makes the armature equations nonlinear, which needs finer steps."""
        return any(touches((self.effect,), port) for port in ("armature_voltage_drop", "motor_torque"))

    @property
    def shape_ends(self) -> list[tuple[float, ...]]:
        """Return the coordinates of the ends of the usual range of each parameter except the amplitude."""
        shapes = list(zip(self.coordinates, describe(self.effect).values(), strict=True))[1:]
        return [tuple(coordinate.at(end) for end in info.typical or ()) for coordinate, info in shapes]

    def times_as_strong(self, x: Floats, probe: float) -> Floats:
        """Return the strength of an effect at amplitude x relative to a probe; 1 without an amplitude."""
        first = self.coordinates[0]
        if not self.has_amplitude:
            return np.ones(np.shape(x))
        if not first.logarithmic:
            return np.asarray(x) / (probe or 1.0)
        away = first.spread * (np.asarray(x) - probe)
        return np.exp(-away if self.null_at_infinity else away)

    def at(self, probe: np.ndarray, amplitude: float) -> np.ndarray:
        """Return the coordinates of an effect of a given strength relative to a probe, within its usual range."""
        suggested, first = probe.copy(), self.coordinates[0]
        if first.logarithmic:
            stronger = math.log(max(amplitude, 1e-3)) / first.spread
            suggested[0] = probe[0] + (-stronger if self.null_at_infinity else stronger)
        else:
            suggested[0] = probe[0] * amplitude
        suggested[0] = np.clip(suggested[0], -_FURTHEST_START, _FURTHEST_START)
        return suggested


def make_candidate(
    effect: Effect,
    usual: Mapping[str, tuple[float, float]] | None = None,
    grids: Mapping[str, tuple[float, ...]] | None = None,
) -> Candidate:
    """Return the candidate for an effect, from its parameter table.

    Args:
        effect: of the catalogue, or the user's own.
        usual: usual ranges for this specimen, in place of the table's.
        grids: values to be tried for this specimen, in place of the table's.
    """
    table = describe(effect)
    usual, grids = usual or {}, grids or {}
    coordinates = tuple(
        effect_coordinate(f"{effect.label}.{name}", info, usual.get(name)) for name, info in table.items()
    )
    choices = []
    for coordinate, (name, info) in zip(coordinates, table.items(), strict=True):
        grid = grids.get(name, info.shape_grid)
        if name not in grids and grid and name in usual and info.typical and info.typical[0] > 0.0:
            grid = tuple(value * usual[name][0] / info.typical[0] for value in grid)
        if grid:
            choices.append([coordinate.at(number) for number in grid])
        else:
            choices.append([0.0 if coordinate.logarithmic else 0.5])
    amplitude = coordinates[0]
    first = next(iter(table.values()))
    on_grid = bool(first.shape_grid) and not amplitude.logarithmic
    return Candidate(
        effect.label,
        "sensor" if effect.is_sensor else "effect",
        effect,
        coordinates,
        tuple(itertools.product(*choices)),
        one_sided=amplitude.logarithmic,
        null_at_infinity=first.null == math.inf,
        amplitude_on_grid=on_grid,
        reach=_ACROSS_RIDGES if on_grid else 0.0,
        has_amplitude=first.null is not None,
    )


def candidates(case: Case, ranges: Mapping[str, tuple[float, float]]) -> list[Candidate]:
    """Return all candidates of a case except unknown laws; `ranges` as for `laws`.

    Curves come first: at a shared port an effect acts on the corrected relation.
    """
    return [*_curves(case, ranges), *_effects(case), *_of_specimens(case), *_of_runs(case)]


def _effects(case: Case) -> Iterator[Candidate]:
    """Yield every effect of the catalogue that is not in the model; sensor faults for every possible column."""
    present = {f"{name}:{values['column']}" if values.get("column") else name for name, values in case.effects.items()}
    columns = _columns(case)
    for name, cls in case.catalogue.items():
        if case.kind not in cls.kinds or name in present or not cls.is_candidate or not is_distinguishable(case, cls):
            continue
        usual, grids = specimen_ranges(case, cls), _grids(case, cls)
        if has_collapsed(usual):
            continue
        if not cls.is_sensor:
            yield make_candidate(cls(), usual, grids)
            continue
        for column in [column for column in columns if column.endswith(cls.reads)] if cls.reads else [""]:
            if f"{name}:{column}" in present:
                continue
            fault = make_candidate(cls(column=column), usual, grids)
            # A small error of the input decides whether a rotor at rest starts to turn in the model.
            sticks = case.kind != "cell" and column in case.runs[0].measured.inputs
            yield dataclasses.replace(fault, reach=_ACROSS_STANDSTILL) if sticks else fault


def specimen_ranges(case: Case, cls: type[Effect]) -> dict[str, tuple[float, float]]:
    """Return the usual ranges of those parameters of an effect that scale with the specimen."""
    numbers = _numbers(case)
    ranges = {name: usual_range(info, numbers) for name, info in describe(cls).items() if info.scales and info.typical}
    return ranges | {name: (-max(grid), max(grid)) for name, grid in _grids(case, cls).items()}


def has_collapsed(usual: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether a range has no width: scaled to a very small or large specimen, both ends are at one bound."""
    return any(not high - low > _LEAST_WIDTH * max(abs(low), abs(high)) for low, high in usual.values())


def _grids(case: Case, cls: type[Effect]) -> dict[str, tuple[float, ...]]:
    """Return the shifts of a clock that are tried for a motor or robot [s]: from a row to the length of a run.

    The table's are for cells, of which seconds matter. A motor's dead time may be a few rows, and a run shorter than
    the table's shifts.
    """
    runs = [run.measured.time_s for run in case.runs if run.split == "fit"]
    if not issubclass(cls, ClockShift) or case.kind == "cell" or not runs:
        return {}
    longest = min(max(float(time_s[-1] - time_s[0]) for time_s in runs), max(describe(cls)["d"].shape_grid))
    row = min(*(float(np.median(np.diff(time_s))) for time_s in runs), 0.5 * longest)
    count = 1 + math.ceil(math.log(longest / row) / math.log(_NEXT_SHIFT))
    later = np.geomspace(row, longest, count).tolist()
    return {"d": (*(-d for d in reversed(later)), *later)}


def _curves(case: Case, ranges: Mapping[str, tuple[float, float]]) -> Iterator[Candidate]:
    """Yield the curves of a kind: smooth corrections of its relations, with knots where the fitted runs were."""
    for name, cls in CURVES.items():
        if case.kind not in cls.kinds:
            continue
        low, high = _covered(cls.over, ranges)
        effect = cls(low=low, high=high)
        typical = cls.typical * _specimen_scale(case, cls.scales)
        mix = typical * _root(len(cls.usual_knots), cls.correlation)
        yield Candidate(
            name,
            "curve",
            effect,
            tuple(Coordinate(f"{name}.values[{place}]", 0.0, 1.0) for place in range(mix.shape[1])),
            is_vector=True,
            mix=mix,
            port=cls.port,
            over={"temperature_degC": "cell_temperature_degC"}.get(cls.over, cls.over),
            stated=not {*case.tables, *case.motor_tables}.isdisjoint(cls.tables),
            largest=cls.largest / cls.typical,
        )


def _covered(over: str, ranges: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """Return the range of a curve's variable in the fitted runs."""
    if over == "soc":
        low, high = ranges.get("soc", (0.0, 1.0))
        low = min(max(low, 0.0), 1.0 - _LEAST_SOC)
        return low, min(max(high, low + _LEAST_SOC), 1.0)
    if over == "temperature_rise_K":
        ambient, cell = (ranges.get(name, (20.0, 20.0)) for name in ("ambient_degC", "cell_temperature_degC"))
        return 0.0, max(_LEAST_K, cell[1] - ambient[0])
    names = {"current_A": ("current_A", "motor_current_A")}.get(over, (over,))
    return 0.0, max([abs(end) for name in names for end in ranges.get(name, ())], default=0.0) or 1.0


def _root(count: int, correlation: float) -> np.ndarray:
    """Return a root of the prior covariance of values at unit size, (knots, modes): Matern 3/2 over the knot number.

    Over the number and not over the place of a knot, so that a curve may bend most where its knots are dense. Modes of
    small variance are dropped.
    """
    if count == 1:
        return np.ones((1, 1))
    number = np.arange(count) / (count - 1.0)
    return _modes(np.abs(number[:, None] - number[None, :]) / correlation)


def _modes(apart: np.ndarray) -> np.ndarray:
    """Return a root of a Matern 3/2 covariance at distances in correlation lengths, (knots, modes)."""
    values, vectors = np.linalg.eigh((1.0 + np.sqrt(3.0) * apart) * np.exp(-np.sqrt(3.0) * apart))
    kept = values > _FAINT_MODE * values[-1]
    return vectors[:, kept] * np.sqrt(values[kept])


def _specimen_scale(case: Case, scales: str) -> float:
    """Return the factor from the paper's hardware to that of a case; see `effects.specimen`."""
    return scale_of(scales, _numbers(case)) if scales else 1.0


def _numbers(case: Case) -> dict[str, float]:
    parameters = case_model(dataclasses.replace(case, effects={}, effect_sd={})).parameters
    return {name: float(np.asarray(getattr(parameters, name))) for name in describe(parameters)}


def _of_runs(case: Case) -> Iterator[Candidate]:
    """Yield the shifts of single fit runs: contact resistance, friction, cooling or zero points."""
    fit_runs = [number for number, run in enumerate(case.runs) if run.split == "fit"]
    if len(fit_runs) < 2:
        return
    # What shows in the only run of a motor or cell is a difference of that specimen.
    of_specimens = Counter(case.runs[number].specimen for number in fit_runs)
    for effect, usual in _absent(case, SHIFTS):
        shift = make_candidate(effect, usual)
        for number in fit_runs:
            run = case.runs[number]
            if run.specimen and of_specimens[run.specimen] == 1:
                continue
            yield dataclasses.replace(
                shift,
                label=f"{effect.label}@{run.name}",
                group="run",
                run=number,
                runs=(number,),
                probes=(tuple(0.5 for _ in shift.coordinates),),
            )


def _of_specimens(case: Case) -> Iterator[Candidate]:
    """Yield what each of several motors or cells may have of its own, if it has a fit run."""
    fitted = [run.specimen for run in case.runs if run.split == "fit" and run.specimen]
    specimens = list(dict.fromkeys(fitted))
    if len(specimens) < 2:
        return
    follows_law = any(name in LAW_EFFECTS for name in case.effects)
    for effect, usual in _absent(case, DIFFERENCES):
        if effect.name == "load_difference" and not follows_law:
            continue
        one = make_candidate(effect, usual)
        for specimen in specimens:
            stated = case.specimens[specimen].effects
            if effect.label in {difference_label(name, values) for name, values in stated.items()}:
                continue
            runs = runs_of(case, specimen)
            yield dataclasses.replace(
                one,
                label=f"{effect.label}@{specimen}",
                group="specimen",
                specimen=specimen,
                runs=runs,
                absent=tuple(number for number in range(len(case.runs)) if number not in runs),
                probes=(tuple(0.5 for _ in one.coordinates),),
            )


def _absent(case: Case, classes: Mapping[str, type[Effect]]) -> Iterator[tuple[Effect, dict[str, tuple[float, float]]]]:
    """Yield effects at their null, those of sensors for every possible column, with their usual ranges."""
    columns = _columns(case)
    for cls in classes.values():
        if case.kind not in cls.kinds:
            continue
        null: dict[str, Any] = {name: info.null for name, info in describe(cls).items()}
        if cls.is_sensor and cls.column == "":
            effects = [cls(column=column, **null) for column in columns if column.endswith(cls.reads)]
        else:
            effects = [cls(**null)]
        for effect in effects:
            usual = specimen_ranges(case, cls)
            if not has_collapsed(usual):
                yield effect, usual


def laws(
    case: Case, ranges: Mapping[str, tuple[float, float]], sizes: Mapping[str, float], settings: Settings = SETTINGS
) -> list[Candidate]:
    """Return every unknown law of a case: each port over each quantity that varies.

    Args:
        case: of a kind.
        ranges: lowest and highest value of every quantity.
        sizes: typical size of a law at every port, in its unit, and the largest value of every multiplier.
        settings: the constants.
    """
    effect = law_effect(case.kind, settings.law_knots)
    ports, count = list(PORTS[case.kind]), settings.law_knots
    root = _modes(np.abs(np.subtract.outer(np.arange(count), np.arange(count))) / (_LAW_CORRELATION * (count - 1.0)))
    modes = root.shape[1]
    shared = tuple(Coordinate(f"law.values[{place}]", 0.0, 1.0) for place in range(len(ports) * modes))
    mix = np.asarray(block_diag(*(sizes[port] * root for port in ports)))
    found = []
    for place, (port, (sources, multiplier, _)) in enumerate(PORTS[case.kind].items()):
        for variable in [name for name in quantities(case.kind) if name in sources and name in ranges]:
            low, high = ranges[variable]
            if high - low <= (_LEAST_K if variable.endswith("degC") else LEAST_SPAN * max(abs(low), abs(high))):
                continue
            for factor in dict.fromkeys(("", multiplier)):
                if factor and (factor == variable or factor not in sizes):
                    continue
                own = setting(case.kind, port, variable, factor, (low, high))
                if factor:
                    own[-1] = 1.0 / sizes[factor]
                times = f" x {factor}" if factor else ""
                found.append(
                    Candidate(
                        f"{port}({variable}){times}",
                        "law",
                        effect,
                        shared[place * modes : (place + 1) * modes],
                        is_vector=True,
                        mix=mix,
                        offset=place * modes,
                        shared=shared,
                        law=(place, own),
                        port=port,
                        over=variable,
                        multiplier=factor,
                    )
                )
    return found


def _columns(case: Case) -> list[str]:
    measured: dict[str, None] = {}
    for run in case.runs:
        for name, values in (run.measured.outputs | run.measured.inputs).items():
            if np.any(np.isfinite(values)):
                measured[name] = None
    return list(measured)
