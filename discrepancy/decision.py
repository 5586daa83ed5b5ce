"""From a table of evidence to a verdict: one pure function, its rules in order, each of which the docs repeat."""

from __future__ import annotations

import dataclasses

from discrepancy.settings import SETTINGS, Settings


@dataclasses.dataclass(frozen=True)
class ChannelEvidence:
    """How far a channel is from where it should be.

    Attributes:
        noise: sd of its sensor.
        before: RMS of the calibrated base model on fitted runs.
        fit: RMS of the final model on fitted runs.
        check: RMS on held-out runs; NaN where there are none.
        tolerance: stated; None where none is.
        model_error: s of what the final model gets wrong, in the channel's unit; 0 where nothing shows.
    """

    noise: float
    before: float
    fit: float
    check: float
    tolerance: float | None
    model_error: float


@dataclasses.dataclass(frozen=True)
class Evidence:
    """All that the verdict rests on.

    Attributes:
        effects: probability of every effect in the final model, by label.
        sensors: which of them are faults of sensors.
        unknown: laws and relations in no catalogue and no table that passed the gates, in words.
        channels: by name.
        extrapolates: a held-out run lies outside the conditions that were fitted.
    """

    effects: dict[str, float]
    sensors: frozenset[str]
    unknown: tuple[str, ...]
    channels: dict[str, ChannelEvidence]
    extrapolates: bool


@dataclasses.dataclass(frozen=True)
class Decision:
    """The verdict, and in words what nothing explains."""

    verdict: str
    unexplained: str | None
    rule: str


# In this order; the first that holds gives the verdict.
RULES = {
    "unknown law": ("unknown_effect", "a law in no catalogue passes the gates beside what is named"),
    "most is left": (
        "unknown_effect",
        "what is left is several times the noise, beyond a stated tolerance, and more than a share of what the base "
        "model left",
    ),
    "named": ("missing_effect", "an effect is in the final model and more probable than not"),
    "fault": ("sensor_fault", "only faults of sensors are"),
    "open": ("undecided", "an effect is in the final model and no more probable than not"),
    "held out": ("undecided", "no effect is named, and the error on held-out runs is far above that on fitted ones"),
    "adequate": ("adequate", "none of these"),
}


def decide(evidence: Evidence, settings: Settings = SETTINGS) -> Decision:
    """Return the verdict on a table of evidence, by the first of RULES that holds."""
    if evidence.unknown:
        return _decision("unknown law", "; ".join(evidence.unknown))
    left = [name for name, one in evidence.channels.items() if _mostly_left(one, settings)]
    if left:
        described = [f"{name} is left at {evidence.channels[name].fit:.3g}" for name in left]
        noise = [f"{evidence.channels[name].noise:.2g}" for name in left]
        return _decision(
            "most is left",
            f"{' and '.join(described)} where the noise is {' and '.join(noise)}, and no effect, curve or law that was "
            "tried explains it on runs left out",
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
        where = "; a check run lies outside the conditions that were fitted" if evidence.extrapolates else ""
        return _decision("held out", "; ".join(described) + where)
    return _decision("adequate", None)


def _decision(rule: str, unexplained: str | None) -> Decision:
    return Decision(RULES[rule][0], unexplained, rule)


def _mostly_left(one: ChannelEvidence, settings: Settings) -> bool:
    """Return True where most of a channel's error is left and matters."""
    if one.model_error <= 0.0 or (one.tolerance is not None and one.fit <= one.tolerance):
        return False
    return one.fit > settings.far_above_noise * one.noise and one.fit > settings.unexplained_share * one.before


def _ratio(one: ChannelEvidence) -> float:
    return one.check / max(one.fit, one.noise)


def _fails_held_out(one: ChannelEvidence, settings: Settings) -> bool:
    """Return True where held-out runs are foretold far worse than fitted ones, and beyond a stated tolerance."""
    if one.tolerance is not None and one.check <= one.tolerance:
        return False
    return _ratio(one) > settings.held_out_factor
