"""What is hidden in a made case, and what a right answer says of it."""

from __future__ import annotations

import dataclasses
from typing import Any

from benchmarks.discrepancy.ranges import EFFECTS
from benchmarks.independent.make_case import Run

# By number of effects, as `answer.toml` has it.
CLASS_OF_EFFECTS = ("null", "single", "double", "triple", "quad", "five")


@dataclasses.dataclass(frozen=True)
class Blind:
    """What was hidden in a case.

    Attributes:
        kind: "cell", "motor" or "robot".
        group: a name of `generate.CLASSES` or of `bench.GROUPS`.
        effects: the hidden effects with their parameters.
        outside: the name of a law outside the catalogue, or "".
        hostile: whether the noise of one sensor is coloured and unstated.
        moves: by how many sigma each effect moves all readings together, the other numbers as they truly are; an
            Arrhenius law in runs at its reference temperature moves none.
        heavy: the sensor with heavy-tailed noise, or "".
        decoy: the number that is far from what is stated, or "": it looks like an effect, and is none.
        rival: the effect that the one hidden can hardly be told from, or "".
        beside: what else is not as stated, and is no effect, under the names of `answer.toml`: `table`, `run` with
            `parameter`, `stated_over_true`, `parameter` with `off_by_sd`, `below_degC`.
        stands_out: by how many sigma each hidden thing stands out of what all others, refitted, make of the readings.
    """

    kind: str
    group: str
    effects: dict[str, dict[str, Any]]
    outside: str
    hostile: bool
    moves: dict[str, float] = dataclasses.field(default_factory=dict)
    heavy: str = ""
    decoy: str = ""
    rival: str = ""
    beside: dict[str, Any] = dataclasses.field(default_factory=dict)
    stands_out: dict[str, float] = dataclasses.field(default_factory=dict)

    @property
    def verdict(self) -> str:
        """Return the verdict that is right if what is hidden can be seen at all."""
        if self.group in ("null", "immaterial", "outside", "extrapolation"):
            told_apart = {"outside": "unknown_effect", "extrapolation": "undecided"}
            return told_apart.get(self.group, "adequate")
        if not self.effects:
            return "adequate"  # but for a table, a run or a number, which are told beside the verdict
        faults = all(name in EFFECTS and EFFECTS[name].is_sensor for name in self.effects)
        return "sensor_fault" if faults else "missing_effect"

    @property
    def told_as(self) -> str:
        """Return the class of its answer: what is judged in it."""
        if self.group in ("table", "run", "noise", "extrapolation", "immaterial", "null", "outside", "sensor"):
            return self.group
        if "off_by_sd" in self.beside:
            return "prior"
        return CLASS_OF_EFFECTS[len(self.effects)]

    @property
    def truth(self) -> dict[str, Any]:
        """Return what the answer is judged by, in the form of `answer.toml`."""
        names = [*self.effects, *([f"x_{self.outside}"] if self.outside else [])]
        if self.group == "immaterial":  # may be told, and need not be
            names = []
        return {
            "class": self.told_as,
            "verdict": self.verdict,
            "effects": names,
            "effect_parameters": self.effects,
            **({"immaterial": list(self.effects)} if self.group == "immaterial" else {}),
            **self.beside,
        }


@dataclasses.dataclass(frozen=True)
class Drawn:
    """All that a seed says of a case.

    Attributes:
        blind: what is hidden.
        stated: the numbers that the user knows, each with its sd, and tables.
        true: those numbers and tables as they are.
        sensors: sd of the noise of each column that is measured.
        runs: the runs, with what truly acts in them.
        strength: of a law outside the catalogue.
        options: of the noise, of the logger's digits, and of what is stated of both.
    """

    blind: Blind
    stated: dict[str, Any]
    true: dict[str, Any]
    sensors: dict[str, float]
    runs: list[Run]
    strength: float
    options: dict[str, Any]
