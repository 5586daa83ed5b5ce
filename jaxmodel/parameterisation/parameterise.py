"""First parameters of a case from its fit runs alone."""

from __future__ import annotations

import dataclasses

from threadpoolctl import threadpool_limits

from jaxmodel.base.progress import Stage, stages
from jaxmodel.case.outliers import without_outliers
from jaxmodel.case.records import Case
from jaxmodel.parameterisation.cell import parameterise_cell
from jaxmodel.parameterisation.motor import parameterise_motor
from jaxmodel.parameterisation.result import Parameterisation
from jaxmodel.parameterisation.robot import parameterise_robot
from jaxmodel.parameterisation.rounding import rounded


# The matrices are small: on busy cores a second thread of BLAS makes each product wait.
@threadpool_limits.wrap(limits=1, user_api="blas")
def parameterise(case: Case, *, progress: bool | Stage = True) -> Parameterisation:
    """Extract first parameters, with sd, from the fit runs of a case.

    What the case states as exact is kept; what it states with an sd is a first guess. Check runs are never used: the
    forward simulation of the result shows their error.

    Args:
        case: from `jaxmodel.read_case` or `jaxmodel.Case.from_dataframes`; it needs runs and a kind only.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with
            each stage.

    Returns:
        Numbers with sd and origin, the case that holds them, and what the data do not give.

    Raises:
        FitError: the fit runs lack readings without which nothing can be extracted.
    """
    kinds = {"cell": parameterise_cell, "motor": parameterise_motor, "robot": parameterise_robot}
    usable, remarks = without_outliers(case)
    with stages(progress, case.name) as tell:
        found = kinds[case.kind](usable, tell)
    read = {run.name: run.measured for run in case.runs}
    # The case that is handed on holds what was read: what follows tells of outliers itself.
    runs = tuple(dataclasses.replace(run, measured=read[run.name]) for run in found.case.runs)
    better = rounded(dataclasses.replace(found.case, runs=runs))
    return dataclasses.replace(found, case=better, remarks=(*remarks, *found.remarks))
