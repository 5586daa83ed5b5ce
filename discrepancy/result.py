"""What a diagnosis says: the verdict, the effects, the candidates, and the answer file."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from discrepancy.failure import Failure
from discrepancy.ladder import ChannelError, Estimate, Rung
from discrepancy.misfit import Block
from discrepancy.next_experiment import Proposal
from discrepancy.noise import NoiseModel
from jaxmodel.cases import Case

VERDICTS = ("adequate", "missing_effect", "sensor_fault", "unknown_effect", "undecided")


@dataclasses.dataclass(frozen=True)
class NamedEffect:
    """An effect that the diagnosis names, with what cannot be told apart from it."""

    label: str
    name: str
    column: str
    probability: float
    parameters: dict[str, Estimate]
    cannot_tell_apart_from: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class ScoreEntry:
    """One line of the score test of all effects at the calibrated base model.

    Attributes:
        label: the effect, with its column where it has one.
        z: standard score of its amplitude; squared, the drop in chi-square that adding it promises.
        significant: beyond the critical value for all effects together.
        blind: this data could not have shown an effect of its usual size.
        hidden_by: base parameters that could have hidden it.
    """

    label: str
    z: float
    significant: bool
    blind: bool
    hidden_by: str


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The whole result for one case.

    Attributes:
        far: channels that no model of few effects brings near their noise: chi-square is over what the best single
            effect leaves in them.
        laws: where something in no catalogue is missing, the law that explains most of what is left, and those that
            explain much of it too, strongest first.
        ordered: what the user had added or ruled out, as told to the shell.
    """

    case: Case
    verdict: str
    effects: tuple[NamedEffect, ...]
    candidates: tuple[tuple[str, float], ...]
    unexplained: str | None
    blind_to: tuple[str, ...]
    noise: dict[str, NoiseModel]
    ladder: tuple[Rung, ...]
    scores: tuple[ScoreEntry, ...]
    critical_z: float
    failure: Failure
    remarks: tuple[str, ...]
    rivals: tuple[str, ...] = ()
    proposals: tuple[Proposal, ...] = ()
    laws: tuple[Block, ...] = ()
    law_source: str | None = None
    far: tuple[str, ...] = ()
    ordered: tuple[str, ...] = ()

    @property
    def law(self) -> Block | None:
        """Return the law that explains most of what is left; None where none was found, or nothing is left."""
        return self.laws[0] if self.laws else None

    @property
    def base(self) -> Rung:
        """Return the calibrated base model."""
        return self.ladder[1]

    @property
    def final(self) -> Rung:
        """Return the model that the diagnosis ends with."""
        return self.ladder[-1]


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the answer in the form of the case contract, ready for JSON; numbers that do not exist are null."""

    def number(value: float) -> float | None:
        return float(f"{value:.6g}") if np.isfinite(value) else None

    def split(error: ChannelError) -> dict[str, float | None]:
        return {"fit": number(error.fit), "check": number(error.check)}

    return {
        "verdict": diagnosis.verdict,
        "effects": [
            {
                "name": effect.name,
                "probability": number(effect.probability),
                "parameters": {
                    **{
                        name: {"value": number(estimate.value), "sd": number(estimate.sd)}
                        for name, estimate in effect.parameters.items()
                    },
                    **({"column": effect.column} if effect.column else {}),
                },
                "cannot_tell_apart_from": list(effect.cannot_tell_apart_from),
            }
            for effect in diagnosis.effects
        ],
        "candidates": [{"name": name, "probability": number(p)} for name, p in diagnosis.candidates],
        "unexplained": diagnosis.unexplained,
        "blind_to": list(diagnosis.blind_to),
        "error": {
            channel: {
                "noise_floor": number(diagnosis.noise[channel].sd),
                "before": split(diagnosis.base.errors[channel]),
                "after": split(diagnosis.final.errors[channel]),
            }
            for channel in diagnosis.noise
        },
    }


def write_answer(diagnosis: Diagnosis, path: Path) -> None:
    """Write the answer as JSON."""
    path.write_text(json.dumps(answer(diagnosis), indent=2) + "\n", encoding="utf-8")
