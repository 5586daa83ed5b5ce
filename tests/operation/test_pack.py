"""The charge of each cell of a pack, on cells whose truth is known: simulated in series."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case
from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import case_model
from jaxmodel.model.names import with_values
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import simulate
from jaxmodel.operation import Tuning, cells_of_pack

TIME_S = np.arange(0.0, 5400.0, 10.0)
SURE = Tuning(voltage_sd_V=3e-3, drop_share=0.05, scale_sd=0.2, offset_sd_V=2e-3, charge_sd=5e-4, current_sd=0.0)
# Cell b has less capacity, cell c more resistance: c has the least voltage under load, b the least charge.
SHARES, FACTORS = {"a": 1.0, "b": 0.88, "c": 1.0}, {"a": 1.0, "b": 1.0, "c": 1.3}


def pack(shares: dict[str, float], factors: dict[str, float], seed: int = 0) -> tuple[Case, dict[str, float]]:
    """Cells in series from full, as a case of runs of each, and the charge that each has left, in A h."""
    rng = np.random.default_rng(seed)
    current = np.repeat(rng.uniform(0.0, 2.4, TIME_S.size // 6), 6)
    frames, entries, left = {}, {}, {}
    one = Case.from_dataframes({"x": table(current, np.full(TIME_S.size, 3.7))}, kind="cell", preset="lg_mj1")
    base = case_model(one)
    for name, share in shares.items():
        capacity_Ah = float(base.parameters.capacity_Ah) * share
        values = {"capacity_Ah": capacity_Ah}
        values |= {key: factors[name] for key in ("series_resistance_scale", "rc_resistance_scale")}
        ran = simulate(
            with_values(base, values), Profile(TIME_S, {"current_A": current, "ambient_degC": 0 * TIME_S + 20})
        )
        frames[name] = table(current, np.asarray(ran.readings["voltage_V"]) + rng.normal(0.0, 2e-3, TIME_S.size))
        entries[name] = {"specimen": name, "initial_soc": (1.0, 0.02)}
        left[name] = float(ran.readings["soc"][-1]) * capacity_Ah
    return Case.from_dataframes(frames, kind="cell", preset="lg_mj1", runs=entries), left


def table(current: np.ndarray, volts: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"time_s": TIME_S, "current_A": current, "ambient_degC": 20.0, "voltage_V": volts})


def test_weakest_cell_is_that_with_the_least_charge_left() -> None:
    case, left = pack(SHARES, FACTORS)
    found = cells_of_pack(case, SURE)
    assert found.weakest == "b"
    assert found.told_apart
    assert found.summary().startswith("Cell b has the least charge left")
    for cell in found.cells:
        assert abs(cell.left_Ah - left[cell.specimen]) < 3.0 * cell.left_sd_Ah
        assert cell.capacity == pytest.approx(SHARES[cell.specimen], abs=0.05)
    # The least voltage under load, at first, is another cell's.
    first = {run.specimen: float(np.mean(run.measured.outputs["voltage_V"][:100])) for run in case.runs}
    assert min(first, key=lambda name: first[name]) == "c"


def test_like_cells_are_not_told_apart() -> None:
    case, _ = pack({"a": 1.0, "b": 1.0}, FACTORS, seed=1)
    found = cells_of_pack(case, SURE)
    assert not found.told_apart
    assert "do not tell apart" in found.summary()


def test_one_cell_is_no_pack() -> None:
    case, _ = pack({"a": 1.0, "b": 1.0}, FACTORS)
    with pytest.raises(MeasurementError, match="needs runs of two cells or more"):
        cells_of_pack(dataclasses.replace(case, runs=case.runs[:1]))
