"""Where and how a calibrated model fails: by channel, run and condition, and which parameter would have to change."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2 as chi2_distribution

from discrepancy.conditions import conditions_of_rows, since_load_changed
from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import at, residuals
from discrepancy.session import Session
from discrepancy.where import (
    Cell,
    MapCell,
    Regressor,
    map_over_two,
    split_excess,
    worst_region,
)
from discrepancy.whiteness import FloorRatio, LjungBox, floor_ratio, ljung_box
from discrepancy.whitening import block_labels
from jaxmodel.units import unit_of

# Of a channel's readings: blocks within which errors may hang together.
_BLOCKS = 60
# What is the same all through a run, where a bench is what it seems to be.
_OF_A_RUN = ("cycles", "ambient_degC")
# A shift of a parameter from run to run is worth a sentence where a right model would hardly want it.
_SURE = 1e-3
# What goes is said in percent from here on.
_WORTH_SAYING = 0.005
# A model that leaves a channel this many times what its noise explains has not explained it. Of the development cases
# that were answered rightly the worst is at 1.02 (readings weighed one by one); sensors' sd are stated to some percent.
FAR_ABOVE = 1.25
# Conditions correlated by more than this say the same.
_SAME = 0.9999


@dataclass(frozen=True)
class Shift:
    """What each fit run would have one parameter be, if all parameters were its own.

    Attributes:
        parameter: its name.
        calibrated: its value for all runs together.
        wanted: by run, the value that the run alone would have.
        sd: by run, the standard deviation of that.
        strength: sum over the runs of their shifts squared, in sd; about the number of runs under a right model.
        p_value: of so large a sum under a right model.
        goes_with: a condition that orders the runs as the parameter does; "" where none or fewer than three runs.
    """

    parameter: str
    calibrated: float
    wanted: dict[str, float]
    sd: dict[str, float]
    strength: float
    p_value: float
    goes_with: str


@dataclass(frozen=True)
class Failure:
    """Where and how a calibrated model fails on its fit runs.

    Attributes:
        floor: by channel, the error against the sensor's noise.
        cells: by channel, the excess error split by every condition in turn.
        maps: by channel, then by pair of conditions, the mean residual over both.
        sentences: for each channel that fails, where most of its excess error is.
        shifts: of the uncertain parameters, the most certain shift first.
        shift_share: part of the excess error that would go, to first order, if parameters differed from run to run.
        memory: Ljung-Box tests of the whitened residuals, channel by channel in each run.
        excess: sum over all fit readings of w^2 - 1.
    """

    floor: dict[str, FloorRatio]
    cells: dict[str, tuple[Cell, ...]]
    maps: dict[str, dict[tuple[str, str], tuple[MapCell, ...]]]
    sentences: tuple[str, ...]
    shifts: tuple[Shift, ...]
    shift_share: float
    memory: tuple[LjungBox, ...]
    excess: float

    def shift_sentence(self) -> str:
        """Say which parameter would have to change from run to run; "" where none would."""
        if not self.shifts or self.shifts[0].p_value > _SURE or self.excess <= 0.0:
            return ""
        first = self.shifts[0]
        low, high = (
            min(first.wanted, key=lambda run: first.wanted[run]),
            max(first.wanted, key=lambda run: first.wanted[run]),
        )
        ordered = f", in the order of {first.goes_with}" if first.goes_with else ""
        gone = f"up to {min(self.shift_share, 1.0):.0%}" if self.shift_share > _WORTH_SAYING else "hardly any"
        return (
            f"If parameters could differ from run to run, {gone} of the excess error would go; "
            f"{first.parameter}, {first.calibrated:.3g} for all, would be {first.wanted[low]:.3g} in {low} "
            f"and {first.wanted[high]:.3g} in {high}{ordered}."
        )


def scatter_beyond_noise(session: Session, hypothesis: Hypothesis) -> str:
    """Say which channels a model leaves far above the noise that the case states for them; "" where none.

    Noise that was estimated says nothing here: slow noise is not seen between one reading and the next.
    """
    problem = hypothesis.problem
    whitened, (_, _, channel) = _whitened(hypothesis)
    left = []
    for place, name in enumerate(problem.channels):
        if name in session.noise and session.noise[name].source.startswith("stated"):
            found = floor_ratio(whitened[channel == place])
            if found.ratio > FAR_ABOVE * found.limit:
                left.append(f"{name} is left {found.ratio:.1f} times as large as its stated noise")
    if not left:
        return ""
    return (
        f"{' and '.join(left)}, and no law of one variable was found in it: either the readings scatter more than is "
        "stated, or what is missing has another form"
    )


def _whitened(hypothesis: Hypothesis) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return the whitened residuals of the fit readings, and the run, row and channel of each."""
    problem = hypothesis.problem
    counted = np.asarray(problem.readings.fit) > 0.0
    index = np.asarray(problem.readings.index)
    places = np.unravel_index(index[counted], (*problem.times.shape, len(problem.channels)))
    return residuals(problem, [at(problem, hypothesis.fitted.x)])[0, counted], places


