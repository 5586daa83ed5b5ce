"""Single readings far from both neighbours, in every channel of the runs: named, and left out."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.case import measurements
from jaxmodel.case.outliers import is_frequent, outlying, share_said, unfollowed
from jaxmodel.data.importing.ambient import fill
from jaxmodel.data.importing.findings import Finding
from jaxmodel.data.importing.logs import Log, spans


def without_outliers(runs: Sequence[Log], known: measurements.Kind) -> list[Log]:
    """Return complete runs with outliers as missing readings, and what was found; see `case.outliers`."""
    runs = [_held(run, known) for run in runs]
    left = list(runs)
    channels = ("ambient_degC", *known.outputs)
    for name in channels:
        flags = {n: _outliers(run, known, name) for n, run in enumerate(runs) if _is_reading(run, known, name)}
        left_out = [rows for rows in flags.values() if not is_frequent(rows)]
        count = sum(int(rows.sum()) for rows in left_out)
        said = share_said(count, count / max(sum(rows.size for rows in left_out), 1))
        for number, rows in flags.items():
            if rows.any():
                left[number] = _told(left[number], name, rows, said)
    return left


def _is_reading(run: Log, known: measurements.Kind, name: str) -> bool:
    return name in run.columns and name not in _drives(run, known)


def _drives(run: Log, known: measurements.Kind) -> list[str]:
    """Return the inputs that load the hardware."""
    chosen = [next((name for name in group if name in run.columns), "") for group in known.alternatives]
    names = [*known.required_inputs, *chosen, *known.optional_inputs]
    return [name for name in names if name in run.columns and name != "ambient_degC"]


def _held(run: Log, known: measurements.Kind) -> Log:
    """Return a run whose inputs have the neighbouring readings where nothing followed theirs."""
    for name in _drives(run, known):
        outputs = {channel: run.columns[channel] for channel in known.outputs if _is_reading(run, known, channel)}
        rows = unfollowed(run.time_s, name, run.columns[name], outputs)
        if rows.any():
            count, first = int(rows.sum()), int(rows.argmax())
            sentence = (
                f"{run.name}: {count} single {'reading' if count == 1 else 'readings'} of {name} far from both "
                f"neighbours, first {run.columns[name][first]:.5g} at {run.time_s[first]:.6g} s, which no reading "
                "followed; left out as outliers."
            )
            found = Finding("spike", run.name, sentence, "warning", name, spans(rows, run.time_s))
            missing = np.where(rows, np.nan, run.columns[name])
            run = fill(dataclasses.replace(run, columns=run.columns | {name: missing}).also(found), name)
    return run


def _outliers(run: Log, known: measurements.Kind, name: str) -> np.ndarray:
    inputs = {drive: run.columns[drive] for drive in _drives(run, known)}
    return outlying(run.time_s, inputs, name, run.columns[name])


def _told(run: Log, name: str, rows: np.ndarray, said: str) -> Log:
    """Return a run without its outliers of a channel, or with all where they are too many; `said` is their share."""
    values, own, first = run.columns[name], int(rows.sum()), int(rows.argmax())
    done = f"kept, as {rows.mean():.1%} of all are too many for outliers: look at the sensor"
    if not is_frequent(rows):
        done = f"left out as {'an outlier' if own == 1 else 'outliers'}{said}"
        run = dataclasses.replace(run, columns=run.columns | {name: np.where(rows, np.nan, values)})
    sentence = (
        f"{run.name}: {own} single {'reading' if own == 1 else 'readings'} of {name} far from both neighbours, first "
        f"{values[first]:.5g} at {run.time_s[first]:.6g} s; {done}."
    )
    numbers = {"readings": float(own)}
    return run.also(Finding("spike", run.name, sentence, "warning", name, spans(rows, run.time_s), numbers))
