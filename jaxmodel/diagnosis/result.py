"""Results of a diagnosis: models and their errors, effects, curves, shifts of single runs."""

from __future__ import annotations

import dataclasses
import functools
import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.late_binding import late_bound
from jaxmodel.base.remark import Remark
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import CaseSimulation, simulate_case
from jaxmodel.diagnosis.plotting import DiagnosisPlots
from jaxmodel.fit.estimates import Estimate

VERDICTS = ("adequate", "missing_effect", "sensor_fault", "unknown_effect", "undecided")


@dataclasses.dataclass(frozen=True)
class ChannelError:
    """RMS error (measured minus predicted) of one channel, in its unit; NaN without readings.

    Attributes:
        fit: on fit runs.
        check: on check runs, their start adjusted on their first readings.
        stated: on check runs, their start exactly as stated.
        worst: largest error on check runs.
        prediction_sd: sd of the prediction of check runs, by the model itself; NaN if not asked.
    """

    fit: float
    check: float
    stated: float = float("nan")
    worst: float = float("nan")
    prediction_sd: float = float("nan")


@dataclasses.dataclass(frozen=True)
class RunError:
    """Error (measured minus predicted) of one channel in one run, over all its readings that count, in its unit.

    Attributes:
        readings: their number, at least 1; the first of a check run, which adjust its start, do not count.
        rms: root mean square.
        mean: mean.
        worst: the largest size.
    """

    readings: int
    rms: float
    mean: float
    worst: float

    @classmethod
    def of(cls, errors: np.ndarray) -> RunError | None:
        """Return the error of some readings (n,), NaN where there is none; None if there is none at all."""
        read = errors[np.isfinite(errors)]
        if not read.size:
            return None
        rms = float(np.sqrt(read @ read / read.size))
        return cls(read.size, rms, float(np.mean(read)), float(max(read.max(), -read.min())))


@dataclasses.dataclass(frozen=True)
class Rung:
    """One model of the ladder.

    Attributes:
        name: in the ladder.
        added: labels of its additions to the base model.
        estimates: calibrated parameters by name; those of one run as 'initial_soc[run-01]'.
        at_bound: names of the estimates more than three prior sd from their stated value.
        errors: by channel.
        predictions: by run, then channel, at the rows of the run; empty in a model that is only compared.
        chi2: of the whitened residuals of the fit runs.
        readings: number of residuals.
        by_run: errors by channel, then run.
        converged: the fit reached a minimum.
    """

    name: str
    added: tuple[str, ...]
    estimates: dict[str, Estimate]
    at_bound: tuple[str, ...]
    errors: dict[str, ChannelError]
    predictions: dict[str, dict[str, np.ndarray]]
    chi2: float
    readings: int
    by_run: dict[str, dict[str, RunError]] = dataclasses.field(default_factory=dict)
    converged: bool = True

    def with_prediction_sd(self, sd: Mapping[str, float]) -> Rung:
        """Return the model with the sd of its prediction of check runs, by channel."""
        errors = {
            name: dataclasses.replace(one, prediction_sd=sd.get(name, one.prediction_sd))
            for name, one in self.errors.items()
        }
        return dataclasses.replace(self, errors=errors)


@dataclasses.dataclass(frozen=True)
class Removed:
    """Reduction of a channel's RMS error, before minus after, in the channel's unit; negative where it rises."""

    fit: float
    check: float


