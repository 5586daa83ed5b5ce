"""Pictures of an import; `plots` and matplotlib are imported only when one is drawn."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from jaxmodel.case.plotting import chosen_run

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
        from jaxmodel.plots.imports import imported_run

        by_name = {one.log.name: one.log for one in self.imported.runs}
        name = chosen_run(run, by_name)
        log = by_name[name]
        marked = [(finding.what, finding.column, finding.spans_s) for finding in log.findings]
        notes = [finding.sentence for finding in log.findings if finding.weight == "warning"]
        return imported_run(name, log.time_s, log.columns, marked, notes)

    def png(self, run: str) -> bytes:
        """Return the picture of a run as a PNG file."""
        from jaxmodel.plots.style import png

        return png(self(run))
