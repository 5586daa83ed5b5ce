"""The laws that could explain what a calibrated model leaves: on a channel, and where one does, in the equations."""

from __future__ import annotations

import numpy as np

from discrepancy.conditions import conditions
from discrepancy.equations import equation_laws
from discrepancy.hypothesis import Hypothesis
from discrepancy.misfit import Block, Leftover, deficiency_map, strongest_first
from discrepancy.screen import Screen
from discrepancy.session import Session


def leftover_laws(
    session: Session, hypothesis: Hypothesis, screened: Screen, beside: Hypothesis | None = None
) -> list[Block]:
    """Return every law tried beside a calibrated model, strongest first.

    Equations are asked only where a channel shows that something is left: what no channel shows, no equation lacks.

    Args:
        session: in which the model is fitted.
        hypothesis: the model.
        screened: its scores.
        beside: a model, with the effects of this one and more, beside which laws were tried: it shares its program.
    """
    problem = hypothesis.problem
    counted = np.asarray(problem.readings.fit) > 0.0
    leftover = Leftover(
        screened.base, screened.residual, np.asarray(problem.readings.index)[counted] % len(problem.channels)
    )

    numbers = np.flatnonzero(counted)

    def whitened(columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return problem.readings.some(numbers[rows]).whiten(columns.T).T

    variables = conditions(session, hypothesis)
    factors = [next((name for name in variables if name.endswith("current_A")), None), "load_torque_Nm"]
    blocks = deficiency_map(
        leftover,
        problem.channels,
        whitened,
        {name: values for name, values in variables.items() if name != "run"},
        {"": np.ones(counted.sum())} | {name: variables[name] for name in factors if name in variables},
    )
    if not any(block.significant for block in blocks):
        return blocks
    in_equations = equation_laws(session, hypothesis, leftover, beside or hypothesis)
    return strongest_first([*blocks, *in_equations], int(counted.sum()))
