"""Pictures of simulated cases, drawn by `plots` when they are asked for: matplotlib is not loaded before."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from jaxmodel.errors import MeasurementError, nearest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class SimulationPlots:
    """Pictures of the simulated runs of a case."""

    simulation: Any

    def __call__(self, run: str | None = None) -> Figure:
        """Draw a run by its name, the first by default: its inputs, and every reading beside what was measured.

        Raises:
            MeasurementError: no run is called so.
        """
        from plots import runs

        by_name = {one.run.name: one for one in self.simulation}
        name = next(iter(by_name)) if run is None else run
        if name not in by_name:
            raise MeasurementError(f"plot: no run is called '{name}'.{nearest(name, by_name)}")
        return runs.simulation(name, by_name[name].table, by_name[name].run)
