"""The experiment that decides between models that the data do not distinguish.

With D the whitened difference of what two calibrated models predict for a run, J the second one's sensitivities there
and S the covariance of its unknowns after the data at hand, the run would raise the second one's chi-square, refitted
to old and new data together, by D'(I + J S J')^-1 D if the first is true: the square of the separation in sigma.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from jaxmodel.case.known import Known
from jaxmodel.case.measurements import Measured
from jaxmodel.case.records import Case, Run
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.data import FitData, collect
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.gauss_newton import linearised
from jaxmodel.fit.lanes import predictions
from jaxmodel.fit.layout import Layout
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.problem import Problem, make_problem
from jaxmodel.fit.space import ModelSpace, ModelSpec, View

# Inputs that drive; all others are loads.
DRIVES = ("current_A", "voltage_V", "duty")
AMBIENTS_degC = (-10.0, 0.0, 10.0, 25.0, 40.0)
FIRST_SOC = 0.95
EMPTY_SOC = 0.1
REST_S = 60.0
# Relative accuracy of a separate measurement of a parameter (ohmmeter, weight, calibrated shunt).
SEPARATE_ACCURACY = 0.005
# Factors and offsets of whole tables, which cannot be measured separately.
NOT_MEASURABLE = ("_scale", "_offset_V")
# Separation that counts as a decision.
ENOUGH_SIGMA = 5.0


@dataclasses.dataclass(frozen=True)
class Proposal:
    """A proposed run or measurement.

    Attributes:
        what: in words.
        sigma: the smallest expected separation between any two of the models.
        repeats: how often it must be done to reach five sigma.
    """

    what: str
    sigma: float

    @property
    def repeats(self) -> int:
        """Return how many such runs are needed for five sigma."""
        return int(np.ceil((ENOUGH_SIGMA / max(self.sigma, 1e-3)) ** 2))


def propose(cache: FitCache, rivals: Sequence[Fit]) -> tuple[Proposal, ...]:
    """Return runs and measurements that would distinguish calibrated models, the best first.

    Args:
        cache: of the case.
        rivals: two or more models of it.
    """
    if len(rivals) < 2:
        return ()
    space = cache.space
    designs = list(candidate_runs(space.case))
    seen = _predicted_runs(cache, rivals, designs)
    pairs = list(itertools.permutations(range(len(rivals)), 2))
    found = [
        Proposal(design.label, min(_separation(seen[a][number], seen[b][number]) for a, b in pairs))
        for number, design in enumerate(designs)
    ]
    found += _separate_measurements(space.layout, rivals)
    return tuple(sorted(found, key=lambda one: -one.sigma))


def candidate_runs(case: Case) -> Iterator[Run]:
    """Return the candidate runs: loads up to the largest of the case, at five temperatures.

    They have the duration and sampling of the longest run of the case. If runs state exact parameters of their own
    (such as the age of a cell), each run is proposed for the two specimens that differ most.
    """
    longest = max(case.runs, key=lambda run: np.ptp(run.measured.time_s))
    times = longest.measured.time_s
    time_s = np.linspace(0.0, float(times[-1] - times[0]), times.size)
    largest = {
        name: max(float(np.max(np.abs(run.measured.inputs.get(name, np.zeros(1))))) for run in case.runs)
        for name in longest.measured.inputs
    }
    for which, overrides in _specimens(case).items():
        for ambient_degC in AMBIENTS_degC:
            for pattern, drive in _patterns(time_s, case.kind).items():
                inputs = {
                    name: np.full(time_s.size, ambient_degC) if name == "ambient_degC" else largest[name] * drive(name)
                    for name in longest.measured.inputs
                }
                label = f"{pattern}{which} at {ambient_degC:g} degC"
                yield dataclasses.replace(
                    longest,
                    name=label,
                    label=label,
                    split="fit",
                    overrides=overrides,
                    measured=Measured(time_s, inputs, {}),
                )


def _specimens(case: Case) -> dict[str, dict[str, Known]]:
    """Return the exact parameters of the two most different specimens among the runs; of one if all are equal.

    Initial states do not count.
    """
    stated = [
        {name: known for name, known in run.overrides.items() if known.sd is None and not name.startswith("initial_")}
        for run in case.runs
    ]
    names = dict.fromkeys(name for one in stated for name in one)

    def values(own: dict[str, Known]) -> tuple[float, ...]:
        return tuple((own.get(name) or case.parameters.get(name, Known(0.0))).value for name in names)

    ordered = sorted(stated, key=values)
    ends = {values(own): own for own in (ordered[0], ordered[-1])}
    if len(ends) == 1:
        return {"": ordered[0]}
    described = {key: ", ".join(f"{name} = {value:g}" for name, value in zip(names, key, strict=True)) for key in ends}
    return {f" with {described[key]}": own for key, own in ends.items()}


def _patterns(time_s: np.ndarray, kind: str):
    """Return drive (current, voltage or duty) and load over time, as shares of the largest."""
    span = time_s[-1]
    rested = time_s > min(REST_S, 0.05 * span)
    part = time_s / span

    def both(drive: np.ndarray, load: np.ndarray):
        return lambda name: np.where(rested, drive if name in DRIVES else load, 0.0)

    steps = np.array([0.2, 0.6, 0.35, 0.9, 0.5, 1.0, 0.7, 0.25])
    stepped = steps[np.minimum((part * steps.size).astype(int), steps.size - 1)]
    period = max(span / 12.0, 4.0 * span / (time_s.size - 1))
    pulses = np.where((time_s % period) < 0.25 * period, 1.0, 0.0)
    slow, one = np.full(time_s.size, 0.15), np.ones(time_s.size)
    alternating = np.where((part * 8.0).astype(int) % 2 == 0, 0.8, -0.4)
    if kind == "cell":
        return {
            "full load until empty": both(one, one),
            "pulses with rests": both(pulses, one),
            "load steps": both(stepped, one),
            "slow discharge": both(slow, one),
            "alternating discharge and charge": both(alternating, one),
        }
    return {
        "full drive and load": both(one, one),
        "full drive without load": both(one, 0.0 * one),
        "drive steps without load": both(stepped, 0.0 * one),
        "drive and load steps": both(stepped, stepped[::-1]),
        "starts with rests": both(pulses, pulses),
        "slow drive under load": both(np.full(time_s.size, 0.35), 0.8 * one),
    }


@dataclasses.dataclass(frozen=True)
class _Predicted:
    """What one model predicts for one run: whitened readings, sensitivities, and information before the run."""

    rows: np.ndarray
    jacobian: np.ndarray
    possible: np.ndarray  # rows before the cell is empty
    known: np.ndarray  # information (inverse covariance) of the unknowns


@dataclasses.dataclass(frozen=True)
class _Batch:
    """Candidate runs in place of fit runs of the case, so that the compiled programs are used again."""

    case: Case
    slots: tuple[int, ...]
    noise: Mapping[str, NoiseModel]

    def problem(self, space: ModelSpace, spec: ModelSpec) -> Problem:
        """Return the problem of the runs, in the shapes of the case's."""
        fine = [one.effect for one in space.candidates.values() if one.bends and one.group == "effect"]
        everything = list(space.candidates.values())
        layout = _with_initial_states(space.layout)
        made = make_problem(self.case, layout, everything, fine if spec.is_fine else ())
        return dataclasses.replace(made, shapes=space.problem(spec).shapes)

    def readings(self, space: ModelSpace) -> FitData:
        """Return the future readings, all zero."""
        outputs = self.case.vocabulary.outputs
        return collect(self.case, self.noise, outputs, self.slots, space.settings)


