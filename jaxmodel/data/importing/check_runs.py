"""Which runs are held out: one condition between others, one direction or one repetition; never the last of its kind.

The parameters need each kind of run: a motor's friction a ramp, its inertia a step, a cell's capacity a discharge at
constant current, its relaxation pulses. So of each kind at least one run stays to be fitted.
"""

from __future__ import annotations

import dataclasses
import fnmatch
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from jaxmodel.base.errors import MeasurementError, listed, nearest
from jaxmodel.case.specimens import together
from jaxmodel.data.importing.conditions import Condition
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log

# Ambient temperatures within so much [K] are one condition, and loads within this factor. Assumed.
_SAME_K, _SAME_RATE = 4.0, 1.25
_OF_ONE_LOAD = ("constant current", "constant voltage", "pulses")
# From so many ages on, of a cell that ages, one of so many is held out, neither the first nor the last. Assumed.
_FEWEST_AGES, _OF_AGES = 4, 4
_LISTED = 6  # runs that a decision names
_CELL_WAYS = ("discharge", "charge")


@dataclasses.dataclass(frozen=True)
class _Proposal:
    """Numbers of runs that may be held out, why, and what the fit lacks without them."""

    held: list[int]
    why: str
    cost: str = ""


def splits_of(
    runs: Sequence[Log], conditions: Sequence[Condition], stated: Sequence[str] | None
) -> tuple[list[str], list[Finding | Decision]]:  # fmt: skip
    """Return "fit" or "check" for each run, and why.

    Args:
        runs: in their order.
        conditions: of each.
        stated: names of the check runs, if the user states them; a pattern such as `*_n20degC` names several.

    Raises:
        MeasurementError: a name is of no run, or no run would be left to fit.
    """
    names = [run.name for run in runs]
    if stated is not None:
        check = _named(names, stated)
        splits = ["check" if name in check else "fit" for name in names]
        return splits, [Decision("check runs", "", listed(sorted(check), _LISTED) or "none", "stated", "user")]
    if len(runs) < 2:
        sentence = (
            "There is only one run, so none is held out; give a second file, or --split-at rests, for a check run."
        )
        return ["fit"] * len(runs), [Finding("no check run", "", sentence, "warning")]
    chosen = next((one for one in _proposals(conditions) if _leaves_each_kind(conditions, one.held)), None)
    if chosen is None:
        profiles = ", ".join(dict.fromkeys(condition.profile for condition in conditions))
        sentence = (
            f"Each run is the only one of its kind ({profiles}), and the parameters need all of them, so none is held "
            "out: repeat one of them, or name one with --check; the fit then lacks what only that run shows."
        )
        return ["fit"] * len(runs), [Finding("no check run", "", sentence, "warning")]
    splits = ["check" if number in chosen.held else "fit" for number in range(len(runs))]
    cost = f"; {chosen.cost}" if chosen.cost else ""
    why = f"{chosen.why}{cost}; hold out another with --check"
    found: list[Finding | Decision] = [
        Decision("check runs", "", listed([names[n] for n in chosen.held], _LISTED), why, "assumed")
    ]
    if len(set(_kinds(conditions))) == 1:
        sentence = (
            "All runs were measured under one condition; the last one is held out, which shows less "
            "than another condition would."
        )
        found.append(Finding("no check condition", "", sentence, "warning"))
    return splits, found


