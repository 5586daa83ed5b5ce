"""The present model of an investigation: the ladder so far, a run, errors, and what candidates promise."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.wording import step_names
from jaxmodel.plots import evidence, runs
from jaxmodel.plots.errors import errors_by_run


def ladder(investigation: Investigation) -> Figure:
    """Draw each channel's error of every model so far, on fit and check runs, against the noise."""
    models = investigation.models()
    names = step_names([one.added for one in models])
    return evidence.errors_of_models([one.errors for one in models], names, _noise_sd(investigation))


def run_of(investigation: Investigation, name: str) -> Figure:
    """Draw measurement, base model, present model and residuals of one run."""
    run = next(one for one in investigation.case.runs if one.name == name)
    drawn = {"calibrated base model": investigation.models()[0].predictions[name]}
    if investigation.added:
        drawn["present model"] = investigation.present().predictions[name]
    return runs.fit_and_residuals(run, drawn, _noise_sd(investigation))


def errors_of(investigation: Investigation) -> Figure:
    """Draw each channel's error in each run, of the present model, against noise and tolerance."""
    return errors_by_run(investigation.errors().assign(model="final" if investigation.added else "base"))


def candidates(investigation: Investigation, most: int, ax: Axes | None = None) -> Figure:
    """Draw the expected gain of log evidence of each candidate, the best first."""
    return evidence.promises(investigation.candidates(), most, ax)


def _noise_sd(investigation: Investigation) -> dict[str, float]:
    return {channel: noise.sd for channel, noise in investigation.noise.items()}
