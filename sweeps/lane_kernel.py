"""The kernel of a lane, of a processor or a GPU, and what its results are kept as."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import jax
import numpy as np

from jaxmodel.lanes import Written, over
from jaxmodel.model.electrothermal import Model
from jaxmodel.sweeps.lane import Keep, Outcome, SteppedProfile, run_lane

_Kind = TypeVar("_Kind", bound=Written)


def kernel_of_a_lane(
    kind: type[_Kind], keep: Keep, shared: Any, lanes: Callable[[np.ndarray], dict[str, Any]], single: bool
) -> _Kind:
    """Return the kernel of a lane, in float64 or float32, the same for like sweeps.

    Raises:
        NotNative: an operation of a lane has no instructions.
    """
    own = {name: np.asarray(value)[0] for name, value in lanes(np.zeros(1, dtype=int)).items()}

    def one_lane(shared: tuple[Model, SteppedProfile, Any], own: dict[str, jax.Array]) -> Outcome:
        return run_lane(keep, *shared, own)

    return over(kind, one_lane, shared, own, keep, single=single)


def doubled(outcome: Outcome) -> Outcome:
    """Return results as they are kept, floats in float64."""
    return jax.tree.map(lambda x: x.astype(np.float64, copy=False) if x.dtype.kind == "f" else x, outcome)
