"""What an investigation says: models and their errors, effects, curves, single runs, and the answer file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxmodel.case import Case

if TYPE_CHECKING:
    import pandas as pd

VERDICTS = ("adequate", "missing_effect", "sensor_fault", "unknown_effect", "undecided")


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A fitted number with its standard deviation (of the fit, priors included) and unit."""

    value: float
    sd: float
    unit: str


@dataclasses.dataclass(frozen=True)
class ChannelError:
    """RMS of measured less predicted of one channel, in its unit, by split; NaN where there is none.

    Attributes:
        fit: on fitted runs.
        check: on held-out runs, their start adjusted on their first readings within what is stated of it.
        stated: on held-out runs, their start exactly as stated.
        worst: largest error on held-out runs.
    """

    fit: float
    check: float
    stated: float = float("nan")
    worst: float = float("nan")


@dataclasses.dataclass(frozen=True)
class Rung:
    """One model of the ladder.

    Attributes:
        name: how the ladder calls it.
        added: labels of what is in it beside the base model.
        estimates: calibrated numbers by name; per-run ones as 'initial_soc[run-01]'.
        at_bound: names of the estimates further than three of their prior's sd from it.
        errors: by channel.
        predictions: by run, then channel, at the rows of the run.
        chi2: of the whitened residuals of the fit runs.
        readings: how many these are.
    """

    name: str
    added: tuple[str, ...]
    estimates: dict[str, Estimate]
    at_bound: tuple[str, ...]
    errors: dict[str, ChannelError]
    predictions: dict[str, dict[str, np.ndarray]]
    chi2: float
    readings: int


@dataclasses.dataclass(frozen=True)
class Removed:
    """What something takes off a channel's error, as the root of the mean square removed, in the channel's unit."""

    fit: float
    check: float


@dataclasses.dataclass(frozen=True)
class NamedEffect:
    """An effect that is named.

    Attributes:
        label: its name, with its column where it has one.
        name: its name.
        column: of a sensor's fault, "" for others.
        probability: of all models that were weighed, the share of those with it.
        parameters: its fitted numbers by name.
        cannot_tell_apart_from: effects that, put in its place, explain the readings as well.
        removes: by channel.
        rests_on: the only run that could show it; "" where several do.
    """

    label: str
    name: str
    column: str
    probability: float
    parameters: dict[str, Estimate]
    cannot_tell_apart_from: tuple[str, ...]
    removes: dict[str, Removed] = dataclasses.field(default_factory=dict)
    rests_on: str = ""


@dataclasses.dataclass(frozen=True)
class CurveFound:
    """A table or relation that is off as a function of one quantity.

    Attributes:
        label: of the candidate.
        port: what is off.
        over: as a function of what.
        at: values of that.
        value: by how much it is off there; of a factor its logarithm.
        sd: of it.
        unit: of the value; "" is the logarithm of a factor.
        removes: by channel.
        stated: the case states the table that is off.
        multiplier: what the value multiplies; "" is 1.
    """

    label: str
    port: str
    over: str
    at: np.ndarray
    value: np.ndarray
    sd: np.ndarray
    unit: str
    removes: dict[str, Removed]
    stated: bool
    multiplier: str = ""

    def sentence(self) -> str:
        """Say where it is off by most, and by how much."""
        worst = int(np.argmax(np.abs(self.value) / np.maximum(self.sd, 1e-300)))
        place = f"{self.over} {self.at[worst]:.3g}"
        name = self.port.replace("_", " ")
        factor = f" per {self.multiplier}" if self.multiplier else ""
        if not self.unit:
            percent = 100.0 * (np.exp(self.value[worst]) - 1.0)
            return f"{name} is off by {percent:+.0f} % at {place} (sd {100.0 * self.sd[worst]:.0f} %)"
        scale, unit = (1e3, f"m{self.unit}") if self.unit.startswith("V") else (1.0, self.unit)
        return (
            f"{name} is off by {scale * self.value[worst]:+.3g} {unit}{factor} at {place} "
            f"(sd {scale * self.sd[worst]:.2g} {unit})"
        )


