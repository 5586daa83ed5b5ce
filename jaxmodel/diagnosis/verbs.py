"""`compare` and `diagnose` as a user calls them: with progress that is shown, told, or left out."""

from __future__ import annotations

from collections.abc import Sequence

from jaxmodel.base.progress import Stage, stages
from jaxmodel.case.records import Case
from jaxmodel.diagnosis import diagnosis
from jaxmodel.diagnosis.result import Diagnosis

# Usual share of the work that is done when each part of a diagnosis starts. Assumed; the number of rounds varies.
DONE_BY = {"calibrating": 0.0, "refitting": 0.35, "adding": 0.5, "comparing models": 0.85}


def compare(case: Case, *, progress: bool | Stage = True) -> Diagnosis:
    """Calibrate a case's model and compare it with the measurements, without testing any candidate.

    Args:
        case: with at least one fit run.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with what is
            done next.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
    """
    with stages(progress, case.name) as tell:
        return diagnosis.compare(case, progress=tell)


def diagnose(
    case: Case,
    *,
    add: Sequence[str] = (),
    with_effects: Sequence[str] = (),
    without: Sequence[str] = (),
    progress: bool | Stage = True,
) -> Diagnosis:
    """Find which physical effect or sensor fault a case's model lacks, which tables are wrong, and what error remains.

    Args:
        case: with at least one fit run.
        add: names of effects that are added whatever the data show; no other candidate is tested.
        with_effects: the same, but other candidates are tested too.
        without: names of effects that are ruled out.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with what is
            done next.

    Raises:
        FitError: nothing is uncertain, or no run may be used to calibrate.
        EffectError: a name that is no candidate of this case, or a sensor's effect without its column.
    """
    with stages(progress, case.name, DONE_BY) as tell:
        return diagnosis.diagnose(case, add=add, with_effects=with_effects, without=without, progress=tell)
