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

from jaxmodel.base.errors import RemarkWarning
from jaxmodel.effects import CATALOGUE
from jaxmodel.lanes.influence import influential
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import TABLE
from jaxmodel.model.profile import Profile
from jaxmodel.sweeps.lane import Keep, lay_out, run_lane
from jaxmodel.sweeps.metrics import metrics_of, metrics_on_request
from jaxmodel.sweeps.study import Study

# An input in place of another through which more numbers of the model act, by kind; and inputs of each kind through
# which all of its numbers act.
_INSTEAD = {"motor": ("current_A", "voltage_V"), "robot": ("load_torque_Nm", "incline_deg")}
_ALL_ACT = {
    "cell": ("ambient_degC", "current_A"),
    "motor": ("ambient_degC", "voltage_V", "load_torque_Nm"),
    "robot": ("ambient_degC", "duty", "incline_deg"),
}


def idle(study: Study) -> dict[str, str]:
    """Return what lanes differ in and no metric or stored column can depend on.

    It is read off the traced program: no lane is run.

    Args:
        study: to be run.

    Returns:
        By the name of an axis, of a range or of a scale: what makes results depend on it, as "turn on self_heating";
        "" where nothing of this kind and no other kind does it.
    """
    own = {name: values[0] for name, values in study.lanes(np.zeros(1, dtype=int)).items()}
    model = study.prepared.model
    keep = Keep(study.prepared.metrics, tuple(study.store))
    found = sorted(set(own) - _influential(study, keep, model, study.prepared.profile, own))
    return {name: _what_lets_act(study, name, own) for name in found}


def acting(study: Study) -> frozenset[str]:
    """Return the axes, ranges and scales of a study on which a metric or a stored column depends; no lane is run."""
    own = {name: values[0] for name, values in study.lanes(np.zeros(1, dtype=int)).items()}
    keep = Keep(study.prepared.metrics, tuple(study.store))
    return _influential(study, keep, study.prepared.model, study.prepared.profile, own)


def _what_lets_act(study: Study, name: str, own: Mapping[str, Any]) -> str:
    """Return in words what would make results depend on a name: a metric, an input, an effect or another kind."""
    model, profile = study.prepared.model, study.prepared.profile
    keep = Keep(study.prepared.metrics, tuple(study.store))
    every = metrics_of(model.kind) | metrics_on_request(model.kind)
    every.pop("time_to_cutoff_s", None)
    if name in _influential(study, Keep(tuple(every.values())), model, profile, own):
        metrics = [m for m in every.values() if name in _influential(study, Keep((m,)), model, profile, own)]
        return f"add {metrics[0].name} to the metrics"
    one, other = _INSTEAD.get(model.kind, ("", ""))
    if one in profile.inputs:
        inputs = {other if column == one else column: values for column, values in profile.inputs.items()}
        changed = Profile(profile.time_s, inputs)
        if name in _influential(study, keep, model, changed, {n: v for n, v in own.items() if n != one}):
            return f"state {other} instead of {one}"
    if effect := _effect(study, name, own):
        return f"turn on {effect}"
    if kinds := [kind for kind in _ALL_ACT if kind != model.kind and _acts_in(kind, name)]:
        return "set kind = " + " or ".join(f'"{kind}"' for kind in kinds)
    return ""


def _effect(study: Study, name: str, own: Mapping[str, Any]) -> str:
    """Return the first effect of the catalogue with which results depend on a name; "" if there is none."""
    model, profile = study.prepared.model, study.prepared.profile
    keep = Keep(study.prepared.metrics, tuple(study.store))
    on = {effect.name for effect in model.effects}
    off = [cls for n, cls in CATALOGUE.items() if n not in on and model.kind in cls.kinds and not cls.is_sensor]

    def with_first(count: int) -> frozenset[str]:
        effects = (*model.effects, *(cls() for cls in off[:count]))
        return _influential(study, keep, dataclasses.replace(model, effects=effects), profile, own)

    if name not in with_first(len(off)):
        return ""
    return off[bisect.bisect_left(range(len(off)), 1, key=lambda n: name in with_first(n + 1))].name


@functools.cache
def _acts_in(kind: str, name: str) -> bool:
    """Return whether a parameter acts on any metric of a kind."""
    if name not in TABLE:
        return False
    model, metrics = Model(kind), tuple(m for n, m in metrics_of(kind).items() if n != "time_to_cutoff_s")
    profile = Profile(np.arange(3.0), {column: np.zeros(3) for column in _ALL_ACT[kind]})
    return name in _influential(None, Keep(metrics), model, profile, {name: TABLE[name].default})


def _influential(
    study: Study | None, keep: Keep, model: Model, profile: Profile, own: Mapping[str, Any]
) -> frozenset[str]:  # fmt: skip
    """Return the names of a lane's own values that what is kept of it depends on."""
    rows = np.arange(profile.time_s.size) if study is None else study.prepared.stored_rows
    shared = (model, lay_out(model, profile, rows), None if study is None else study.prepared.cutoff)
    leaves, structure = jax.tree.flatten((shared, dict(own)))
    shapes = tuple((np.shape(x), np.asarray(x).dtype) for x in leaves)
    return _influential_in(keep, structure, shapes)


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
        RemarkWarning: for each.
    """
    kind = study.prepared.model.kind
    for name, act in idle(study).items():
        where = f"axes.{name}" if name in study.axes else f"sample.ranges.{name}"
        advice = f"{act}, or remove it" if act else "remove it"
        sentence = f"{where}: no metric and no stored column of this {kind} depends on it; {advice}."
        warnings.warn(sentence, RemarkWarning, stacklevel=3)
