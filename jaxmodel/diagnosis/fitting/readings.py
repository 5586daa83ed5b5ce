"""The fitted readings in one flat list, and the whitening of their errors."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.noise.input_noise import InputNoise, slow_directions
from jaxmodel.diagnosis.noise.instrument import NoiseModel
from jaxmodel.diagnosis.noise.model_error import Chain, ModelError, Series, Whitener
from jaxmodel.diagnosis.noise.whitening import chain_starts, chain_weights, innovations
from jaxmodel.diagnosis.settings import SETTINGS, Settings


@dataclasses.dataclass(frozen=True)
class Readings:
    """Readings of some runs, channel by channel, run by run, in order of time.

    Attributes:
        value: (n,) the readings.
        run: (n,) index of the run in the case.
        row: (n,) its row.
        channel: (n,) index of the channel among all outputs of the kind.
        time_s: (n,) time of each.
        sd: (n,) noise of one reading, in its unit.
        weight: (n,) correlation of its noise with that of the previous reading; 0 at the start of a chain.
        steepness: (n,) of each, see `jaxmodel.diagnosis.noise.steepness`; 1 except of voltages.
        chains: rows of each channel in each run.
        shared: (n, noises) responses to independent slow noises of measured inputs.
    """

    value: np.ndarray
    run: np.ndarray
    row: np.ndarray
    channel: np.ndarray
    time_s: np.ndarray
    sd: np.ndarray
    weight: np.ndarray
    steepness: np.ndarray
    chains: tuple[tuple[tuple[str, int], slice], ...]
    shared: np.ndarray

    @property
    def count(self) -> int:
        """Return how many readings there are."""
        return self.value.size

    def differenced(self, errors: np.ndarray) -> np.ndarray:
        """Return errors (n, ...) without the autocorrelated part of their noise, at unchanged sd."""
        if not self.weight.any():
            return errors
        return (innovations(errors.T / self.sd, self.weight) * self.sd).T

    def pieces(self, most: int | None = None) -> list[Chain]:
        """Return the chains for the model error, thinned to at most so many readings each."""
        found = []
        for series, rows in self.chains:
            step = 1 if most is None else max(1, -(-(rows.stop - rows.start) // most))
            mine = np.arange(rows.start, rows.stop, step)
            gain = np.sqrt((1.0 - self.weight[mine]) / (1.0 + self.weight[mine]))
            found.append(Chain(series, mine, self.time_s[mine], self.sd[mine], gain))
        return found

    def blocks(self, pieces: int) -> np.ndarray:
        """Return the number of each reading's block (n,): its run, in so many pieces of equal time."""
        block = np.zeros(self.count, dtype=int)
        for run in np.unique(self.run):
            mine = self.run == run
            time = self.time_s[mine] - self.time_s[mine].min()
            share = time / max(float(time.max()), 1e-12)
            block[mine] = run * pieces + np.minimum((share * pieces).astype(int), pieces - 1)
        return block


class Weights:
    """Whitening of errors: noise, model error, and slow noise of inputs."""

    def __init__(self, readings: Readings, error: ModelError) -> None:
        """Prepare the filter of every chain."""
        self.readings, self.error = readings, error
        self._filter = Whitener(readings.pieces(), error, readings.count)
        self._slow = np.zeros((readings.count, 0))
        if readings.shared.shape[1]:
            self._slow = slow_directions(self._filter(readings.differenced(readings.shared)).T, readings.run)

    def whiten(self, errors: np.ndarray) -> np.ndarray:
        """Return errors (n,) or (n, columns) as white noise of unit variance."""
        columns = errors.reshape(self.readings.count, -1)
        white = self._filter(self.readings.differenced(columns))
        if self._slow.shape[1]:
            white = white - self._slow @ (self._slow.T @ white)
        return white.reshape(errors.shape)


def collect(
    case: Case,
    noise: Mapping[str, NoiseModel],
    channels: Sequence[str],
    runs: Sequence[int],
    input_noise: InputNoise | None = None,
    settings: Settings = SETTINGS,
    rows_of: Mapping[int, slice] | None = None,
    steepness: Mapping[Series, np.ndarray] | None = None,
) -> Readings:
    """Return the readings of some runs.

    More than `settings.most_readings` are thinned: every k-th reading of each channel and run is kept, with the same k
    for all.

    Args:
        case: with its measurements.
        noise: of each output column to be used.
        channels: all outputs of the kind.
        runs: numbers of the runs.
        input_noise: of each reading, in place of its average over a channel.
        settings: the constants.
        rows_of: by index of the run, the rows that count; all if not given.
        steepness: by channel and run, of its rows; 1 if not given.
    """
    present: dict[tuple[str, int], np.ndarray] = {}
    for name in noise:
        for run in runs:
            values = case.runs[run].measured.outputs.get(name)
            if values is None:
                continue
            counts = np.isfinite(values)
            if rows_of and run in rows_of:
                inside = np.zeros(values.size, dtype=bool)
                inside[rows_of[run]] = True
                counts &= inside
            if counts.any():
                present[name, run] = np.flatnonzero(counts)
    total = sum(rows.size for rows in present.values())
    every = max(1, -(-total // settings.most_readings))
    parts, chains, first = [], [], 0
    for (name, number), rows in present.items():
        run, model = case.runs[number], noise[name]
        kept = rows[::every]
        there = np.zeros(run.measured.time_s.size, dtype=bool)
        there[kept] = True
        _, weight = chain_weights(chain_starts([run.measured.time_s]), model.rho, there)
        sd = np.full(kept.size, model.sd)
        place = channels.index(name)
        if input_noise is not None:
            sd = np.sqrt(model.own_sd**2 + input_noise.variance[number, kept, place])
        columns = (
            run.measured.outputs[name][kept],
            np.full(kept.size, number),
            kept,
            np.full(kept.size, place),
            run.measured.time_s[kept],
            sd,
            weight,
            steepness[name, number][kept] if steepness and (name, number) in steepness else np.ones(kept.size),
        )
        parts.append(columns)
        chains.append(((name, number), slice(first, first + kept.size)))
        first += kept.size
    stacked = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else [np.zeros(0, int)] * 8
    shared = np.zeros((first, 0))
    if input_noise is not None and parts:
        shared = input_noise.shared[:, stacked[1], stacked[2], stacked[3]].T.astype(float)
    return Readings(*stacked, chains=tuple(chains), shared=shared)
