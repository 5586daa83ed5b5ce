"""The vector of unknowns of a case: those of the base model, then those of all candidates."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Array

from jaxmodel.base.errors import FitError
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.case.specimens import difference_label, own_parameters, runs_of
from jaxmodel.effects.differences import DIFFERENCES
from jaxmodel.fit.candidates import Candidate
from jaxmodel.fit.coordinates import REACH_OF_A_RUN, Coordinate, known_coordinate
from jaxmodel.model.declaration import ParameterInfo, describe
from jaxmodel.model.parameters import info

# Sd of the initial cell temperature from the first reading, or from the ambient temperature if none is read (K,
# assumed).
FIRST_READING_K, AMBIENT_K = 0.5, 0.5
# Two thermometers differ by no more than this (K, assumed); a cell that seems warmer than its surroundings is.
THERMOMETERS_DIFFER_K = 2.0
# Sd of a cell's initial hysteresis, which may be anything between the branches, relative to the loop.
HYSTERESIS = 0.5


@dataclasses.dataclass(frozen=True)
class Layout:
    """The order of the vector of unknowns.

    Attributes:
        coordinates: one for each unknown.
        runs: for each unknown its run, or -1 for all runs.
        fixed_in: for each unknown the runs that it does not act in: they state an exact value of their own, or are of
            another specimen.
        owners: for each unknown the run or specimen that it is of, "" for none.
        base: number of unknowns of the base model; those of candidates follow.
        of: indices of each candidate's unknowns, by label.
        vectors: unknowns that form one vector of the model: (name, first, one past the last, mix).
    """

    coordinates: tuple[Coordinate, ...]
    runs: tuple[int, ...]
    fixed_in: tuple[tuple[int, ...], ...]
    owners: tuple[str, ...]
    base: int
    of: dict[str, tuple[int, ...]]
    vectors: tuple[tuple[str, int, int, np.ndarray], ...]

    @property
    def size(self) -> int:
        """Return the number of unknowns."""
        return len(self.coordinates)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the unknowns."""
        return tuple(coordinate.name for coordinate in self.coordinates)

    def name_of(self, place: int) -> str:
        """Return the name of an unknown, with the run or specimen that it is of in brackets."""
        owner = self.owners[place]
        return self.names[place] + (f"[{owner}]" if owner else "")

    @property
    def targets(self) -> tuple[tuple[str, tuple[int, ...]], ...]:
        """Return the parameters of the model and the indices of their unknowns, without vectors."""
        inside = {place for _, first, last, _ in self.vectors for place in range(first, last)}
        found: dict[str, list[int]] = {}
        for place, name in enumerate(self.names):
            if place not in inside:
                found.setdefault(name, []).append(place)
        return tuple((name, tuple(places)) for name, places in found.items())

    def places_of(self, labels: Sequence[str]) -> list[int]:
        """Return the indices of the base model's unknowns and of some candidates'."""
        return [*range(self.base), *(place for label in labels for place in self.of[label])]

    def of_runs(self, count: int) -> Array:
        """Return which unknowns apply to which runs, shape (runs, unknowns)."""
        places = list(zip(self.runs, self.fixed_in, strict=True))
        return jax.device_put(
            np.array([[(own < 0 and i not in fixed) or own == i for own, fixed in places] for i in range(count)])
        )


