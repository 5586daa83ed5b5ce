"""Whether a planted fault is told where it belongs, and what else changed against the case without it.

- *told*: named, in `effects`, `runs` or a remark, as one of the ways in which it may be told, with a size within the
  stated factor of the planted one. The size may be that above the plain case's, where the data had such a fault
  before.
- *possible*: named with another size, told as possible (`immaterial`, beside another name, or a hypothesis), or by a
  way that points to the run alone, if nothing is said of that run in the plain case.
- *missed*: neither.
- *lost*: named in the plain case and no longer, unless it is said of a name that it cannot be told apart from it.
- *new*: named now and not in the plain case, unless it tells the fault or an expert expects it of this case.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

from benchmarks.planted.plantings import Planting, Telling

# A hypothesis less probable than this is not told as possible; the same as for a rival of a diagnosis.
LEAST_PROBABLE = 0.05
# How an answer calls the shifts that it does not call by their label.
SHIFT_NAMES = {"series_resistance_ohm": "contact_resistance", "friction_torque_Nm": "friction_shift"}


@dataclasses.dataclass(frozen=True)
class Judgement:
    """What a diagnosis said of a planted fault.

    Attributes:
        verdict: "told", "possible", "missed", or "failed" where there is no answer.
        how: what was said, in words.
        size: of what was told; None where nothing was, or no size belongs to it.
        lost: labels of what was named without the fault, and is not with it.
        new: labels of what is named besides, and is not the fault.
    """

    verdict: str
    how: str
    size: float | None = None
    lost: tuple[str, ...] = ()
    new: tuple[str, ...] = ()


def named(answer: dict[str, Any]) -> dict[str, dict[str, float]]:
    """Return what an answer names, by label ('effect:column', 'shift@run'), with the numbers of each."""
    found: dict[str, dict[str, float]] = {}
    for effect in answer.get("effects", ()):
        numbers = {name: _finite(one["value"]) for name, one in effect["parameters"].items() if isinstance(one, dict)}
        column = effect["parameters"].get("column", "")
        found[f"{effect['name']}:{column}" if column else effect["name"]] = numbers
    for run in answer.get("runs", ()):
        shift = SHIFT_NAMES.get(run["parameter"], run["parameter"])
        # A shift has one number, whatever an effect calls it.
        found[f"{shift}@{PurePath(run['file']).stem}"] = {"": _finite(run["value"])}
    return found


def possible_names(answer: dict[str, Any]) -> set[str]:
    """Return the names, without columns, of what an answer says may be there without naming it."""
    found = {one["name"] for one in answer.get("immaterial", ())} | _beside(answer)
    for one in answer.get("candidates", ()):
        if (one["probability"] or 0.0) >= LEAST_PROBABLE:
            found |= set(one["name"].split("+"))
    return found - {"base", "something_else"}


def judge(
    planting: Planting, amount: float, plain: dict[str, Any], planted: dict[str, Any], expects: Sequence[str] = ()
) -> Judgement:
    """Judge the answer on a case with a planted fault beside that on the plain case.

    Args:
        planting: the fault.
        amount: its size, in its unit.
        plain: the answer without it.
        planted: the answer with it.
        expects: effects that an expert expects of this case; `a|b` is either.
    """
    before, after = named(plain), named(planted)
    accepted = {label for one in (*planting.told, *planting.partly) for label in one.labels}
    kept = after.keys() | {label for label in before if _bare(label) in _beside(planted)}
    expected = {name for either in expects for name in either.split("|")}
    lost = tuple(label for label in before if label not in kept)
    new = tuple(label for label in after if label not in before and label not in accepted and label not in expected)
    verdict, how, size = _told(planting, amount, plain, planted)
    return Judgement(verdict, how, size, lost, new)


def _told(
    planting: Planting, amount: float, plain: dict[str, Any], planted: dict[str, Any]
) -> tuple[str, str, float | None]:
    before, after = named(plain), named(planted)
    wrong: tuple[str, str, float | None] | None = None
    for one in planting.told:
        if one.code:
            if remark := _new_remark(one, plain, planted):
                return "told", remark, None
            continue
        if not all(label in after for label in one.labels):
            continue
        how = " and ".join(one.labels)
        if not one.number:
            return "told", how, None
        sizes = [_number(after[label], one.number) for label in one.labels]
        changes = [
            size - (_number(before[label], one.number) if label in before else 0.0)
            for label, size in zip(one.labels, sizes, strict=True)
        ]
        if any(all(_within(size, one.sign * amount, one.factor) for size in some) for some in (sizes, changes)):
            return "told", how, sizes[0]
        wrong = wrong or ("possible", f"{how}, of another size", sizes[0])
    if wrong:
        return wrong
    likely = possible_names(planted)
    for one in planting.told:
        if found := [label for label in one.labels if label in after]:
            return "possible", f"named {' and '.join(found)}", None
        if any("@" not in label and _bare(label) in likely for label in one.labels):
            return "possible", f"{one.labels[0]} as possible", None
    doubted = {label.partition("@")[2] for label in before if "@" in label}
    for one in planting.partly:
        if one.code and (remark := _new_remark(one, plain, planted)):
            return "possible", remark, None
        if found := [label for label in one.labels if label in after and label.partition("@")[2] not in doubted]:
            return "possible", f"named {' and '.join(found)}", None
    return "missed", "", None


def _beside(answer: dict[str, Any]) -> set[str]:
    return {name for effect in answer.get("effects", ()) for name in effect.get("cannot_tell_apart_from", ())}


def _finite(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _bare(label: str) -> str:
    return label.partition("@")[0].partition(":")[0]


def _number(numbers: dict[str, float], name: str) -> float:
    return numbers.get(name, numbers.get("", float("nan")))


def _new_remark(telling: Telling, plain: dict[str, Any], planted: dict[str, Any]) -> str:
    """Return the remark of a telling; "" where there is none, or one in the plain case too."""
    said, before = (
        [
            one["text"]
            for one in answer.get("findings", ())
            if one["code"] == telling.code and one["subject"].endswith(telling.about)
        ]
        for answer in (planted, plain)
    )
    return said[0] if said and not before else ""


def _within(size: float, wanted: float, factor: float) -> bool:
    return bool(1.0 / factor <= size / wanted <= factor)
