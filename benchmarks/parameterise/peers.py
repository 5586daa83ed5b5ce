"""Peers in their own environment: NREL's thevenin, PyBaMM's Thevenin model, and the identification of PyBOP.

The first two simulate, they do not extract. Their user has an open-circuit curve from the slow discharge, and a
resistance and two RC pairs fitted to the fit run nearest in temperature by `benchmarks.real.base_models.resistances`.
PyBOP fits these five numbers again, from there, to the voltage of the same run.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.real.base_models import resistances
from benchmarks.real.writing import SOC
from jaxmodel import Case, Run

SCRIPT = Path(__file__).parent / "simulate_peers.py"
LIMIT_S = 3600


def peer_errors(case: Case, python: Path) -> dict[str, dict[str, float]]:
    """Return the RMS error [V] by peer and check run; peers or runs that fail are left out.

    Args:
        case: with an `ocv` table and a capacity.
        python: of the environment in which the peers are installed.
    """
    capacity, ocv = case.parameters["capacity_Ah"].value, case.tables["ocv"]
    curve = np.interp(SOC, ocv.soc, ocv.values)
    pulsed = [run for run in case.runs if run.split == "fit" and _dynamic(run)]
    found = {run.name: resistances(_counted(run), curve, capacity) for run in pulsed}
    fits = {run.name: _job(run, found[run.name], curve, capacity) for run in pulsed}
    jobs = []
    for run in (run for run in case.runs if run.split == "check"):
        nearest = min(pulsed, key=lambda other: abs(_degC(other) - _degC(run))).name
        jobs.append(_job(run, found[nearest], curve, capacity) | {"fit": nearest})
    content = json.dumps({"fits": fits, "jobs": jobs})
    done = subprocess.run(
        [str(python), str(SCRIPT)], input=content, capture_output=True, text=True, timeout=LIMIT_S, check=True
    )
    errors: dict[str, dict[str, float]] = {}
    read = {run.name: run.measured.outputs["voltage_V"] for run in case.runs}
    for one in json.loads(done.stdout.splitlines()[-1]):
        left = read[one["run"]] - np.array(one["voltage_V"], dtype=float)
        if np.isfinite(left).mean() > 0.9:
            errors.setdefault(one["peer"], {})[one["run"]] = float(np.sqrt(np.nanmean(left**2)))
    return errors


def _job(run: Run, found, curve: np.ndarray, capacity_Ah: float) -> dict[str, Any]:
    """Return a run with the numbers of the usual recipe, as the script takes it."""
    (R_0, R_1, R_2), taus = found
    measured = run.measured
    job = {"run": run.name, "time_s": measured.time_s.tolist(), "current_A": measured.inputs["current_A"].tolist()}
    job |= {"voltage_V": measured.outputs["voltage_V"].tolist(), "soc": SOC.tolist(), "ocv": curve.tolist()}
    job |= {"capacity_Ah": capacity_Ah, "soc0": run.initial_soc.value}
    return job | {"R": [max(float(R), 1e-5) for R in (R_0, R_1, R_2)], "tau_s": [float(tau) for tau in taus]}


def _dynamic(run: Run) -> bool:
    return float(np.std(run.measured.inputs["current_A"])) > 0.1


def _degC(run: Run) -> float:
    return float(np.median(run.measured.inputs["ambient_degC"]))


def _counted(run: Run) -> Any:
    rows = run.to_dataframe()
    steps = np.diff(rows.time_s) * rows.current_A.to_numpy()[1:] / 3600.0
    return rows.assign(discharged_Ah=np.append(0.0, np.cumsum(steps))).dropna(subset=["voltage_V"])
