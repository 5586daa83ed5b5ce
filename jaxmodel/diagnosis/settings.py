"""Every constant of the diagnosis, each with its source; the table in docs/discrepancy.md is generated from it."""

from __future__ import annotations

import dataclasses
from typing import Any


def _constant(value: Any, meaning: str, source: str = "assumed") -> Any:
    return dataclasses.field(default=value, metadata={"meaning": meaning, "source": source})


@dataclasses.dataclass(frozen=True)
class Settings:
    """The constants of a diagnosis; `dataclasses.replace` changes one."""

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

    # Model error: an Ornstein-Uhlenbeck process for each channel and run.
    correlation_times_s: tuple[float, ...] = _constant(
        (10.0, 30.0, 100.0),
        "correlation times tried, s",
        "assumed; with longer ones an error of a whole run would cost nothing",
    )
    correlation_time_median_s: float = _constant(170.0, "median of the prior of the correlation time, s", "design")
    correlation_time_spread: float = _constant(1.2, "sd of the logarithm of the correlation time", "design")
    error_from_run_to_run: float = _constant(0.7, "sd of the logarithm of a run's model error about that of all runs")
    least_error_share: float = _constant(
        0.3, "share of the tolerance, stated or assumed, to which a nonzero model error is raised"
    )
    largest_raise: float = _constant(3.0, "largest factor by which a model error is raised")
    least_error_gain: float = _constant(
        6.0, "log likelihood that a model error must gain to be used", "two parameters at p = 0.002"
    )

    soc_uncertainty: float = _constant(
        0.02, "uncertainty of the state of charge within which the steepest slope of the OCV counts"
    )

    # Readings.
    most_readings: int = _constant(
        30_000, "readings used in a fit; more are thinned evenly; errors are computed from all"
    )

    most_steps: int = _constant(
        10_000,
        "rows of all fit runs together that a fit simulates; longer runs have windows of all rows, and between them "
        "steps that keep charge and heat",
    )

    # Curves and unknown laws; the evidence chooses the sd of their priors.
    curve_correlation: float = _constant(0.25, "correlation length of a curve's prior, as a share of its span")
    law_knots: int = _constant(9, "knots of an unknown law")

    # The rounds.
    refitted_effects: int = _constant(4, "effects and sensor faults refitted in each round, best scores first")
    leading_effects: int = _constant(2, "of these, effects with the best score in each single channel")
    leading_faults: int = _constant(1, "of these, sensor faults with the best score in each single channel")
    refitted_curves: int = _constant(2, "curves refitted in each round")
    refitted_runs: int = _constant(1, "shifts of single runs refitted in each round")
    refitted_laws: int = _constant(2, "unknown laws refitted when no other candidate is accepted")
    most_rounds: int = _constant(10, "largest number of rounds")
    least_odds: float = _constant(
        1.0, "log evidence required in addition to the log of the number of candidates", "3 to 1"
    )
    rare_odds: float = _constant(3.0, "further log evidence required of rare effects", "20 to 1, assumed")
    odds_beside_model_error: float = _constant(
        5.0, "further log evidence required if there is a model error, whose form is only assumed"
    )
    preference: float = _constant(
        0.25,
        "an effect is preferred to a curve if it gains this share of the curve's gain",
        "a curve is no new physics",
    )
    least_expected_score: float = _constant(
        6.0, "expected gain in log score on left-out data from which an addition must show a gain"
    )
    implausible: float = _constant(4.0, "size of an addition, in sd of its prior, above which it is refused")
    largest_increase: float = _constant(
        0.1, "share by which an addition may increase the error on left-out data, in units of tolerances"
    )
    obvious: float = _constant(
        0.3, "an addition that leaves less than this share of a channel's error on left-out data is added first"
    )
    obvious_lead: float = _constant(
        1.5, "of several such additions, those that leave so many times the error of the best come later"
    )
    negligible_share: float = _constant(
        0.5, "share of a tolerance below which an error on left-out data does not count"
    )
    material_share: float = _constant(
        0.1, "share of a stated tolerance by which an addition must reduce an error", "design"
    )
    least_share: float = _constant(
        0.2, "share of a channel's error above noise that an addition must remove if no tolerance is stated"
    )
    later_share: float = _constant(0.3, "the same from the third addition on")
    work_of_a_shift: float = _constant(
        0.5,
        "share of the error removed by a shift of a single run that an effect with more evidence must remove to count "
        "as material beside it",
    )
    law_share: float = _constant(0.25, "remaining share of a channel's error above which an unknown law is tested")
    faint_law: float = _constant(0.02, "the same if the remaining error is close to the noise")
    near_noise: float = _constant(5.0, "remaining error, in multiples of the noise, that counts as close to it")
    left_out_blocks: int = _constant(4, "time blocks per run for cross-validation, at least")
    fewest_blocks: int = _constant(8, "time blocks of all runs together, at least")

    # The answer.
    named: float = _constant(0.5, "probability from which an effect is named")
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
    level_share: float = _constant(
        0.8, "share of an error that remains without the steep ends of the OCV, below which the answer mentions them"
    )
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