def _predicted_runs(cache: FitCache, rivals: Sequence[Fit], designs: Sequence[Run]) -> list[list[_Predicted]]:
    """Return the predictions of each model for every candidate run, as many at a time as the case has fit runs."""
    space, slots = cache.space, cache.fit_runs
    driven_by_current = space.case.kind == "motor" and "current_A" in designs[0].measured.inputs
    fastest = [_fastest(space, one) if driven_by_current else np.inf for one in rivals]
    found: list[list[_Predicted]] = [[] for _ in rivals]
    for first in range(0, len(designs), len(slots)):
        some = list(designs[first : first + len(slots)])
        own = tuple(slots[: len(some)])
        runs = list(space.fitted.runs)
        for slot, new in zip(slots, some + [some[-1]] * (len(slots) - len(some)), strict=True):
            runs[slot] = _replacing(runs[slot], new, tuple(cache.noise))
        batch = _Batch(dataclasses.replace(space.fitted, runs=tuple(runs)), own, cache.noise)
        problems: dict[bool, Problem] = {}
        for number, one in enumerate(rivals):
            if one.spec.is_fine not in problems:
                problems[one.spec.is_fine] = batch.problem(space, one.spec)
            found[number] += _of_batch(space, batch, problems[one.spec.is_fine], one, fastest[number])
    return found


