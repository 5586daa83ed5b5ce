"""Pictures of simulated cases; the room `plots` draws them, and is imported when one is drawn."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from jaxmodel.base.late_binding import late_bound
from jaxmodel.case.records import chosen_run

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
        by_name = {one.run.name: one for one in self.simulation}
        name = chosen_run(run, by_name)
        return late_bound("jaxmodel.plots.runs:simulation")(name, by_name[name].table, by_name[name].run)
