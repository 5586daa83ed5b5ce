"""How warm a motor is when its run begins, by thermometers that differ from ambient by more than they may."""

from __future__ import annotations

import numpy as np

from jaxmodel.data.importing.findings import Decision
from jaxmodel.data.importing.logs import Log

# Two thermometers at one temperature may differ by this much (assumed); the model then begins at ambient.
_THERMOMETERS_DIFFER_K = 2.0
_FIRST_ROWS = 5


def rises_of(run: Log, ambient_degC: float | None) -> dict[str, float]:
    """Return the first temperatures of a motor that is warm or cold when its run begins, as a case states them.

    Its case above ambient and its winding above its case [K]. Where only the winding has a thermometer, the case is
    taken as warm as the winding, which comes to the temperature of the case in minutes of rest.

    Args:
        run: of a motor or robot.
        ambient_degC: constant ambient temperature; None where it is a column.
    """
    case, winding = (_first(run, f"{part}_temperature_degC") for part in ("case", "winding"))
    around = _first(run, "ambient_degC") if ambient_degC is None else ambient_degC
    if around is None or (case is None and winding is None):
        return {}
    body = winding if case is None else case
    assert body is not None
    found = {"initial_case_rise_K": body - around}
    if case is not None and winding is not None:
        found["initial_winding_rise_K"] = winding - case
    return {name: round(rise, 3) for name, rise in found.items() if abs(rise) > _THERMOMETERS_DIFFER_K}


def told(run: Log, rises: dict[str, float]) -> Log:
    """Return a run that says how warm it begins."""
    return run.also(
        *(Decision(name, run.name, f"{rise:.3g} K", "by its first readings", "file") for name, rise in rises.items())
    )


def _first(run: Log, name: str) -> float | None:
    values = run.columns.get(name, np.zeros(0))[:_FIRST_ROWS]
    there = values[np.isfinite(values)]
    return float(there[0]) if there.size else None
