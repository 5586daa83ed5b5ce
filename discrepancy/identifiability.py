"""What a case can tell of its parameters: information of its readings at the calibrated model, run by run."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from discrepancy.calibrate import Fit, fit, look
from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import one_thread_of_blas
from discrepancy.noise import residual_noise
from discrepancy.problem import Problem
from discrepancy.session import Session
from discrepancy.whitening import chain_starts
from jaxmodel.build import case_model
from jaxmodel.cases import Case
from jaxmodel.effects import CATALOGUE
from jaxmodel.errors import ParameterError, nearest
from jaxmodel.known import Known
from jaxmodel.names import parameter_table, value
from jaxmodel.parameters import TABLE, info
from jaxmodel.ports import Effect
from sensitivity.information import Floats, Information, direction_in_words

# What is asked for and stated as exact is taken as known to this share of its value, for want of anything better.
ASSUMED_SHARE = 0.3
_ASSUMED_RANGE_SHARE = 0.1  # and a number that may be zero to this share of its range
# Below this the data know less of a direction than was known before.
SLOPPY = 1.0
# An sd of this share of what was known before is an answer, of that one part of one.
_TOLD, _PARTLY = 0.5, 0.9
# By how much less chi-square a profile must find for the calibration to begin anew.
_DEEPER = 0.2
# A model that leaves more than this times the noise misses more than noise.
MISFIT = 1.5


@dataclasses.dataclass(frozen=True)
class Profiled:
    """The likelihood with one parameter held, all others fitted again, beside what the quadratic says.

    Attributes:
        name: of the parameter.
        values: where it was held, in its unit.
        rise: of chi-square (readings and priors) over its least.
        quadratic: the rise that the information predicts.
        interval: where the rise is 1, in the parameter's unit; nan where the profile ends before.
        lowest: coordinates of all unknowns where the rise is least: below zero, calibration had stopped short.
    """

    name: str
    values: Floats
    rise: Floats
    quadratic: Floats
    interval: tuple[float, float]
    lowest: Floats

    @property
    def lies(self) -> bool:
        """Return True where the quadratic is off by more than a quarter of a standard deviation within two of them."""
        near = self.quadratic <= 4.0 + 1e-9
        return bool(np.max(np.abs(np.sqrt(np.maximum(self.rise, 0.0)) - np.sqrt(self.quadratic))[near]) > 0.25)


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """What the fit runs of a case tell of its unknowns.

    Attributes:
        case: its name.
        information: in prior sd, its parts the cells of (run, sensor), in order.
        runs: names of the fit runs.
        sensors: names of the channels.
        values: of the unknowns at the calibrated model, in their units.
        units: of the unknowns.
        prior_sd: in units, at the calibrated model.
        logarithmic: True where the unknown moves in proportion.
        relative: d ln p / dx, or 1 where a relative change means nothing.
        assumed: unknowns whose prior is assumed, not stated in the case.
        misfit: root mean square of the residual in sd of the noise: 1 where the model fits. Where it does not, the
            bounds are for noise as large and as correlated as what the model leaves.
    """

    case: str
    information: Information
    runs: tuple[str, ...]
    sensors: tuple[str, ...]
    values: Floats
    units: tuple[str, ...]
    prior_sd: Floats
    logarithmic: tuple[bool, ...]
    relative: Floats
    assumed: tuple[str, ...]
    misfit: float

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the unknowns, those of one run with its name in brackets."""
        return self.information.names

    @property
    def sd(self) -> Floats:
        """Return the Cramer-Rao bounds with what was known before, in units."""
        return self.information.sd() * self.prior_sd

    @property
    def sd_of_data(self) -> Floats:
        """Return the Cramer-Rao bounds of the data alone, in units; inf where they leave an unknown open."""
        return self.information.sd_of_data() * self.prior_sd

    @functools.cached_property
    def _shares(self) -> Floats:
        return self.information.shares()

    def shares_by_run(self) -> Floats:
        """Return the runs' shares in what is known at last, shape (runs, unknowns); see `Information.shares`."""
        return self._shares[:-2].reshape(len(self.runs), len(self.sensors), -1).sum(axis=1)

    def shares_by_sensor(self) -> Floats:
        """Return the sensors' shares in what is known at last, shape (sensors, unknowns)."""
        return self._shares[:-2].reshape(len(self.runs), len(self.sensors), -1).sum(axis=0)

    def shares_known_before(self) -> Floats:
        """Return the shares of what was known before, of the parameter itself and of the others, (2, unknowns)."""
        return self._shares[-2:]

    def sd_without_run(self) -> Floats:
        """Return the bounds in units with each run left out in turn, shape (runs, unknowns)."""
        width = len(self.sensors)
        cells = [range(i * width, (i + 1) * width) for i in range(len(self.runs))]
        return np.array([self.information.without(one).sd() * self.prior_sd for one in cells])

    def sd_without_sensor(self) -> Floats:
        """Return the bounds in units with each sensor left out in turn, shape (sensors, unknowns)."""
        width = len(self.sensors)
        cells = [range(i, len(self.runs) * width, width) for i in range(width)]
        return np.array([self.information.without(one).sd() * self.prior_sd for one in cells])

    def sloppy(self) -> list[tuple[float, str]]:
        """Return the directions of which the data tell less than was known before: information, and words for it."""
        proportional = {n: bool(log) for n, log in zip(self.names, self.logarithmic, strict=True)}
        return [
            (float(strength), direction_in_words(self.names, way * self.relative, proportional))
            for strength, way in zip(*(part.T for part in self.information.directions()), strict=True)
            if strength < SLOPPY
        ]

    def place(self, name: str) -> int:
        """Return the number of an unknown; of one that each run has for its own, the name alone is the first run's.

        Raises:
            ParameterError: it is not among the unknowns.
        """
        meant = [i for i, known in enumerate(self.names) if name in (known, known.partition("[")[0])]
        if not meant:
            raise ParameterError(f"{self.case}: '{name}' is not among the unknowns.{nearest(name, self.names)}")
        return meant[0]

    def answer(self, name: str) -> str:
        """Say in one sentence whether the data can tell a parameter.

        Raises:
            ParameterError: it is not among the unknowns.
        """
        i = self.place(name)
        unit = f" {self.units[i]}" if self.units[i] else ""
        before, after, alone = (float(part[i]) for part in (self.prior_sd, self.sd, self.sd_of_data))
        known = f"{_rounded(before)}{unit} {'assumed' if name in self.assumed else 'known'} before"
        if self.information.total[i, i] < 1e-8:
            return f"No: nothing that was measured depends on {name}."
        found = f"{name} = {self.values[i]:.4g} ± {_rounded(after)}{unit}"
        if after > _PARTLY * before:
            why = self._why_not(i)
            return f"No: the data leave {name} at ± {_rounded(after)}{unit}, against ± {known}; {why}."
        verdict = "Yes" if after <= _TOLD * before and alone <= 2.0 * after else "In part"
        gain = f"{_rounded(before / after)} times as well as the ± {known}"
        if alone <= 2.0 * after:
            how = f"{self._best_source(i)}"
        else:
            open_ = f"± {_rounded(alone)}{unit}" if np.isfinite(alone) else "nothing certain"
            how = f"only with what was known of the others: the data alone would give {open_}"
        but = (
            f"; the model misses the data by {_rounded(self.misfit)} times the noise, and the ± holds only as far as "
            f"what it misses is like noise"
            if self.misfit > MISFIT
            else ""
        )
        return f"{verdict}: {found}, {gain}; {how}{but}."

    def _best_source(self, i: int) -> str:
        cells = self._shares[:-2, i]
        best = int(np.argmax(cells))
        run, sensor = self.runs[best // len(self.sensors)], self.sensors[best % len(self.sensors)]
        return f"{100.0 * cells[best]:.0f} % of it from {sensor} of {run}"

    def _why_not(self, i: int) -> str:
        if self.information.total[i, i] < 1.0:
            return "the readings hardly move with it"
        strength, axes = self.information.directions()
        weights = axes[i] ** 2 / (1.0 + strength)
        way = axes[:, int(np.argmax(weights))] * self.relative
        proportional = {n: bool(log) for n, log in zip(self.names, self.logarithmic, strict=True)}
        words = direction_in_words(self.names, way, proportional)
        return f"they tell {words}" if "only as" in words else f"they leave open {words}"


def _rounded(number: float) -> str:
    return f"{number:.2g}" if abs(number) < 100.0 else f"{number:.0f}"


def asking_for(
    case: Case, names: Sequence[str], catalogue: Mapping[str, type[Effect]] = CATALOGUE
) -> tuple[Case, tuple[str, ...]]:
    """Return the case with parameters made uncertain that it states as exact, and which these are.

    A number without an uncertainty is taken as known to 30 % of its value, one that may be zero to a tenth of its
    range.

    Raises:
        ParameterError: a name is unknown.
    """
    changed: dict[str, Known] = {}
    for name in names:
        if name not in TABLE:
            known = parameter_table(case_model(case, case.runs[0], catalogue=catalogue))
            raise ParameterError(f"--parameter {name}: no parameter is called so.{nearest(name, [*known])}")
        stated = case.parameters.get(name)
        in_runs = name == "initial_soc" or any(name in run.overrides and run.overrides[name].sd for run in case.runs)
        if in_runs or (stated is not None and stated.sd is not None):
            continue
        known = info(name)
        number = float(
            stated.value if stated is not None else value(case_model(case, case.runs[0], catalogue=catalogue), name)
        )
        width = known.upper - known.lower
        sd = ASSUMED_SHARE * abs(number) or (_ASSUMED_RANGE_SHARE * width if np.isfinite(width) else 1.0)
        changed[name] = Known(number, sd)
    return dataclasses.replace(case, parameters=case.parameters | changed), tuple(changed)


@one_thread_of_blas
def calibrated(session: Session, labels: Sequence[str] = ()) -> tuple[Session, Hypothesis, float]:
    """Return the session in which a model's estimates can be trusted, the model calibrated, and its misfit.

    The misfit is the root mean square of the residual in sd of the noise. Where it is not near 1, what the model misses
    is no noise, and the noise's bounds mean nothing. Then all that it leaves is weighed as noise instead, as large and
    as correlated from reading to reading as it is.
    """
    best = session.hypothesis(labels)
    misfit = float(np.sqrt(best.fitted.chi2 / np.sum(np.asarray(best.problem.readings.fit))))
    if misfit < MISFIT:
        return session, best, misfit
    coarse = session.reweighted(best)
    predictions = session.rung("", best).predictions
    runs = [run for run in session.case.runs if run.split == "fit"]
    for name, model in coarse.weights.items():
        own = [run for run in runs if name in run.measured.outputs]
        if not own:
            continue
        left = [run.measured.outputs[name] - predictions[run.name][name] for run in own]
        found = residual_noise(np.concatenate(left), chain_starts([run.measured.time_s for run in own]))
        coarse.weights[name] = dataclasses.replace(model, sd=max(model.sd, found.sd), rho=max(found.rho, 0.0))
    return coarse, coarse.hypothesis(labels), misfit


@one_thread_of_blas
def deeper(hypothesis: Hypothesis, profiled: Profiled) -> Hypothesis | None:
    """Return the model calibrated anew from where a profile was lower than its minimum, None where it nowhere was."""
    if np.min(profiled.rise) > -_DEEPER:
        return None
    found = fit(hypothesis.problem, profiled.lowest)
    return dataclasses.replace(hypothesis, fitted=found)


@one_thread_of_blas
def identifiability(
    session: Session, hypothesis: Hypothesis, misfit: float = 1.0, assumed: Sequence[str] = ()
) -> Identifiability:
    """Return what the fit runs of a session's case tell of the unknowns of a calibrated model.

    Args:
        session: of the case.
        hypothesis: a calibrated model.
        misfit: how far it misses the data, in sd of the noise.
        assumed: names of unknowns whose prior is none of the case's.
    """
    case, problem, layout, x = session.case, hypothesis.problem, hypothesis.layout, hypothesis.fitted.x
    names = names_of(case, hypothesis)
    fit_runs = problem.runs_read("fit").tolist()
    # What belongs to a check run is not asked of the fit runs.
    kept = [i for i in hypothesis.own if layout.runs[i] < 0 or layout.runs[i] in fit_runs]
    sensors = tuple(session.noise)
    values = np.array([layout.coordinates[i].number(x[i]) for i in kept])
    slopes = np.array([layout.coordinates[i].slope(x[i]) for i in kept])
    proportional = tuple(
        _is_proportional(layout.coordinates[i].name, value) for i, value in zip(kept, values, strict=True)
    )
    table = parameter_table(problem.models)
    return Identifiability(
        case=case.name,
        information=Information(tuple(names[i] for i in kept), _parts(problem, x, sensors)[:, kept][:, :, kept]),
        runs=tuple(case.runs[number].name for number in fit_runs),
        sensors=sensors,
        values=values,
        units=tuple(table[layout.coordinates[i].name].unit for i in kept),
        prior_sd=slopes,
        logarithmic=proportional,
        relative=np.where(proportional, slopes / np.where(values == 0.0, 1.0, values), 1.0),
        assumed=tuple(assumed),
        misfit=misfit,
    )


def _is_proportional(name: str, number: float) -> bool:
    return bool(number) and (name not in TABLE or (TABLE[name].unit != "degC" and TABLE[name].transform == "log"))


def names_of(case: Case, hypothesis: Hypothesis) -> tuple[str, ...]:
    """Return the names of all unknowns, those of one run with its name in brackets."""
    layout = hypothesis.layout
    return tuple(
        name + (f"[{case.runs[run].name}]" if run >= 0 else "")
        for name, run in zip(layout.names, layout.runs, strict=True)
    )


def _parts(problem: Problem, x: np.ndarray, sensors: Sequence[str]) -> np.ndarray:
    """Return J'J of the fit readings of each run and sensor, shape (runs * sensors, unknowns, unknowns)."""
    part = problem.only("fit")
    slopes = look(part, x)[1]
    place, counts = np.asarray(part.readings.index), np.asarray(part.readings.fit) > 0.0
    run, _, channel = np.unravel_index(place, (*part.times.shape, len(part.channels)))
    parts = []
    for number in range(part.times.shape[0]):
        for sensor in sensors:
            own = slopes[counts & (run == number) & (channel == part.channels.index(sensor))]
            parts.append(own.T @ own)
    return np.array(parts)


@one_thread_of_blas
def profile_likelihood(
    session: Session, hypothesis: Hypothesis, name: str, reach: float = 3.0, places: int = 9
) -> Profiled:
    """Return the likelihood along one unknown, all others fitted anew at each place.

    Args:
        session: of the case.
        hypothesis: calibrated.
        name: of the unknown, one of `names_of`.
        reach: to how many sd on either side.
        places: how many, an odd number.
    """
    best, number = hypothesis.fitted, names_of(session.case, hypothesis).index(name)
    others = [i for i in hypothesis.own if i != number]
    offsets = np.linspace(-reach, reach, places)
    middle = places // 2
    fits = [best] * places
    for side in (range(middle + 1, places), range(middle - 1, -1, -1)):
        at: Fit = best
        for place in side:  # outwards, each fit begun from its neighbour's
            start = at.x.copy()
            start[number] = best.x[number] + offsets[place] * best.sd[number]
            at = fits[place] = fit(hypothesis.problem, start, others)
    coordinate = hypothesis.layout.coordinates[number]
    xs = best.x[number] + offsets * best.sd[number]
    # Its own prior counts, though a fit with the unknown held does not count it.
    chi2 = np.array([one.chi2 + float(one.x @ one.x) for one in fits])
    rise = chi2 - chi2[middle]
    return Profiled(
        name=name,
        values=np.array([coordinate.number(x) for x in xs]),
        rise=rise,
        quadratic=offsets**2,
        interval=(
            coordinate.number(_crossing(xs[middle::-1], rise[middle::-1])),
            coordinate.number(_crossing(xs[middle:], rise[middle:])),
        ),
        lowest=fits[int(np.argmin(rise))].x,
    )


def _crossing(xs: np.ndarray, rise: np.ndarray) -> float:
    """Return where the rise reaches 1, nan where it does not: the root of the rise is nearly straight there."""
    root = np.sqrt(np.maximum(rise, 0.0))
    beyond = np.flatnonzero(root >= 1.0)
    if not beyond.size:
        return float("nan")
    last = int(beyond[0])
    return float(np.interp(1.0, root[last - 1 : last + 1], xs[last - 1 : last + 1]))