def splits_of_motors(
    runs: Sequence[Log], conditions: Sequence[Condition], stated: Sequence[str] | None
) -> tuple[list[str], list[Finding | Decision]]:
    """Return "fit" or "check" for each run, and why, where several motors were logged together.

    What was logged together is held out together: the same ride of another motor is no other condition.

    Args:
        runs: as `splits_of`, with their specimens.
        conditions: of each.
        stated: names of check runs, with their motor or without it for all of them.

    Raises:
        MeasurementError: as `splits_of`, or a motor would have no run to fit.
    """
    if not any(run.specimen for run in runs):
        return splits_of(runs, conditions, stated)
    rides = [together(run.name, run.specimen) for run in runs]
    if stated is None:
        first = [rides.index(ride) for ride in dict.fromkeys(rides)]
        once = [dataclasses.replace(runs[number], name=rides[number]) for number in first]
        if len(once) == 1:
            sentence = "All runs were logged together, so none is held out; give a second file for a check run."
            return ["fit"] * len(runs), [Finding("no check run", "", sentence, "warning")]
        of_rides, found = splits_of(once, [conditions[number] for number in first], None)
        by_ride = dict(zip(dict.fromkeys(rides), of_rides, strict=True))
        splits = [by_ride[ride] for ride in rides]
    else:
        wanted: list[str] = []
        for pattern in stated:
            plain = pattern.removesuffix(".csv")
            of_ride = [r.name for r, ride in zip(runs, rides, strict=True) if fnmatch.fnmatchcase(ride, plain)]
            wanted += of_ride or [pattern]
        splits, found = splits_of(runs, conditions, wanted)
    return _each_is_fitted(runs, splits, found, stated is not None)


def _each_is_fitted(
    runs: Sequence[Log], splits: list[str], found: list[Finding | Decision], stated: bool
) -> tuple[list[str], list[Finding | Decision]]:
    """Return splits in which each motor has a run to fit: one alone of its motor is not held out.

    Raises:
        MeasurementError: the user holds it out.
    """
    for motor in dict.fromkeys(run.specimen for run in runs):
        mine = [number for number, run in enumerate(runs) if run.specimen == motor]
        if any(splits[number] == "fit" for number in mine):
            continue
        if stated:
            raise MeasurementError(f"check: every run of {motor} would be held out, and none left to fit; name fewer.")
        splits = ["fit" if number in mine else split for number, split in enumerate(splits)]
        sentence = f"Each run of {motor} would be held out, so all of them are fitted; repeat one for a check run."
        found = [*found, Finding("no check run", "", sentence, "warning")]
    return splits, found


def _proposals(conditions: Sequence[Condition]) -> Iterator[_Proposal]:
    """Yield what may be held out, the best first: what lies between others is what a model is asked for first."""
    aged = sorted((one.cycles, number) for number, one in enumerate(conditions) if one.cycles is not None)
    if len(aged) >= _FEWEST_AGES:
        yield _Proposal(sorted(number for _, number in aged[2:-1:_OF_AGES]), "ages between others")
    warmth, loads = _by_warmth(conditions), list(_by_load(conditions))
    yield from _between("ambient temperature [degC]", warmth)
    for profile, levels in loads:
        yield from _between(profile, levels)
    ways = {way: [n for n, one in enumerate(conditions) if one.direction == way] for way in ("reverse", "forward")}
    if all(ways.values()):
        way = min(ways, key=lambda one: len(ways[one]))
        cost = "a friction that differs between the directions is not fitted"
        yield _Proposal(ways[way], f"all of one direction ({way})", cost)
    cycles = [n for n, one in enumerate(conditions) if one.profile == "dynamic"]
    if _of_a_cell(conditions) and any(one.profile == "pulses" for one in conditions):
        yield _Proposal(cycles, "all of profile dynamic, which the pulses are to predict")
    kinds = _kinds(conditions)
    alike = {kind: [n for n, other in enumerate(kinds) if other == kind] for kind in kinds}
    last = sorted(group[-1] for group in alike.values() if len(group) > 1)
    yield _Proposal(last, f"the last of {'runs' if len(last) == 1 else 'each group of runs'} under one condition")
    if len(warmth) == 2:
        cost = "how the parameters change with temperature is not fitted"
        yield _one_of_two("ambient temperature [degC]", warmth, cost)
    for profile, levels in loads:
        if len(levels) == 2:
            yield _one_of_two(profile, levels, f"the fit has one {profile} only")
    # A slow charge stays: half of its distance from the slow discharge is the hysteresis.
    charges = [n for n, one in enumerate(conditions) if one.direction == "charge" and not one.slow]
    yield _Proposal(charges, "all charges", "what differs between charge and discharge is not fitted")


def _leaves_each_kind(conditions: Sequence[Condition], held: Sequence[int]) -> bool:
    """Return whether of every profile that is held out a run is left to fit; a cell's pulses stand in for a cycle."""
    left = {condition.profile for number, condition in enumerate(conditions) if number not in held}
    if _of_a_cell(conditions) and "pulses" in left:
        left.add("dynamic")
    return bool(held) and bool(left) and {conditions[number].profile for number in held} <= left


