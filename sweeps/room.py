"""Whether there is room for what a study leaves, before the first lane is run."""

from __future__ import annotations

import os
from pathlib import Path

from jaxmodel.base.errors import SweepError
from jaxmodel.sweeps.places import place_of
from jaxmodel.sweeps.plan import size_text
from jaxmodel.sweeps.results import result_bytes_per_lane
from jaxmodel.sweeps.study import Study

# Of its size that a result on disk may lose by compression: metrics of lanes that differ lose a tenth to a half.
MOST_COMPRESSION = 4.0


def refuse_what_cannot_be_kept(study: Study, out: str | Path | None) -> None:
    """Raise an error if no disk or memory of this machine holds the results of a study.

    Raises:
        SweepError: they are larger than the memory of this machine, or than four times what is free on the disk.
    """
    size = study.size * result_bytes_per_lane(study)
    lanes = f"the results of {study.size:,} lanes take {size_text(size)}"
    if out is None:
        if size > (memory := _memory_bytes()):
            raise SweepError(
                f"study: {lanes}, and this machine has {size_text(memory)} of memory; name a folder with out, or take "
                "fewer values of an axis."
            )
        return
    free = place_of(out).free_bytes()
    if size > MOST_COMPRESSION * free:
        raise SweepError(
            f"study: {lanes} uncompressed, and {size_text(free)} are free where {out} lies; take fewer values of an "
            "axis, fewer metrics, or another disk."
        )


def _memory_bytes() -> float:
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError):  # not of every system
        return float("inf")
