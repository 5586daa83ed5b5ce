"""How the time of a whole sweep, written to disk, grows with lanes and workers, beside what was foretold for it."""

from __future__ import annotations

import json
import tempfile
from typing import Any

import numpy as np

from jaxmodel import sweeps
from jaxmodel.sweeps import Study

LANES = (10_000, 100_000, 1_000_000, 10_000_000)
WORKERS = (1, 2, 4)
_WITH_WORKERS = 4_000_000


def study_of(lanes: int) -> Study:
    """Return a sweep of cells over 1,800 s in steps of 30 s, with two metrics."""
    return Study(
        kind="cell",
        profile={"duration_s": 1800, "step_s": 30, "ambient_degC": 20.0},
        axes={"current_A": np.linspace(0.5, 5.0, lanes // 1000), "cycles": np.linspace(0.0, 400.0, 1000)},
        metrics=["final_soc", "min_voltage_V"],
        cutoff={},
    )


def _seconds(study: Study, engine: str) -> float:
    """Return how long a sweep runs, compilation apart."""
    with tempfile.TemporaryDirectory() as folder:
        result = sweeps.run(study, out=folder, engine=engine)
        return json.loads(result.attrs["manifest"])["performance"]["run_s"]


def over_lanes() -> list[dict[str, Any]]:
    """Return measured and foretold seconds; the forecast times one call of each study, and runs no chunk of it."""
    rows = []
    for lanes in LANES:
        study = study_of(lanes)
        foretold = sweeps.forecast(study).run_s
        measured = _seconds(study, "local")
        rows.append({"lanes": lanes, "foretold_s": foretold, "measured_s": measured, "ratio": measured / foretold})
    return rows


def over_workers() -> list[dict[str, Any]]:
    """Return the seconds of a sweep by workers of one thread on this machine, each of which writes its chunks."""
    from distributed import LocalCluster

    rows, study = [], study_of(_WITH_WORKERS)
    for workers in WORKERS:
        with LocalCluster(n_workers=workers, threads_per_worker=1, dashboard_address=None) as cluster:
            _seconds(study_of(LANES[0]), cluster.scheduler_address)  # every worker compiles
            rows.append({"workers": workers, "measured_s": _seconds(study, cluster.scheduler_address)})
    return rows