def _of_a_cell(conditions: Sequence[Condition]) -> bool:
    return all(condition.direction in ("", *_CELL_WAYS) for condition in conditions) and any(
        condition.unit == "A" and condition.profile != "rest" for condition in conditions
    )


def _between(what: str, levels: dict[float, list[int]]) -> Iterator[_Proposal]:
    """Yield the levels between the lowest and the highest, those of fewest runs first; one run of a level of most."""
    count = sum(map(len, levels.values()))
    for level in sorted(sorted(levels)[1:-1], key=lambda level: len(levels[level])):
        held = levels[level]
        if 2 * len(held) > count:
            yield _Proposal([held[len(held) // 2]], f"one of {what} about {level:.3g}, which lies between others")
        else:
            yield _Proposal(held, f"all of {what} {level:.3g}, which lies between others")


def _one_of_two(what: str, levels: dict[float, list[int]], cost: str) -> _Proposal:
    level = min(sorted(levels, reverse=True), key=lambda level: len(levels[level]))
    return _Proposal(levels[level], f"all of {what} {level:.3g}, one of two", cost)


def _kinds(conditions: Sequence[Condition]) -> list[tuple[object, ...]]:
    """Return of each run what it has in common with its repetitions: temperature, profile, load, direction and age."""
    warmth = {n: level for level, group in _by_warmth(conditions).items() for n in group}
    loads = {n: level for _, levels in _by_load(conditions) for level, group in levels.items() for n in group}
    return [(warmth.get(n), one.profile, loads.get(n), one.direction, one.cycles) for n, one in enumerate(conditions)]


def _by_warmth(conditions: Sequence[Condition]) -> dict[float, list[int]]:
    """Return the numbers of the runs by ambient temperature; none where it is not known of each steady run."""
    steady = [number for number, condition in enumerate(conditions) if not condition.changing]
    known = [value for n in steady if (value := conditions[n].ambient_degC) is not None]
    return {} if len(known) < len(steady) else _clusters(steady, known, lambda a, b: b - a > _SAME_K)


def _by_load(conditions: Sequence[Condition]) -> Iterator[tuple[str, dict[float, list[int]]]]:
    """Yield the numbers of the runs by load, of each profile that has one load, with its unit."""
    for profile in _OF_ONE_LOAD:
        numbers = [number for number, condition in enumerate(conditions) if condition.profile == profile]
        rates = [conditions[number].rate for number in numbers]
        unit = f" [{conditions[numbers[0]].unit}]" if numbers else ""
        yield f"{profile}{unit}", _clusters(numbers, rates, lambda a, b: b > _SAME_RATE * max(a, 1e-12))


def _clusters(
    numbers: Sequence[int], values: Sequence[float], apart: Callable[[float, float], bool]
) -> dict[float, list[int]]:
    """Return the numbers by level of their values: a new level begins where the next value is apart."""
    order = sorted(range(len(values)), key=lambda place: values[place])
    groups: list[list[int]] = []
    for place in order:
        if not groups or apart(values[groups[-1][0]], values[place]):
            groups.append([])
        groups[-1].append(place)
    return {float(np.median([values[n] for n in group])): sorted(numbers[n] for n in group) for group in groups}


def _named(names: Sequence[str], stated: Sequence[str]) -> set[str]:
    check: set[str] = set()
    for pattern in stated:
        plain = pattern.removesuffix(".csv")
        found = [name for name in names if fnmatch.fnmatchcase(name, plain)]
        if not found:
            hint = nearest(plain, names) or f" The runs are {', '.join(names[:20])}."
            if len(parts := plain.replace(",", " ").split()) > 1 and all(part in names for part in parts):
                hint = f" Give each run an option of its own, as --check {parts[0]} --check {parts[1]}."
            raise MeasurementError(f"check: no run is called '{pattern}'.{hint}")
        check.update(found)
    if len(check) == len(names):
        raise MeasurementError("check: every run would be held out, and none left to fit; name fewer.")
    return check
