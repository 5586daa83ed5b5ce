"""Traces, previews and cells of the regime maps as arrays in the session's folder, read by the server as they are."""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd

from jaxmodel.app.browser.files import CELLS, PREVIEWS, TRACES, write_json
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.residuals.regime_map import RegimeMap

MEASURED, BASE, MODEL, INPUT = "measured", "base", "model", "input"
# Readings of a series that a preview keeps: it is drawn over traces that keep all.
_MOST_OF_A_PREVIEW = 1500

Predictions = Mapping[str, Mapping[str, np.ndarray]]


def write_traces(folder: Path, case: Case, models: Mapping[str, Predictions]) -> None:
    """Write every run's times, inputs, readings and the predictions of some models, by their names.

    Times are seconds since the start of the run.
    """
    with _replaced(folder / TRACES) as aside:
        for number, run in enumerate(case.runs):
            own = aside / str(number)
            own.mkdir()
            np.save(own / "time_s.npy", np.asarray(run.measured.time_s - run.measured.time_s[0], dtype=np.float64))
            for name, values in run.measured.inputs.items():
                np.save(own / f"{name}.{INPUT}.npy", np.asarray(values, dtype=np.float64))
            for name, values in run.measured.outputs.items():
                np.save(own / f"{name}.{MEASURED}.npy", np.asarray(values, dtype=np.float64))
                for model, predictions in models.items():
                    predicted = predictions.get(run.name, {}).get(name)
                    if predicted is not None:
                        np.save(own / f"{name}.{model}.npy", np.asarray(predicted, dtype=np.float64))


def write_previews(folder: Path, case: Case, table: pd.DataFrame) -> None:
    """Write what `Investigation.preview` returned: a row of errors for each candidate, and the series that they are of.

    Args:
        folder: of the session.
        case: whose runs the table names.
        table: run, channel, time_s, residual, and a column for each candidate.
    """
    names = [str(name) for name in table.columns[4:]]
    numbers = {run.name: number for number, run in enumerate(case.runs)}
    series, kept = [], []
    first = 0
    for key, part in table.groupby(["run", "channel"], sort=False):
        run, channel = cast("tuple[str, str]", key)
        rows = part.index.to_numpy()[:: max(1, -(-len(part) // _MOST_OF_A_PREVIEW))]
        own = {"run": numbers[str(run)], "channel": str(channel), "first": first, "last": first + rows.size}
        series.append(own)
        kept.append(rows)
        first += rows.size
    rows = np.concatenate(kept)
    chosen = table.loc[rows]
    starts = {run.name: float(run.measured.time_s[0]) for run in case.runs}
    with _replaced(folder / PREVIEWS) as aside:
        since = chosen["time_s"].to_numpy() - chosen["run"].map(starts).to_numpy()
        np.save(aside / "time_s.npy", since.astype(np.float64))
        np.save(aside / "residual.npy", chosen["residual"].to_numpy(dtype=np.float32))
        np.save(aside / "left.npy", np.ascontiguousarray(chosen[names].to_numpy(dtype=np.float32).T))
        write_json(aside / "index.json", {"names": names, "series": series})


def write_cells(folder: Path, maps: Sequence[RegimeMap]) -> None:
    """Write, for each channel's map, run, time and cell of every reading."""
    with _replaced(folder / CELLS) as aside:
        for one in maps:
            cell = one.along.code * one.across.count + one.across.code
            np.savez(aside / f"{one.channel}.npz", run=one.run, time_s=one.time_s, cell=cell)


class _replaced:
    """A folder that is filled aside and then put in place of the old one."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._aside = folder.with_name(f".{folder.name}.new")

    def __enter__(self) -> Path:
        shutil.rmtree(self._aside, ignore_errors=True)
        self._aside.mkdir(mode=0o700)
        return self._aside

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            return
        old = self._folder.with_name(f".{self._folder.name}.old")
        shutil.rmtree(old, ignore_errors=True)
        if self._folder.exists():
            os.replace(self._folder, old)
        os.replace(self._aside, self._folder)
        shutil.rmtree(old, ignore_errors=True)
