"""Pictures of the results of a diagnosis; the room `plots` draws them, and is imported when one is drawn."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.base.late_binding import late_bound
from jaxmodel.case.records import chosen_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class _Saved:
    """Pictures that can be written to a folder together."""

    def all(self) -> dict[str, Figure]:
        """Return every picture for which there are data, by name."""
        raise NotImplementedError

    def save(self, folder: str | Path) -> list[Path]:
        """Write every picture as a PNG to a folder, which is made if need be; return the files."""
        return late_bound("jaxmodel.plots.style:save")(self.all().items(), folder)


@dataclasses.dataclass(frozen=True)
class DiagnosisPlots(_Saved):
    """Pictures of a diagnosis or comparison; each method returns a matplotlib Figure."""

    diagnosis: Any

    def ladder(self) -> Figure:
        """Draw each channel's error of each model, on fit and check runs, against the noise."""
        return late_bound("jaxmodel.plots.evidence:ladder")(self.diagnosis)

    def run(self, name: str | None = None) -> Figure:
        """Draw measurement, models and residuals of a run by its name, of the first by default.

        Raises:
            MeasurementError: there is no such run.
        """
        chosen = chosen_run(name, (run.name for run in self.diagnosis.case.runs))
        return late_bound("jaxmodel.plots.diagnosis:run_of")(self.diagnosis, chosen)

    def pulses(self, name: str | None = None, channel: str | None = None) -> Figure:
        """Draw each pulse or step of a run by itself: measured, models and residual, as small multiples.

        Args:
            name: of the run, the first by default.
            channel: the reading, by default the first that is no temperature.

        Raises:
            MeasurementError: there is no such run or channel, or the run has no pulses or steps.
        """
        chosen = chosen_run(name, (run.name for run in self.diagnosis.case.runs))
        if channel is not None and channel not in self.diagnosis.noise:
            raise MeasurementError(
                f"plot.pulses: no channel '{channel}' was measured.{nearest(channel, self.diagnosis.noise)}"
            )
        return late_bound("jaxmodel.plots.diagnosis:pulses_of")(self.diagnosis, chosen, channel)

    def residuals(self) -> Figure:
        """Draw the residuals of base and final model over state of charge, current, temperature or speed."""
        return late_bound("jaxmodel.plots.diagnosis:residuals_by_condition")(self.diagnosis)

    def errors(self) -> Figure:
        """Draw each channel's error in each run, before and after, against noise and tolerance."""
        return late_bound("jaxmodel.plots.diagnosis:errors_of")(self.diagnosis)

    def scores(self, ax: Axes | None = None) -> Figure:
        """Draw the standard score of every effect at the calibrated base model."""
        return late_bound("jaxmodel.plots.evidence:scores")(self.diagnosis, ax=ax)

    def candidates(self, ax: Axes | None = None) -> Figure:
        """Draw the probability of each compared model."""
        return late_bound("jaxmodel.plots.evidence:candidates")(self.diagnosis, ax=ax)

    def curves(self) -> Figure:
        """Draw the correction of each table or relation.

        Raises:
            MeasurementError: there is none.
        """
        if not self.diagnosis.curves:
            raise MeasurementError("plot.curves: the diagnosis corrects no table or relation.")
        return late_bound("jaxmodel.plots.evidence:curves")(self.diagnosis.curves)

    def all(self) -> dict[str, Figure]:
        """Return every picture for which there are data, by name."""
        return late_bound("jaxmodel.plots.diagnosis:pictures_of")(self.diagnosis)


@dataclasses.dataclass(frozen=True)
class InvestigationPlots:
    """Pictures of the present model of an investigation; each method returns a matplotlib Figure."""

    investigation: Any

    def ladder(self) -> Figure:
        """Draw each channel's error of every model so far, on fit and check runs, against the noise."""
        return late_bound("jaxmodel.plots.investigation:ladder")(self.investigation)

    def run(self, name: str | None = None) -> Figure:
        """Draw measurement, base model, present model and residuals of a run, of the first by default.

        Raises:
            MeasurementError: there is no such run.
        """
        chosen = chosen_run(name, (run.name for run in self.investigation.case.runs))
        return late_bound("jaxmodel.plots.investigation:run_of")(self.investigation, chosen)

    def errors(self) -> Figure:
        """Draw each channel's error in each run, of the present model, against noise and tolerance."""
        return late_bound("jaxmodel.plots.investigation:errors_of")(self.investigation)

    def candidates(self, most: int = 16, ax: Axes | None = None) -> Figure:
        """Draw the expected gain of log evidence of each candidate, the best first.

        Args:
            most: candidates to draw.
            ax: axes of yours to draw on; by default those of a new figure.
        """
        return late_bound("jaxmodel.plots.investigation:candidates")(self.investigation, most, ax)


@dataclasses.dataclass(frozen=True)
class IdentificationPlots(_Saved):
    """Pictures of an identification; each method returns a matplotlib Figure."""

    identification: Any

    def information(self) -> Figure:
        """Draw the shares of runs, sensors and priors in the information on each parameter."""
        return late_bound("jaxmodel.plots.identifiability:information_bars")(self.identification.found)

    def correlations(self, ax: Axes | None = None) -> Figure:
        """Draw the correlations of the estimates."""
        return late_bound("jaxmodel.plots.identifiability:correlations")(self.identification.found, ax=ax)

    def ellipse(self, first: str, second: str, ax: Axes | None = None) -> Figure:
        """Draw the joint confidence region of two parameters.

        Raises:
            ParameterError: one is not among the unknowns.
        """
        found = self.identification.found
        one, other = (found.names[found.place(name)] for name in (first, second))
        return late_bound("jaxmodel.plots.identifiability:ellipse")(found, one, other, ax)

    def profile(self, name: str | None = None, ax: Axes | None = None) -> Figure:
        """Draw the profile likelihood of a requested parameter, the first by default, and its quadratic approximation.

        Raises:
            MeasurementError: it was not profiled.
        """
        profiles = {one.name: one for one in self.identification.profiles}
        if not profiles:
            raise MeasurementError("plot.profile: no profile was requested; use identify(case, profiles=[...]).")
        chosen = next(iter(profiles)) if name is None else name
        if chosen not in profiles:
            raise MeasurementError(f"plot.profile: '{chosen}' was not profiled.{nearest(chosen, profiles)}")
        found, draw = self.identification.found, late_bound("jaxmodel.plots.identifiability:profile_beside_quadratic")
        return draw(profiles[chosen], found.units[found.place(chosen)], ax)

    def all(self) -> dict[str, Figure]:
        """Return every picture for which there are data, by name."""
        return late_bound("jaxmodel.plots.identifiability:pictures_of")(self.identification)
