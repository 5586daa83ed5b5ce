"""The constants of a diagnosis that an investigation may change, each with its source.

docs/reference/settings.md is made from them. Constants of the search and of the fit itself stand in their modules.
"""

from __future__ import annotations

import dataclasses
from typing import Any

# Seed of all random numbers: a case always gives the same result.
SEED = 0


def _constant(value: Any, meaning: str, source: str = "assumed") -> Any:
    return dataclasses.field(default=value, metadata={"meaning": meaning, "source": source})


@dataclasses.dataclass(frozen=True)
class Settings:
    """The constants of a diagnosis; `dataclasses.replace` changes one.

    Example:
        >>> import dataclasses
        >>> from jaxmodel import SETTINGS
        >>> dataclasses.replace(SETTINGS, noise_contradiction=2.0).noise_contradiction
        2.0
    """

    # Sensor noise.
    noise_contradiction: float = _constant(
        1.5, "factor between the stated sd and the scatter of the readings beyond which the scatter is used"
    )
    filtered: float = _constant(
        100.0,
        "factor by which readings scatter less than stated, above which the log is taken to be filtered or "
        "interpolated, and the stated sd holds",
    )
    finest_sensor: float = _constant(
        1e-6, "least sd of a reading that is not stated, as a share of the range of the readings", "20 bits"
    )
    fewest_for_noise: int = _constant(50, "readings needed to replace a stated sd by the scatter")

    # Readings.
    most_readings: int = _constant(
        30_000, "readings used in a fit; more are thinned evenly; errors are computed from all"
    )
    most_steps: int = _constant(
        10_000,
        "rows of all fit runs together that a fit simulates; longer runs have few steps where their inputs are steady, "
        "and windows of all rows where they change",
    )

    # Unknown laws; the evidence chooses the sd of their priors.
    law_knots: int = _constant(9, "knots of an unknown law")

    # The search.
    refitted_effects: int = _constant(
        3, "effects and sensor faults refitted in each round: the best scores, under each of two sets of weights"
    )
    leading_effects: int = _constant(1, "effects refitted besides for their score in each single channel")
    refitted_runs: int = _constant(
        2, "kinds of shifts refitted in each round, of each the best run, under each of two sets of weights"
    )
    refitted_beside: int = _constant(
        2, "candidates refitted in a round beside curves of what no table states, where none entered without them"
    )
    refitted_laws: int = _constant(2, "unknown laws refitted at the end of the search")
    most_rounds: int = _constant(10, "largest number of rounds")
    least_odds: float = _constant(
        1.0, "log evidence required in addition to the log of the number of candidates", "3 to 1"
    )
    rare_odds: float = _constant(3.0, "further log evidence required of rare effects", "20 to 1, assumed")
    odds_beside_model_error: float = _constant(
        5.0, "further log evidence required where a model leaves more than the noise of the sensors"
    )
    implausible: float = _constant(4.0, "size of an unknown law, in units of its usual size, above which it is refused")
    largest_increase: float = _constant(
        0.1, "share by which an addition may increase a channel's mean square error on blocks that are left out"
    )
    negligible_share: float = _constant(
        0.5, "share of a tolerance, added to the noise, up to which an addition may increase an error"
    )
    material_share: float = _constant(
        0.1, "share of a stated tolerance that an addition must remove of an error, as a difference of mean squares",
        "design",
    )  # fmt: skip
    least_share: float = _constant(
        0.2, "share of a channel's mean square error above noise that an addition must remove without a tolerance"
    )
    law_share: float = _constant(
        0.25, "share of the base model's mean square error above noise that must remain for an unknown law to be tested"
    )
    near_noise: float = _constant(
        5.0, "remaining error, in multiples of the noise, below which an unknown law is tested whatever that share"
    )

    # The answer.
    most_probable: float = _constant(0.99, "largest probability that is printed")
    strained: float = _constant(
        3.0, "distance of a parameter from its stated value, in sd, from which it is remarked on"
    )
    unexplained_share: float = _constant(
        0.5,
        "remaining share of the base model's error in a channel, on fit runs and on check runs, above which the "
        "verdict is `unknown_effect`",
    )
    far_above_noise: float = _constant(3.0, "remaining error, in multiples of the noise, required for that verdict")
    held_out_factor: float = _constant(
        1.25, "error on check runs, in multiples of the error on fit runs or the noise, above which a channel fails",
        "of the sealed cases answered correctly one in twenty exceeds 1.07",
    )  # fmt: skip
    start_share: float = _constant(0.01, "share of a check run's readings that may adjust its start")
    start_readings: int = _constant(3, "readings that may adjust the start of a check run, at least")
    start_reach: float = _constant(2.0, "largest adjustment of the start of a check run, in sd")
    assumed_voltage: float = _constant(0.01, "assumed tolerance of a voltage, as a share of its span", "design")
    assumed_temperature_K: float = _constant(1.0, "assumed tolerance of a temperature, K", "design")
    assumed_share: float = _constant(0.02, "assumed tolerance of any other channel, as a share of its span", "design")


SETTINGS = Settings()
"""The constants as they are unless an investigation is given others."""


def table(settings: Settings = SETTINGS) -> list[dict[str, str]]:
    """Return one row for each constant: name, value, meaning and source."""
    return [
        {
            "name": field.name,
            "value": str(getattr(settings, field.name)),
            "meaning": field.metadata["meaning"],
            "source": field.metadata["source"],
        }
        for field in dataclasses.fields(settings)
    ]
