"""The extended case of a diagnosis: calibrated parameters, effects and corrected tables."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from jaxmodel.case.known import Known
from jaxmodel.case.records import Case, Run
from jaxmodel.diagnosis.result import CurveFound, RunFound, Rung
from jaxmodel.diagnosis.wording import effect_name, is_law, run_sentence
from jaxmodel.fit.fitted_case import FittedNumbers, fitted_case
from jaxmodel.model.parameters import info

# Shifts of single runs that a case file can hold, and the parameter that holds them.
_HELD_BY_A_RUN = {"friction_shift": "tau_0"}


def extended_case(
    case: Case, final: Rung, curves: Sequence[CurveFound] = (), found_runs: Sequence[RunFound] = ()
) -> tuple[Case, list[str]]:
    """Return the case with the final model's parameters, effects and tables, each with its sd; and notes on the rest.

    Parameters fitted outside their bounds are moved to the bound. A case file holds one effect of each name, so that of
    two faults of one kind on two columns the first is kept. It can hold no unknown law and few
    shifts of single runs. The notes state every such change.

    Args:
        case: as it was diagnosed.
        final: the model.
        curves: its corrections of tables and relations.
        found_runs: its shifts of single runs.
    """
    fitted = FittedNumbers(final.estimates)
    added = [label for label in final.added if "@" not in label and not is_law(label)]
    differ = [label for label in final.added if "@" in label and label.partition("@")[2] in case.specimens]
    extended, notes = fitted_case(case, fitted, added, curves, differ=differ)
    shifted = {run.label: run for run in found_runs}
    runs = list(extended.runs)
    for label in (label for label in final.added if "@" in label and label not in differ):
        if label in shifted and label.partition("@")[0] in _HELD_BY_A_RUN:
            runs = [_shifted(run, shifted[label], extended.parameters, fitted) for run in runs]
        else:
            described = run_sentence(shifted[label]) if label in shifted else f"{effect_name(label)}."
            fitted.notes.append(f"A case file cannot hold this shift of a single run: {described}")
    notes += [
        f"{effect_name(label)} is left out: it is an effect in found_law.py; give --effect found_law.py:FoundLaw."
        for label in final.added
        if is_law(label)
    ]
    return dataclasses.replace(extended, runs=tuple(runs)), [*fitted.notes, *notes]


def _shifted(run: Run, found: RunFound, parameters: Mapping[str, Known], fitted: FittedNumbers) -> Run:
    """Return the run with its shift, if it is the run that was found."""
    if run.name != found.run or not np.isfinite(found.value):
        return run
    name = _HELD_BY_A_RUN[found.label.partition("@")[0]]
    entry = info(name)
    before = run.overrides.get(name) or parameters.get(name) or Known(float(entry.default))
    sd = float(np.hypot(before.sd or 0.0, found.sd if np.isfinite(found.sd) else 0.0))
    now = Known(fitted.bounded(f"{name}[{run.name}]", before.value + found.value, entry), sd or None)
    return dataclasses.replace(run, overrides=run.overrides | {name: now})
