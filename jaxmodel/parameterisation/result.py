"""The result of a parameterisation: numbers with sd and origin, the case that holds them, and what is missing."""

from __future__ import annotations

import dataclasses
import functools
import html
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.in_short import InShort
from jaxmodel.base.remark import Remark
from jaxmodel.case.records import Case
from jaxmodel.case.simulation import CaseSimulation, simulate_case
from jaxmodel.parameterisation.plotting import ParameterisationPlots


@dataclasses.dataclass(frozen=True)
class Extraction(InShort):
    """One number, and where it comes from.

    Attributes:
        name: as in case.toml; a table's name with where it is read: `R_ints at SOC 0.5, 25 degC`.
        value: in its unit; NaN where there is none.
        sd: standard deviation, model misfit included; NaN where it is not known.
        unit: "" for a pure number.
        runs: the runs it was extracted from.
        samples: which readings of them.
        method: how.
        found: False where the data do not give it: then `method` says where the number comes from.
        test: a test that would give it, where it was not found.
    """

    name: str
    value: float
    sd: float
    unit: str
    runs: tuple[str, ...]
    samples: str
    method: str
    found: bool = True
    test: str = ""

    def sentence(self) -> str:
        """Say the number, its sd and its origin."""
        unit = f" {self.unit}" if self.unit else ""
        name = f"{self.name} = {self.value:.5g}{unit}" if math.isfinite(self.value) else self.name
        spread = f" ± {self.sd:.2g}" if math.isfinite(self.sd) else ""
        if not self.found:
            return f"{name}: not in this data: {self.method}. {self.test}".rstrip()
        origin = f", from {', '.join(self.runs)}" if self.runs else ""
        return f"{self.name} = {self.value:.5g}{spread}{unit}: {self.method}{origin} ({self.samples})."


def absent(name: str, value: float, unit: str, taken_from: str, test: str, sd: float = math.nan) -> Extraction:
    """Return an extraction that the data do not give.

    Args:
        name: of the number.
        value: that is used.
        unit: of it.
        taken_from: where the value comes from.
        test: a sentence: which test would give it.
        sd: of the value.
    """
    return Extraction(name, value, sd, unit, (), "", f"taken from {taken_from}", found=False, test=test)


@dataclasses.dataclass(frozen=True, eq=False)
class Parameterisation:
    """First parameters of a case from its fit runs.

    Attributes:
        case: with the parameters, tables, effects and sensors found; its check runs were not used.
        extractions: every number.
        points: by extraction, the readings it was made from: `rests`, `resistance`, `relaxation`, `slow`, `thermal`,
            `electrical`, `friction`; each a table with a row for each point.
        remarks: on the data and the fit.
    """

    case: Case
    extractions: tuple[Extraction, ...]
    points: Mapping[str, pd.DataFrame]
    remarks: tuple[Remark, ...] = ()

    @functools.cached_property
    def simulation(self) -> CaseSimulation:
        """Return the forward simulation of every run by the parameterised case."""
        return simulate_case(self.case)

    @functools.cached_property
    def errors(self) -> pd.DataFrame:
        """Return the RMS error of the forward simulation: a row for each reading of each run.

        `rms` is over all readings, `rms_to_soc_0.1` over those above a counted state of charge of 0.1; rows after the
        end of a simulation are left out, and `share` is the share of the readings that are left.
        """
        rows = []
        for one in self.simulation:
            outputs, table = one.run.measured.outputs, one.table
            soc = table["soc"].to_numpy() if "soc" in table else np.ones(len(table))
            for name, read in outputs.items():
                if name not in table or name == "soc":
                    continue
                left = read - table[name].to_numpy()
                there, high = np.isfinite(left), np.isfinite(left) & (soc >= 0.1)
                rows.append(
                    {
                        "run": one.run.name,
                        "split": one.run.split,
                        "reading": name,
                        "rms": _rms(left[there]),
                        "rms_to_soc_0.1": _rms(left[high]),
                        "share": float(there.sum() / max(np.isfinite(read).sum(), 1)),
                    }
                )
        return pd.DataFrame(rows)

    def __getitem__(self, name: str) -> Extraction:
        """Return the first extraction of a name.

        Raises:
            KeyError: there is none.
        """
        for one in self.extractions:
            if one.name == name:
                return one
        raise KeyError(name)

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each number: name, value, sd, unit, found, runs, samples, method, test."""
        rows = [dataclasses.asdict(one) | {"runs": ", ".join(one.runs)} for one in self.extractions]
        return pd.DataFrame(rows)

    def summary(self) -> str:
        """Return a line for each number, what is not in the data, and remarks."""
        found = [one.sentence() for one in self.extractions if one.found]
        missing = [one.sentence() for one in self.extractions if not one.found]
        notes = [f"Note: {remark}" for remark in self.remarks]
        return "\n".join([f"{self.case.title}: {len(found)} numbers from the data", *found, *missing, *notes])

    @property
    def plot(self) -> ParameterisationPlots:
        """Return the pictures: `plot.all()`, `plot.extraction("rests")`, `plot.curves("ocv")`, `plot.run("name")`."""
        return ParameterisationPlots(self)

    def write(self, folder: str | Path, *, pictures: bool = True) -> Path:
        """Write `case.toml` with a CSV for each run, `extractions.csv`, `errors.csv`, and pictures; return the folder.

        Raises:
            MeasurementError: the folder is the one that the case was read from.
        """
        folder = Path(folder)
        self.case.write(folder)
        write_whole(folder / "extractions.csv", self.to_dataframe().to_csv(index=False))
        write_whole(folder / "errors.csv", self.errors.to_csv(index=False))
        if pictures:
            self.plot.save(folder)
        return folder

    def __repr__(self) -> str:
        found = sum(one.found for one in self.extractions)
        return (
            f"<Parameterisation of {self.case.name}: {found} numbers, {len(self.extractions) - found} not in the data>"
        )

    def _repr_html_(self) -> str:
        table = self.to_dataframe()[["name", "value", "sd", "unit", "found", "runs", "method"]]
        title = f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>"
        return title + table.to_html(index=False, border=0, float_format="{:.4g}".format)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan
