"""Pictures of simulated cases; `plots` and matplotlib are imported only when one is drawn."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from jaxmodel.base.errors import MeasurementError, nearest

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def chosen_run(name: str | None, names: Iterable[str]) -> str:
    """Return the name of a run, the first by default; raise MeasurementError if there is no such run."""
    names = list(names)
    chosen = names[0] if name is None else name
    if chosen not in names:
        hint = nearest(chosen, names) or f" The runs are {', '.join(names)}."
        raise MeasurementError(f"plot: no run is called '{chosen}'.{hint}")
    return chosen


@dataclasses.dataclass(frozen=True)
class SimulationPlots:
    """Pictures of the simulated runs of a case."""

    simulation: Any

    def __call__(self, run: str | None = None) -> Figure:
        """Draw a run by its name, the first by default: inputs, simulated readings and measurements.

        Raises:
            MeasurementError: there is no such run.
        """
        from jaxmodel.plots import runs

        by_name = {one.run.name: one for one in self.simulation}
        name = chosen_run(run, by_name)
        return runs.simulation(name, by_name[name].table, by_name[name].run)
