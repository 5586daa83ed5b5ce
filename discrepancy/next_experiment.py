"""The experiment that would decide between hypotheses which this data cannot tell apart (step 10).

With D the whitened difference of what two calibrated models predict for a run, J the second one's sensitivities there
and S the covariance of its unknowns after the data at hand, the run would raise the second one's chi-square, refitted
to old and new data together, by D'(I + J S J')^-1 D if the first is true: the square of the separation in sigma.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

import numpy as np

from discrepancy.calibrate import look
from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import predict
from discrepancy.session import Session
from jaxmodel.cases import Case, Known, Run
from jaxmodel.measurements import Measured

# Inputs that drive; all others load.
DRIVES = ("current_A", "voltage_V", "duty")
AMBIENTS_degC = (-10.0, 0.0, 10.0, 25.0, 40.0)
FIRST_SOC = 0.95
EMPTY_SOC = 0.1
REST_S = 60.0
# How well a quantity can be measured by itself, of its value (an ohmmeter, a hung weight, a calibrated shunt).
ANCHORED_TO = 0.005
# Multipliers of a whole table, which no single instrument reads.
NOT_BY_ITSELF = ("_scale", "_offset_V")
# What tells two hypotheses apart for good.
ENOUGH_SIGMA = 5.0


@dataclasses.dataclass(frozen=True)
class Proposal:
    """One thing that could be done, and what it would tell.

    Attributes:
        what: in words.
        sigma: the least separation that it would bring between any two of the hypotheses.
        repeats: how often it must be done to reach five sigma.
    """

    what: str
    sigma: float

    @property
    def repeats(self) -> int:
        """Return how many such runs it takes to reach five sigma."""
        return int(np.ceil((ENOUGH_SIGMA / max(self.sigma, 1e-3)) ** 2))


def propose(session: Session, rivals: Sequence[Hypothesis]) -> tuple[Proposal, ...]:
    """Return runs and measurements that would tell calibrated hypotheses apart, the one that tells most first.

    Args:
        session: of the case.
        rivals: two or more hypotheses of it.
    """
    if len(rivals) < 2:
        return ()
    designs = list(bank(session.case))
    seen = [_foreseen(session, one, designs) for one in rivals]
    pairs = [(a, b) for a, b in itertools.permutations(range(len(rivals)), 2)]
    found = [
        Proposal(design.label, min(_separation(seen[a][number], seen[b][number]) for a, b in pairs))
        for number, design in enumerate(designs)
    ]
    found += _anchors(rivals)
    return tuple(sorted(found, key=lambda one: -one.sigma))


def bank(case: Case) -> Iterator[Run]:
    """Return the runs that the bench can do: loads no larger than it has driven, at five temperatures.

    They last as long, and are read as often, as the longest run of the case. Where runs state exact numbers of their
    own (a cell of another age), each run is proposed for either of the specimens that differ most.
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
    """Return the exact numbers of the two most different specimens among the runs, of a single one if all are alike."""
    stated = [{name: known for name, known in run.overrides.items() if known.sd is None} for run in case.runs]
    names = dict.fromkeys(name for one in stated for name in one)

    def values(own: dict[str, Known]) -> tuple[float, ...]:
        return tuple((own.get(name) or case.parameters.get(name, Known(0.0))).value for name in names)

    ordered = sorted(stated, key=values)
    ends = {values(own): own for own in (ordered[0], ordered[-1])}
    if len(ends) == 1:
        return {"": ordered[0]}
    told = {key: ", ".join(f"{name} = {value:g}" for name, value in zip(names, key, strict=True)) for key in ends}
    return {f" with {told[key]}": own for key, own in ends.items()}


def _patterns(time_s: np.ndarray, kind: str):
    """Return what is done to the drive (current, voltage or duty) and to the load, as shares of the largest."""
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
            "full load to the end": both(one, one),
            "pulses with rests": both(pulses, one),
            "steps of load": both(stepped, one),
            "slow discharge": both(slow, one),
            "discharge and charge in turn": both(alternating, one),
        }
    return {
        "full drive and load": both(one, one),
        "full drive without load": both(one, 0.0 * one),
        "steps of drive without load": both(stepped, 0.0 * one),
        "steps of drive and load": both(stepped, stepped[::-1]),
        "starts with rests": both(pulses, pulses),
        "slow drive under load": both(np.full(time_s.size, 0.35), 0.8 * one),
    }


@dataclasses.dataclass(frozen=True)
class _Foreseen:
    """What one hypothesis foresees for one run: whitened rows, sensitivities, and its knowledge before the run."""

    rows: np.ndarray
    jacobian: np.ndarray
    possible: np.ndarray  # of the rows: before the cell is empty
    known: np.ndarray  # inverse covariance of the unknowns