@dataclasses.dataclass(frozen=True)
class NamedEffect:
    """An effect that is named.

    Attributes:
        label: its name, with its column where it has one.
        name: its name.
        column: of a sensor fault, "" for others.
        probability: total probability of the compared models that contain it.
        parameters: its fitted parameters by name.
        cannot_tell_apart_from: effects that explain the readings equally well in its place.
        removes: reduction of the error by channel.
        rests_on: the only run that shows it; "" if several do.
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
    """A correction of a table or relation as a function of one quantity.

    Attributes:
        label: of the candidate.
        port: the corrected relation.
        over: the quantity.
        at: knots, values of the quantity.
        value: correction at the knots; the logarithm if it is a factor.
        sd: of the correction.
        unit: of the correction; "" for the logarithm of a factor.
        removes: reduction of the error by channel.
        stated: the case states the corrected table.
        multiplier: quantity that the value multiplies; "" for 1.
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

    @property
    def relation(self) -> str:
        """Return the corrected relation in words: 'long RC resistance'."""
        return self.port.replace("_", " ").replace("rc ", "RC ")

    def sentence(self) -> str:
        """Say where the correction is most significant, and how large it is there."""
        worst = int(np.argmax(np.abs(self.value) / np.maximum(self.sd, 1e-300)))
        place = f"{'SOC' if self.over == 'soc' else self.over} {self.at[worst]:.3g}"
        name = self.relation
        factor = f" per {self.multiplier}" if self.multiplier else ""
        if not self.unit:
            if abs(self.value[worst]) > np.log(2.0):
                times = np.exp(self.value[worst])
                ends = [np.exp(self.value[worst] + k * self.sd[worst]) for k in (-1.0, 1.0)]
                said = "what the table says" if self.stated else "that of the model"
                return f"{name} is {times:.2g} times ({ends[0]:.2g} to {ends[1]:.2g}) {said} at {place}"
            percent = 100.0 * (np.exp(self.value[worst]) - 1.0)
            return f"{name} is off by {percent:+.0f} % at {place} (sd {100.0 * self.sd[worst]:.0f} %)"
        scale, unit = (1e3, f"m{self.unit}") if self.unit.startswith("V") else (1.0, self.unit)
        return (
            f"{name} is off by {scale * self.value[worst]:+.3g} {unit}{factor} at {place} "
            f"(sd {scale * self.sd[worst]:.2g} {unit})"
        )


@dataclasses.dataclass(frozen=True)
class RunFound:
    """A parameter that differs in one run."""

    label: str
    run: str
    file: str
    parameter: str
    value: float
    sd: float
    unit: str
    removes: dict[str, Removed]


@dataclasses.dataclass(frozen=True)
class SpecimenFound:
    """What one of several like motors or cells has of its own.

    Attributes:
        label: of the difference, 'resistance_difference@left'.
        specimen: as the runs name it.
        name: of the difference, with its column where it has one.
        factor: whether the value is the logarithm of a factor.
        value, sd, unit: of the difference from the other specimens.
        others: specimens of which the same difference was not found; it is from what the case states where none is.
        cannot_tell_apart_from: what explains the readings as well in its place.
        removes: reduction of the error by channel.
    """

    label: str
    specimen: str
    name: str
    factor: bool
    value: float
    sd: float
    unit: str
    others: tuple[str, ...]
    cannot_tell_apart_from: tuple[str, ...]
    removes: dict[str, Removed]


@dataclasses.dataclass(frozen=True)
class Immaterial:
    """A significant candidate that was not added; the sentence says why."""

    name: str
    removes: dict[str, Removed]
    sentence: str


@dataclasses.dataclass(frozen=True)
class Remaining:
    """The remaining error of one channel.

    Attributes:
        rms: on fit runs.
        tau_s: its correlation time.
        where: sentences on where it occurs.
        mostly: the range of a condition that holds most of it, in words; "" for none.
    """

    rms: float
    tau_s: float
    where: tuple[str, ...]
    mostly: str = ""


@dataclasses.dataclass(frozen=True)
class Extrapolated:
    """A condition of a check run that is outside the fit runs."""

    file: str
    condition: str
    span_fitted: tuple[float, float]
    span: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Sensor:
    """The noise of one channel: sd, autocorrelation from reading to reading, source of both, rounding step."""

    sd: float
    rho: float
    source: str
    quantum: float


@dataclasses.dataclass(frozen=True)
class ScoreEntry:
    """One row of the score test at the calibrated base model.

    Attributes:
        label: the candidate.
        z: standard score of its amplitude; its square is the expected drop in chi-square.
        significant: above the critical value for all candidates together.
        blind: the data could not show an effect of its usual size.
    """

    label: str
    z: float
    significant: bool
    blind: bool


