"""Robots of the user's own: models read from case files, and packs with cells in parallel."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import case_model
from jaxmodel.case.reading import read_case
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.names import with_values


def read_robots(paths: Iterable[str | Path]) -> dict[str, Model]:
    """Read the models of robots from their cases, by the names of the cases' folders.

    Raises:
        UserError: a case cannot be used, is of another kind, or has the name of another.

    Example:
        >>> from jaxmodel.operation import read_robots
        >>> list(read_robots(["examples/paper_table1"]))
        ['paper_table1']
    """
    models: dict[str, Model] = {}
    for path in paths:
        case = read_case(Path(path))
        if case.kind != "robot":
            raise MeasurementError(f"{path}: this needs a case of kind robot, and this one is of kind {case.kind}.")
        if case.name in models:
            raise MeasurementError(f"Two of the models are called '{case.name}'; rename the folder of one of them.")
        models[case.name] = case_model(case)
    return models


def cells_in_parallel(model: Model, count: float) -> Model:
    """Return a model whose pack has `count` times the cells in parallel.

    The current is shared: `count` times the capacity and the RC capacitances, the resistances divided by `count`.

    Example:
        >>> from jaxmodel import Model
        >>> from jaxmodel.operation import cells_in_parallel
        >>> float(cells_in_parallel(Model("robot"), 2.0).parameters.capacity_Ah)
        10.4
    """
    p = model.parameters
    return with_values(
        model,
        {
            "capacity_Ah": p.capacity_Ah * count,
            "series_resistance_scale": p.series_resistance_scale / count,
            "rc_resistance_scale": p.rc_resistance_scale / count,
            "rc_capacitance_scale": p.rc_capacitance_scale * count,
        },
    )
