"""A model fitted under given weights, and what it says of readings that were left out."""

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

# Blocks of a run whose scores are taken for independent.
SANDWICH_PIECES = 4


@dataclasses.dataclass(frozen=True)
class Scale:
    """What errors are held against: the noise of sensors, and the error of the model.

    Attributes:
        noise: of every output.
        view: the readings that are fitted, with the noise of each.
        weights: noise and model error together.
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
        """Return the run of each reading: the blocks that are left out."""
        return self.view.readings.run

    def pieces(self, count: int) -> np.ndarray:
        """Return each reading's piece of its run."""
        return self.view.readings.blocks(count)


@dataclasses.dataclass(frozen=True)
class Trial:
    """A model fitted under given weights.

    Attributes:
        setting: the model.
        amplitudes: of its curves and laws.
        fitted: the calibration.
        scale: that it was fitted under.
    """

    setting: Setting
    amplitudes: Mapping[str, float]
    fitted: Fit
    scale: Scale

    @property
    def labels(self) -> Labels:
        """Return what is added to the base model."""
        return self.setting.labels

    @property
    def log_evidence(self) -> float:
        """Return the log evidence, less a constant common to all models under one scale."""
        return self.fitted.log_evidence

    @functools.cached_property
    def sd(self) -> np.ndarray:
        """Return the sd of the free unknowns' coordinates, (k,): the larger of the posterior's and of the sandwich's.

        The sandwich I^-1 (sum g g') I^-1 takes the scatter of the scores g of blocks of time, a few to a run, as it is:
        where what the model gets wrong is not what its weights say, blocks disagree by more than these.
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
        """Return where it ended, as a start for another."""
        layout, x = space.layout, self.fitted.x
        return {BASE: x[: layout.base]} | {label: x[list(layout.of[label])] for label in self.labels}


@dataclasses.dataclass(frozen=True)
class Settled(Trial):
    """A model fitted under weights of its own: those beside the richest model about it.

    Attributes:
        screened: how the readings answer to its unknowns and to all that is not in it.
    """

    screened: Screen
