"""Pictures of an import; the room `plots` draws them, and is imported when one is drawn."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from jaxmodel.base.late_binding import late_bound
from jaxmodel.case.records import chosen_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclasses.dataclass(frozen=True)
class ImportPlots:
    """Pictures of imported runs with what was found in them."""

    imported: Any

    def __call__(self, run: str | None = None) -> Figure:
        """Draw a run by its name, the first by default: every column over time, and where something was found.

        Raises:
            MeasurementError: there is no such run.
        """
        by_name = {one.log.name: one.log for one in self.imported.runs}
        log = by_name[chosen_run(run, by_name)]
        marked = [(finding.what, finding.column, finding.spans_s) for finding in log.findings]
        notes = [finding.sentence for finding in log.findings if finding.weight == "warning"]
        return late_bound("jaxmodel.plots.imports:imported_run")(log.name, log.time_s, log.columns, marked, notes)

    def png(self, run: str) -> bytes:
        """Return the picture of a run as a PNG file."""
        return late_bound("jaxmodel.plots.style:png")(self(run))
