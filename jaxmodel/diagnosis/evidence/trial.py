"""A model fitted under given weights."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np

from jaxmodel.diagnosis.fitting.fit import Fit
from jaxmodel.diagnosis.fitting.layout import BASE, Start
from jaxmodel.diagnosis.fitting.model import Labels, ModelSpace, Setting, View
from jaxmodel.diagnosis.fitting.readings import Weights
from jaxmodel.diagnosis.noise.instrument import NoiseModel
from jaxmodel.diagnosis.noise.model_error import ModelError
from jaxmodel.diagnosis.screening.screen import Screen

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
        """Return the sd of the free unknowns' coordinates, (k,): the largest of posterior and sandwich estimates.

        The sandwich estimate I^-1 (sum g g') I^-1 uses the actual scatter of the scores g of parts of the data, which
        exceeds the posterior if the model error differs from the assumed process. The parts are time blocks and, if
        there is a model error, whole runs: the error of a model may have the same sign throughout a run.
        """
        parts = [self.scale.pieces(SANDWICH_PIECES)] + ([self.scale.runs] if self.scale.error.sd else [])
        variances = [np.diag(self.fitted.covariance), *map(self._sandwich, parts)]
        return np.sqrt(np.max(variances, axis=0))

    def _sandwich(self, part: np.ndarray) -> np.ndarray:
        """Return the sandwich estimate of the variances, (k,), from the part of each reading."""
        scores = np.stack(
            [self.fitted.jacobian[part == one].T @ self.fitted.rows[part == one] for one in np.unique(part)]
        )
        count = max(len(scores), 2)
        moved = (scores - scores.mean(axis=0)) @ self.fitted.covariance
        return np.sum(moved**2, axis=0) * count / (count - 1.0)

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
