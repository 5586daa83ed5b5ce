"""Pictures of simulated cases; `plots` and matplotlib are imported only when one is drawn."""

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
        """Draw a run by its name, the first by default: inputs, simulated readings and measurements.

        Raises:
            MeasurementError: there is no such run.
        """
        from plots import runs

        by_name = {one.run.name: one for one in self.simulation}
        name = next(iter(by_name)) if run is None else run
        if name not in by_name:
            raise MeasurementError(f"plot: no run is called '{name}'.{nearest(name, by_name)}")
        return runs.simulation(name, by_name[name].table, by_name[name].run)