def _of_batch(space: ModelSpace, batch: _Batch, problem: Problem, fit: Fit, fastest: float) -> list[_Predicted]:
    """Return the predictions of a model for the runs of a batch."""
    layout, readings = space.layout, batch.readings(space)
    # A shift of one run does not apply to other runs.
    kept = [n for n, p in enumerate(fit.spec.free) if p < layout.base or layout.runs[p] < 0]
    spec = fit.spec.with_free([fit.spec.free[n] for n in kept])
    x = _at_the_start(layout, fit)
    errors, jacobian = linearised(View(space, readings), problem, spec, x)
    white = np.column_stack([errors, -jacobian]) * fit.likelihood.roots(readings)[:, None]
    predicted = predictions(problem.of(np.array(batch.slots)), [spec.lane(x)])[0]
    place = np.searchsorted(batch.slots, readings.run)
    possible = _possible(problem.channels, predicted, fastest)[place, readings.row]
    known = _known(layout, fit, kept)
    return [
        _Predicted(white[mine, 0], white[mine, 1:], possible[mine], known)
        for mine in (np.flatnonzero(place == number) for number in range(len(batch.slots)))
    ]


def _with_initial_states(layout: Layout) -> Layout:
    """Return the layout with the initial states of the candidate runs."""
    begins = {"initial_soc": FIRST_SOC, "initial_temperature_rise_K": 0.0, "initial_hysteresis": 0.0}
    coordinates = tuple(
        dataclasses.replace(one, centre=begins[one.name]) if run >= 0 and one.name in begins else one
        for one, run in zip(layout.coordinates, layout.runs, strict=True)
    )
    return dataclasses.replace(layout, coordinates=coordinates)


def _at_the_start(layout: Layout, fit: Fit) -> np.ndarray:
    """Return the unknowns of a model in candidate runs: their initial states, and run parameters as stated."""
    x = np.where(np.asarray(layout.runs) < 0, fit.x, 0.0)
    for place, coordinate in enumerate(_with_initial_states(layout).coordinates[: layout.base]):
        if layout.runs[place] >= 0 and coordinate.name == "initial_soc":
            x[place] = coordinate.at(FIRST_SOC)
    return x


def _known(layout: Layout, fit: Fit, kept: Sequence[int]) -> np.ndarray:
    """Return the information on some unknowns before a new run: posterior for those of all runs, prior for others.

    Args:
        layout: of the unknowns.
        fit: the model.
        kept: places among its free unknowns.
    """
    shared = np.array([layout.runs[fit.spec.free[n]] < 0 for n in kept])
    of_all = np.array(kept)[shared]
    known = np.diag(fit.spec.precision[list(kept)])
    known[np.ix_(shared, shared)] = np.linalg.inv(fit.covariance[np.ix_(of_all, of_all)])
    return known


