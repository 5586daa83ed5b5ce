"""What one screening of a case says, kept: all that the baselines, the ablations and the curves of power need."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.hidden import Blind
from benchmarks.discrepancy.ranges import PLACES
from discrepancy.candidates import Candidate
from discrepancy.conditions import conditions
from discrepancy.lanes import one_thread_of_blas
from discrepancy.projection import Block, Projection
from discrepancy.screen import Screen
from discrepancy.session import Session
from jaxmodel.cases import Case
from jaxmodel.declaration import describe

# The low end of a range that spans the null, as a share of its high end; the diagnosis takes the same for `blind_to`.
LEAST_SHARE = 0.2


@dataclasses.dataclass(frozen=True)
class Evidence:
    """One case at its calibrated base model.

    The n rows are the fit readings, channel by channel, run by run, in order of time. Sensitivities are those of the
    prediction, whitened as the residual.

    Attributes:
        residual: (n + p,) whitened residual, prior rows appended.
        base: (n + p, p) whitened sensitivities to the p calibrated unknowns.
        effects: (n + p, k) whitened sensitivities to each candidate at each shape that was tried.
        names: (k,) label of each column's candidate.
        signs: (k,) 1 where physics allows one sign of the amplitude alone, else 0.
        channel: (n,) number of each row's channel.
        run: (n,) number of each row's run.
        weight: (n,) correlation of each row's noise with that of the row before; 0 at the first of a run.
        conditions: by name, (n,) inputs and states of the model at each row.
    """

    residual: np.ndarray
    base: np.ndarray
    effects: np.ndarray
    names: np.ndarray
    signs: np.ndarray
    channel: np.ndarray
    run: np.ndarray
    weight: np.ndarray
    conditions: dict[str, np.ndarray]

    @property
    def rows(self) -> int:
        """Number of readings."""
        return self.weight.size

    def coloured(self) -> Evidence:
        """Return the same with the whitening undone: errors in units of their noise's sd, as correlated as they are."""

        def undone(columns: np.ndarray) -> np.ndarray:
            before = columns.copy()
            size = np.sqrt(1.0 - self.weight**2)
            for row in range(self.rows):
                before[row] *= size[row]
                if self.weight[row]:
                    before[row] += self.weight[row] * before[row - 1]
            return before

        if not self.weight.any():
            return self
        changed = {name: undone(getattr(self, name)) for name in ("residual", "base", "effects")}
        return dataclasses.replace(self, **changed, weight=np.zeros_like(self.weight))

    def write(self, path: Path) -> None:
        """Write the arrays; sensitivities in single precision, which is finer than the differences they are."""
        parts = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        given = parts.pop("conditions")
        parts |= {name: parts[name].astype(np.float32) for name in ("base", "effects")}
        np.savez(path, **parts, **{f"conditions.{name}": values for name, values in given.items()})


def read_evidence(path: Path) -> Evidence:
    """Return what was written."""
    with np.load(path) as file:
        given = {name.partition(".")[2]: file[name] for name in file.files if name.startswith("conditions.")}
        parts = {name: file[name] for name in file.files if not name.startswith("conditions.")}
    parts |= {name: parts[name].astype(float) for name in ("base", "effects")}
    return Evidence(**parts, conditions=given)


@one_thread_of_blas
def gather(case: Case, blind: Blind) -> tuple[Evidence, dict[str, Any]]:
    """Screen a case once.

    Returns:
        The arrays, and as JSON: the critical value, each candidate's score, how far it would lift above the noise at
        `PLACES` of its usual range, and the same for each hidden effect at its true amplitude, beside any other.
    """
    session = Session(case)
    base = session.hypothesis()
    screen = session.screen(base)
    problem = base.problem
    counted = np.asarray(problem.readings.fit) > 0.0
    index = np.asarray(problem.readings.index)[counted]
    runs, _, channels = np.unravel_index(index, (*problem.times.shape, len(problem.channels)))
    blocks = screen.table.projection.blocks
    evidence = Evidence(
        residual=screen.residual,
        base=screen.base,
        effects=np.stack([_whole(screen.table.projection, block) for block in blocks], axis=1),
        names=np.array([block.candidate for block in blocks]),
        signs=np.array([float(session.candidates[block.candidate].one_sided) for block in blocks]),
        channel=channels,
        run=runs,
        weight=np.asarray(problem.readings.weight)[counted],
        conditions=conditions(session, base),
    )
    return evidence, _summary(session, screen, blind)


