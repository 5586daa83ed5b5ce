"""The fitted readings of a case in one flat list."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.records import Case
from jaxmodel.fit.noise.instrument import NoiseModel
from jaxmodel.fit.settings import SETTINGS, Settings

# Time blocks of a run (design).
PIECES = 16
# A channel in one run: its name and the index of the run.
Series = tuple[str, int]


@dataclasses.dataclass(frozen=True)
class FitData:
    """Readings of some runs, channel by channel, run by run, in order of time.

    Attributes:
        value: (n,) the readings.
        run: (n,) index of the run in the case.
        row: (n,) its row.
        channel: (n,) index of the channel among all outputs of the kind.
        time_s: (n,) time of each.
        sd: (n,) noise of one reading, in its unit.
        chains: rows of each channel in each run.
    """

    value: np.ndarray
    run: np.ndarray
    row: np.ndarray
    channel: np.ndarray
    time_s: np.ndarray
    sd: np.ndarray
    chains: tuple[tuple[Series, slice], ...]

    @property
    def count(self) -> int:
        """Return how many readings there are."""
        return self.value.size

    @functools.cached_property
    def by_channel(self) -> dict[str, list[slice]]:
        """Return the rows of each channel, run by run."""
        found: dict[str, list[slice]] = {}
        for (name, _), rows in self.chains:
            found.setdefault(name, []).append(rows)
        return found

    @functools.cached_property
    def noise(self) -> dict[str, float]:
        """Return the sd of each channel's sensor, the mean over runs."""
        return {name: float(np.mean([self.sd[rows][0] for rows in slices])) for name, slices in self.by_channel.items()}

    @functools.cached_property
    def block(self) -> np.ndarray:
        """Return the number of each reading's block (n,): its run, in `PIECES` pieces of equal time."""
        block = np.zeros(self.count, dtype=int)
        for run in np.unique(self.run):
            mine = self.run == run
            time = self.time_s[mine] - self.time_s[mine].min()
            share = time / max(float(time.max()), 1e-12)
            block[mine] = run * PIECES + np.minimum((share * PIECES).astype(int), PIECES - 1)
        return block

    @functools.cached_property
    def blocks(self) -> dict[int, dict[str, slice]]:
        """Return the rows of each block by channel: those of a channel in a run are in order of time."""
        found: dict[int, dict[str, slice]] = {}
        for (name, _), rows in self.chains:
            numbers, first = np.unique(self.block[rows], return_index=True)
            ends = [*first[1:], rows.stop - rows.start]
            for number, begin, end in zip(numbers.tolist(), first, ends, strict=True):
                found.setdefault(number, {})[name] = slice(rows.start + int(begin), rows.start + int(end))
        return dict(sorted(found.items()))


def collect(
    case: Case,
    noise: Mapping[str, NoiseModel],
    channels: Sequence[str],
    runs: Sequence[int],
    settings: Settings = SETTINGS,
    rows_of: Mapping[int, slice] | None = None,
) -> FitData:
    """Return the readings of some runs.

    More than `settings.most_readings` are thinned: every k-th reading of each channel and run is kept, with the same k
    for all.

    Args:
        case: with its measurements.
        noise: of each output column to be used.
        channels: all outputs of the kind.
        runs: numbers of the runs.
        settings: the constants.
        rows_of: by index of the run, the rows that count; all if not given.
    """
    present: dict[Series, np.ndarray] = {}
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
        measured, kept = case.runs[number].measured, rows[::every]
        parts.append(
            (
                measured.outputs[name][kept],
                np.full(kept.size, number),
                kept,
                np.full(kept.size, channels.index(name)),
                measured.time_s[kept],
                np.full(kept.size, noise[name].sd),
            )
        )
        chains.append(((name, number), slice(first, first + kept.size)))
        first += kept.size
    stacked = [np.concatenate(column) for column in zip(*parts, strict=True)] if parts else [np.zeros(0, int)] * 6
    return FitData(*stacked, chains=tuple(chains))
