"""Ours against solvers of others at equal accuracy: cells at constant current, SOC to 1e-6 and voltage to 0.1 mV."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.by_diffrax import SOLVERS, ByDiffrax
from benchmarks.peer import PEERS, NoPeer, Peer
from benchmarks.timing import alternate
from benchmarks.work import AMBIENT_DEGC, DURATION_S, Ours, study_of
from jaxmodel.model.cell import storage_factor

LANES = 4096
MOST_SOC, MOST_VOLTAGE_V = 1e-6, 1e-4
# Ours is held to the accuracy at each of these times, the others at the last.
CHECKED_EVERY_S = 180.0
CHECKED_S = tuple(np.arange(CHECKED_EVERY_S, DURATION_S + 1.0, CHECKED_EVERY_S).tolist())
STEPS_S = (180.0, 90.0, 60.0, 45.0, 36.0, 30.0, 20.0, 15.0, 12.0, 10.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0)
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
# Those that solve lanes one by one get some of them: the time of a lane does not depend on how many there are.
LANES_OF_PEER = {"numba": LANES, "pybamm": 32, "thevenin": 8}

Row = dict[str, Any]


def _errors(found: Iterable[np.ndarray], truth: Iterable[np.ndarray]) -> dict[str, float]:
    """Return the greatest errors of SOC and voltage."""
    return {n: float(np.max(np.abs(a - b))) for n, a, b in zip(("soc", "voltage_V"), found, truth, strict=True)}


def _good(error: dict[str, float]) -> bool:
    return error["soc"] <= MOST_SOC and error["voltage_V"] <= MOST_VOLTAGE_V


class EqualAccuracy:
    """The contestants, each at the largest step or loosest tolerance that meets the accuracy, and what they are."""

    def __init__(self) -> None:
        study = study_of("cell", LANES)
        lanes = study.lanes(np.arange(LANES))
        p = study.prepared.model.parameters
        self._lanes = lanes["current_A"], lanes["cycles"]
        self._charge_C = 3600.0 * float(p.capacity_Ah * storage_factor(p.storage_months, p.storage_temperature_degC))
        exact = ByDiffrax("Tsit5", *self._lanes, self._charge_C, CHECKED_S)
        exact.tolerance = 1e-12
        self._truth = exact()
        self._contestants: dict[str, Any] = {}
        self._rows: dict[str, Row] = {}
        self._left_out: list[Row] = []
        self._step_s = self._add_ours()
        for solver in SOLVERS:
            self._add_diffrax(solver)
        for peer in PEERS:
            self._add_peer(peer)

    def _add(self, name: str, run: Any, setting: str, error: dict[str, float], lanes: int) -> None:
        self._contestants[name] = run
        self._rows[name] = {"name": name, "setting": setting, "errors": error, "lanes": lanes}

    def _add_ours(self) -> float:
        """Take the largest step that is good at all checked times, and return it."""
        for step_s in STEPS_S:
            every = {"store": ["soc", "voltage_V"], "store_every": round(CHECKED_EVERY_S / step_s)}
            columns = Ours(study_of("cell", LANES, step_s, **every)).stored()
            error = _errors((columns[name][:, 1:] for name in every["store"]), self._truth)
            if _good(error):
                break
        self._add("ours", Ours(study_of("cell", LANES, step_s)), f"step {step_s:g} s", error, LANES)
        return step_s

    def _add_diffrax(self, name: str) -> None:
        solver = ByDiffrax(name, *self._lanes, self._charge_C)
        for solver.tolerance in TOLERANCES:
            error = _errors(solver(), (x[:, -1:] for x in self._truth))
            if _good(error):
                break
        self._add(f"diffrax {name}", solver, f"tolerance {solver.tolerance:g}", error, LANES)

    def _add_peer(self, name: str) -> None:
        count = LANES_OF_PEER[name]
        some = np.linspace(0, LANES - 1, count).astype(int)
        current, cycles = (x[some].tolist() for x in self._lanes)
        job = {"current_A": current, "cycles": cycles, "charge_C": self._charge_C, "ambient_degC": AMBIENT_DEGC}
        job |= {"duration_s": DURATION_S, "step_s": self._step_s}
        try:
            for tolerance in TOLERANCES:
                peer = Peer(name, job | {"tolerance": tolerance})
                error = _errors((peer.soc, peer.voltage_V), (x[some, -1] for x in self._truth))
                if _good(error) or name == "numba":
                    break
                peer.close()
        except NoPeer as reason:
            self._left_out.append({"name": name, "left_out": str(reason)})
            return
        setting = f"step {self._step_s:g} s" if name == "numba" else f"tolerance {tolerance:g}"
        self._add(name, peer, setting, error, count)

    def rows(self, rounds: int = 7) -> list[Row]:
        """Time all in alternation; return of each its setting, errors, time per lane, and its multiple of ours."""
        times = alternate(self._contestants, rounds)
        for run in self._contestants.values():
            if isinstance(run, Peer):
                run.close()
        for name, row in self._rows.items():
            per_lane = 1e6 * np.array(times[name].wall_s) / row["lanes"]
            row |= {"us_per_lane": float(per_lane.min()), "median_us_per_lane": float(np.median(per_lane))}
            row["times_ours"] = row["us_per_lane"] / self._rows["ours"]["us_per_lane"]
        return [*self._rows.values(), *self._left_out]