@dataclasses.dataclass(frozen=True)
class ToleranceUsed:
    """The acceptable error of a channel on check runs, stated by the case or assumed."""

    rms: float
    largest: float | None
    assumed: bool


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The whole result for one case.

    Attributes:
        case: as it was diagnosed.
        verdict: one of VERDICTS; "" for a comparison.
        effects: the named effects, the one that explains most first.
        candidates: the compared models, with their probability.
        unexplained: what remains unexplained, in words; None if nothing does.
        blind_to: effects that the data could not show.
        noise: by channel.
        ladder: nominal, calibrated, and every model on the way to the final one.
        scores: of all candidates at the calibrated base model.
        critical_z: the score that the largest of all candidates exceeds by chance in one of twenty cases.
        remarks: on the data and the fit.
        curves, specimens, runs, immaterial, remaining, extrapolated, tolerance: see their classes.
        fit_for_purpose: by channel and check run, whether the error is within tolerance.
        where_base: sentences on where the calibrated base model fails, by channel.
        errors: a row for each channel of each run.
        rivals, proposals: models between which the data do not decide, and what to measure to decide.
        law_source: source code of an unknown law as an effect.
        corrections: all curves of the final model; `curves` has those that are told.
        ordered: options with which effects were added or ruled out.
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
    remarks: tuple[Remark, ...]
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
    corrections: tuple[CurveFound, ...] = ()
    ordered: tuple[str, ...] = ()
    specimens: tuple[SpecimenFound, ...] = ()

    @property
    def base(self) -> Rung:
        """Return the calibrated base model."""
        return self.ladder[1]

    @property
    def final(self) -> Rung:
        """Return the final model."""
        return self.ladder[-1]

    @property
    def stays_as_stated(self) -> bool:
        """Return True if the final model is the stated one, because calibration predicts the check runs worse."""
        return len(self.ladder) > 1 and self.final.predictions is self.ladder[0].predictions

    def to_dataframe(self) -> pd.DataFrame:
        """Return the errors by run and channel: model ("base" or "final"), run, split, channel, rms, tolerance."""
        return self.errors

    def summary(self) -> str:
        """Return the verdict and its reasons in a few lines."""
        return late_bound("jaxmodel.diagnosis.summary:whole_summary")(self)

    def answer(self) -> dict[str, Any]:
        """Return the answer in the form of the case contract, ready for JSON."""
        return late_bound("jaxmodel.diagnosis.answer:answer")(self)

    def extended_case(self) -> Case:
        """Return the case with the parameters, effects and tables of the final model."""
        return self.extension[0]

    @functools.cached_property
    def extension(self) -> tuple[Case, list[str]]:
        """Return the extended case, and a sentence for everything that a case cannot hold."""
        extended_case = late_bound("jaxmodel.diagnosis.extended:extended_case")
        return extended_case(self.case, self.final, self.corrections, self.runs)

    @functools.cached_property
    def simulation(self) -> CaseSimulation:
        """Return the simulated runs of the extended case."""
        return simulate_case(self.extended_case())

    @property
    def plot(self) -> DiagnosisPlots:
        """Return the pictures: `plot.ladder()`, `plot.run("name")`, `plot.residuals()` and others."""
        return DiagnosisPlots(self)

    def write(self, folder: str | Path, *, pictures: bool = True) -> Path:
        """Write the result to a folder: `answer.json`, `extended.toml`, `found_law.py` if there is one, and pictures.

        A comparison has `errors.json` and `calibrated.toml` in place of the first two. `read_diagnosis` reads the
        whole again.

        Args:
            folder: made if need be.
            pictures: draws a PNG for each picture.

        Returns:
            The folder.
        """
        late_bound("jaxmodel.diagnosis.extended.files:write_result")(self, Path(folder))
        if pictures:
            self.plot.save(folder)
        return Path(folder)

    def __repr__(self) -> str:
        named = "".join(f" {effect.label}" for effect in self.effects)
        return f"<Diagnosis of {self.case.name}: {self.verdict or 'calibrated'}{named}>"

    def _repr_html_(self) -> str:
        title, *rest = map(html.escape, self.summary().splitlines())
        lines = "".join(f"<li>{line}</li>" for line in rest)
        table = "" if self.errors is None else self.errors.to_html(index=False, border=0, float_format="%.4g")
        return f"<p><b>{title}</b></p><ul>{lines}</ul>{table}"
