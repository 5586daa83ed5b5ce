"""Numbers of which someone asks what the readings say, though the case states them as exact."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from jaxmodel.base.errors import ParameterError, instead
from jaxmodel.case.build import case_model
from jaxmodel.case.known import Known
from jaxmodel.case.records import Case
from jaxmodel.model.names import parameter_table, value
from jaxmodel.model.parameters import TABLE, info

# Prior sd assumed for a requested parameter that the case states as exact, as a share of its value,
_ASSUMED_SHARE = 0.3
_ASSUMED_RANGE_SHARE = 0.1  # or as a share of its range if the value is zero


def asking_for(case: Case, names: Sequence[str]) -> tuple[Case, tuple[str, ...]]:
    """Return the case with an sd for requested parameters that it states as exact, and the names of these.

    The assumed sd is 30 % of the value, or a tenth of the range if the value is zero.

    Raises:
        ParameterError: a name is unknown.
    """
    changed: dict[str, Known] = {}
    for name in names:
        if name not in TABLE:
            known = parameter_table(case_model(case, case.runs[0]))
            raise ParameterError(f"{case.label}: no parameter is called '{name}'.{instead(name, [*known])}")
        stated = case.parameters.get(name)
        in_runs = name == "initial_soc" or any(name in run.overrides and run.overrides[name].sd for run in case.runs)
        if in_runs or (stated is not None and stated.sd is not None):
            continue
        known = info(name)
        number = float(stated.value if stated is not None else value(case_model(case, case.runs[0]), name))
        width = known.upper - known.lower
        sd = _ASSUMED_SHARE * abs(number) or (_ASSUMED_RANGE_SHARE * width if np.isfinite(width) else 1.0)
        changed[name] = Known(number, sd)
    return dataclasses.replace(case, parameters=case.parameters | changed), tuple(changed)
