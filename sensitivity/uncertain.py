"""How uncertain parameters are: as a study's case states it, or as `jaxmodel identify` found it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd

from jaxmodel.base.errors import SweepError
from jaxmodel.base.in_short import InShort
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Case
from jaxmodel.sweeps.study import Study


@dataclasses.dataclass(frozen=True, repr=False)
class Estimates(InShort):
    """Estimated parameters.

    Attributes:
        values: by name, in the parameter's unit.
        sd: standard deviations by name, in the same order.
        correlation: of the estimates, shape (parameters, parameters), in that order.

    Example:
        >>> import numpy as np
        >>> from jaxmodel.sensitivity import Estimates
        >>> values, sd = {"capacity_Ah": 3.0, "cycles": 100.0}, {"capacity_Ah": 0.03, "cycles": 20.0}
        >>> found = Estimates(values, sd, np.array([[1.0, 0.4], [0.4, 1.0]]))
        >>> found.sd["capacity_Ah"]
        0.03
    """

    values: dict[str, float]
    sd: dict[str, float]
    correlation: np.ndarray


def stated_sd(study: Study) -> dict[str, float]:
    """Return the standard deviations that the study's case states of parameters, by name.

    Raises:
        SweepError: the study names no case, or its case states no sd.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> study = sweeps.Study(case="examples/samsung_30q", profile=profile, axes={"cycles": [0.0]})
        >>> sensitivity.stated_sd(study)["capacity_Ah"]
        0.03
    """
    if study.case is None:
        raise SweepError("uncertain: the study names no case; state a standard deviation by name, as in NAME=SD.")
    case = study.case if isinstance(study.case, Case) else read_case(study.folder / study.case)
    parameters = case.parameters
    found = {name: float(stated.sd) for name, stated in parameters.items() if stated.sd}
    if not found:
        raise SweepError(f"uncertain: {case.label} states no sd of a parameter; state it by name, as in NAME=SD.")
    return found


def read_estimates(folder: str | Path) -> Estimates:
    """Read the estimates that `jaxmodel identify` wrote.

    What belongs to one run of the case (an initial state of charge) is left out: the correlations of the others hold
    for any value of it.

    Raises:
        SweepError: the folder holds no such results.
    """
    folder = Path(folder)
    if not (folder / "covariance.csv").exists():
        raise SweepError(
            f"uncertain: {folder} holds no results of identify; name a folder that does, or write NAME=SD or case."
        )
    covariance = pd.read_csv(folder / "covariance.csv", index_col=0)
    names = [str(name) for name in covariance.index if "[" not in str(name)]
    matrix = covariance.loc[names, names].to_numpy(dtype=float)
    sd = np.sqrt(np.diag(matrix))
    values = pd.read_csv(folder / "identifiability.csv", index_col="parameter").loc[names, "value"]
    return Estimates(
        values=dict(zip(names, map(float, values), strict=True)),
        sd=dict(zip(names, map(float, sd), strict=True)),
        correlation=matrix / np.outer(sd, sd),
    )
