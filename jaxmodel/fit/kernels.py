"""Predictions of a case as vector instructions of the processor: one kernel for runs and lanes of any number."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib.metadata
import platform
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from jaxmodel.base.errors import RemarkWarning
from jaxmodel.fit.problem import Lane, OneRun, Problem
from jaxmodel.lanes import ROWS, STEPS, Kernel, NotNative, Pool, over
from jaxmodel.lanes.kernel import Shared
from jaxmodel.model.simulation import Needed, read_track


def predicted(problem: Problem, lanes: Sequence[Lane], pool: Pool) -> list[list[np.ndarray]]:
    """Return the readings of each run by channel, each (rows, lanes).

    Args:
        problem: a case.
        lanes: arrays on the host.
        pool: of threads.

    Raises:
        NotNative: an effect has an operation without vector instructions.
    """
    # Sensors with a state of their own cost as much as the run: lanes that have none go without.
    switches = np.stack([lane.switches for lane in lanes])
    have = _dynamic_sensors(problem, switches)
    dynamic = np.any(have, axis=1)
    if dynamic.any() and not dynamic.all():
        parts = [
            predicted(problem, [lane for lane, chosen in zip(lanes, which, strict=True) if chosen], pool)
            for which in (dynamic, ~dynamic)
        ]
        order = np.argsort(np.concatenate([np.flatnonzero(dynamic), np.flatnonzero(~dynamic)]))
        return [
            [np.concatenate(both, axis=1)[:, order] for both in zip(*of_run, strict=True)]
            for of_run in zip(*parts, strict=True)
        ]
    ready = _ready(problem, lanes[0], tuple(bool(one) for one in np.any(have, axis=0)))
    unknowns = problem.unknowns_on_host
    numbers = unknowns.numbers(np.stack([lane.x for lane in lanes]))
    values: dict[str, Any] = {
        "numbers": numbers,
        "mixed": unknowns.mixed(numbers),
        "switches": switches,
        "laws": np.stack([lane.laws for lane in lanes]),
    }
    own = ready.kernel.own(values, len(lanes))
    jobs = [
        pool.start(ready.kernel, shared, own, len(lanes), 1, run.sizes)
        for run, shared in zip(problem.by_run, ready.shared, strict=True)
    ]
    return [job.raw() for job in jobs]


class _Ready(NamedTuple):
    """The kernel of a problem, and what all lanes share of each run."""

    kernel: Kernel
    shared: list[Shared]


def _ready(problem: Problem, lane: Lane, dynamic: tuple[bool, ...]) -> _Ready:
    """Return what each call with a problem needs, made once."""
    if dynamic not in problem.ready:
        kernel = kernel_of(problem, problem.by_run[0], lane)
        shared = [kernel.shared((*run.shared, np.array(dynamic))) for run in problem.by_run]
        problem.ready[dynamic] = _Ready(kernel, shared)
    return problem.ready[dynamic]


def _dynamic_sensors(problem: Problem, switches: np.ndarray) -> np.ndarray:
    """Return, for switches of lanes (lanes, switches), which sensors with a state each has, (lanes, sensors)."""
    dynamic = [effect for effect in problem.models.effects if effect.has_state]
    on = [
        np.ones(len(switches)) if one.switch is None else switches[:, problem.switched.index(one.label)]
        for one in dynamic
    ]
    return np.array(on, dtype=float).reshape(len(dynamic), len(switches)).T != 0.0


def kernel_of(problem: Problem, run: OneRun, lane: Lane) -> Kernel:
    """Return the kernel of a problem, the same for all that differ only in numbers and in lengths of runs.

    Raises:
        NotNative: there is none.
    """
    shared, own = _shapes(problem, run, lane)
    rest, of_rest = jax.tree.flatten(eqx.partition(dataclasses.replace(problem, shapes=()), eqx.is_array)[1])
    known_by = (of_rest, tuple(rest))

    def one_lane(shared: Any, own: dict[str, Any]) -> list[jax.Array]:
        model, track, of_run, dynamic = shared
        at = problem.model_at(model, of_run, own["numbers"], own["mixed"], own["switches"], own["laws"])
        readings = read_track(at, track, track.duration_s, Needed(None, dynamic))
        return [readings[name] for name in problem.channels]

    name = _name_of(problem, (jax.tree.structure((shared, own)), known_by, jax.tree.leaves((shared, own))))
    try:
        return over(Kernel, one_lane, shared, own, known_by, sizes=(STEPS, ROWS), known_as=name, alike=True)
    except NotNative as reason:
        _say_once(str(reason))
        raise


@functools.cache
def _say_once(reason: str) -> None:
    warnings.warn(
        f"The fits run through XLA, which takes longer: {reason} has no vector instructions yet.",
        RemarkWarning,
        stacklevel=3,
    )


def _name_of(problem: Problem, key: Any) -> str:
    """Return what identifies a kernel in other processes; "" with an effect of the user, whose source may change."""
    text = repr(key)
    of_project = are_of_project(map(type, problem.models.effects))
    return "" if not of_project or " at 0x" in text else f"{made_from()} {text}"


def are_of_project(classes: Iterable[type]) -> bool:
    """Return whether all classes are of this project."""
    return all(one.__module__.partition(".")[0] == "jaxmodel" for one in classes)


@functools.cache
def made_from() -> str:
    """Return a digest of what a kernel is made from beside its arguments: our source, JAX, the processor."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        digest.update(path.read_bytes())
    versions = [importlib.metadata.version(package) for package in ("jax", "jaxlib", "equinox", "numpy")]
    processor = [platform.machine(), np.show_config(mode="dicts")["SIMD Extensions"]]  # type: ignore[index, call-overload]
    digest.update(repr((versions, processor)).encode())
    return digest.hexdigest()


def _shapes(problem: Problem, run: OneRun, lane: Lane) -> Any:
    """Return the shapes of the kernel's arguments, with the lengths that stand for those of a run."""
    model, track, of_run = run.shared
    shape = jax.ShapeDtypeStruct

    def like(leaf: Any) -> Any:
        return shape(np.shape(leaf), np.asarray(leaf).dtype)

    lengths = (
        shape((STEPS,), np.dtype(float)),
        {name: shape((STEPS + 1,), values.dtype) for name, values in track.inputs.items()},
        shape((ROWS - 1,), track.last_step.dtype),
    )
    long = eqx.tree_at(lambda t: (t.duration_s, t.inputs, t.last_step), track, lengths)
    own: dict[str, Any] = {
        "numbers": shape((of_run.shape[0],), np.dtype(float)),
        "mixed": [shape((mix.shape[0],), np.dtype(float)) for mix in problem.unknowns.mixes],
        "switches": shape(np.shape(lane.switches), np.dtype(float)),
        "laws": shape(np.shape(lane.laws), np.dtype(float)),
    }
    sensors = sum(effect.has_state for effect in problem.models.effects)
    shared = (*jax.tree.map(like, (model,)), long, like(of_run), shape((sensors,), np.dtype(bool)))
    return shared, own
