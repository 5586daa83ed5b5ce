"""Tables 1 and 2, Figs. 6 and 7: discharges over ambient temperature and torque, with formulas and look-up tables."""

from __future__ import annotations

import numpy as np
import xarray as xr

from examples.paper.printed import TABLE_1, TABLE_2, share_left
from jaxmodel import sweeps

# Values that the paper does not state, chosen to reproduce Table 2; see `docs/paper.md`.
ASSUMED = {"duty": 0.3, "load_torque_Nm": 0.175, "onboard_current_A": 0.3}
FIDELITIES = ("formula", "lut")
DURATION_S, STEP_S, STORED_EVERY = 1800.0, 1.0, 30


def discharges() -> xr.Dataset:
    """Return slope and trajectory of the state of charge over fidelity, ambient and torque.

    The slope is the mean over half an hour, as read from Figs. 6 and 7, which are straight.
    """
    runs = []
    for fidelity in FIDELITIES:
        study = sweeps.Study(
            title="The paper's Tables 1 and 2",
            kind="robot",
            fidelity=fidelity,  # type: ignore[arg-type]
            parameters={"onboard_current_A": ASSUMED["onboard_current_A"]},
            profile={"duration_s": DURATION_S, "step_s": STEP_S, "duty": ASSUMED["duty"]},  # type: ignore[arg-type]
            axes={"ambient_degC": list(TABLE_1), "load_torque_Nm": [0.0, 0.05, 0.1, *TABLE_2]},
            metrics=["soc_gradient", "min_pack_voltage_V", "peak_winding_temperature_degC", "valid_share"],
            store=["soc"],
            store_every=STORED_EVERY,
            cutoff={},  # the paper's slopes are over the whole half hour
        )  # fmt: skip
        runs.append(sweeps.run(study))
    return xr.concat(runs, dim="fidelity", coords="minimal", compat="override").assign_coords(fidelity=list(FIDELITIES))


def slopes(data: xr.Dataset, fidelity: str, axis: str) -> dict[float, float]:
    """Return the slopes along one axis of the tables, the other at the paper's: 0.175 N m, 20 degC."""
    other = {"ambient_degC": {"load_torque_Nm": 0.175}, "load_torque_Nm": {"ambient_degC": 20.0}}[axis]
    line = data["soc_gradient"].sel({"fidelity": fidelity, **other})
    return {float(at): float(line.sel({axis: at})) for at in (TABLE_1 if axis == "ambient_degC" else TABLE_2)}


def misfit(ours: dict[float, float], printed: dict[float, float]) -> tuple[float, float]:
    """Return the RMS and the largest relative difference of simulated and printed slopes."""
    off = np.array([ours[at] / printed[at] - 1.0 for at in printed])
    return float(np.sqrt(np.mean(off**2))), float(np.abs(off).max())


def with_storage_at_ambient(ours: dict[float, float], months: float) -> dict[float, float]:
    """Return the slopes if eq. 8's T_amb were the ambient of the run; NaN if no charge would be left.

    The slope is the draw divided by the usable charge, and eq. 8 affects only the latter.
    """
    at_20, left = share_left(months, 20.0), {at: share_left(months, at) for at in ours}
    return {at: slope * at_20 / left[at] if left[at] > 0.0 else np.nan for at, slope in ours.items()}