def _whole(projection: Projection, block: Block) -> np.ndarray:
    """Return the sensitivity that a block was projected from; of one absorbed by the base, the part in the base."""
    inside = projection.base.q @ block.in_base[:, 0]
    return inside + (block.u @ block.triangle)[:, 0] * block.scale[0] if block.dof else inside


def _summary(session: Session, screen: Screen, blind: Blind) -> dict[str, Any]:
    table = screen.table
    lifts = {}
    for label, probes in screen.probes.items():
        shapes = [block for block in table.projection.blocks if block.candidate == label]
        ratios = [_ratios(session.candidates[label], probe[0]) for probe in probes]
        sigmas = [[block.projected_length(ratio) for ratio in own] for block, own in zip(shapes, ratios, strict=True)]
        lifts[label] = np.median(sigmas, axis=0).tolist()
    return {
        "critical_z": table.critical_z,
        "scores": {effect.name: effect.z_equivalent for effect in table.effects},
        "sensor": [label for label in screen.probes if session.candidates[label].is_sensor],
        "lifts": lifts,
        "hidden": {name: stands_out(session, screen, name, blind.effects) for name in blind.effects},
    }


def _ratios(candidate: Candidate, probe: float) -> np.ndarray:
    """Return the amplitude at `PLACES` of the usual range, in units of a probe's."""
    first = candidate.coordinates[0]
    if not first.logarithmic:
        return candidate.times_as_strong(LEAST_SHARE + (1.0 - LEAST_SHARE) * PLACES, abs(probe))
    up = -1.0 if candidate.null_at_infinity else 1.0
    return candidate.times_as_strong(up * (2.0 * PLACES - 1.0), probe)


def stands_out(session: Session, screen: Screen, name: str, effects: Mapping[str, Mapping[str, Any]]) -> float | None:
    """Return by how many sigma a hidden effect stands out, in the linear model, at the shape nearest to its own.

    Out of what the base model makes of it, calibrated with all else that is hidden: of two effects that can stand in
    for each other neither stands out. None where it, or what else is hidden, cannot be tried on this case.

    Args:
        session: of the case.
        screen: of its base model.
        name: of the effect.
        effects: all that are hidden, with their parameters.
    """
    labels = {hidden: f"{hidden}:{own['column']}" if "column" in own else hidden for hidden, own in effects.items()}
    label, others = labels[name], [other for hidden, other in labels.items() if hidden != name]
    if not set(labels.values()) <= set(screen.probes):
        return None
    if others:
        starts = {other: session.starts(screen, other)[0][other] for other in others}
        screen = session.screen(session.hypothesis(others, [starts]))
    if label not in screen.probes:
        return None
    candidate, values = session.candidates[label], effects[name]
    true = [
        coordinate.at(values[parameter]) if parameter in values else 0.0
        for coordinate, parameter in zip(candidate.coordinates, describe(candidate.effect), strict=True)
    ]
    shapes = [block for block in screen.table.projection.blocks if block.candidate == label]
    scaled = candidate.has_amplitude and not candidate.amplitude_on_grid
    apart = [np.linalg.norm(np.subtract(probe, true)[int(scaled) :]) for probe in screen.probes[label]]
    nearest = int(np.argmin(apart))
    times = candidate.times_as_strong(np.array([true[0]]), screen.probes[label][nearest][0])
    return shapes[nearest].projected_length(float(abs(times[0])))


def save(folder: Path, case: Case, blind: Blind) -> None:
    """Screen a case and keep what was found in its folder."""
    evidence, summary = gather(case, blind)
    evidence.write(folder / "evidence.npz")
    (folder / "evidence.json").write_text(json.dumps(summary))
