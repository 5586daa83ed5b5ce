"""One answer to what is missing: a model with some effects added, calibrated."""

from __future__ import annotations

import dataclasses

from discrepancy.calibrate import Fit
from discrepancy.problem import BASE, Layout, Problem, Start

Labels = tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Hypothesis:
    """A model with some effects added, calibrated on the fit runs.

    Attributes:
        labels: of the added effects.
        problem: the case under this model.
        layout: of its unknowns. Models that share a program have the unknowns of one another's effects too, at zero.
        fitted: the calibration.
    """

    labels: Labels
    problem: Problem
    layout: Layout
    fitted: Fit

    @property
    def log_evidence(self) -> float:
        """Return the log of the probability of the readings, less a constant common to all hypotheses of the case."""
        return self.fitted.log_evidence

    @property
    def own(self) -> list[int]:
        """Return the numbers of the unknowns that are the model's own: the base model's, then its effects'."""
        return self.layout.own(self.labels)

    @property
    def start(self) -> Start:
        """Return where it ended, as a start for another."""
        of_effects = {label: self.fitted.x[list(self.layout.of_effect[label])] for label in self.labels}
        return {BASE: self.fitted.x[: self.layout.base]} | of_effects
