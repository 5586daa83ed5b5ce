"""The readings of a case in one flat list, as whitening and fitting take them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array

from discrepancy.input_noise import InputNoise
from discrepancy.noise import NoiseModel
from discrepancy.whitening import chain_starts, chain_weights
from jaxmodel.cases import Case

Values = TypeVar("Values", Array, np.ndarray)  # numpy's where all leaves are

# Their number is rounded up to this, so that cases of like size share a compiled program.
_MULTIPLE = 4096


class Readings(eqx.Module):
    """Every reading of a case in one flat list, with what whitening needs; padded with readings that never count.

    Attributes:
        index: (n,) place in the flattened (runs, rows, channels) predictions.
        value: (n,) what was read.
        sd: (n,) noise of one reading, in its unit.
        previous: (n,) number of the reading before it in its chain.
        weight: (n,) correlation of its noise with that of the reading before.
        fit: (n,) 1 where the run may be used to calibrate.
        check: (n,) 1 where the run may only judge.
        slow: (n, directions) what takes noise that many readings share out of whitened errors e: e - slow (slow' e).
    """

    index: Array
    value: Array
    sd: Array
    previous: Array
    weight: Array
    fit: Array
    check: Array
    slow: Array

    def whiten(self, errors: Values) -> Values:
        """Return errors (..., n) as white noise of unit variance."""
        white = self.without_colour(errors / self.sd)
        return white - (white @ self.slow) @ self.slow.T

    def without_colour(self, scaled: Values) -> Values:
        """Return errors over their sd (..., n) less what each has of the one before it in its chain."""
        return (scaled - self.weight * scaled[..., self.previous]) / (1.0 - self.weight**2) ** 0.5

    def some(self, mine: np.ndarray) -> Readings:
        """Return the readings of those numbers, on the host: whole chains, as of a run or a channel.

        Slow noise that channels share is counted in each by itself.
        """
        kept = jax.tree.map(lambda column: np.asarray(column)[mine], self)
        return eqx.tree_at(lambda readings: readings.previous, kept, np.searchsorted(mine, kept.previous))


def flatten(
    case: Case,
    noise: Mapping[str, NoiseModel],
    channels: tuple[str, ...],
    rows: int,
    input_noise: InputNoise | None,
) -> Readings:
    """Return the readings of a case channel by channel, run by run, in order of time.

    Args:
        case: with its measurements.
        noise: of each output column to be used.
        channels: all outputs of the kind.
        rows: of a run of the predictions.
        input_noise: of each reading, in place of its average over a channel.
    """
    none, nowhere = np.zeros(0), np.zeros(0, int)
    parts: list[tuple[np.ndarray, ...]] = [(nowhere, none, none, nowhere, none, none, none)]
    first = 0
    for name, model in noise.items():
        for number, run in enumerate(case.runs):
            values = run.measured.outputs.get(name)
            if values is None:
                continue
            present, weight = chain_weights(chain_starts([run.measured.time_s]), model.rho, np.isfinite(values))
            count = present.size
            place = (number * rows + present) * len(channels) + channels.index(name)
            previous = np.maximum(np.arange(count) - 1, 0) + first
            fit = np.full(count, float(run.split == "fit"))
            sd = np.full(count, model.sd)
            if input_noise is not None:
                sd = np.sqrt(model.own_sd**2 + input_noise.variance.reshape(-1)[place])
            sd = sd * model.crowding(run.measured.time_s[present])
            parts.append((place, values[present], sd, previous, weight, fit, 1.0 - fit))
            first += count
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    slow = None if input_noise is None else input_noise.slow
    return _filled(columns, np.zeros((first, 0)) if slow is None else slow)


def part_of(
    readings: Readings, shape: tuple[int, ...], channels: int, number: np.ndarray, rows: int, split: str
) -> Readings:
    """Return the readings that fit, or check, where runs have new numbers and as many rows each.

    Args:
        readings: of all runs.
        shape: (runs, rows) of the predictions that they are places in.
        channels: of these predictions.
        number: the new number of each run.
        rows: of a run of the new predictions.
        split: "fit" or "check".
    """
    mine = np.flatnonzero(np.asarray(getattr(readings, split)) > 0.0)
    run, row, channel = np.unravel_index(np.asarray(readings.index)[mine], (*shape, channels))
    index = (number[run] * rows + row) * channels + channel
    kept = readings.some(mine)
    return _filled([index, kept.value, kept.sd, kept.previous, kept.weight, kept.fit, kept.check], kept.slow)


def none() -> Readings:
    """Return no readings at all."""
    return Readings(*jax.device_put(list(np.zeros((7, 0)))), slow=jax.device_put(np.zeros((0, 0))))


def _filled(columns: Sequence[np.ndarray | Array], slow: np.ndarray | Array) -> Readings:
    """Return readings, filled up with some that never count."""
    count = columns[0].size
    extra = -count % _MULTIPLE if count else _MULTIPLE
    filler = (np.zeros(extra, int), np.zeros(extra), np.ones(extra), np.zeros(extra, int), *(np.zeros(extra),) * 3)
    filled = [np.concatenate(pair) for pair in zip(columns, filler, strict=True)]
    return Readings(*map(jax.device_put, filled), slow=jax.device_put(np.pad(slow, ((0, extra), (0, 0)))))
