"""Pictures of the results of this package; `plots` and matplotlib are imported only when one is drawn."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jaxmodel.base.errors import MeasurementError, nearest
from jaxmodel.case.plotting import chosen_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Saved:
    """Pictures that can be written to a folder together."""

    def all(self) -> dict[str, Figure]:
        """Return every picture for which there are data, by name."""
        raise NotImplementedError

    def save(self, folder: str | Path) -> list[Path]:
        """Write every picture as a PNG to a folder, which is made if need be; return the files."""
        from jaxmodel.plots.style import save

        return save(self.all().items(), folder)


@dataclasses.dataclass(frozen=True)
class DiagnosisPlots(_Saved):
    """Pictures of a diagnosis or comparison; each method returns a matplotlib Figure."""

    diagnosis: Any

    def ladder(self) -> Figure:
        """Draw each channel's error of each model, on fit and check runs, against the noise."""
        from jaxmodel.plots import evidence

        return evidence.ladder(self.diagnosis)

    def run(self, name: str | None = None) -> Figure:
        """Draw measurement, models and residuals of a run by its name, of the first by default.

        Raises:
            MeasurementError: there is no such run.
        """
        from jaxmodel.plots import diagnosis

        return diagnosis.run_of(self.diagnosis, chosen_run(name, (run.name for run in self.diagnosis.case.runs)))

    def residuals(self) -> Figure:
        """Draw the residuals of base and final model over state of charge, current, temperature or speed."""
        from jaxmodel.plots import diagnosis

        return diagnosis.residuals_by_condition(self.diagnosis)

    def errors(self) -> Figure:
        """Draw each channel's error in each run, before and after, against noise and tolerance."""
        from jaxmodel.plots import diagnosis

        return diagnosis.errors_of(self.diagnosis)

    def scores(self) -> Figure:
        """Draw the standard score of every effect at the calibrated base model."""
        from jaxmodel.plots import evidence

        return evidence.scores(self.diagnosis)

    def candidates(self) -> Figure:
        """Draw the probability of each compared model."""
        from jaxmodel.plots import evidence

        return evidence.candidates(self.diagnosis)

    def curves(self) -> Figure:
        """Draw the correction of each table or relation.

        Raises:
            MeasurementError: there is none.
        """
        from jaxmodel.plots import evidence

        if not self.diagnosis.curves:
            raise MeasurementError("plot.curves: the diagnosis corrects no table or relation.")
        return evidence.curves(self.diagnosis.curves)

    def all(self) -> dict[str, Figure]:
        """Return every picture for which there are data, by name."""
        from jaxmodel.plots import diagnosis

        return diagnosis.pictures_of(self.diagnosis)


@dataclasses.dataclass(frozen=True)
class InvestigationPlots:
    """Pictures of the present model of an investigation; each method returns a matplotlib Figure."""

    investigation: Any

    def ladder(self) -> Figure:
        """Draw each channel's error of every model so far, on fit and check runs, against the noise."""
        from jaxmodel.diagnosis.wording import step_names
        from jaxmodel.plots import evidence

        models = self.investigation.models()
        noise_sd = {channel: noise.sd for channel, noise in self.investigation.noise.items()}
        return evidence.errors_of_models([m.errors for m in models], step_names([m.added for m in models]), noise_sd)

    def run(self, name: str | None = None) -> Figure:
        """Draw measurement, base model, present model and residuals of a run, of the first by default.

        Raises:
            MeasurementError: there is no such run.
        """
        from jaxmodel.plots import runs

        by_name = {run.name: run for run in self.investigation.case.runs}
        chosen = chosen_run(name, by_name)
        models = self.investigation.models()
        drawn = {"calibrated base model": models[0].predictions[chosen]}
        if self.investigation.added:
            drawn["present model"] = self.investigation.present().predictions[chosen]
        noise_sd = {channel: noise.sd for channel, noise in self.investigation.noise.items()}
        return runs.fit_and_residuals(by_name[chosen], drawn, noise_sd)

    def errors(self) -> Figure:
        """Draw each channel's error in each run, of the present model, against noise and tolerance."""
        from jaxmodel.plots.errors import errors_by_run

        return errors_by_run(self.investigation.errors().assign(model="final" if self.investigation.added else "base"))

    def candidates(self, most: int = 16) -> Figure:
        """Draw the expected gain of log evidence of each candidate, the best first.

        Args:
            most: candidates to draw.
        """
        from jaxmodel.plots import evidence

        return evidence.promises(self.investigation.candidates(), most)


@dataclasses.dataclass(frozen=True)
class IdentificationPlots(_Saved):
    """Pictures of an identification; each method returns a matplotlib Figure."""

    identification: Any

    def information(self) -> Figure:
        """Draw the shares of runs, sensors and priors in the information on each parameter."""
        from jaxmodel.plots import identifiability

        return identifiability.information_bars(self.identification.found)

    def correlations(self) -> Figure:
        """Draw the correlations of the estimates."""
        from jaxmodel.plots import identifiability

        return identifiability.correlations(self.identification.found)

    def ellipse(self, first: str, second: str) -> Figure:
        """Draw the joint confidence region of two parameters.

        Raises:
            ParameterError: one is not among the unknowns.
        """
        from jaxmodel.plots import identifiability

        found = self.identification.found
        return identifiability.ellipse(found, *(found.names[found.place(name)] for name in (first, second)))

    def profile(self, name: str | None = None) -> Figure:
        """Draw the profile likelihood of a requested parameter, the first by default, and its quadratic approximation.

        Raises:
            MeasurementError: it was not profiled.
        """
        from jaxmodel.plots import identifiability

        profiles = {one.name: one for one in self.identification.profiles}
        if not profiles:
            raise MeasurementError("plot.profile: no profile was requested; use identify(case, profiles=[...]).")
        chosen = next(iter(profiles)) if name is None else name
        if chosen not in profiles:
            raise MeasurementError(f"plot.profile: '{chosen}' was not profiled.{nearest(chosen, profiles)}")
        found = self.identification.found
        return identifiability.profile_beside_quadratic(profiles[chosen], found.units[found.place(chosen)])

    def all(self) -> dict[str, Figure]:
        """Return every picture for which there are data, by name."""
        from jaxmodel.plots import identifiability

        return identifiability.pictures_of(self.identification)
