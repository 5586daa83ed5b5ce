"""Lanes at given points of one model, in memory: what a sweep does, without a study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from jaxmodel.lanes import Kernel, NotNative
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sweeps.by_vectors import ByVectors
from jaxmodel.sweeps.by_xla import ByXla
from jaxmodel.sweeps.devices import lane_mesh
from jaxmodel.sweeps.lane import Keep, Outcome, SteppedProfile
from jaxmodel.sweeps.lane_kernel import kernel_of_a_lane


def outcomes_at(
    keep: Keep, model: Model, stepped: SteppedProfile, cutoff: Cutoff | None, own: Mapping[str, np.ndarray]
) -> Outcome:
    """Run a lane at each point: vector instructions on a processor, XLA where there are none.

    Args:
        keep: what is kept of each lane.
        model: of all lanes.
        stepped: the profile, from `lay_out`.
        cutoff: ends a lane; None for none.
        own: values of each lane by name, as `run_lane` takes them, each of shape (points,).

    Returns:
        The outcome, with the axis of points first.
    """
    points = {name: np.asarray(values, dtype=float) for name, values in own.items()}
    count = next(iter(points.values())).size
    steps = int(stepped.duration_s.size)
    [(_, outcome)] = _program(keep, (model, stepped, cutoff), points, count, steps).outcomes(
        [(0, 0, count)], lambda lanes: None
    )
    return outcome


def _program(keep: Keep, shared: Any, points: dict[str, np.ndarray], count: int, steps: int) -> ByVectors | ByXla:
    def lanes(numbers: np.ndarray) -> dict[str, np.ndarray]:
        return {name: values[numbers] for name, values in points.items()}

    devices = jax.devices()
    if devices[0].platform == "cpu":
        try:
            values = jax.tree.map(np.asarray, shared)
            kernel = kernel_of_a_lane(Kernel, keep, values, lanes, single=False)
            return ByVectors(kernel, values, lanes, devices, steps)
        except NotNative:  # an effect of the user's
            pass
    return ByXla(keep, shared, lanes, lane_mesh(), steps, count)
