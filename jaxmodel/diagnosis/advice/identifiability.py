"""How well a case determines its parameters: Fisher information of its readings at the calibrated model, by run."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from jaxmodel.base.errors import ParameterError, nearest
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import Fit, calibrate
from jaxmodel.fit.gauss_newton import descend
from jaxmodel.fit.lanes import one_thread_of_blas
from jaxmodel.model.names import parameter_table
from jaxmodel.model.parameters import TABLE
from jaxmodel.sensitivity.information import Floats, Information, direction_in_words

# Information of a direction, relative to the prior, below which it is reported as undetermined.
SLOPPY = 1.0
# Ratio of posterior to prior sd up to which the answer is "Yes", and "In part".
_DETERMINED, _PARTLY = 0.5, 0.9
# Decrease of chi-square along a profile from which the calibration is started again.
_DEEPER = 0.2
# RMS residual, in sd of the noise, above which it is said that the model is off.
MISFIT = 1.5
# Steps of a fit with one unknown held.
_STEPS = 6
# Initial states that a case need not state; left out if their information is below this share of the prior's.
_UNSTATED_STARTS, _NOTHING = ("initial_hysteresis", "initial_temperature_rise_K"), 1e-6


@dataclasses.dataclass(frozen=True)
class Profiled:
    """The profile likelihood of one parameter and its quadratic approximation.

    Attributes:
        name: of the parameter.
        values: at which it was held, in its unit.
        rise: of chi-square (readings and priors) above its minimum.
        quadratic: the rise that the information predicts.
        interval: where the rise is 1, in the parameter's unit; nan if the profile ends before.
        lowest: coordinates of all unknowns at the smallest rise; if it is negative, the calibration had not converged.
    """

    name: str
    values: Floats
    rise: Floats
    quadratic: Floats
    interval: tuple[float, float]
    lowest: Floats

    @property
    def is_not_quadratic(self) -> bool:
        """Return True if the quadratic approximation is wrong by more than 0.25 sd within two sd."""
        near = self.quadratic <= 4.0 + 1e-9
        return bool(np.max(np.abs(np.sqrt(np.maximum(self.rise, 0.0)) - np.sqrt(self.quadratic))[near]) > 0.25)


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """How well the fit runs of a case determine its unknowns.

    Attributes:
        case: its name.
        information: in units of prior sd; its parts are the pairs (run, sensor), in order.
        runs: names of the fit runs.
        sensors: names of the channels.
        values: of the unknowns at the calibrated model, in their units.
        units: of the unknowns.
        prior_sd: in units, at the calibrated model.
        logarithmic: True if changes of the unknown are relative.
        relative: d ln p / dx, or 1 if a relative change has no meaning.
        assumed: unknowns whose prior is assumed, not stated in the case.
        misfit: RMS residual in sd of the noise, 1 if the model fits. If it does not, the bounds treat the residual as
            an autocorrelated model error.
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
        """Return the Cramer-Rao bounds with the priors, in units."""
        return self.information.sd() * self.prior_sd

    @property
    def sd_of_data(self) -> Floats:
        """Return the Cramer-Rao bounds of the data alone, in units; inf if they do not determine an unknown."""
        return self.information.sd_of_data() * self.prior_sd

    @functools.cached_property
    def _shares(self) -> Floats:
        return self.information.shares()

    def shares_by_run(self) -> Floats:
        """Return the runs' shares in the final information, shape (runs, unknowns); see `Information.shares`."""
        return self._shares[:-2].reshape(len(self.runs), len(self.sensors), -1).sum(axis=1)

    def shares_by_sensor(self) -> Floats:
        """Return the sensors' shares in the final information, shape (sensors, unknowns)."""
        return self._shares[:-2].reshape(len(self.runs), len(self.sensors), -1).sum(axis=0)

    def shares_known_before(self) -> Floats:
        """Return the shares of the parameter's own prior and of the priors of the others, (2, unknowns)."""
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
        """Return the directions with less information from the data than from the prior, with a description."""
        proportional = {n: bool(log) for n, log in zip(self.names, self.logarithmic, strict=True)}
        return [
            (float(strength), direction_in_words(self.names, way * self.relative, proportional))
            for strength, way in zip(*(part.T for part in self.information.directions()), strict=True)
            if strength < SLOPPY
        ]

    def place(self, name: str) -> int:
        """Return the index of an unknown; a name without run means the first run's.

        Raises:
            ParameterError: it is not among the unknowns.
        """
        meant = [i for i, known in enumerate(self.names) if name in (known, known.partition("[")[0])]
        if not meant:
            raise ParameterError(f"{self.case}: '{name}' is not among the unknowns.{nearest(name, self.names)}")
        return meant[0]

    def answer(self, name: str) -> str:
        """Say in one sentence whether the data determine a parameter.

        Raises:
            ParameterError: it is not among the unknowns.
        """
        i = self.place(name)
        unit = f" {self.units[i]}" if self.units[i] else ""
        before, after, alone = (float(part[i]) for part in (self.prior_sd, self.sd, self.sd_of_data))
        prior = f"{'assumed' if name in self.assumed else 'stated'} sd of {_rounded(before)}{unit}"
        if self.information.total[i, i] < 1e-8:
            return f"No: no reading depends on {name}."
        found = f"{name} = {self.values[i]:.4g} ± {_rounded(after)}{unit}"
        if after > _PARTLY * before:
            why = self._why_not(i)
            return f"No: with the data the sd of {name} is {_rounded(after)}{unit}, against the {prior}; {why}."
        verdict = "Yes" if after <= _DETERMINED * before and alone <= 2.0 * after else "In part"
        gain = f"{_rounded(before / after)} times more accurate than the {prior}"
        if alone <= 2.0 * after:
            how = f"{self._best_source(i)}"
        else:
            of_data = f"give an sd of {_rounded(alone)}{unit}" if np.isfinite(alone) else "do not determine it"
            how = f"this needs the stated values of other parameters: the data alone {of_data}"
        but = (
            f"; the RMS residual is {_rounded(self.misfit)} times the noise, and the sd is valid only if "
            f"the model error averages out like noise"
            if self.misfit > MISFIT
            else ""
        )
        return f"{verdict}: {found}, {gain}; {how}{but}."

    def _best_source(self, i: int) -> str:
        cells = self._shares[:-2, i]
        best = int(np.argmax(cells))
        run, sensor = self.runs[best // len(self.sensors)], self.sensors[best % len(self.sensors)]
        return f"{100.0 * cells[best]:.0f} % of the information comes from {sensor} in {run}"

    def _why_not(self, i: int) -> str:
        if self.information.total[i, i] < 1.0:
            return "the readings hardly depend on it"
        strength, axes = self.information.directions()
        weights = axes[i] ** 2 / (1.0 + strength)
        way = axes[:, int(np.argmax(weights))] * self.relative
        proportional = {n: bool(log) for n, log in zip(self.names, self.logarithmic, strict=True)}
        words = direction_in_words(self.names, way, proportional)
        return f"they determine {words}" if "only as" in words else f"they do not determine {words}"


def _rounded(number: float) -> str:
    return f"{number:.2g}" if abs(number) < 100.0 else f"{number:.0f}"


@one_thread_of_blas
def calibrated(cache: FitCache, labels: Sequence[str] = ()) -> tuple[Fit, float]:
    """Return a calibrated model, and its RMS residual in sd of the noise.

    If that is not close to 1, the residual is treated as error of the model: the weights of a fit are those of the
    errors that it leaves.
    """
    found = cache.fit(labels, "none")
    squares = [(found.errors[rows] / cache.view.data.sd[rows]) ** 2 for _, rows in cache.view.data.chains]
    return found, float(np.sqrt(np.mean(np.concatenate(squares))))


@one_thread_of_blas
def deeper(cache: FitCache, fit: Fit, profiled: Profiled) -> Fit | None:
    """Return the model calibrated again from where a profile was below its minimum; None if it was not."""
    if np.min(profiled.rise) > -_DEEPER:
        return None
    weights = fit.likelihood
    return calibrate(cache.view, fit.spec, profiled.lowest, cache.tolerances, weights, held=weights.channels)


def identifiability(cache: FitCache, fit: Fit, misfit: float = 1.0, assumed: Sequence[str] = ()) -> Identifiability:
    """Return how well the fit runs of a case determine the unknowns of a calibrated model.

    Args:
        cache: of the case.
        fit: a calibrated model.
        misfit: its RMS residual, in sd of the noise.
        assumed: names of unknowns whose prior is assumed.
    """
    case, space, free = cache.case, cache.space, fit.spec.free
    layout, fit_runs, sensors = space.layout, cache.fit_runs, tuple(cache.noise)
    parts = _parts(fit, fit_runs, sensors)
    information = np.diag(parts.sum(axis=0))
    # Unknowns of check runs are left out.
    kept = [
        i
        for i, place in enumerate(free)
        if (layout.runs[place] < 0 or layout.runs[place] in fit_runs)
        and not (layout.coordinates[place].name in _UNSTATED_STARTS and information[i] < _NOTHING)
    ]
    coordinates, x = [layout.coordinates[free[i]] for i in kept], [fit.x[free[i]] for i in kept]
    values = np.array([one.number(at) for one, at in zip(coordinates, x, strict=True)])
    prior_sd = (
        np.array([one.slope(at) for one, at in zip(coordinates, x, strict=True)]) * fit.spec.precision[kept] ** -0.5
    )
    proportional = tuple(_is_proportional(one.name, value) for one, value in zip(coordinates, values, strict=True))
    units = {name: known.unit for name, known in parameter_table(space.coarse.models).items()}
    names = names_of(cache)
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


def names_of(cache: FitCache) -> tuple[str, ...]:
    """Return the names of all unknowns, those of one run or specimen with its name in brackets."""
    layout = cache.space.layout
    return tuple(map(layout.name_of, range(layout.size)))


def _parts(fit: Fit, runs: Sequence[int], sensors: Sequence[str]) -> np.ndarray:
    """Return J'J of the readings of each run and sensor, in prior sd, shape (runs * sensors, k, k)."""
    scale, count = fit.spec.precision**-0.5, len(fit.spec.free)
    parts = np.zeros((len(runs), len(sensors), count, count))
    for number, block in fit.linear.blocks.items():
        for sensor, gram in block.items():
            squared = fit.likelihood.channels[sensor].root ** 2
            own = squared * scale[:, None] * gram.square * scale
            parts[runs.index(fit.linear.runs[number]), sensors.index(sensor)] += own
    return parts.reshape(-1, count, count)


@one_thread_of_blas
def profile_likelihood(cache: FitCache, fit: Fit, name: str, reach: float = 3.0, places: int = 9) -> Profiled:
    """Return the profile likelihood of one unknown: all others are fitted again at each of its values.

    Args:
        cache: of the case.
        fit: a calibrated model.
        name: of the unknown, one of `names_of`.
        reach: sd on either side.
        places: number of values, odd.
    """
    view, free, number = cache.view, list(fit.spec.free), names_of(cache).index(name)
    others = fit.spec.with_free([place for place in free if place != number])
    offsets = np.linspace(-reach, reach, places)
    xs = fit.x[number] + offsets * float(np.sqrt(fit.covariance[free.index(number), free.index(number)]))
    middle = places // 2
    at, objective = [fit.x] * places, np.full(places, fit.objective)
    for side in (range(middle + 1, places), range(middle - 1, -1, -1)):
        start = fit.x
        for place in side:  # outwards, each fit starts at its neighbour's
            start = start.copy()
            start[number] = xs[place]
            point = descend(view, others, fit.likelihood, start, steps=_STEPS)
            # The prior of the held unknown counts too, which a fit with it held leaves out.
            own = fit.spec.precision[free.index(number)] * xs[place] ** 2
            at[place], objective[place], start = point.x, point.objective + own, point.x
    coordinate = cache.space.layout.coordinates[number]
    rise = objective - objective[middle]
    return Profiled(
        name=name,
        values=np.array([coordinate.number(x) for x in xs]),
        rise=rise,
        quadratic=offsets**2,
        interval=(
            coordinate.number(_crossing(xs[middle::-1], rise[middle::-1])),
            coordinate.number(_crossing(xs[middle:], rise[middle:])),
        ),
        lowest=at[int(np.argmin(rise))],
    )


def _crossing(xs: np.ndarray, rise: np.ndarray) -> float:
    """Return where the rise reaches 1, by linear interpolation of its root; nan if it does not."""
    root = np.sqrt(np.maximum(rise, 0.0))
    beyond = np.flatnonzero(root >= 1.0)
    if not beyond.size:
        return float("nan")
    last = int(beyond[0])
    return float(np.interp(1.0, root[last - 1 : last + 1], xs[last - 1 : last + 1]))
