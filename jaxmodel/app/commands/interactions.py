"""`jaxmodel sensitivity --pair`: second derivatives by pairs of parameters, beside the doubling of both."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from jaxmodel import sensitivity
from jaxmodel.app import terminal
from jaxmodel.app.commands.sensitivity import study_at
from jaxmodel.app.commands.start import start
from jaxmodel.base.errors import SweepError
from jaxmodel.plots.datasets import save_pictures

_SEEN = 5e-4


def interactions(
    path: Path, out: Path, at: Sequence[str], effects: Sequence[str], pairs: Sequence[str], *, pictures: bool = True
) -> xr.Dataset:
    """Differentiate a study's metrics twice; write `interactions.zarr`, `interactions.csv` and matrices to `out`.

    Args:
        path: of the study.
        out: folder for the results.
        at: the point, as `NAME=VALUE`.
        effects: the user's own.
        pairs: as `A,B`, or `A,B,C` for every pair of them; each name with itself too.
        pictures: whether to draw.

    Raises:
        UserError: the study, the point or a pair cannot be used.
    """
    chosen = [pair for entry in pairs for pair in itertools.combinations_with_replacement(_names(entry), 2)]
    study = study_at(path, at, effects)
    start(out)
    with terminal.stages("interactions") as progress:
        progress("compiling and running, half a minute the first time")
        data = sensitivity.interactions(study, chosen, progress=False)
        sensitivity.save(data, out)
        if pictures:
            save_pictures(data, out)
    _print(data)
    terminal.say(f"interactions.zarr, interactions.csv{' and pictures' if pictures else ''} are in {out}.")
    return data


def _names(entry: str) -> list[str]:
    names = list(dict.fromkeys(name.strip() for name in entry.split(",") if name.strip()))
    if len(names) < 2:
        raise SweepError(f"--pair {entry}: write two names or more, as in --pair capacity_Ah,duty.")
    return names


def _print(data: xr.Dataset) -> None:
    """Print for each metric and pair the change by each alone, by both, and what is predicted of their joint effect."""
    rows = []
    for metric in map(str, data["metric"].to_numpy()):
        for place in range(data.sizes["pair"]):
            one = data.sel(metric=metric).isel(pair=place)
            first, second = (str(one[end].item()) for end in ("first", "second"))
            effects = [float(one[f"effect_{which}"]) for which in ("first", "second", "both", "joint")]
            if float(one["valid_share"]) < 1.0:
                effects[2:] = [np.nan, np.nan]
            expected = [float(one["interaction"]), float(one["power_law"])]
            if first != second and np.nanmax(np.abs([*effects, 0.0])) > _SEEN:
                rows.append((metric, first, second, *(_percent(x) for x in [*effects, *expected])))
    columns = ("metric", "first", "second", "first alone", "second alone", "both", "joint", "by d2y/dpdq", "power law")
    title = data.attrs["title"] or "Interactions"
    terminal.table(f"{title}: change in % when doubled, or moved by a stated step", columns, rows, right=range(3, 9))
    left = data.isel(pair=np.flatnonzero(data["valid_share"].to_numpy() < 1.0))
    if left.sizes["pair"]:
        both = ", ".join(f"{p} and {q}" for p, q in zip(left["first"].values, left["second"].values, strict=True))
        terminal.say(f"Moved together these leave the range in which the equations make sense: {both}.")


def _percent(share: float) -> str:
    return f"{100.0 * share:+.1f}" if np.isfinite(share) else ""
