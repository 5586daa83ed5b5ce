"""Expected gain of every candidate to first order, from one set of inner products; no model is refitted.

A are the whitened sensitivities of a calibrated model, L the precision of its priors, S the sensitivities of a
candidate and r the whitened errors; the Gram matrix of [A | S ... | r] is sufficient. After projection off A,

    H = S'S - S'A (A'A + L)^-1 A'S,   u = S'r - S'A (A'A + L)^-1 (A'r - L x),

and an amplitude with the prior N(0, a^2) gains (u^2 a^2 / (1 + a^2 H) - log(1 + a^2 H)) / 2 of log evidence.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from jaxmodel.fit.candidates import SHIFTED, Candidate
from jaxmodel.fit.data import FitData
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.likelihood import Likelihood
from jaxmodel.fit.linearisation import Gram, log_evidence, solved
from jaxmodel.fit.screen import Direction, Screen
from jaxmodel.fit.settings import SEED

# A direction of which less than this remains after projection is within the error of finite differences.
ABSORBED = 3e-3
# Share of a squared length that is lost in rounding.
ROUNDING = 1e-12
# A candidate is no effect if less than this remains when parameters of all runs may be so many times further from their
# stated values: it is then a wrongly stated parameter. Assumed.
IMITATED, AS_FAR = 0.03, 30.0
# Prior sd of a curve or law, in units of its usual size; the best is used. Assumed.
AMPLITUDES = (0.1, 0.3, 1.0, 3.0)
# Grid of a standard normal, and the logarithms of its weights.
_PLACES = np.linspace(-4.0, 4.0, 161)
_LOG_SHARES = -0.5 * _PLACES**2 - np.log(np.sum(np.exp(-0.5 * _PLACES**2)))


@dataclasses.dataclass(frozen=True)
class Gain:
    """The expected gain of one candidate.

    Attributes:
        label: of the candidate.
        log_evidence: expected gain, to first order.
        chi2: expected drop in chi-square.
        start: coordinates at which its fit starts.
        amplitude: prior sd of a curve or law, in units of its usual size.
        z: signed score of a single amplitude; the root of the drop in chi-square for several.
        base_step: (k,) change of the model's free unknowns with it.
        step: amplitudes of its directions.
    """

    label: str
    log_evidence: float
    chi2: float
    start: np.ndarray
    amplitude: float
    z: float
    base_step: np.ndarray
    step: np.ndarray


class Scores:
    """A calibrated model and all candidates, linearised, under given weights."""

    def __init__(
        self,
        screened: Screen,
        data: FitData,
        fit: Fit,
        candidates: Mapping[str, Candidate],
        is_common: np.ndarray,
        likelihood: Likelihood | None = None,
    ) -> None:
        """Weight all columns and compute their inner products.

        Args:
            screened: the model's sensitivities and directions.
            data: the readings.
            fit: the model.
            candidates: by label.
            is_common: (k,) True for parameters of all runs.
            likelihood: the weights; the model's own if not given.
        """
        self.candidates, self.directions = candidates, screened.directions
        self.count = len(fit.spec.free)
        columns = [screened.base, *(way.columns for way in self.directions), screened.errors[:, None]]
        roots = (likelihood or fit.likelihood).roots(data)
        white = roots[:, None] * np.concatenate(columns, axis=1)
        of_channel = [data.channel == one for one in np.unique(data.channel)]
        self._grams = [white[rows].T @ white[rows] for rows in of_channel]
        own = fit.likelihood.roots(data) * fit.errors
        self._independent = [float(own[rows] @ own[rows]) for rows in of_channel]
        self._noise = [float(np.sum((roots[rows] * data.sd[rows]) ** 2)) for rows in of_channel]
        self.gram = np.sum(self._grams, axis=0)
        self._raw = columns
        self.precision = fit.spec.precision
        self.prior_slope = self.precision * fit.free
        edges = np.cumsum([self.count, *(way.columns.shape[1] for way in self.directions)])
        self.places = [slice(first, last) for first, last in itertools.pairwise(edges)]
        own, whole = slice(0, self.count), self._with_priors(self.gram)
        # How the model's own unknowns answer to each column, and where they go without any candidate.
        self._answers = _solved(whole[own, own], self.precision, whole[own])
        self.projected = whole - whole[:, own] @ self._answers
        loose = np.where(is_common, self.precision / AS_FAR**2, self.precision)
        self._free = np.diag(self._off(self.gram, slice(0, self.count), loose))

    def _off_own(self, gram: np.ndarray) -> np.ndarray:
        """Return the inner products after projection off the model's free unknowns."""
        return self._off(self._with_priors(gram), slice(0, self.count), self.precision)

    def _with_priors(self, gram: np.ndarray) -> np.ndarray:
        """Return the inner products with the slopes of the priors in those of the errors."""
        found = gram.copy()
        found[: self.count, -1] -= self.prior_slope
        found[-1, : self.count] -= self.prior_slope
        return found

    def _off(self, gram: np.ndarray, place: slice, precision: np.ndarray) -> np.ndarray:
        """Return the inner products after projection off some columns with a prior."""
        return gram - gram[:, place] @ _solved(gram[place, place], precision, gram[place])

    def gains(self, projected: np.ndarray | None = None) -> list[Gain]:
        """Return the expected gain of each candidate at its best shape, the largest first."""
        best = self._best_shapes(self.projected if projected is None else projected, self._labels)
        return sorted((gain for gain, _ in best.values()), key=lambda gain: -gain.log_evidence)

    @property
    def _labels(self) -> set[str]:
        return {way.label for way in self.directions}

    def _best_shapes(self, projected: np.ndarray, labels: Collection[str]) -> dict[str, tuple[Gain, slice]]:
        """Return the gain of each of some candidates at its best shape, and the place of that shape."""
        found: dict[str, tuple[Gain, slice]] = {}
        for way, place in zip(self.directions, self.places, strict=True):
            gain = self._gain(way, place, projected) if way.label in labels else None
            if gain is not None and (way.label not in found or gain.log_evidence > found[way.label][0].log_evidence):
                found[way.label] = gain, place
        return found

    def gains_by_channel(self) -> list[list[Gain]]:
        """Return the expected gains from each channel alone.

        If one channel has a large error, an effect that is visible in another may seem to lose evidence in all
        together.
        """
        return [self.gains(self._off_own(gram)) for gram in self._grams]

    def _gain(self, way: Direction, place: slice, projected: np.ndarray) -> Gain | None:
        candidate = self.candidates[way.label]
        inner, score = projected[place, place], projected[place, -1]
        if candidate.is_vector:
            whole = float(np.max(np.diag(self.gram)[place]))
            found = self._vector_gain(way.label, inner, score, whole)
            return dataclasses.replace(found, base_step=self._base_step(place, found.start), step=found.start)
        squared = float(inner[0, 0])
        whole = float(self.gram[place.start, place.start])
        if squared <= ABSORBED**2 * whole or squared <= 0.0 or self._free[place.start] <= IMITATED**2 * whole:
            return None
        length = np.sqrt(squared)
        z = float(score[0]) / length
        if candidate.group in SHIFTED:
            log = 0.5 * z**2 * squared / (1.0 + squared) - 0.5 * np.log1p(squared)
            at = np.array([float(score[0]) / (squared + 1.0)])
            return Gain(way.label, float(log), z**2, at, 1.0, z, self._base_step(place, at), at)
        log = _mean_odds(z, length, candidate, way.probe[0])
        amplitude = float(score[0]) / squared
        probe = np.array(way.probe, dtype=float)
        start = candidate.at(probe, amplitude) if candidate.has_amplitude else probe
        allowed = not candidate.one_sided or amplitude > 0.0
        step = np.array([amplitude if allowed else 0.0])
        chi2 = z**2 if allowed else 0.0
        return Gain(way.label, log, chi2, start, 1.0, z, self._base_step(place, step), step)

    def _base_step(self, place: slice, amplitudes: np.ndarray) -> np.ndarray:
        """Return how the model's own unknowns move where a candidate has these amplitudes, (k,)."""
        return self._answers[:, -1] - self._answers[:, place] @ amplitudes

    @staticmethod
    def _vector_gain(label: str, inner: np.ndarray, score: np.ndarray, whole: float) -> Gain:
        values, vectors = np.linalg.eigh(inner)
        left = values > ROUNDING * whole
        values, along = np.where(left, values, 0.0), np.where(left, vectors.T @ score, 0.0)
        logs = []
        for a in AMPLITUDES:
            stronger = 1.0 + a**2 * values
            logs.append(0.5 * float(np.sum(along**2 * a**2 / stronger - np.log(stronger))))
        best = int(np.argmax(logs))
        a = AMPLITUDES[best]
        start = vectors @ (along * a**2 / (1.0 + a**2 * values))
        drop = float(2.0 * start @ score - start @ inner @ start)
        drop = max(drop, 0.0)
        return Gain(label, logs[best], drop, start, a, float(np.sqrt(drop)), np.zeros(0), np.zeros(0))

    def gains_reweighed(self) -> dict[str, float]:
        """Return the log evidence that each candidate gains where weights follow the errors, the largest first.

        An error that a model leaves sets the weight of its own channel, so that chi-square there is the number n of
        independent errors, and no candidate gains more than n / 2. Where chi-square falls from Q to Q' the gain is
        n/2 log(Q / Q') once weights follow, down to the noise of the sensor.
        """
        own = np.arange(self.count)
        found: dict[str, float] = {}
        for label, (gain, place) in self._best_shapes(self.projected, self._labels).items():
            at = np.concatenate([own, np.arange(place.start, place.stop)])
            moved = np.concatenate([gain.base_step, gain.step])
            freed = gain.log_evidence - 0.5 * gain.chi2
            for gram, floor, independent in zip(self._grams, self._noise, self._independent, strict=True):
                before = float(gram[-1, -1])
                after = before - 2.0 * float(moved @ gram[at, -1]) + float(moved @ gram[np.ix_(at, at)] @ moved)
                if before > floor:
                    freed += 0.5 * independent * np.log(before / max(after, floor))
            found[label] = freed
        return dict(sorted(found.items(), key=lambda one: -one[1]))

    def critical_z(self, draws: int = 10_000, chance: float = 0.05) -> float:
        """Return what the largest score of all effects exceeds by chance in one of twenty cases without any.

        Scores without any effect are N(0, C), C the correlation of all projected directions of a single amplitude.
        """
        single = [
            place.start
            for way, place in zip(self.directions, self.places, strict=True)
            if not self.candidates[way.label].is_vector and self.candidates[way.label].group not in SHIFTED
        ]
        inner = self.projected[np.ix_(single, single)]
        length = np.sqrt(np.maximum(np.diag(inner), 0.0))
        kept = length > 0.0
        if not kept.any():
            return float("inf")
        correlation = inner[np.ix_(kept, kept)] / np.outer(length[kept], length[kept])
        values, vectors = np.linalg.eigh(correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        scores = np.random.default_rng(SEED).standard_normal((draws, values.size)) @ root.T
        return float(np.quantile(np.max(np.abs(scores), axis=1), 1.0 - chance))

    def visible(self, sigma: float = 4.0) -> set[str]:
        """Return the effects that this data would have shown at the low end of their usual range, or do show."""
        seen = {gain.label for gain in self.gains() if gain.log_evidence > sigma}
        lengths: dict[str, list[float]] = {}
        for way, place in zip(self.directions, self.places, strict=True):
            candidate = self.candidates[way.label]
            if candidate.is_vector or candidate.group in SHIFTED:
                continue
            first = candidate.coordinates[0]
            smallest = float(np.exp(-first.spread)) if first.logarithmic else 0.2
            squared = max(float(self.projected[place.start, place.start]), 0.0)
            lengths.setdefault(way.label, []).append(smallest * np.sqrt(squared))
        return seen | {label for label, free in lengths.items() if float(np.median(free)) >= sigma}

    def in_place_of(self, columns: Collection[int], fit: Fit) -> dict[str, float]:
        """Return the log evidence that each single candidate gains where it takes the place of some unknowns.

        Curves that are free to imitate an effect leave it no gain of its own. But one number that does the work of many
        has more evidence, and this shows without a refit.

        Args:
            columns: of the model's free unknowns, those that the candidate is to do without.
            fit: the model.
        """
        own, x = slice(0, self.count), fit.free
        aim = self.gram[:, -1] + self.gram[:, own] @ x
        power = float(self.gram[-1, -1] + 2.0 * self.gram[-1, own] @ x + x @ self.gram[own, own] @ x)
        present = log_evidence(Gram(self.gram[own, own], aim[own], power, 0), self.precision)
        kept = [number for number in range(self.count) if number not in columns]
        found: dict[str, float] = {}
        for way, place in zip(self.directions, self.places, strict=True):
            candidate, some = self.candidates[way.label], [*kept, place.start]
            if candidate.is_vector:
                continue
            gram = Gram(self.gram[np.ix_(some, some)], aim[some], power, 0)
            precision = np.append(self.precision[kept], 1.0)
            if candidate.one_sided and solved(gram.square, gram.aim, precision)[-1] <= 0.0:
                continue
            gained = log_evidence(gram, precision) - present
            found[way.label] = max(gained, found.get(way.label, -np.inf))
        return found

    def resembling(self, column: int) -> dict[str, float]:
        """Return how alike each single candidate is to one of the model's unknowns, the most alike first.

        That is the correlation of their derivatives, without what the other unknowns can do: at 1 the one does all that
        the other does.

        Args:
            column: of the model's free unknowns.
        """
        kept = [number for number in range(self.count) if number != column]
        singles = [
            (way.label, place.start)
            for way, place in zip(self.directions, self.places, strict=True)
            if not self.candidates[way.label].is_vector
        ]
        places = [column, *(place for _, place in singles)]
        own, across = self.gram[np.ix_(kept, kept)], self.gram[np.ix_(kept, places)]
        inner = self.gram[np.ix_(places, places)] - across.T @ _solved(own, self.precision[kept], across)
        length = np.sqrt(np.maximum(np.diag(inner), 0.0))
        found: dict[str, float] = {}
        for (label, place), product, size in zip(singles, inner[0, 1:], length[1:], strict=True):
            if size > ABSORBED * np.sqrt(self.gram[place, place]) and length[0] > 0.0:
                found[label] = max(float(abs(product)) / float(size * length[0]), found.get(label, 0.0))
        return dict(sorted(found.items(), key=lambda one: -one[1]))

    def left_with(self, label: str) -> np.ndarray | None:
        """Return the raw errors (readings,) that the model would leave with one candidate, to first order.

        The candidate is at its best shape, and the model's own unknowns move with it. None if nothing can show it.
        """
        found = self._best_shapes(self.projected, {label}).get(label)
        if found is None:
            return None
        (best, place), candidate = found, self.candidates[label]
        taken = [(slice(0, self.count), self.precision)]
        # Physics allows one sign only, and the readings ask for the other: nothing is added.
        if not candidate.one_sided or self.projected[place.start, -1] > 0.0:
            is_free = not candidate.is_vector and candidate.group not in SHIFTED
            taken.append((place, np.full(place.stop - place.start, 0.0 if is_free else best.amplitude**-2.0)))
        return self._left(taken)

    def _left(self, taken: Sequence[tuple[slice, np.ndarray]]) -> np.ndarray:
        places = np.concatenate([np.arange(place.start, place.stop) for place, _ in taken])
        precision = np.concatenate([one for _, one in taken])
        score = self.gram[places, -1].copy()
        score[: self.count] -= self.prior_slope
        coefficients = _solved(self.gram[np.ix_(places, places)], precision, score)
        raw = np.concatenate(self._raw, axis=1)
        return raw[:, -1] - raw[:, places] @ coefficients


def _solved(inner: np.ndarray, precision: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return (inner + L)^-1 right, L the precision, for right (k,) or (k, columns)."""
    inner = inner + np.diag(precision)
    # Rounding may leave less than the precision of columns that earlier ones absorb, and make it negative.
    scale = 1.0 / np.sqrt(np.maximum(np.diag(inner), np.maximum(precision, 1e-300)))
    values, vectors = np.linalg.eigh(inner * scale[:, None] * scale)
    turned = scale[:, None] * vectors
    return turned @ ((turned.T @ right).T / np.maximum(values, ROUNDING)).T


def _mean_odds(z: float, length: float, candidate: Candidate, probe: float) -> float:
    """Return the log of the mean of exp(z s - s^2/2) over the prior of s, the sigmas by which the effect lifts."""
    if candidate.amplitude_on_grid:
        sigmas = np.full(_PLACES.size, length)  # each probe is an amplitude of its own
    elif candidate.has_amplitude and not candidate.coordinates[0].logarithmic:
        spread = (length * candidate.times_as_strong(np.ones(1), probe)[0]) ** 2
        return float(0.5 * z**2 * spread / (1.0 + spread) - 0.5 * np.log1p(spread))
    else:
        sigmas = length * candidate.times_as_strong(_PLACES, probe)
    return float(np.logaddexp.reduce(z * sigmas - 0.5 * sigmas**2 + _LOG_SHARES))
