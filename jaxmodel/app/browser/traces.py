"""Traces as they are drawn: decimated to what a picture can show, exact once the window is small enough."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tsdownsample import MinMaxLTTBDownsampler

from jaxmodel.app.browser.files import CELLS, PREVIEWS, TRACES, read_json

# Points of one trace that are sent: some for each column of dots of a wide screen.
MOST_POINTS = 4000
_MODELS = ("base", "model")
_LEAST_POINTS = 50


def decimated(x: np.ndarray, y: np.ndarray, most: int = MOST_POINTS) -> tuple[np.ndarray, np.ndarray]:
    """Return at most so many points of a trace, its extremes among them; missing values are left out.

    Args:
        x: (n,) increasing.
        y: (n,) values, NaN where there is none.
        most: points to keep; all are returned where there are not more.
    """
    there = np.isfinite(y)
    if not there.all():
        x, y = x[there], y[there]
    if x.size <= most:
        return x, y
    x, y = np.ascontiguousarray(x, dtype=np.float64), np.ascontiguousarray(y, dtype=np.float64)
    kept = MinMaxLTTBDownsampler().downsample(x, y, n_out=most)
    return x[kept], y[kept]


def packed(values: np.ndarray, dtype: str = "f4") -> dict[str, str]:
    """Return an array as plotly.js reads it: base64 of its bytes."""
    data = np.ascontiguousarray(values, dtype=np.dtype(f"<{dtype}")).tobytes()
    return {"dtype": dtype, "bdata": base64.b64encode(data).decode("ascii")}


def traces(
    folder: Path,
    view: Mapping[str, Any],
    runs: Sequence[int],
    window: tuple[float | None, float | None] = (None, None),
    most: int = MOST_POINTS,
) -> dict[str, Any]:
    """Return what is drawn of some runs: inputs, readings, models and residuals, in a window of time.

    Args:
        folder: of the session.
        view: of the session: its runs, channels, units.
        runs: numbers of runs.
        window: first and last time, in the unit of the time axis; None for all.
        most: points of a trace.
    """
    case, most = view["case"], min(max(most, _LEAST_POINTS), MOST_POINTS)
    drawn: list[dict[str, Any]] = []
    for number in runs:
        own = folder / TRACES / str(number)
        if not 0 <= number < len(case["runs"]) or not own.is_dir():
            continue
        time = np.load(own / "time_s.npy", mmap_mode="r") * case["time"]["factor"]
        rows = _rows(time, window)
        x = time[rows]

        def trace(y: np.ndarray, x: np.ndarray = x) -> dict[str, Any]:
            shown, values = decimated(x, y, most)
            return {"x": packed(shown, "f8"), "y": packed(values)}

        channels = {}
        for channel in case["channels"]:
            measured = _column(own, channel["name"], "measured", rows)
            if measured is None or not np.isfinite(measured).any():
                continue
            factor = view.get("residuals", {}).get(channel["name"], {}).get("factor", 1.0)
            lines = {"measured": trace(measured)}
            for model in _MODELS:
                predicted = _column(own, channel["name"], model, rows)
                if predicted is not None:
                    lines |= {model: trace(predicted), f"{model}_residual": trace(factor * (measured - predicted))}
            channels[channel["name"]] = lines
        inputs = {}
        for name in [one["name"] for one in case["inputs"]]:
            values = _column(own, name, "input", rows)
            if values is not None:
                inputs[name] = trace(values)
        drawn.append({"number": number, "rows": int(x.size), "channels": channels, "inputs": inputs})
    return {"runs": drawn, "exact": all(one["rows"] <= most for one in drawn)}


def preview(folder: Path, view: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return what a candidate would leave of the residual of every fit run, before any refit; no series if unknown."""
    index = read_json(folder / PREVIEWS / "index.json") or {"names": [], "series": []}
    if name not in index["names"]:
        return {"series": []}
    left = np.load(folder / PREVIEWS / "left.npy", mmap_mode="r")[index["names"].index(name)]
    time = np.load(folder / PREVIEWS / "time_s.npy", mmap_mode="r") * view["case"]["time"]["factor"]
    found = []
    for one in index["series"]:
        rows = slice(one["first"], one["last"])
        factor = view["residuals"][one["channel"]]["factor"]
        drawn = {"x": packed(time[rows], "f8"), "y": packed(factor * left[rows])}
        found.append({"run": one["run"], "channel": one["channel"], **drawn})
    return {"series": found}


def samples(folder: Path, view: Mapping[str, Any], channel: str, cell: int) -> dict[str, Any]:
    """Return the readings in one cell of a channel's regime map, by run, with their residuals."""
    if channel not in [one["name"] for one in view["case"]["channels"]]:
        return {"runs": []}
    try:
        with np.load(folder / CELLS / f"{channel}.npz") as stored:
            run, time_s, cells = stored["run"], stored["time_s"], stored["cell"]
    except OSError:
        return {"runs": []}
    inside, factor = cells == cell, view["residuals"][channel]["factor"]
    found = []
    for number in np.unique(run[inside]).tolist():
        own = folder / TRACES / str(number)
        time = np.load(own / "time_s.npy", mmap_mode="r")
        rows = np.minimum(np.searchsorted(time, time_s[inside & (run == number)] - 1e-9), time.size - 1)
        measured = np.load(own / f"{channel}.measured.npy", mmap_mode="r")[rows]
        model = next(m for m in reversed(_MODELS) if (own / f"{channel}.{m}.npy").exists())
        residual = factor * (measured - np.load(own / f"{channel}.{model}.npy", mmap_mode="r")[rows])
        x = packed(time[rows] * view["case"]["time"]["factor"], "f8")
        found.append({"run": number, "x": x, "measured": packed(measured), "residual": packed(residual)})
    return {"runs": found}


def _rows(time: np.ndarray, window: tuple[float | None, float | None]) -> slice:
    """Return the rows of a window, with one more on either side, so that lines reach its edges."""
    low, high = window
    first = 0 if low is None else max(int(np.searchsorted(time, low)) - 1, 0)
    last = time.size if high is None else min(int(np.searchsorted(time, high, side="right")) + 1, time.size)
    return slice(first, max(last, first))


def _column(folder: Path, name: str, what: str, rows: slice) -> np.ndarray | None:
    path = folder / f"{name}.{what}.npy"
    return np.asarray(np.load(path, mmap_mode="r")[rows]) if path.exists() else None