@dataclasses.dataclass(frozen=True)
class RunFound:
    """A number of one run that differs from that of the others."""

    label: str
    run: str
    file: str
    parameter: str
    value: float
    sd: float
    unit: str
    removes: dict[str, Removed]


@dataclasses.dataclass(frozen=True)
class Immaterial:
    """Something that the fitted runs show and that was not added; the sentence says why."""

    name: str
    removes: dict[str, Removed]
    sentence: str


@dataclasses.dataclass(frozen=True)
class Remaining:
    """What the final model leaves of one channel: its RMS on fitted runs, how long it hangs together, and where."""

    rms: float
    tau_s: float
    where: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Extrapolated:
    """A condition of a held-out run that lies outside those that were fitted."""

    file: str
    condition: str
    span_fitted: tuple[float, float]
    span: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Sensor:
    """The noise of one channel: its sd, its correlation from reading to reading, and where both come from."""

    sd: float
    rho: float
    source: str
    quantum: float


@dataclasses.dataclass(frozen=True)
class ScoreEntry:
    """One line of the score test of everything at the calibrated base model.

    Attributes:
        label: the candidate.
        z: standard score of its amplitude; squared, the drop in chi-square that adding it promises.
        significant: beyond the critical value for all candidates together.
        blind: this data could not have shown an effect of its usual size.
    """

    label: str
    z: float
    significant: bool
    blind: bool


@dataclasses.dataclass(frozen=True)
class ToleranceUsed:
    """The error on held-out runs that a channel may have, stated by the case or assumed."""

    rms: float
    largest: float | None
    assumed: bool


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The whole result for one case.

    Attributes:
        case: as it was diagnosed.
        verdict: one of VERDICTS; "" where nothing was asked.
        effects: what is named, the one that explains most first.
        candidates: models that were weighed, with their probability.
        unexplained: in words, what nothing explains; None where nothing is left.
        blind_to: effects that this data could not have shown.
        noise: by channel.
        ladder: nominal, calibrated, and every model on the way to the final one.
        scores: of everything, beside the calibrated base model.
        critical_z: the score that chance exceeds in one of twenty cases without any effect, over all candidates.
        remarks: what a reader should know beside the verdict.
        curves, runs, immaterial, remaining, extrapolated, tolerance: see there.
        fit_for_purpose: by channel and check run, whether the error is within tolerance.
        where_base: sentences on where the calibrated base model fails, by channel.
        errors: a row for each channel of each run.
        rivals, proposals: models between which the data have not decided, and what to measure to decide.
        law_source: the file of an unknown law as an effect.
        ordered: what the user had added or ruled out.
    """

    case: Case
    verdict: str
    effects: tuple[NamedEffect, ...]
    candidates: tuple[tuple[str, float], ...]
    unexplained: str | None
    blind_to: tuple[str, ...]
    noise: dict[str, Sensor]
    ladder: tuple[Rung, ...]
    scores: tuple[ScoreEntry, ...]
    critical_z: float
    remarks: tuple[str, ...]
    curves: tuple[CurveFound, ...] = ()
    runs: tuple[RunFound, ...] = ()
    immaterial: tuple[Immaterial, ...] = ()
    remaining: Mapping[str, Remaining] = dataclasses.field(default_factory=dict)
    extrapolated: tuple[Extrapolated, ...] = ()
    tolerance: Mapping[str, ToleranceUsed] = dataclasses.field(default_factory=dict)
    fit_for_purpose: Mapping[str, Mapping[str, bool]] = dataclasses.field(default_factory=dict)
    where_base: Mapping[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
    errors: Any = None
    rivals: tuple[str, ...] = ()
    proposals: tuple[Any, ...] = ()
    law_source: str | None = None
    ordered: tuple[str, ...] = ()

    @property
    def base(self) -> Rung:
        """Return the calibrated base model."""
        return self.ladder[1]

    @property
    def final(self) -> Rung:
        """Return the model that the diagnosis ends with."""
        return self.ladder[-1]

    def to_dataframe(self) -> pd.DataFrame:
        """Return the errors by run and channel, before and after."""
        return self.errors

    def answer(self) -> dict[str, Any]:
        """Return the answer in the form of the case contract."""
        return answer(self)


def number(value: float) -> float | None:
    """Return a number to six digits, ready for JSON; None where it does not exist."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _split(error: ChannelError | Removed) -> dict[str, float | None]:
    return {"fit": number(error.fit), "check": number(error.check)}


def answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return the answer in the form of the case contract, ready for JSON; numbers that do not exist are null."""
    before, after = diagnosis.base.errors, diagnosis.final.errors
    return {
        "verdict": diagnosis.verdict,
        "effects": [
            {
                "name": effect.name,
                "probability": number(effect.probability),
                "parameters": {
                    **{n: {"value": number(e.value), "sd": number(e.sd)} for n, e in effect.parameters.items()},
                    **({"column": effect.column} if effect.column else {}),
                },
                "cannot_tell_apart_from": list(effect.cannot_tell_apart_from),
                "removes": {c: _split(one) for c, one in effect.removes.items()},
                **({"rests_on": effect.rests_on} if effect.rests_on else {}),
            }
            for effect in diagnosis.effects
        ],
        "candidates": [{"name": name, "probability": number(p)} for name, p in diagnosis.candidates],
        "unexplained": diagnosis.unexplained,
        "blind_to": list(diagnosis.blind_to),
        "error": {
            channel: {
                "noise_floor": number(diagnosis.noise[channel].sd),
                "before": _split(before[channel]),
                "after": _split(after[channel]),
                "check_as_stated": {
                    "before": number(before[channel].stated),
                    "after": number(after[channel].stated),
                },
            }
            for channel in diagnosis.noise
        },
        "tolerance": {
            channel: {"rms": number(one.rms), "max": one.largest and number(one.largest), "assumed": one.assumed}
            for channel, one in diagnosis.tolerance.items()
        },
        "fit_for_purpose": {channel: dict(of_run) for channel, of_run in diagnosis.fit_for_purpose.items()},
        "curves": [
            {
                "port": curve.port,
                "over": curve.over,
                "at": [number(x) for x in curve.at],
                "value": [number(x) for x in curve.value],
                "sd": [number(x) for x in curve.sd],
                "unit": curve.unit or "log of a factor",
                "removes": {c: _split(one) for c, one in curve.removes.items()},
            }
            for curve in diagnosis.curves
        ],
        "runs": [
            {
                "file": run.file,
                "parameter": run.parameter,
                "value": number(run.value),
                "sd": number(run.sd),
                "unit": run.unit,
                "removes": {c: _split(one) for c, one in run.removes.items()},
            }
            for run in diagnosis.runs
        ],
        "immaterial": [
            {"name": one.name, "removes": {c: _split(r) for c, r in one.removes.items()}}
            for one in diagnosis.immaterial
        ],
        "remaining": {
            channel: {"rms": number(one.rms), "tau_s": number(one.tau_s), "where": list(one.where)}
            for channel, one in diagnosis.remaining.items()
        },
        "extrapolated": [
            {
                "file": one.file,
                "condition": one.condition,
                "span_fitted": [number(x) for x in one.span_fitted],
                "span": [number(x) for x in one.span],
            }
            for one in diagnosis.extrapolated
        ],
        "errors_by_run": [] if diagnosis.errors is None else _rows(diagnosis.errors),
        "remarks": list(diagnosis.remarks),
    }


def _rows(table: pd.DataFrame) -> list[dict[str, Any]]:
    def plain(value: Any) -> Any:
        if isinstance(value, float | np.floating):
            return number(float(value))
        return value.item() if isinstance(value, np.generic) else value

    return [{key: plain(value) for key, value in row.items()} for row in table.to_dict("records")]


def write_answer(diagnosis: Diagnosis, path: Path) -> None:
    """Write the answer as JSON."""
    path.write_text(json.dumps(answer(diagnosis), indent=2) + "\n", encoding="utf-8")
