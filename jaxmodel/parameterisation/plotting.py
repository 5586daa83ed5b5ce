"""Pictures of a parameterisation; the room `plots` draws them, and is imported when one is drawn."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxmodel.base.errors import MeasurementError, listed, nearest
from jaxmodel.base.late_binding import late_bound

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Tables of a cell that are drawn, with the unit of the picture, and extractions that are drawn run by run.
TABLES = {"ocv": "V", "R_ints": "mΩ", "R_TS": "mΩ", "R_TL": "mΩ", "C_TS": "F", "C_TL": "F"}
RUN_BY_RUN = ("fit", "thermal", "electrical")
_NAMED = 8  # runs or tables that a sentence names


def kind_of(name: str) -> str:
    """Return the kind of an extraction by its name: that of a robot's part is the part's."""
    return name.split("_", 1)[1] if name.startswith(("cells_", "motors_")) else name


@dataclasses.dataclass(frozen=True)
class ParameterisationPlots:
    """Pictures of a parameterisation; each method returns a matplotlib Figure."""

    parameterisation: Any

    def extraction(self, name: str, run: str | None = None, ax: Axes | None = None) -> Figure:
        """Draw the readings from which numbers were extracted, with what was fitted: a key of `points`.

        Args:
            name: of the extraction.
            run: of an extraction that is drawn run by run ("fit", "thermal", "electrical"), the one to draw; by default
                all of them.
            ax: axes of yours to draw on; by default those of a new figure.

        Raises:
            MeasurementError: there are no such points or no such run, or several runs do not fit on the axes.
        """
        points = self.parameterisation.points
        if name not in points:
            hint = nearest(name, points) or f" There are {', '.join(points)}."
            raise MeasurementError(f"plot: no extraction is called '{name}'.{hint}")
        runs = list(dict.fromkeys(map(str, points[name]["run"]))) if kind_of(name) in RUN_BY_RUN else []
        if run is not None and run not in runs:
            hint = nearest(run, runs) or (
                f" It has {listed(runs, _NAMED)}." if runs else " It is not drawn run by run."
            )
            raise MeasurementError(f"plot: extraction '{name}' has no run '{run}'.{hint}")
        if ax is not None and run is None and len(runs) > 1:
            raise MeasurementError(
                f"plot: '{name}' is of {len(runs)} runs; name one for your axes, as run='{runs[0]}'."
            )
        return late_bound("jaxmodel.plots.parameterisation:extraction")(self.parameterisation, name, run, ax)

    def curves(self, table: str | None = None, ax: Axes | None = None) -> Figure:
        """Draw the tables over state of charge, a line for each temperature.

        Args:
            table: the one to draw, such as "ocv"; by default all.
            ax: axes of yours to draw on; by default those of a new figure.

        Raises:
            MeasurementError: the case has no tables or no such table, or several do not fit on the axes.
        """
        tables = [name for name in TABLES if name in self.parameterisation.case.tables]
        if not tables:
            raise MeasurementError("plot: the case has no tables; draw an extraction.")
        if table is not None and table not in tables:
            hint = nearest(table, tables) or f" It has {listed(tables, _NAMED)}."
            raise MeasurementError(f"plot: the case has no table '{table}'.{hint}")
        if ax is not None and table is None:
            raise MeasurementError(f"plot: name the table for your axes, as table='{tables[0]}'.")
        return late_bound("jaxmodel.plots.parameterisation:curves")(self.parameterisation.case, table, ax)

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
