"""From a table of evidence to a verdict: one pure function, with its rules in order; docs/discrepancy.md lists them."""

from __future__ import annotations

import dataclasses

from jaxmodel.base.units import difference_unit, readable, split_unit
from jaxmodel.fit.settings import SETTINGS, Settings


@dataclasses.dataclass(frozen=True)
class ChannelEvidence:
    """The errors of a channel, in its unit.

    Attributes:
        noise: sd of its sensor.
        before: RMS error of the calibrated base model on fit runs.
        fit: RMS error of the final model on fit runs.
        check: RMS error of the final model on check runs; NaN without check runs.
        tolerance: stated or assumed.
        check_before: RMS error of the calibrated base model on check runs; NaN without check runs.
        stated_tolerance: whether the case states the tolerance.
    """

    noise: float
    before: float
    fit: float
    check: float
    tolerance: float
    check_before: float = float("nan")
    stated_tolerance: bool = False


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Everything that decides the verdict.

    Attributes:
        named: effects that are named, by label.
        possible: effects of the final model that are not.
        sensors: those of both that are sensor faults.
        unknown: accepted laws and curves that belong to no effect and no table, in words.
        channels: by name.
        extrapolates: a check run is outside the conditions of the fit runs.
        kinetics: those of both that every cell has: a model without them is not what a faulty sensor needs.
    """

    named: tuple[str, ...]
    possible: tuple[str, ...]
    sensors: frozenset[str]
    unknown: tuple[str, ...]
    channels: dict[str, ChannelEvidence]
    extrapolates: bool
    kinetics: frozenset[str] = frozenset()


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
        "the remaining error is several times the noise, above the tolerance, and more than a share of the base "
        "model's error, on fit runs and on check runs",
    ),
    "named": ("missing_effect", "an effect other than a sensor fault is named"),
    "fault": ("sensor_fault", "a sensor fault is named, and besides at most kinetics, which every cell has"),
    "open": ("undecided", "the final model contains effects of which none may be named, and its base is not adequate"),
    "held out": ("undecided", "the error on check runs is far above that on fit runs, and above the tolerance"),
    "adequate": ("adequate", "none of the rules above applies"),
}


def decide(evidence: Evidence, settings: Settings = SETTINGS) -> Decision:
    """Return the verdict on a table of evidence, by the first of RULES that applies."""
    if evidence.unknown:
        return _decision("unknown law", "; ".join(evidence.unknown))
    left = [name for name, one in evidence.channels.items() if _mostly_left(one, settings)]
    if left:
        described = [
            f"the error of {split_unit(name)[0]} remains at {_size(name, one.fit)} (noise {_size(name, one.noise)})"
            for name, one in evidence.channels.items()
            if name in left
        ]
        return _decision(
            "large remaining error",
            f"{' and '.join(described)}; no effect, curve or law that was tried explains it on left-out data",
        )
    if evidence.named:
        named = set(evidence.named)
        is_fault = bool(named & evidence.sensors) and named <= evidence.sensors | evidence.kinetics
        return _decision("fault" if is_fault else "named", None)
    if evidence.possible and not all(_within(one) for one in evidence.channels.values()):
        return _decision("open", None)
    failing = [name for name, one in evidence.channels.items() if _fails_held_out(one, settings)]
    if failing:
        described = [
            f"on check runs the error of {split_unit(name)[0]} is {_ratio(evidence.channels[name]):.1f} times that on "
            "fit runs"
            for name in failing
        ]
        where = "; a check run is outside the conditions of the fit runs" if evidence.extrapolates else ""
        return _decision("held out", "; ".join(described) + where)
    return _decision("adequate", None)


def _size(channel: str, error: float) -> str:
    """Return an error of a channel with its unit, as '29.8 mV'."""
    scale, unit = readable([error], difference_unit(split_unit(channel)[1]))
    return f"{error * scale:.3g} {unit}".rstrip()


def _decision(rule: str, unexplained: str | None) -> Decision:
    return Decision(RULES[rule][0], unexplained, rule)


def _mostly_left(one: ChannelEvidence, settings: Settings) -> bool:
    """Return True if most of a channel's error remains, on held-out runs too, and is above the tolerance."""
    if one.fit <= one.tolerance:
        return False
    if one.check <= settings.unexplained_share * one.check_before:  # False for NaN, without check runs
        return False
    return one.fit > settings.far_above_noise * one.noise and one.fit > settings.unexplained_share * one.before


def _within(one: ChannelEvidence) -> bool:
    """Return True if the base model is within a stated tolerance, or a third of an assumed one, on all runs."""
    limit = one.tolerance if one.stated_tolerance else one.tolerance / 3.0
    return one.before <= limit and not one.check_before > limit


def _ratio(one: ChannelEvidence) -> float:
    return one.check / max(one.fit, one.noise)


def _fails_held_out(one: ChannelEvidence, settings: Settings) -> bool:
    """Return True if the error on check runs is far above that on fit runs, and above the tolerance."""
    if one.check <= one.tolerance:
        return False
    return _ratio(one) > settings.held_out_factor