def make_layout(case: Case, candidates: Sequence[Candidate]) -> Layout:
    """Lay out the unknowns: parameters of the case, of runs, initial states, then those of candidates.

    Raises:
        FitError: the case declares nothing uncertain.
    """
    coordinates, runs, fixed_in, owners = [], [], [], []

    def add(
        name: str, known: Known, about: ParameterInfo, run: int = -1, fixed: tuple[int, ...] = (), specimen: str = ""
    ) -> None:
        assert known.sd is not None
        coordinate = known_coordinate(name, known.value, known.sd, about, run)
        if name == "initial_soc" and "ocv" in case.tables:
            coordinate = _within(coordinate, known, case.tables["ocv"].soc)
        coordinates.append(coordinate)
        runs.append(run)
        fixed_in.append(fixed)
        owners.append(case.runs[run].name if run >= 0 else specimen)

    def exact_in(name: str) -> set[int]:
        return {i for i, r in enumerate(case.runs) if name in r.overrides and r.overrides[name].sd is None}

    for name, known in case.parameters.items():
        if known.sd is not None:
            fixed = exact_in(name) | {i for i, r in enumerate(case.runs) if name in own_parameters(case, r)}
            add(name, known, info(name), -1, tuple(sorted(fixed)))
    for specimen, own in case.specimens.items():
        others = set(range(len(case.runs))) - set(runs_of(case, specimen))
        for name, known in own.parameters.items():
            if known.sd is not None:
                add(name, known, info(name), -1, tuple(sorted(others | exact_in(name))), specimen)
        for name, sds in own.effect_sd.items():
            label = difference_label(name, own.effects[name])
            for field, sd in sds.items():
                known = Known(float(own.effects[name][field]), sd)
                add(f"{label}.{field}", known, describe(DIFFERENCES[name])[field], -1, tuple(sorted(others)), specimen)
    for name, sds in case.effect_sd.items():
        table, column = describe(case.catalogue[name]), case.effects[name].get("column", "")
        for field, sd in sds.items():
            label = f"{name}:{column}" if column else name
            add(f"{label}.{field}", Known(float(case.effects[name][field]), sd), table[field])
    for number, run in enumerate(case.runs):
        own = dict(run.overrides) | ({"initial_soc": run.initial_soc} if case.kind != "motor" else {})
        for name, known in own.items():
            if known.sd is not None:
                add(name, known, info(name), number)
    if not coordinates:
        example = (
            "R_0 = { value = 0.1, sd = 0.05 }" if case.kind == "motor" else "capacity_Ah = { value = 5.2, sd = 0.15 }"
        )
        raise FitError(
            f"{case.label}: nothing to calibrate; give at least one parameter an uncertainty, as in {example}."
        )
    for number, run in enumerate(case.runs):
        for name, known in _starts(case, number).items():
            if name not in run.overrides:
                add(name, known, info(name), number)
    base = len(coordinates)
    of: dict[str, tuple[int, ...]] = {}
    vectors: dict[str, tuple[str, int, int, np.ndarray]] = {}
    for candidate in candidates:
        vector = f"{candidate.effect.label}.values"
        if candidate.is_vector and vector in vectors:
            _, first, _, _ = vectors[vector]
        else:
            first = len(coordinates)
            coordinates.extend(candidate.unknowns)
            runs.extend([candidate.run] * len(candidate.unknowns))
            fixed_in.extend([candidate.absent] * len(candidate.unknowns))
            owner = candidate.specimen or (case.runs[candidate.run].name if candidate.run >= 0 else "")
            owners.extend([owner] * len(candidate.unknowns))
            if candidate.is_vector:
                vectors[vector] = (vector, first, len(coordinates), candidate.mix)
        first += candidate.offset
        of[candidate.label] = tuple(range(first, first + len(candidate.coordinates)))
    return Layout(
        tuple(coordinates), tuple(runs), tuple(fixed_in), tuple(owners), base, of, tuple(vectors.values())
    )  # fmt: skip


def _within(coordinate: Coordinate, known: Known, soc: np.ndarray) -> Coordinate:
    """Return the coordinate of an initial state of charge, which stays within those of a table (soc,)."""
    assert known.sd is not None
    top, bottom = max(float(soc[-1]), known.value), min(float(soc[0]), known.value)
    coordinate = dataclasses.replace(coordinate, above=REACH_OF_A_RUN, below=REACH_OF_A_RUN)
    if known.value + 4.0 * known.sd > top:
        return dataclasses.replace(coordinate, ceiling=top)
    if known.value - 4.0 * known.sd < bottom:
        return dataclasses.replace(coordinate, ceiling=bottom, is_floor=True)
    return coordinate


def _starts(case: Case, number: int) -> dict[str, Known]:
    """Return the initial states that are always uncertain: temperature and hysteresis of a cell.

    The temperature is the stated one, else the ambient temperature of a cell that was at rest. Else it is the first
    reading, and that of a check run, whose thermometer is not on trial: it may be off by as much as it differs.
    """
    if case.kind == "motor":
        return {}
    run = case.runs[number]
    stated, off = run.initial_cell_temperature, _above_ambient(run)
    if stated is not None:
        rise = Known(stated.value - float(run.measured.inputs["ambient_degC"][0]), stated.sd)
    elif run.split == "check":
        rise = Known(off, float(np.clip(abs(off), FIRST_READING_K, THERMOMETERS_DIFFER_K)))
    else:
        rise = Known(0.0, AMBIENT_K) if was_at_rest(case, run) else Known(off, FIRST_READING_K)
    found = {"initial_hysteresis": Known(0.0, HYSTERESIS)}
    return found | ({"initial_temperature_rise_K": rise} if rise.sd is not None else {})


def was_at_rest(case: Case, run: Run) -> bool:
    """Return True if a cell may be as warm as its surroundings when a run begins.

    Its first reading differs from the ambient temperature by no more than two thermometers may, or by what it does in
    most runs: were that reading its temperature, a thermometer that is off would have a prior on its side in every run.
    """
    off, usual = _above_ambient(run), float(np.median([_above_ambient(one) for one in case.runs]))
    as_usual = abs(usual) <= THERMOMETERS_DIFFER_K and abs(off - usual) <= FIRST_READING_K
    return abs(off) <= THERMOMETERS_DIFFER_K or as_usual


def _above_ambient(run: Run) -> float:
    """Return the first reading of a cell's temperature less the ambient temperature, in K; 0 if there is none."""
    read = run.measured.outputs.get("cell_temperature_degC", np.zeros(0))[:1]
    first = read[np.isfinite(read)]
    return float(first[0] - run.measured.inputs["ambient_degC"][0]) if first.size else 0.0
