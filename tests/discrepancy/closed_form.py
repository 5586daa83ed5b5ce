"""Problems whose readings are known functions of the unknowns, so that everything about them is known."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
from discrepancy.problem import Lane, Problem
from discrepancy.readings import Readings
from jaxtyping import Array


class ClosedForm(Problem):
    """Readings of one run and channel, each with noise of sd 1 of its own; `readings_at` is to be overridden."""

    def readings_at(self, x: Array) -> Array:
        """Return the readings (lanes, n) at the unknowns (lanes, unknowns)."""
        raise NotImplementedError

    def predictions(self, lanes: Lane) -> Array:
        return self.readings_at(jnp.asarray(lanes.x))[:, None, :, None]

    def only(self, split: str) -> Problem:
        return self

    @property
    def blocks(self) -> list[tuple[np.ndarray, Problem]]:
        return [(np.zeros(1, int), self)]


def closed_form(kind: type[ClosedForm], like: Problem, data: np.ndarray, counted: Array, **own: Any) -> ClosedForm:
    """Return a problem with the unknowns of another and readings of its own, of which those counted may calibrate."""
    fields = {field.name: getattr(like, field.name) for field in dataclasses.fields(like)}
    number, nothing = jnp.arange(data.size), jnp.zeros(data.size)
    readings = Readings(number, jnp.asarray(data), nothing + 1.0, number, nothing, counted, nothing, nothing[:, None])
    return kind(**fields | {"times": nothing[None], "channels": ("voltage_V",), "readings": readings}, **own)
