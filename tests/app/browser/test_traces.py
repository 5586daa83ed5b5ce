"""A trace of any length is sent as a few thousand points, its extremes among them, and as it is once it is short."""

from __future__ import annotations

import base64
import time
from pathlib import Path

import numpy as np

from jaxmodel.app.browser.traces import MOST_POINTS, decimated, packed, traces

VIEW = {
    "case": {
        "time": {"factor": 1.0, "unit": "s"},
        "runs": [{"name": "long"}],
        "channels": [{"name": "voltage_V"}],
        "inputs": [{"name": "current_A"}],
    },
    "residuals": {"voltage_V": {"factor": 1000.0}},
}


def unpacked(trace: dict[str, dict[str, str]]) -> tuple[np.ndarray, np.ndarray]:
    x, y = (np.frombuffer(base64.b64decode(trace[key]["bdata"]), trace[key]["dtype"]) for key in ("x", "y"))
    return x, y


def write_run(folder: Path, time_s: np.ndarray, measured: np.ndarray, model: np.ndarray) -> None:
    own = folder / "traces" / "0"
    own.mkdir(parents=True)
    np.save(own / "time_s.npy", time_s)
    np.save(own / "voltage_V.measured.npy", measured)
    np.save(own / "voltage_V.base.npy", model)
    np.save(own / "current_A.input.npy", np.ones(time_s.size))


def test_a_spike_among_a_million_points_is_kept() -> None:
    x, y = np.arange(1_000_000.0), np.sin(np.arange(1_000_000) * 1e-4)
    y[123_457] = 5.0
    shown, values = decimated(x, y)
    assert shown.size == MOST_POINTS
    assert values.max() == 5.0
    assert shown[values.argmax()] == 123_457.0
    assert np.all(np.diff(shown) > 0.0)


def test_a_short_trace_is_sent_as_it_is_without_what_is_missing() -> None:
    x, y = np.arange(5.0), np.array([1.0, np.nan, 3.0, 4.0, np.nan])
    shown, values = decimated(x, y)
    assert shown.tolist() == [0.0, 2.0, 3.0]
    assert values.tolist() == [1.0, 3.0, 4.0]


def test_zoomed_in_every_reading_is_sent(tmp_path: Path) -> None:
    time_s = np.arange(1_000_000.0)
    measured = np.random.default_rng(1).normal(3.7, 0.01, time_s.size)
    write_run(tmp_path, time_s, measured, np.full(time_s.size, 3.7))
    began = time.perf_counter()
    whole = traces(tmp_path, VIEW, [0])
    assert time.perf_counter() - began < 5.0  # 0.1 s on a machine with nothing else to do
    assert not whole["exact"]
    near = traces(tmp_path, VIEW, [0], (1000.0, 1100.0))
    assert near["exact"]
    lines = near["runs"][0]["channels"]["voltage_V"]
    x, y = unpacked(lines["measured"])
    inside = slice(int(x[0]), int(x[-1]) + 1)
    assert x[0] <= 1000.0
    assert x[-1] >= 1100.0
    np.testing.assert_allclose(y, measured[inside].astype(np.float32))
    # The residual is in the unit of its axis: millivolts.
    np.testing.assert_allclose(unpacked(lines["base_residual"])[1], 1000.0 * (measured[inside] - 3.7), atol=1e-3)


def test_a_run_that_is_not_there_is_left_out(tmp_path: Path) -> None:
    assert traces(tmp_path, VIEW, [0, 7, -1])["runs"] == []


def test_arrays_are_packed_as_plotly_reads_them() -> None:
    assert packed(np.array([1.0, 2.0])) == {"dtype": "f4", "bdata": "AACAPwAAAEA="}
