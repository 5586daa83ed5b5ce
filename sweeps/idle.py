"""What lanes differ in and no result depends on, and what would make it matter."""

from __future__ import annotations

import bisect
import dataclasses
import functools
import warnings
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import Remark
from jaxmodel.effects import CATALOGUE
from jaxmodel.lanes.influence import influential
from jaxmodel.model.electrothermal import Model
from jaxmodel.sweeps.lane import Keep, lay_out, run_lane
from jaxmodel.sweeps.prepare import Prepared
from jaxmodel.sweeps.study import Study


def idle(study: Study) -> dict[str, str]:
    """Return what lanes differ in and no metric or stored column can depend on.

    It is read off the traced program: no lane is run.

    Args:
        study: to be run.

    Returns:
        By the name of an axis, of a range or of a scale: an effect of the catalogue with which results would depend
        on it; "" where none of this kind does it.
    """
    own = {name: values[0] for name, values in study.lanes(np.zeros(1, dtype=int)).items()}
    model = study.prepared.model
    found = set(own) - _influential(study, model, own)
    if not found:
        return {}
    on = {effect.name for effect in model.effects}
    off = [cls for name, cls in CATALOGUE.items() if name not in on and model.kind in cls.kinds and not cls.is_sensor]

    def with_first(count: int) -> frozenset[str]:
        effects = (*model.effects, *(cls() for cls in off[:count]))
        return _influential(study, dataclasses.replace(model, effects=effects), own)

    with_all = with_first(len(off)) & found
    needed = {}
    for name in sorted(found):
        needed[name] = ""
        if name in with_all:
            first = bisect.bisect_left(range(len(off)), 1, key=lambda n, name=name: name in with_first(n + 1))
            needed[name] = off[first].name
    return needed


def _influential(study: Study, model: Model, own: Mapping[str, Any]) -> frozenset[str]:
    prepared: Prepared = study.prepared
    shared = (model, lay_out(model, prepared.profile, prepared.stored_rows), prepared.cutoff)
    leaves, structure = jax.tree.flatten((shared, dict(own)))
    shapes = tuple((np.shape(x), np.asarray(x).dtype) for x in leaves)
    return _influential_in(Keep(prepared.metrics, tuple(study.store)), structure, shapes)


@functools.lru_cache(maxsize=128)
def _influential_in(
    keep: Keep, structure: Any, shapes: tuple[tuple[tuple[int, ...], np.dtype], ...]
) -> frozenset[str]:  # fmt: skip
    """Return the names of a lane's own values that its results depend on, the same for all like sweeps."""
    shared, own = jax.tree.unflatten(structure, [np.zeros(*shape) for shape in shapes])
    model, stepped, cutoff = jax.tree.map(jnp.asarray, shared)

    def results(given: dict[str, jax.Array]) -> list[jax.Array]:
        outcome = run_lane(keep, model, stepped, cutoff, given)
        return jax.tree.leaves((outcome.values, outcome.columns))

    return frozenset(influential(results, own))


def warn_of_idle(study: Study) -> None:
    """Warn of each axis that changes no result, and say what would make it matter.

    Warns:
        Remark: for each.
    """
    kind = study.prepared.model.kind
    for name, effect in idle(study).items():
        where = f"axes.{name}" if name in study.axes else f"sample.ranges.{name}"
        advice = f"turn on {effect}, or remove it" if effect else "remove it"
        sentence = f"{where}: no metric and no stored column of this {kind} depends on it; {advice}."
        warnings.warn(sentence, Remark, stacklevel=3)