def _fastest(space: ModelSpace, fit: Fit) -> float:
    """Return the highest speed of a motor in the present runs: driven by current, it has no other limit."""
    predicted = space.predicted(fit.spec, fit.x).values()
    return max(float(np.max(np.abs(of_run["speed_rad_s"]))) for of_run in predicted)


def _possible(channels: Sequence[str], predicted: np.ndarray, fastest: float) -> np.ndarray:
    """Return, by run and row, whether the cell is not yet empty and the speed is within its limit."""
    goes_on = np.ones(predicted.shape[:2], dtype=bool)
    if "soc" in channels:
        goes_on &= predicted[:, :, channels.index("soc")] > EMPTY_SOC
    if "speed_rad_s" in channels:
        goes_on &= np.abs(predicted[:, :, channels.index("speed_rad_s")]) <= fastest
    return np.logical_and.accumulate(goes_on, axis=1)


def _replacing(old: Run, new: Run, channels: Sequence[str]) -> Run:
    """Return a candidate run in place of a run of the case, with the unknowns of that run and blank readings."""
    blank = {name: np.zeros(new.measured.time_s.size) for name in channels}
    unknown = {name: known for name, known in old.overrides.items() if known.sd is not None}
    return dataclasses.replace(
        old,
        initial_soc=Known(FIRST_SOC, old.initial_soc.sd),
        split="fit",
        initial_cell_temperature=None,
        overrides=new.overrides | unknown,
        measured=dataclasses.replace(new.measured, outputs=blank),
    )


def _separation(true: _Predicted, other: _Predicted) -> float:
    """Return the expected separation in sigma from another model, refitted, if one is true."""
    both = true.possible & other.possible
    difference, jacobian = (true.rows - other.rows)[both], other.jacobian[both]
    taken = jacobian.T @ difference
    left = difference @ difference - taken @ np.linalg.solve(other.known + jacobian.T @ jacobian, taken)
    return float(np.sqrt(max(left, 0.0)))


def _separate_measurements(layout: Layout, rivals: Sequence[Fit]) -> list[Proposal]:
    """Return proposals to measure a parameter separately, for which the models have different values."""
    found = []
    for place, coordinate in enumerate(layout.coordinates[: layout.base]):
        if layout.runs[place] >= 0 or coordinate.name.endswith(NOT_MEASURABLE):
            continue
        at = [one.x[place] for one in rivals]
        sds = [one.sd[one.spec.free.index(place)] for one in rivals]
        values = [coordinate.number(x) for x in at]
        spreads = [coordinate.slope(x) * sd for x, sd in zip(at, sds, strict=True)]
        sigmas = []
        for a, b in itertools.combinations(range(len(rivals)), 2):
            accuracy = SEPARATE_ACCURACY * max(abs(values[a]), abs(values[b]))
            sigmas.append(abs(values[a] - values[b]) / np.hypot(max(spreads[a], spreads[b]), accuracy))
        what = f"a separate measurement of {coordinate.name} to {100 * SEPARATE_ACCURACY:g} %"
        found.append(Proposal(what, float(min(sigmas))))
    return found


def in_words(proposals: Sequence[Proposal], names: Sequence[str]) -> str:
    """Say what to do next to distinguish models, or that no candidate would."""
    if not proposals:
        return ""
    between = f"{', '.join(names[:-1])} and {names[-1]}"
    best = proposals[0]
    if best.sigma < 1.0:
        return f"To distinguish {between}: no tested run or measurement is sufficient (at most {best.sigma:.1f} sigma)."
    again = "" if best.repeats == 1 else f"; {ENOUGH_SIGMA:g} sigma after {best.repeats} repetitions"
    return f"To distinguish {between}: {best.what} (expected separation {best.sigma:.1f} sigma{again})."


def best_of_each(proposals: Sequence[Proposal]) -> tuple[Proposal, ...]:
    """Return the best temperature for each load pattern, and every measurement."""
    kept: dict[str, Proposal] = {}
    for one in proposals:
        kept.setdefault(one.what.rpartition(" at ")[0] or one.what, one)
    return tuple(kept.values())