def failure(session: Session, hypothesis: Hypothesis) -> Failure:
    """Say where and how a calibrated model fails on its fit runs."""
    problem = hypothesis.problem
    weighed, (run, row, channel) = _whitened(hypothesis)
    # Where the search weighed channels otherwise, what fails is still told in units of the sensors' noise.
    unit = np.ones(weighed.size)
    if session.weights is not session.noise:
        stated = [session.noise[n].sd if n in session.noise else np.inf for n in problem.channels]
        unit = np.array(stated)[channel] / np.asarray(problem.readings.sd)[np.asarray(problem.readings.fit) > 0.0]
    whitened = weighed / unit
    of_rows = conditions_of_rows(session, hypothesis, currents=True)
    of_rows["time_since_load_changed_s"] = since_load_changed(session.case, problem.times.shape)
    given = {name: values[run, row] for name, values in of_rows.items()}
    floor, cells, maps, sentences, series = {}, {}, {}, [], {}
    for place, name in enumerate(problem.channels):
        mine = channel == place
        if name not in session.noise or not mine.any():
            continue
        w, runs = whitened[mine], run[mine]
        floor[name] = floor_ratio(w)
        regressors = _different(
            [
                Regressor(condition, unit_of(condition), values[mine])
                for condition, values in given.items()
                if condition != name and np.ptp(values[mine]) > 1e-6
            ]
        )
        starts = np.diff(runs, prepend=-1) != 0
        blocks = block_labels(starts, max(5, w.size // _BLOCKS))
        of_runs = [one for one in regressors if one.name == "run"]
        others = [one for one in regressors if one.name != "run"]
        cells[name] = split_excess(w, of_runs, blocks, bins=len(session.case.runs)) + split_excess(w, others, blocks)
        of_state = [one for one in others if one.name != "time_s"]
        maps[name] = {(x.name, y.name): map_over_two(w, x, y, blocks) for x, y in itertools.combinations(of_state, 2)}
        region = worst_region(w, others)
        if region is not None:
            sentences.append(f"{name}: {region.sentence()}")
        for number in np.unique(runs):
            series[f"{name} in {session.case.runs[number].name}"] = w[runs == number]
    shifts, drop = _shifts(session, hypothesis, given, run)
    excess = float(np.sum(weighed**2 - unit**2))
    return Failure(
        floor=floor,
        cells=cells,
        maps=maps,
        sentences=tuple(sentences),
        shifts=shifts,
        shift_share=drop / excess if excess > 0.0 else 0.0,
        memory=ljung_box(series),
        excess=excess,
    )


def _different(regressors: list[Regressor]) -> list[Regressor]:
    """Leave out what says the same as one before it: a cell without self-heating is as warm as the air."""
    kept: list[Regressor] = []
    for one in regressors:
        if one.name == "run" or not any(abs(np.corrcoef(one.values, other.values)[0, 1]) > _SAME for other in kept):
            kept.append(one)
    return kept


def _shifts(
    session: Session, hypothesis: Hypothesis, given: dict[str, np.ndarray], run: np.ndarray
) -> tuple[tuple[Shift, ...], float]:
    """Return what each run would have the parameters be, and the drop in chi-square if each had its way.

    One Newton step of each run alone: d = -(I + 1)^-1 s with I its information, s half the slope of its chi-square, 1
    the prior's, about the values calibrated to all runs.
    """
    layout, fitted = hypothesis.layout, hypothesis.fitted
    runs = np.unique(run).tolist()
    if len(runs) < 2:
        return (), 0.0
    information = fitted.run_information[runs] + np.eye(fitted.x.size)
    slope = fitted.run_score[runs]
    step = -np.linalg.solve(information, slope[..., None])[..., 0]
    spread = np.sqrt(np.diagonal(np.linalg.inv(information), axis1=1, axis2=2))
    means = {
        name: np.array(
            [
                np.mean(np.abs(values) if name.endswith(("_A", "_Nm")) else values, where=run == number)
                for number in runs
            ]
        )
        for name, values in given.items()
        if name not in ("run", "time_s")
    }
    names = [session.case.runs[number].name for number in runs]
    found = []
    for place, coordinate in enumerate(layout.coordinates[: layout.base]):
        known = fitted.run_information[runs, place, place] > 1.0
        if layout.runs[place] >= 0 or not known.any():
            continue
        x = fitted.x[place] + step[:, place]
        wanted = np.array([coordinate.number(one) for one in x])
        # A run that says nothing of the parameter stays where it is.
        strength = float(np.sum((step[:, place] / spread[:, place]) ** 2))
        found.append(
            Shift(
                parameter=coordinate.name,
                calibrated=coordinate.number(fitted.x[place]),
                wanted=dict(zip(names, wanted.tolist(), strict=True)),
                sd={name: coordinate.slope(one) * s for name, one, s in zip(names, x, spread[:, place], strict=True)},
                strength=strength,
                p_value=float(chi2_distribution.sf(strength, len(runs) - 1)),
                goes_with=_order(wanted, means),
            )
        )
    drop = -float(np.sum(slope * step))
    return tuple(sorted(found, key=lambda shift: -shift.strength)), drop


def _order(wanted: np.ndarray, means: dict[str, np.ndarray]) -> str:
    """Return the condition whose run means are in the order of what the runs want, or its reverse.

    One that is the run's own, as its age, goes before a mean of what changed during the runs.
    """
    if wanted.size < 3 or np.ptp(wanted) == 0.0:
        return ""
    for name, values in sorted(means.items(), key=lambda one: one[0] not in _OF_A_RUN):
        if np.ptp(values) > 1e-3 * np.abs(values).max() and _same_order(values, wanted):
            return name
    return ""


def _same_order(one: np.ndarray, other: np.ndarray) -> bool:
    order = np.argsort(one)
    steps = np.diff(other[order])
    return bool(np.all(np.diff(one[order]) > 0.0) and (np.all(steps > 0.0) or np.all(steps < 0.0)))
