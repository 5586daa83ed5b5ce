"""Pictures of a parameterisation; the room `plots` draws them, and is imported when one is drawn."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.late_binding import late_bound

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class ParameterisationPlots:
    """Pictures of a parameterisation; each method returns a matplotlib Figure."""

    parameterisation: Any

    def extraction(self, name: str) -> Figure:
        """Draw the readings from which numbers were extracted, with what was fitted: a key of `points`.

        Raises:
            MeasurementError: there are no such points.
        """
        points = self.parameterisation.points
        if name not in points:
            hint = nearest(name, points) or f" There are {', '.join(points)}."
            raise MeasurementError(f"plot: no extraction is called '{name}'.{hint}")
        return late_bound("jaxmodel.plots.parameterisation:extraction")(self.parameterisation, name)

    def curves(self) -> Figure:
        """Draw the tables over state of charge, a line for each temperature.

        Raises:
            MeasurementError: the case has no tables.
        """
        if not self.parameterisation.case.tables:
            raise MeasurementError("plot: the case has no tables; draw an extraction.")
        return late_bound("jaxmodel.plots.parameterisation:curves")(self.parameterisation.case)

    def run(self, name: str | None = None) -> Figure:
        """Draw a run and its forward simulation, the first by default.

        Raises:
            MeasurementError: there is no such run.
        """
        return self.parameterisation.simulation.plot(name)

    def all(self) -> dict[str, Figure]:
        """Return every picture by name."""
        found = {name: self.extraction(name) for name in self.parameterisation.points}
        if self.parameterisation.case.tables:
            found["curves"] = self.curves()
        return found | {f"run-{run.name}": self.run(run.name) for run in self.parameterisation.case.runs}

    def save(self, folder: str | Path) -> list[Path]:
        """Write every picture as a PNG to a folder, which is made if need be; return the files."""
        return late_bound("jaxmodel.plots.style:save")(self.all().items(), folder)
