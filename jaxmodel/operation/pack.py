"""The charge of each cell of a pack whose cells are measured, and which of them is the weakest.

In series, all cells lose the same charge: the pack is empty with the cell that has the least left, in A h. That is not
the cell of the least voltage under load, which may only have more resistance, nor always that of the least capacity.
"""

from __future__ import annotations

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.in_short import InShort
from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case, Run
from jaxmodel.case.specimens import in_words
from jaxmodel.operation.evaluation import UNRESTED_V, filters, seen
from jaxmodel.operation.kalman import Tuning
from jaxmodel.operation.preparation import for_estimation

APART = 2.0  # sd of a difference of charges from which two cells are told apart; assumed, 95 % of a normal error


@dataclasses.dataclass(frozen=True, repr=False)
class CellCharge(InShort):
    """The charge of one cell at the end of a run; each number beside its sd.

    Attributes:
        specimen: the cell.
        run: its last.
        soc: state of charge.
        sd: of it.
        capacity: its scale, as a share of the capacity of the case.
        capacity_sd: of it.
        left_Ah: charge left.
        left_sd_Ah: of it.
    """

    specimen: str
    run: str
    soc: float
    sd: float
    capacity: float
    capacity_sd: float
    left_Ah: float
    left_sd_Ah: float


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PackCharge(InShort):
    """The charge of each cell of a pack at the end of its last run.

    Attributes:
        cells: that with the least charge left first.
        soc: by specimen, the state of charge at each row of its last run.
    """

    cells: tuple[CellCharge, ...]
    soc: dict[str, np.ndarray]

    @property
    def weakest(self) -> str:
        """The cell with the least charge left."""
        return self.cells[0].specimen

    @property
    def told_apart(self) -> bool:
        """Whether the weakest cell has less charge left than the next by two sd of the difference.

        Errors of the model are those of all cells and cancel in a difference, so that this asks for more than it need.
        """
        least, following = self.cells[:2]
        return following.left_Ah - least.left_Ah > APART * math.hypot(least.left_sd_Ah, following.left_sd_Ah)

    def summary(self) -> str:
        """Return which cell is the weakest, in words."""
        least, following = self.cells[:2]
        weakest, second = (in_words("cell", cell.specimen) for cell in (least, following))
        says = (
            f"{weakest[0].upper()}{weakest[1:]} has the least charge left: {least.left_Ah:.3g} ± "
            f"{least.left_sd_Ah:.2g} A h, {100 * least.soc:.0f} ± {100 * least.sd:.0f} % of its capacity, which is "
            f"{100 * least.capacity:.0f} ± {100 * least.capacity_sd:.0f} % of the stated one; "
        )
        other = f"{second} has {following.left_Ah:.3g} ± {following.left_sd_Ah:.2g} A h"
        return says + (f"{other}." if self.told_apart else f"but {other}, which these bands do not tell apart.")

    def to_dataframe(self) -> pd.DataFrame:
        """Return a line for each cell, that with the least charge left first; columns as in `CellCharge`."""
        return pd.DataFrame([dataclasses.asdict(cell) for cell in self.cells])


def cells_of_pack(case: Case, tuning: Tuning | None = None) -> PackCharge:
    """Return the charge of each cell of a pack by a filter for each: Q_left = s q Q.

    s is the state of charge, q the scale of the capacity Q of the case, as the filter of the cell's last run ends; the
    sd of the charge left is q Q sqrt(sd_s^2 + (s sd_ln q)^2).

    Args:
        case: of kind "cell", its runs of two specimens or more, with `voltage_V`; `initial_soc` of a run is where its
            filter starts, with its sd if that is stated.
        tuning: of the filter, from an evaluation on runs of such a cell whose charge is known; the default if None.

    Raises:
        MeasurementError: the case is of another kind or of fewer than two cells, or a run has no voltage.
    """
    last = {run.specimen: run for run in case.runs if run.specimen}
    if case.kind != "cell" or len(last) < 2:
        raise MeasurementError(
            f"{case.label}: needs runs of two cells or more, each with its specimen; import the log with --each-cell."
        )
    cells, tracks = [], {}
    for specimen, run in last.items():
        found = _filtered(case, run, tuning or Tuning())
        soc, sd, scale, log_sd = (float(values[-1]) for values in found)
        capacity_Ah = scale * float(case_model(case).parameters.capacity_Ah)
        left_sd_Ah = capacity_Ah * math.hypot(sd, soc * log_sd)
        cells.append(CellCharge(specimen, run.name, soc, sd, scale, scale * log_sd, soc * capacity_Ah, left_sd_Ah))
        tracks[specimen] = found[0]
    return PackCharge(tuple(sorted(cells, key=lambda cell: cell.left_Ah)), tracks)


def _filtered(case: Case, run: Run, tuning: Tuning) -> tuple[np.ndarray, ...]:
    """Return charge, its sd, the scale of the capacity and the sd of its logarithm at each row of a run."""
    if "voltage_V" not in run.measured.outputs:
        raise MeasurementError(f"{run.file}: needs the column voltage_V, to estimate the charge of its cell.")
    sd = run.initial_soc.sd
    if sd is not None:
        tuning = eqx.tree_at(lambda t: t.start_sd, tuning, jnp.asarray(sd))
    known = run.overrides.get("initial_hysteresis")
    found = filters(
        for_estimation(case_model(case)),
        jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], tuning),
        seen(run, 0, with_temperature=True),
        jnp.asarray([run.initial_soc.value]),
        jnp.asarray(UNRESTED_V),
        jnp.asarray(0.0 if known is None else known.value),
    )
    outputs = (found.soc, found.sd, found.capacity_scale, found.capacity_sd)
    return tuple(np.asarray(values)[0, 0, : run.measured.time_s.size] for values in outputs)
