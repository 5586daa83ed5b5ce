"""A model fitted under given weights."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from discrepancy.fitting.fit import Fit
from discrepancy.fitting.layout import BASE, Start
from discrepancy.fitting.model import Labels, ModelSpace, Setting, View
from discrepancy.fitting.readings import Weights
from discrepancy.noise.instrument import NoiseModel
from discrepancy.noise.model_error import ModelError
from discrepancy.screening.screen import Screen

# Time blocks per run for the sandwich estimate.
SANDWICH_PIECES = 4


@dataclasses.dataclass(frozen=True)
class Scale:
    """The noise and model error by which errors are weighted.

    Attributes:
        noise: of every output.
        view: the fitted readings, with the noise of each.
        weights: from noise and model error.
    """

    noise: Mapping[str, NoiseModel]
    view: View
    weights: Weights

    @property
    def error(self) -> ModelError:
        """Return the model error."""
        return self.weights.error

    def with_error(self, error: ModelError) -> Scale:
        """Return the scale with another model error."""
        return dataclasses.replace(self, weights=Weights(self.view.readings, error))

    @functools.cached_property
    def runs(self) -> np.ndarray:
        """Return the run of each reading."""
        return self.view.readings.run

    def pieces(self, count: int) -> np.ndarray:
        """Return the time block of each reading."""
        return self.view.readings.blocks(count)


@dataclasses.dataclass(frozen=True)
class Trial:
    """A model fitted under given weights.

    Attributes:
        setting: the model.
        amplitudes: prior sd of its curves and laws.
        fitted: the fit.
        scale: its noise and model error.
    """

    setting: Setting
    amplitudes: Mapping[str, float]
    fitted: Fit
    scale: Scale

    @property
    def labels(self) -> Labels:
        """Return the additions to the base model."""
        return self.setting.labels

    @property
    def log_evidence(self) -> float:
        """Return the log evidence, minus a constant common to all models under one scale."""
        return self.fitted.log_evidence

    @functools.cached_property
    def sd(self) -> np.ndarray:
        """Return the sd of the free unknowns' coordinates, (k,): the larger of the posterior and the sandwich estimate.

        The sandwich estimate I^-1 (sum g g') I^-1 uses the actual scatter of the scores g of time blocks, which exceeds
        the posterior if the model error differs from the assumed process.
        """
        block = self.scale.pieces(SANDWICH_PIECES)
        scores = np.stack(
            [self.fitted.jacobian[block == one].T @ self.fitted.rows[block == one] for one in np.unique(block)]
        )
        scores = scores - scores.mean(axis=0)
        count = max(len(scores), 2)
        moved = scores @ self.fitted.covariance
        return np.sqrt(np.maximum(np.diag(self.fitted.covariance), np.sum(moved**2, axis=0) * count / (count - 1.0)))

    def start(self, space: ModelSpace) -> Start:
        """Return its fitted coordinates, as a start for another fit."""
        layout, x = space.layout, self.fitted.x
        return {BASE: x[: layout.base]} | {label: x[list(layout.of[label])] for label in self.labels}


@dataclasses.dataclass(frozen=True)
class Settled(Trial):
    """A model fitted under its own weights, which come from the residual of the richest model that contains it.

    Attributes:
        screened: sensitivities of the readings to its unknowns and to all candidates.
    """

    screened: Screen
