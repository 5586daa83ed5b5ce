"""What a case can tell of its parameters: information of its readings at the calibrated model, run by run."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from discrepancy.evidence.trial import Trial
from discrepancy.fitting.fit import Fit, errors_at, fit
from discrepancy.fitting.lanes import one_thread_of_blas
from discrepancy.fitting.readings import Weights
from discrepancy.noise.model_error import NONE, estimate
from discrepancy.workings import Workings
from jaxmodel.build import case_model
from jaxmodel.case import Case
from jaxmodel.errors import ParameterError, nearest
from jaxmodel.known import Known
from jaxmodel.names import parameter_table, value
from jaxmodel.parameters import TABLE, info
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
# Its error is then estimated so many times, from so many readings of a series, and the model fitted under it.
_REWEIGHTINGS, _MOST_OF_A_SERIES = 3, 1500
# Starts of a run that no case need state; where readings tell less of them than this share of the prior, they are no
# unknowns of it.
_UNSTATED_STARTS, _NOTHING = ("initial_hysteresis", "initial_temperature_rise_K"), 1e-6


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
        misfit: root mean square of what is left, in sd of the noise: 1 where the model fits. Where it does not, the
            bounds count what it leaves as an error with a memory, which many readings share.
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
            f"what it misses comes and goes like noise"
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


def asking_for(case: Case, names: Sequence[str]) -> tuple[Case, tuple[str, ...]]:
    """Return the case with parameters made uncertain that it states as exact, and which these are.

    A number without an uncertainty is taken as known to 30 % of its value, one that may be zero to a tenth of its
    range.

    Raises:
        ParameterError: a name is unknown.
    """
    changed: dict[str, Known] = {}
    for name in names:
        if name not in TABLE:
            known = parameter_table(case_model(case, case.runs[0]))
            raise ParameterError(f"--parameter {name}: no parameter is called so.{nearest(name, [*known])}")
        stated = case.parameters.get(name)
        in_runs = name == "initial_soc" or any(name in run.overrides and run.overrides[name].sd for run in case.runs)
        if in_runs or (stated is not None and stated.sd is not None):
            continue
        known = info(name)
        number = float(stated.value if stated is not None else value(case_model(case, case.runs[0]), name))
        width = known.upper - known.lower
        sd = ASSUMED_SHARE * abs(number) or (_ASSUMED_RANGE_SHARE * width if np.isfinite(width) else 1.0)
        changed[name] = Known(number, sd)
    return dataclasses.replace(case, parameters=case.parameters | changed), tuple(changed)


@one_thread_of_blas
def calibrated(investigation: Workings, labels: Sequence[str] = ()) -> tuple[Trial, float]:
    """Return a calibrated model, and the root mean square of what it leaves in sd of the noise.

    Where that is not near 1 the noise's bounds mean nothing. What the model leaves is then weighed as its error, as
    large and with as long a memory as it is; the investigation's own weights know only what the richest model leaves.
    """
    found: Trial = investigation.settled(labels)
    readings, setting = found.scale.view.readings, found.setting
    problem, weights = investigation.space.problem(setting), Weights(readings, NONE)
    left = errors_at(found.scale.view, problem, setting, found.fitted.x[None])[:, 0]
    misfit = float(np.sqrt(np.mean(weights.whiten(left) ** 2)))
    for _ in range(_REWEIGHTINGS if misfit > MISFIT else 0):
        error = estimate(readings.pieces(_MOST_OF_A_SERIES), readings.differenced(left))
        scale = found.scale.with_error(error)
        fitted = fit(scale.view, setting, scale.weights, found.fitted.x)
        found = Trial(setting, found.amplitudes, fitted, scale)
        left = errors_at(scale.view, problem, setting, fitted.x[None])[:, 0]
    return found, misfit


@one_thread_of_blas
def deeper(trial: Trial, profiled: Profiled) -> Trial | None:
    """Return the model calibrated anew from where a profile was lower than its minimum, None where it nowhere was."""
    if np.min(profiled.rise) > -_DEEPER:
        return None
    found = fit(trial.scale.view, trial.setting, trial.scale.weights, profiled.lowest)
    return dataclasses.replace(trial, fitted=found)


def identifiability(
    investigation: Workings, trial: Trial, misfit: float = 1.0, assumed: Sequence[str] = ()
) -> Identifiability:
    """Return what the fit runs of a case tell of the unknowns of a calibrated model.

    Args:
        investigation: of the case.
        trial: a calibrated model.
        misfit: how far it misses the data, in sd of the noise.
        assumed: names of unknowns whose prior is none of the case's.
    """
    case, space, fitted, free = investigation.case, investigation.space, trial.fitted, trial.setting.free
    layout, fit_runs, sensors = space.layout, investigation.fit_runs, tuple(investigation.noise)
    parts = _parts(trial, fit_runs, sensors)
    information = np.diag(parts.sum(axis=0))
    # What belongs to a check run is not asked of the fit runs.
    kept = [
        i
        for i, place in enumerate(free)
        if (layout.runs[place] < 0 or layout.runs[place] in fit_runs)
        and not (layout.coordinates[place].name in _UNSTATED_STARTS and information[i] < _NOTHING)
    ]
    coordinates, x = [layout.coordinates[free[i]] for i in kept], [fitted.x[free[i]] for i in kept]
    values = np.array([one.number(at) for one, at in zip(coordinates, x, strict=True)])
    prior_sd = np.array([one.slope(at) for one, at in zip(coordinates, x, strict=True)]) * fitted.prior_sd[kept]
    proportional = tuple(_is_proportional(one.name, value) for one, value in zip(coordinates, values, strict=True))
    units = {name: known.unit for name, known in parameter_table(space.coarse.models).items()}
    names = names_of(investigation)
    return Identifiability(
        case=case.name,
        information=Information(tuple(names[free[i]] for i in kept), parts[:, kept][:, :, kept]),
        runs=tuple(case.runs[number].name for number in fit_runs),
        sensors=sensors,
        values=values,
        units=tuple(units.get(one.name, "") for one in coordinates),
        prior_sd=prior_sd,
        logarithmic=proportional,
        relative=np.where(proportional, prior_sd / np.where(values == 0.0, 1.0, values), 1.0),
        assumed=tuple(assumed),
        misfit=misfit,
    )


def _is_proportional(name: str, number: float) -> bool:
    return bool(number) and (name not in TABLE or (TABLE[name].unit != "degC" and TABLE[name].transform == "log"))


def names_of(investigation: Workings) -> tuple[str, ...]:
    """Return the names of all unknowns, those of one run with its name in brackets."""
    layout, runs = investigation.space.layout, investigation.case.runs
    return tuple(
        name + (f"[{runs[run].name}]" if run >= 0 else "") for name, run in zip(layout.names, layout.runs, strict=True)
    )


def _parts(trial: Trial, runs: Sequence[int], sensors: Sequence[str]) -> np.ndarray:
    """Return J'J of the readings of each run and sensor, in prior sd, shape (runs * sensors, own, own)."""
    slopes = trial.fitted.jacobian * trial.fitted.prior_sd
    parts = np.zeros((len(runs), len(sensors), slopes.shape[1], slopes.shape[1]))
    for (sensor, run), rows in trial.scale.view.readings.chains:
        parts[runs.index(run), sensors.index(sensor)] = slopes[rows].T @ slopes[rows]
    return parts.reshape(-1, *parts.shape[2:])


