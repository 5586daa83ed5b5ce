"""What an investigation says: models and their errors, effects, curves, single runs, and the answer file."""

from __future__ import annotations

import dataclasses
import functools
import html
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from discrepancy.plotting import DiagnosisPlots
from jaxmodel.case import Case
from jaxmodel.case_simulation import CaseSimulation, simulate_case

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
        """Return the errors by run and channel: model ("base" or "final"), run, split, channel, rms, tolerance."""
        return self.errors

    def summary(self) -> str:
        """Return the verdict and what it rests on in a few lines."""
        from discrepancy.summary import summary
        from discrepancy.wording import verdict_sentence

        return "\n".join([verdict_sentence(self), *summary(self), *(f"Note: {remark}" for remark in self.remarks)])

    def answer(self) -> dict[str, Any]:
        """Return the answer in the form of the case contract, ready for JSON."""
        from discrepancy.answer import answer

        return answer(self)

    def extended_case(self) -> Case:
        """Return the case with the final model's numbers, effects and tables: it simulates, sweeps, is investigated."""
        return self._extended[0]

    @functools.cached_property
    def _extended(self) -> tuple[Case, list[str]]:
        from discrepancy.extended import extended_case

        return extended_case(self.case, self.final, self.curves, self.runs)

    @functools.cached_property
    def simulation(self) -> CaseSimulation:
        """Return the runs of the extended case as its model gives them."""
        return simulate_case(self.extended_case())

    @property
    def plot(self) -> DiagnosisPlots:
        """Return the pictures: `plot.ladder()`, `plot.run("name")`, `plot.residuals()` and others."""
        return DiagnosisPlots(self)

    def write(self, folder: str | Path, *, pictures: bool = True) -> Path:
        """Write the result to a folder: `answer.json`, `extended.toml`, `found_law.py` if there is one, and pictures.

        A comparison has `errors.json` and `calibrated.toml` in place of the first two.

        Args:
            folder: made if need be.
            pictures: draws a PNG for each picture.

        Returns:
            The folder.
        """
        from discrepancy.extended.files import write_result

        write_result(self, Path(folder))
        if pictures:
            self.plot.save(folder)
        return Path(folder)

    def __repr__(self) -> str:
        named = "".join(f" {effect.label}" for effect in self.effects)
        return f"<Diagnosis of {self.case.name}: {self.verdict or 'calibrated'}{named}>"

    def _repr_html_(self) -> str:
        lines = "".join(f"<li>{html.escape(line)}</li>" for line in self.summary().splitlines()[1:])
        title = html.escape(self.summary().partition("\n")[0])
        table = "" if self.errors is None else self.errors.to_html(index=False, border=0, float_format="%.4g")
        return f"<p><b>{title}</b></p><ul>{lines}</ul>{table}"
