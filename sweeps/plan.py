"""How a study is cut: chunks, which are committed whole, of calls, which keep the devices busy, of blocks of lanes."""

from __future__ import annotations

import dataclasses
import math
import re

import numpy as np

from jaxmodel.base.errors import SweepError

# Of all chunks in progress, unless the user states another; the program itself takes some 0.5 GiB beside it.
DEFAULT_MEMORY = 512 * 2**20
# Steps of lanes that a device takes in one call: some tenths of a second, so that progress moves and calls cost little.
LANE_STEPS_PER_CALL = 4_000_000
# So many times the lanes of a processor's core does a GPU take at once: measured 17 ps per step of a cell beside 4 ns.
ACCELERATOR = 250
# Steps of lanes in one chunk: seconds of work, which a kill costs at most.
LANE_STEPS_PER_CHUNK = 64_000_000
# Each chunk is one file per variable; a sweep too large for this many is cut into larger chunks.
MOST_CHUNKS = 10_000
# Narrower loops than this are unrolled by the compiler and run slower than a wider block padded.
NARROWEST_BLOCK = 64
# A chunk is alive as parts from the devices, put together, and compressed for the disk.
COPIES = 3
_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


@dataclasses.dataclass(frozen=True)
class Chunks:
    """A cut of a grid of lanes into boxes that are runs of consecutive lanes, the last axis running fastest.

    Attributes:
        shape: of the grid.
        box: of a chunk: whole axes at the end, a part of one, single values of those before; less at the far side.
    """

    shape: tuple[int, ...]
    box: tuple[int, ...]

    @property
    def counts(self) -> tuple[int, ...]:
        """The number of chunks along each axis."""
        return tuple(-(-size // part) for size, part in zip(self.shape, self.box, strict=True))

    def __len__(self) -> int:
        return math.prod(self.counts)

    @property
    def lanes(self) -> int:
        """The number of lanes of a whole chunk."""
        return math.prod(self.box)

    def region(self, number: int) -> tuple[slice, ...]:
        """Return where chunk `number` lies along each axis."""
        place = np.unravel_index(number, self.counts)
        starts = [int(at) * part for at, part in zip(place, self.box, strict=True)]
        return tuple(
            slice(start, min(start + part, size))
            for start, part, size in zip(starts, self.box, self.shape, strict=True)
        )

    def span(self, number: int) -> tuple[int, int]:
        """Return the first lane of chunk `number`, and how many it has."""
        region = self.region(number)
        first = np.ravel_multi_index([part.start for part in region], self.shape)
        return int(first), math.prod(part.stop - part.start for part in region)


def cut(shape: tuple[int, ...], most_lanes: int) -> Chunks:
    """Return the cut of a grid into the largest chunks of at most `most_lanes`, of nearly equal size."""
    box, lanes = [1] * len(shape), 1
    for axis in reversed(range(len(shape))):
        parts = math.ceil(shape[axis] / max(1, most_lanes // lanes))
        box[axis] = math.ceil(shape[axis] / parts)
        lanes *= box[axis]
        if parts > 1:
            break
    return Chunks(tuple(shape), tuple(box))


def lanes_per_chunk(lanes: int, steps: int, bytes_per_lane: int, memory: int, least: int = 1, times: int = 1) -> int:
    """Return how many lanes a chunk may have.

    Args:
        lanes: of the whole sweep.
        steps: of each.
        bytes_per_lane: of its axes and results.
        memory: in bytes, for the chunks in progress.
        least: so many chunks at least, as far as each keeps a block of lanes.
        times: as many lanes as on a processor.

    Raises:
        SweepError: not even one block of lanes fits.
    """
    fitting = memory // (COPIES * bytes_per_lane)
    if fitting < NARROWEST_BLOCK:
        need = COPIES * bytes_per_lane * NARROWEST_BLOCK
        raise SweepError(
            f"memory: {size_text(memory)} is too little for {NARROWEST_BLOCK} lanes at a time, which take "
            f"{size_text(need)}; allow more, store fewer columns, or raise store_every."
        )
    wanted = max(times * LANE_STEPS_PER_CHUNK // steps, math.ceil(lanes / MOST_CHUNKS))
    return min(fitting, max(min(wanted, math.ceil(lanes / least)), NARROWEST_BLOCK))


@dataclasses.dataclass(frozen=True)
class Calls:
    """How a chunk is run: `number` calls of `blocks` blocks of `width` lanes on each device."""

    number: int
    blocks: int
    width: int


def calls_of(lanes: int, steps: int, devices: int, widest: int, times: int = 1) -> Calls:
    """Return how a chunk of so many lanes is run, with as few blocks left empty as may be.

    The width does not depend on the number of devices: neither do the bits of the results.
    """
    width = min(widest, NARROWEST_BLOCK * math.ceil(lanes / NARROWEST_BLOCK))
    blocks = math.ceil(lanes / (width * devices))
    most = max(1, times * LANE_STEPS_PER_CALL // (steps * width))
    fewest = math.ceil(blocks / most)
    number = min(range(fewest, 2 * fewest), key=lambda calls: calls * math.ceil(blocks / calls))
    return Calls(number, math.ceil(blocks / number), width)


def bytes_of(text: float | int | str) -> int:
    """Return a number of bytes written as 2e9, "500 MB" or "1.5GiB".

    Raises:
        SweepError: it is not written so.
    """
    found = re.fullmatch(r"\s*([0-9.]+(?:e[0-9]+)?)\s*([kmgt]i?)?b?\s*", str(text).lower())
    try:
        if found is not None and (size := int(float(found[1]) * _UNITS[found[2] or ""])) > 0:
            return size
    except ValueError:
        pass
    raise SweepError(f'memory: "{text}" is not a size; write it as "500 MB" or "2 GiB".')


def size_text(size: float | int) -> str:
    """Return a number of bytes as text, as in "38.2 kB"."""
    for unit in ("B", "kB", "MB", "GB"):
        if size < 1000.0:
            return f"{size:.3g} {unit}"
        size /= 1000.0
    return f"{size:,.3g} TB"
