"""From a table of evidence to a verdict: one pure function, with its rules in order; docs/discrepancy.md lists them."""

from __future__ import annotations

import dataclasses

from jaxmodel.diagnosis.settings import SETTINGS, Settings


@dataclasses.dataclass(frozen=True)
class ChannelEvidence:
    """The errors of a channel; those of a voltage are divided by its steepness (`jaxmodel.diagnosis.noise.steepness`).

    Attributes:
        noise: sd of its sensor.
        before: RMS error of the calibrated base model on fit runs.
        fit: RMS error of the final model on fit runs.
        check: RMS error of the final model on check runs; NaN without check runs.
        tolerance: stated; None if not stated.
        model_error: s of the model error, in the channel's unit; 0 without one.
        check_before: RMS error of the calibrated base model on check runs; NaN without check runs.
        steep: whether readings where the OCV is steep make up much of the whole error.
    """

    noise: float
    before: float
    fit: float
    check: float
    tolerance: float | None
    model_error: float
    check_before: float = float("nan")
    steep: bool = False

    @property
    def where(self) -> str:
        """Return where the error is that large, for a sentence."""
        return ", apart from the steep ends of the OCV" if self.steep else ""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Everything that decides the verdict.

    Attributes:
        effects: probability of every effect in the final model, by label.
        sensors: those of them that are sensor faults.
        unknown: accepted laws and curves that belong to no effect and no table, in words.
        channels: by name.
        extrapolates: a check run is outside the conditions of the fit runs.
    """

    effects: dict[str, float]
    sensors: frozenset[str]
    unknown: tuple[str, ...]
    channels: dict[str, ChannelEvidence]
    extrapolates: bool


@dataclasses.dataclass(frozen=True)
class Decision:
    """The verdict, what remains unexplained in words, and the rule that gave the verdict."""

    verdict: str
    unexplained: str | None
    rule: str


# In this order; the first that applies gives the verdict.
RULES = {
    "unknown law": ("unknown_effect", "an unknown law is accepted"),
    "large remaining error": (
        "unknown_effect",
        "the remaining error is several times the noise, above a stated tolerance, and more than a share of the base "
        "model's error, on fit runs and on check runs",
    ),
    "named": ("missing_effect", "an effect other than a sensor fault has a probability of at least 0.5"),
    "fault": ("sensor_fault", "a sensor fault has a probability of at least 0.5"),
    "open": ("undecided", "the final model contains effects, all with a probability below 0.5"),
    "held out": ("undecided", "the error on check runs is far above that on fit runs"),
    "adequate": ("adequate", "none of the rules above applies"),
}


def decide(evidence: Evidence, settings: Settings = SETTINGS) -> Decision:
    """Return the verdict on a table of evidence, by the first of RULES that applies."""
    if evidence.unknown:
        return _decision("unknown law", "; ".join(evidence.unknown))
    left = [name for name, one in evidence.channels.items() if _mostly_left(one, settings)]
    if left:
        described = [
            f"the error of {name} remains at {one.fit:.3g} (noise {one.noise:.2g}{one.where})"
            for name, one in evidence.channels.items()
            if name in left
        ]
        return _decision(
            "large remaining error",
            f"{' and '.join(described)}; no effect, curve or law that was tried explains it on left-out data",
        )
    named = [label for label, probability in evidence.effects.items() if probability >= settings.named]
    if named:
        return _decision("fault" if all(label in evidence.sensors for label in named) else "named", None)
    if evidence.effects:
        return _decision("open", None)
    failing = [name for name, one in evidence.channels.items() if _fails_held_out(one, settings)]
    if failing:
        described = [
            f"on check runs the error of {name} is {_ratio(evidence.channels[name]):.1f} times that on fit runs"
            for name in failing
        ]
        where = "; a check run is outside the conditions of the fit runs" if evidence.extrapolates else ""
        return _decision("held out", "; ".join(described) + where)
    return _decision("adequate", None)


def _decision(rule: str, unexplained: str | None) -> Decision:
    return Decision(RULES[rule][0], unexplained, rule)


def _mostly_left(one: ChannelEvidence, settings: Settings) -> bool:
    """Return True if most of a channel's error remains, on held-out runs too, and is material."""
    if one.model_error <= 0.0 or (one.tolerance is not None and one.fit <= one.tolerance):
        return False
    if one.check <= settings.unexplained_share * one.check_before:  # False for NaN, without check runs
        return False
    return one.fit > settings.far_above_noise * one.noise and one.fit > settings.unexplained_share * one.before


def _ratio(one: ChannelEvidence) -> float:
    return one.check / max(one.fit, one.noise)


def _fails_held_out(one: ChannelEvidence, settings: Settings) -> bool:
    """Return True if the error on check runs is far above that on fit runs, and above a stated tolerance."""
    if one.tolerance is not None and one.check <= one.tolerance:
        return False
    return _ratio(one) > settings.held_out_factor