def _foreseen(session: Session, hypothesis: Hypothesis, designs: Sequence[Run]) -> list[_Foreseen]:
    """Return what a hypothesis foresees for every run of the bank, as many at a time as the case has fit runs.

    Their layout is then that of the case, whose program is compiled already.
    """
    layout, fitted = hypothesis.layout, hypothesis.fitted
    case = session.case
    slots = [number for number, run in enumerate(case.runs) if run.split == "fit"]
    found: list[_Foreseen] = []
    shared = [place for place, run in enumerate(layout.runs) if run < 0]
    covariance = np.linalg.inv(fitted.information)[np.ix_(shared, shared)]
    precision = np.eye(fitted.x.size)
    precision[np.ix_(shared, shared)] = np.linalg.inv(covariance)
    x = np.where(np.asarray(layout.runs) < 0, fitted.x, 0.0)
    fastest = _fastest(hypothesis) if case.kind == "motor" and "current_A" in designs[0].measured.inputs else np.inf
    for first in range(0, len(designs), len(slots)):
        batch = list(designs[first : first + len(slots)])
        runs = list(case.runs)
        for slot, new in zip(slots, batch + [batch[-1]] * (len(slots) - len(batch)), strict=True):
            runs[slot] = _in_the_place_of(runs[slot], new, tuple(session.noise))
        problem = session.problem_on(hypothesis, runs).only("fit")
        rows, jacobian = look(problem, x)
        run, row, _ = np.unravel_index(
            np.asarray(problem.readings.index), (*problem.times.shape, len(problem.channels))
        )
        possible = _possible(problem.channels, predict(problem, x), fastest)[run, row]
        for place in range(len(batch)):
            mine = np.flatnonzero((np.asarray(problem.readings.fit) > 0.0) & (run == place))
            found.append(_Foreseen(rows[mine], jacobian[mine], possible[mine], precision))
    return found


def _fastest(hypothesis: Hypothesis) -> float:
    """Return the greatest speed of a motor in the runs at hand: one driven by its current has no other limit."""
    speed = predict(hypothesis.problem, hypothesis.fitted.x)[..., hypothesis.problem.channels.index("speed_rad_s")]
    return float(np.max(np.abs(speed)))


def _possible(channels: Sequence[str], predicted: np.ndarray, fastest: float) -> np.ndarray:
    """Return, by run and row, whether the cell still has charge to go on, and no motor has run away."""
    goes_on = np.ones(predicted.shape[:2], dtype=bool)
    if "soc" in channels:
        goes_on &= predicted[:, :, channels.index("soc")] > EMPTY_SOC
    if "speed_rad_s" in channels:
        goes_on &= np.abs(predicted[:, :, channels.index("speed_rad_s")]) <= fastest
    return np.logical_and.accumulate(goes_on, axis=1)


def _in_the_place_of(old: Run, new: Run, channels: Sequence[str]) -> Run:
    """Return a run of the bank in the place of a run of the case: its unknowns, the readings still to be made."""
    blank = {name: np.zeros(new.measured.time_s.size) for name in channels}
    unknown = {name: known for name, known in old.overrides.items() if known.sd is not None}
    return dataclasses.replace(
        old,
        initial_soc=Known(FIRST_SOC, old.initial_soc.sd),
        split="fit",
        overrides=new.overrides | unknown,
        measured=dataclasses.replace(new.measured, outputs=blank),
    )


def _separation(true: _Foreseen, other: _Foreseen) -> float:
    """Return the sigma by which a run would speak against another hypothesis, refitted, if one is true."""
    both = true.possible & other.possible
    difference, jacobian = (true.rows - other.rows)[both], other.jacobian[both]
    taken = jacobian.T @ difference
    left = difference @ difference - taken @ np.linalg.solve(other.known + jacobian.T @ jacobian, taken)
    return float(np.sqrt(max(left, 0.0)))


def _anchors(rivals: Sequence[Hypothesis]) -> list[Proposal]:
    """Return what measuring a parameter by itself would tell: the models want different values of it."""
    found = []
    layout = rivals[0].layout
    for place, coordinate in enumerate(layout.coordinates[: layout.base]):
        if layout.runs[place] >= 0 or coordinate.name.endswith(NOT_BY_ITSELF):
            continue
        sigmas = []
        for one, other in itertools.combinations(rivals, 2):
            values = [coordinate.number(h.fitted.x[place]) for h in (one, other)]
            spread = [coordinate.slope(h.fitted.x[place]) * h.fitted.sd[place] for h in (one, other)]
            anchor = ANCHORED_TO * max(abs(value) for value in values)
            sigmas.append(abs(values[0] - values[1]) / np.sqrt(max(spread) ** 2 + anchor**2))
        found.append(Proposal(f"a measurement of {coordinate.name} by itself, to {100 * ANCHORED_TO:g} %", min(sigmas)))
    return found


def in_words(proposals: Sequence[Proposal], names: Sequence[str]) -> str:
    """Say what to do next to tell hypotheses apart, or that nothing of the bank would."""
    if not proposals:
        return ""
    between = f"{', '.join(names[:-1])} from {names[-1]}"
    best = proposals[0]
    if best.sigma < 1.0:
        return f"To tell {between}: no run or measurement that was tried would (at most {best.sigma:.1f} sigma)."
    again = "" if best.repeats == 1 else f"; {best.repeats} times for {ENOUGH_SIGMA:g}"
    return f"To tell {between}: {best.what} (expected to separate them by {best.sigma:.1f} sigma{again})."


def best_of_each(proposals: Sequence[Proposal]) -> tuple[Proposal, ...]:
    """Return the temperature that tells most for each pattern of load, and every measurement."""
    kept: dict[str, Proposal] = {}
    for one in proposals:
        kept.setdefault(one.what.rpartition(" at ")[0] or one.what, one)
    return tuple(kept.values())
