"""The method with one part left out at a time, as far as one screening and the answer tell without another fit."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discrepancy.baselines import Says
from benchmarks.discrepancy.evidence import Evidence, read_evidence
from discrepancy.posterior import SOMETHING_ELSE
from discrepancy.projection import Candidate
from discrepancy.score import score_effects
from discrepancy.screen import ABSORBED_BELOW

# |z| that one effect tested alone exceeds in 5 % of cases.
ALONE = 1.96


def by_score(evidence: Evidence, critical_z: float | None = None) -> Says:
    """Name the effect with the strongest efficient score, where one is beyond the critical value of all together."""
    candidates = {}
    for name in dict.fromkeys(evidence.names.tolist()):
        mine = evidence.names == name
        candidates[name] = Candidate(list(evidence.effects[:, mine].T), signs=int(evidence.signs[mine][0]))
    table = score_effects(evidence.base, evidence.residual, candidates, absorbed_below=ABSORBED_BELOW)
    limit = table.critical_z if critical_z is None else critical_z
    return Says(table.effects[0].z_equivalent <= limit, tuple(effect.name for effect in table.effects), 1)


def without_projection(evidence: Evidence) -> Evidence:
    """Return the case as if nothing had been calibrated: no sensitivity of the base to project off."""
    return dataclasses.replace(evidence, base=np.zeros((evidence.residual.size, 0)))


def without_signs(evidence: Evidence) -> Evidence:
    """Return the case with every amplitude free to have either sign."""
    return dataclasses.replace(evidence, signs=np.zeros_like(evidence.signs))


def with_one_shape(evidence: Evidence) -> Evidence:
    """Return the case with the middle one of each effect's shapes alone."""
    places = [np.flatnonzero(evidence.names == name) for name in dict.fromkeys(evidence.names.tolist())]
    kept = [each[each.size // 2] for each in places]
    return dataclasses.replace(
        evidence, effects=evidence.effects[:, kept], names=evidence.names[kept], signs=evidence.signs[kept]
    )


def screened(folder: Path) -> dict[str, Says]:
    """Return what the score alone says of a gathered case, whole and with one part of it left out."""
    evidence = read_evidence(folder / "evidence.npz")
    return {
        "score alone": by_score(evidence),
        "score, no projection": by_score(without_projection(evidence)),
        "score, no whitening": by_score(evidence.coloured()),
        "score, either sign": by_score(without_signs(evidence)),
        "score, one shape each": by_score(with_one_shape(evidence)),
        "score, each effect at 5 %": by_score(evidence, ALONE),
    }


def weighed(said: dict[str, Any], without_something_else: bool = False, effects: int = 2) -> Says:
    """Return what an answer's own hypotheses say, some of them left out: the likeliest of the others.

    A model that was never fitted because of what is left out has no say: the pairs that were begun with another first
    effect, for one.
    """
    left = [
        each["name"]
        for each in said["candidates"]
        if not (without_something_else and each["name"] == SOMETHING_ELSE)
        and (each["name"] == SOMETHING_ELSE or each["name"].count("+") < effects)
    ]
    effects_left = [each for each in left if each not in ("base", SOMETHING_ELSE)]
    ranking = tuple(dict.fromkeys(name for each in effects_left for name in each.split("+")))
    if not left or left[0] == SOMETHING_ELSE:  # an answer lists nothing below one in two thousand
        return Says(False, ranking, 0, unknown=bool(left))
    return Says(left[0] == "base", ranking, left[0].count("+") + 1)


IN_ANSWER = {
    "likeliest hypothesis": weighed,
    "no something else": functools.partial(weighed, without_something_else=True),
    "no second effect": functools.partial(weighed, effects=1),
}
