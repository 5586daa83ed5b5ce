"""`identify`: how well the fit runs of a case determine its parameters."""

from __future__ import annotations

import dataclasses
import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.progress import Stage, stages
from jaxmodel.base.remark import Remark
from jaxmodel.base.schema import with_schema
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.advice.identifiability import (
    MISFIT,
    Identifiability,
    Profiled,
    calibrated,
    deeper,
    identifiability,
    profile_likelihood,
)
from jaxmodel.diagnosis.answer import findings
from jaxmodel.diagnosis.plotting import IdentificationPlots
from jaxmodel.fit.asked import asking_for
from jaxmodel.fit.cache import FitCache

# A profile can lead to a deeper minimum, from which another one can.
_MOST_RESTARTS = 3


@dataclasses.dataclass(frozen=True, eq=False)
class Identification:
    """How well the fit runs of a case determine its unknowns.

    Attributes:
        found: values, bounds, and the sources of information.
        profiles: likelihood profiles of the requested unknowns.
        remarks: on excluded readings.
    """

    found: Identifiability
    profiles: tuple[Profiled, ...]
    remarks: tuple[Remark, ...]

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each unknown: value, unit, prior and posterior sd, and the share of each run and sensor."""
        found = self.found
        own, others = found.shares_known_before()
        columns: dict[str, Any] = {
            "parameter": found.names,
            "value": found.values,
            "unit": found.units,
            "sd_before": found.prior_sd,
            "assumed": [name in found.assumed for name in found.names],
            "sd": found.sd,
            "sd_of_data_alone": found.sd_of_data,
        }
        columns |= {f"share_of_{run}": part for run, part in zip(found.runs, found.shares_by_run(), strict=True)}
        columns |= {
            f"share_of_{name}": part for name, part in zip(found.sensors, found.shares_by_sensor(), strict=True)
        }
        columns |= {"share_known_before": own, "share_of_others_known_before": others}
        return pd.DataFrame(columns)

    def sd_without(self) -> pd.DataFrame:
        """Return the sd of each unknown with each run, and each sensor, left out in turn."""
        found = self.found
        parts = [("run", found.runs, found.sd_without_run()), ("sensor", found.sensors, found.sd_without_sensor())]
        return pd.DataFrame(
            {"left_out": kind, "name": name, **dict(zip(found.names, row, strict=True))}
            for kind, names, rows in parts
            for name, row in zip(names, rows, strict=True)
        )

    def covariance(self) -> pd.DataFrame:
        """Return the covariance of the estimates, in the products of their units."""
        scale = np.outer(self.found.prior_sd, self.found.prior_sd)
        return pd.DataFrame(self.found.information.covariance * scale, self.found.names, self.found.names)

    def answer(self, name: str) -> str:
        """Say in one sentence whether the data determine a parameter.

        Raises:
            ParameterError: it is not among the unknowns.
        """
        return self.found.answer(name)

    def summary(self) -> str:
        """Return a sentence for each unknown, the undetermined directions, and the profiles."""
        lines = []
        if self.found.misfit > MISFIT:
            lines.append(
                f"The RMS residual is {self.found.misfit:.3g} times the noise; it was treated as model error. Run "
                "`diagnose` to find what the model lacks."
            )
        lines += [self.answer(name) for name in self.found.names]
        return "\n".join([*lines, *self.sentences()])

    def sentences(self) -> list[str]:
        """Return the undetermined directions, the profiles, and remarks on excluded readings, as sentences."""
        lines = [
            f"The data contain less information than the prior: {words} (information {strength:.2g})."
            for strength, words in self.found.sloppy()
        ]
        for one in self.profiles:
            low, high = (f"{end:.5g}" if np.isfinite(end) else "open" for end in one.interval)
            verdict = "wrong" if one.is_not_quadratic else "accurate"
            lines.append(f"Profile of {one.name}: {low} to {high} at one sd; the quadratic approximation is {verdict}.")
        return lines + [f"Note: {remark}" for remark in self.remarks]

    @property
    def plot(self) -> IdentificationPlots:
        """Return the pictures: `plot.information()`, `plot.correlations()`, `plot.profile()` and others."""
        return IdentificationPlots(self)

    def write(self, folder: str | Path, *, pictures: bool = True) -> Path:
        """Write `identify.json`, tables and pictures to a folder, which is made if need be; return it.

        Args:
            folder: made if need be.
            pictures: draws a PNG for each picture.
        """
        out, found = Path(folder), self.found
        out.mkdir(parents=True, exist_ok=True)
        write_whole(out / "identifiability.csv", self.to_dataframe().to_csv(index=False, float_format="%.8g"))
        write_whole(out / "sd-without.csv", self.sd_without().to_csv(index=False, float_format="%.8g"))
        write_whole(out / "covariance.csv", self.covariance().to_csv(float_format="%.12g"))
        content = {
            "case": found.case,
            "misfit": found.misfit,
            "remarks": list(self.remarks),
            "findings": findings(self.remarks),
            "answers": {name: found.answer(name) for name in found.names},
            "asked": [one.name for one in self.profiles],
            "sloppy": [{"information": strength, "told": words} for strength, words in found.sloppy()],
            "correlation": {
                name: dict(zip(found.names, row.tolist(), strict=True))
                for name, row in zip(found.names, found.information.correlation(), strict=True)
            },
            "profiles": [
                {
                    "parameter": one.name,
                    "values": one.values.tolist(),
                    "rise_of_chi2": one.rise.tolist(),
                    "quadratic": one.quadratic.tolist(),
                    "interval": [end if np.isfinite(end) else None for end in one.interval],
                    "quadratic_lies": one.is_not_quadratic,
                }
                for one in self.profiles
            ],
        }
        write_whole(out / "identify.json", json.dumps(with_schema(content), indent=2, ensure_ascii=False) + "\n")
        if pictures:
            self.plot.save(out)
        return out

    def __repr__(self) -> str:
        return f"<Identification of {self.found.case}: {', '.join(self.found.names)}>"

    def _repr_html_(self) -> str:
        table = self.to_dataframe().to_html(index=False, border=0, float_format="{:.4g}".format)
        lines = "".join(f"<li>{html.escape(line)}</li>" for line in self.summary().splitlines())
        return f"{table}<ul>{lines}</ul>"


def identify(
    case: Case,
    parameters: Sequence[str] = (),
    *,
    profiles: Sequence[str] = (),
    add: Sequence[str] = (),
    progress: bool | Stage = True,
) -> Identification:
    """Calibrate a case's model and return how well its fit runs determine every unknown.

    Args:
        case: with at least one fit run.
        parameters: made uncertain if the case states them as exact; their likelihood is profiled.
        profiles: further unknowns whose likelihood is profiled.
        add: effects added to the model, their parameters unknown.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with
            what is done next.

    Raises:
        ParameterError: a name is unknown.
        EffectError: an effect is no candidate of this case.
        FitError: nothing is uncertain, or no run may be used to calibrate.
    """
    with stages(progress, case.name) as say:
        return _identified(case, parameters, profiles, add, say)


def _identified(
    case: Case, parameters: Sequence[str], profiles: Sequence[str], add: Sequence[str], say: Stage
) -> Identification:
    asked_case, assumed = asking_for(case, parameters)
    cache = FitCache(asked_case)
    labels = cache.space.labels_to_add(add)
    say("calibrating")
    model, misfit = calibrated(cache, labels)
    found = identifiability(cache, model, misfit, assumed)
    asked = [found.place(name) for name in dict.fromkeys([*parameters, *profiles])]
    profiled: list[Profiled] = []
    for _ in range(_MOST_RESTARTS):
        say("profiles of the likelihood" if asked else "tables and pictures")
        profiled = [profile_likelihood(cache, model, found.names[i]) for i in asked]
        better = [one for one in (deeper(cache, model, each) for each in profiled) if one is not None]
        if not better:
            break
        model = min(better, key=lambda one: one.objective)
        found = identifiability(cache, model, misfit, assumed)
    return Identification(found, tuple(profiled), cache.preparation)
