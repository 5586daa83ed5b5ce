"""`python -m tests.stress.extremes --lanes 1000000`: every parameter between its extremes, all effects, every kind.

Each lane has every parameter that its model knows drawn between its bounds (Sobol), typical ranges where they are open.
Each must end with numbers, or with a status that says why not; run again, or alone, it must give the same bits; and
vector instructions must agree with XLA on which lanes end how.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np
import xarray as xr

from jaxmodel.model.names import parameter_table, value
from jaxmodel.model.parameters import ParameterInfo
from jaxmodel.model.simulation import Status
from jaxmodel.sweeps import Study, run
from tests.sweeps.test_by_vectors import OF_CELL, OF_MOTOR, OF_ROBOT, OF_STATES

# By kind: effects, the loads and surroundings between which a user may be, and the rest of the study.
KINDS: dict[str, tuple[tuple[str, ...], dict[str, tuple[float, float]], dict[str, Any]]] = {
    "cell": (OF_CELL, {"current_A": (-10.0, 30.0), "ambient_degC": (-30.0, 60.0)}, {"duration_s": 600, "step_s": 100}),
    "motor": (
        OF_MOTOR,
        {"voltage_V": (-30.0, 30.0), "load_torque_Nm": (-1.0, 1.0), "ambient_degC": (-30.0, 60.0)},
        {"duration_s": 2, "step_s": 0.5},
    ),
    "robot": (
        OF_CELL[:10] + OF_MOTOR + OF_ROBOT,
        {"duty": (0.0, 1.0), "load_torque_Nm": (-0.5, 0.5), "ambient_degC": (-30.0, 60.0)},
        {"duration_s": 2, "step_s": 0.5},
    ),
}


def _range(info: ParameterInfo, now: float) -> tuple[float, float] | None:
    """Return the ends between which a parameter is drawn; None for one that stays as it is.

    An effect's: its typical range and half its width beyond. Others: a quarter to four times what they are, but for
    temperatures that are a reference: a resistance that falls below zero in the cold says nothing of the step.
    """
    if info.whole or (info.typical is None and (now <= 0.0 or info.unit == "degC")):
        return None
    low, high = info.typical or (now / 4.0, 4.0 * now)
    beyond = 0.5 * (high - low) if info.typical else 0.0
    low, high = max(low - beyond, info.lower), min(high + beyond, info.upper)
    return (low, high) if low < high else None


def study(kind: str, lanes: int) -> Study:
    """Return the sweep over all that a kind has."""
    effects, loads, profile = KINDS[kind]
    base: dict[str, Any] = {"kind": kind, "effects": {name: {} for name in effects}, "profile": profile}
    base["metrics"] = OF_STATES if kind == "cell" else []
    model = Study(**base, sample={"count": 1, "ranges": loads}).prepared.model
    known = {name: _range(info, float(value(model, name))) for name, info in parameter_table(model).items()}
    ranges = {name: found for name, found in known.items() if found is not None}
    return Study(**base, sample={"method": "sobol", "count": lanes, "seed": 1, "ranges": ranges | loads})


def _values(found: xr.Dataset) -> np.ndarray:
    return np.stack([found[name].values.astype(float) for name in sorted(map(str, found.data_vars))])


def main() -> int:
    """Run the lanes; return 1 if one ends without a number and without a reason, or differs when it is run again."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--lanes", type=int, default=2**20)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    parser.add_argument("--no-xla", action="store_true", help="leave out the comparison with XLA, four times as long")
    given = parser.parse_args()
    wrong = 0
    for kind in given.kind or KINDS:
        whole = study(kind, given.lanes)
        began = time.perf_counter()
        found = run(whole)
        took = time.perf_counter() - began
        status, values = found["status"].values, _values(found)
        finite = np.isfinite(values).all(axis=0)
        silent = int((~finite & (status != Status.NOT_FINITE)).sum())
        blamed = int((finite & (status == Status.NOT_FINITE)).sum())
        again = int((~((_values(run(whole)) == values) | np.isnan(values))).any(axis=0).sum())
        ends = {Status(int(code)).name: int((status == code).sum()) for code in np.unique(status)}
        print(f"{kind}: {status.size:,} lanes, {len(whole.sample.ranges)} ranges, {took:.0f} s: {ends}", flush=True)
        print(f"  without a number and a reason {silent}, with both {blamed}, not the same again {again}", flush=True)
        wrong += silent + again
        if given.no_xla:
            continue
        began = time.perf_counter()
        through_xla = run(whole, engine="xla")["status"].values
        apart = int((through_xla != status).sum())
        print(f"  other status through XLA {apart} ({time.perf_counter() - began:.0f} s)", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
