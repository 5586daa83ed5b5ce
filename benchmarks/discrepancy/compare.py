"""Ours, the baselines and the ablations side by side on the same cases, and how far hidden effects stood out."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from benchmarks.discrepancy.ablations import IN_ANSWER, screened
from benchmarks.discrepancy.baselines import Says, baselines, by_peers
from benchmarks.discrepancy.hidden import Blind
from benchmarks.discrepancy.judge import Judged
from benchmarks.discrepancy.ranges import PLACES
from benchmarks.discrepancy.rates import Rate, rate
from jaxmodel.effects import CATALOGUE

OURS = "jaxmodel diagnose"


@dataclasses.dataclass(frozen=True)
class Compared:
    """One case and what each method says of it."""

    blind: Blind
    says: dict[str, Says]


@dataclasses.dataclass(frozen=True)
class Hidden:
    """One hidden effect, how far it stood out, and whether it was found.

    Attributes:
        name: of the effect.
        kind: of the case.
        sigma: how far its true amplitude lifts above noise and calibration in the linear model; 0 where it cannot be
            tried on the case.
        critical_z: what a score must exceed.
        significant: whether its score did.
        named: whether the answer names it.
    """

    name: str
    kind: str
    sigma: float
    critical_z: float
    significant: bool
    named: bool


def ours(case: Judged) -> Says:
    """Return the whole diagnosis in the form of the others."""
    verdict = case.said["verdict"]
    ranking = tuple(case.named) or tuple(case.first_three)
    undecided = verdict == "undecided" and case.first_three[:1] not in (["base"], ["something_else"])
    return Says(verdict == "adequate", ranking, len(case.named) or int(undecided), verdict == "unknown_effect")


def read_compared(folder: Path, cases: Iterable[Judged]) -> list[Compared]:
    """Return every case with what all methods say; what takes long is kept beside it."""
    kept = [case for case in cases if (folder_of(folder, case) / "evidence.npz").exists()]
    by_peers([folder_of(folder, case) for case in kept])
    found = []
    for case in kept:
        path = folder_of(folder, case)
        stored = path / "says.json"
        if not stored.exists():
            says = baselines(path) | screened(path)
            stored.write_text(json.dumps({name: dataclasses.asdict(each) for name, each in says.items()}))
        says = {name: Says(**each) for name, each in json.loads(stored.read_text()).items()}
        in_answer = {name: weigh(case.said) for name, weigh in IN_ANSWER.items()}
        found.append(Compared(case.blind, {OURS: ours(case)} | says | in_answer))
    return found


def folder_of(folder: Path, case: Judged) -> Path:
    """Return where a case is."""
    return folder / f"{case.number:04d}"


def rates(cases: Sequence[Compared]) -> dict[str, dict[str, Rate | float]]:
    """Return by method the figures that can be told of all of them."""
    methods = list(dict.fromkeys(name for case in cases for name in case.says))
    return {method: _rates([(c.blind, c.says[method]) for c in cases if method in c.says]) for method in methods}


def _rates(pairs: Sequence[tuple[Blind, Says]]) -> dict[str, Rate | float]:
    def of(group: str, hostile: bool | None = None) -> list[tuple[Blind, Says]]:
        return [(b, s) for b, s in pairs if b.group == group and (hostile is None or b.hostile == hostile)]

    named = [len(says.effects) for _, says in pairs if not says.adequate]
    return {
        "false alarms, clean": rate(not s.adequate for _, s in of("null", hostile=False)),
        "false alarms, hostile": rate(not s.adequate for _, s in of("null", hostile=True)),
        "singles: right first": rate([s.first] == list(b.effects) for b, s in of("single")),
        "sensor faults: right first": rate([s.first] == list(b.effects) for b, s in of("sensor")),
        "doubles: these two alone": rate(sorted(s.effects) == sorted(b.effects) for b, s in of("double")),
        "outside: called unknown": rate(s.unknown and not s.adequate for _, s in of("outside")),
        "outside: called adequate": rate(s.adequate for _, s in of("outside")),
        "effects named where any is": float(np.mean(named)) if named else float("nan"),
    }


def read_hidden(folder: Path, cases: Iterable[Judged]) -> list[Hidden]:
    """Return every effect hidden by itself in the cases gathered; the score of one of two is not its own."""
    found = []
    for case in cases:
        path = folder_of(folder, case) / "evidence.json"
        if len(case.blind.effects) > 1 or not path.exists():
            continue
        seen = json.loads(path.read_text())
        for name, sigma in seen["hidden"].items():
            column = case.blind.effects[name].get("column")
            score = seen["scores"].get(f"{name}:{column}" if column else name, 0.0)
            limit = seen["critical_z"]
            found.append(Hidden(name, case.blind.kind, sigma or 0.0, limit, score > limit, name in case.named))
    return found


def read_lifts(folder: Path, cases: Iterable[Judged]) -> dict[str, dict[str, np.ndarray]]:
    """Return by kind and effect what each case would show of it: sigma less the critical value, (cases, places).

    Of a fault that several columns could have, the mean over them. Physics that a case's profile does not touch
    at all (no second temperature, no age) lifts by nothing; a fault of a column that is not there is left out.
    """
    found: dict[str, dict[str, list[np.ndarray]]] = {}
    for case in cases:
        path = folder_of(folder, case) / "evidence.json"
        if not path.exists():
            continue
        kind, seen = case.blind.kind, json.loads(path.read_text())
        lifts: dict[str, list[np.ndarray]] = {
            name: [] for name, effect in CATALOGUE.items() if kind in effect.kinds and not effect.is_sensor
        }
        for label, sigmas in seen["lifts"].items():
            lifts.setdefault(label.split(":")[0], []).append(np.array(sigmas))
        for name, each in lifts.items():
            lift = np.mean(each, axis=0) if each else np.zeros(PLACES.size)
            found.setdefault(kind, {}).setdefault(name, []).append(lift - seen["critical_z"])
    return {kind: {name: np.stack(rows) for name, rows in each.items()} for kind, each in found.items()}