@one_thread_of_blas
def profile_likelihood(
    investigation: Workings, trial: Trial, name: str, reach: float = 3.0, places: int = 9
) -> Profiled:
    """Return the likelihood along one unknown, all others fitted anew at each place.

    Args:
        investigation: of the case.
        trial: a calibrated model.
        name: of the unknown, one of `names_of`.
        reach: to how many sd on either side.
        places: how many, an odd number.
    """
    best, free, number = trial.fitted, list(trial.setting.free), names_of(investigation).index(name)
    view, weights = trial.scale.view, trial.scale.weights
    others = [place for place in free if place != number]
    offsets = np.linspace(-reach, reach, places)
    sd = float(best.sd()[free.index(number)])
    xs = best.x[number] + offsets * sd
    middle = places // 2
    fits = [best] * places
    for side in (range(middle + 1, places), range(middle - 1, -1, -1)):
        at: Fit = best
        for place in side:  # outwards, each fit begun from its neighbour's
            start = at.x.copy()
            start[number] = xs[place]
            at = fits[place] = fit(view, trial.setting, weights, start, free=others)
    coordinate = investigation.space.layout.coordinates[number]
    # Its own prior counts, though a fit with the unknown held does not count it.
    chi2 = np.array([one.chi2 + float(np.sum((one.x[free] / best.prior_sd) ** 2)) for one in fits])
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
