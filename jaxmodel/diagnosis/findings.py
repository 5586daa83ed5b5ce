"""Curves, unknown laws and shifts of single runs in the final model."""

from __future__ import annotations

import numpy as np

from jaxmodel.diagnosis.result import CurveFound, Estimate, Removed, RunFound, Rung, SpecimenFound
from jaxmodel.effects.curves import Curve
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimate import Fit
from jaxmodel.fit.estimates import free_curves, values_of
from jaxmodel.fit.laws import PORTS


def curve_found(cache: FitCache, fit: Fit, label: str, removes: dict[str, Removed]) -> CurveFound:
    """Return the correction of a table or relation at its knots."""
    candidate = cache.space.candidates[label]
    effect = candidate.effect
    assert isinstance(effect, Curve)
    values, sd = values_of(cache, fit, label)
    return CurveFound(
        label, candidate.port if label != "entropy_curve" else "entropy_coefficient", candidate.over,
        effect.knots, values, sd, effect.unit, removes, candidate.stated,
    )  # fmt: skip


def all_curves(cache: FitCache, fit: Fit) -> tuple[CurveFound, ...]:
    """Return every curve of a model that is not held at nothing, in the order in which the model has them."""
    return tuple(curve_found(cache, fit, label, {}) for label in free_curves(cache, fit))


def law_found(cache: FitCache, fit: Fit, label: str, removes: dict[str, Removed]) -> CurveFound:
    """Return a fitted unknown law at its knots."""
    candidate = cache.space.candidates[label]
    assert candidate.law is not None
    low, high = candidate.law[1][-4], candidate.law[1][-3]
    values, sd = values_of(cache, fit, label)
    factor = candidate.law[1][-1] if candidate.multiplier else 1.0
    at = np.linspace(low, high, values.size)
    unit = {"torque_constant": "N m/A", "motor_loss": "W", "cell_heat": "W"}.get(candidate.port, "")
    unit = unit or ("V" if candidate.port in ("overpotential", "bridge_voltage") else "")
    unit = unit or ("N m" if candidate.port == "load_torque" else "A")
    return CurveFound(
        label, candidate.port, candidate.over, at, factor * values, factor * sd, unit, removes, False,
        candidate.multiplier,
    )  # fmt: skip


def unknown_sentence(curve: CurveFound) -> str:
    """Say where a law acts, and how it depends on its variable."""
    equation = next((ports[curve.port][2] for ports in PORTS.values() if curve.port in ports), curve.port)
    factor = f" proportional to {curve.multiplier}" if curve.multiplier else ""
    turns = np.diff(curve.value)
    unit = f" {curve.unit}" if curve.unit else ""
    if np.all(turns >= 0.0) or np.all(turns <= 0.0):
        shape = f"{'rising' if turns.sum() > 0 else 'falling'} by {abs(curve.value[-1] - curve.value[0]):.3g}{unit}"
    else:
        shape = f"between {curve.value.min():.3g} and {curve.value.max():.3g}{unit}"
    return (
        f"the remaining error acts on {equation.replace('_', ' ')}{factor} as a function of {curve.over}, {shape} over "
        f"{curve.at.min():.3g} to {curve.at.max():.3g}"
    )


def run_found(cache: FitCache, fit: Fit, last: Rung, label: str, removes: dict[str, Removed]) -> RunFound:
    """Return the shift of a parameter in one run."""
    candidate = cache.space.candidates[label]
    run = cache.case.runs[candidate.run]
    coordinate = candidate.coordinates[0]
    estimate = last.estimates.get(f"{coordinate.name}[{run.name}]", Estimate(np.nan, np.nan, ""))
    names = {"contact_resistance": "series_resistance_ohm", "friction_shift": "friction_torque_Nm"}
    parameter = names.get(candidate.effect.name, candidate.effect.label)
    return RunFound(label, run.name, run.file, parameter, estimate.value, estimate.sd, estimate.unit, removes)


def specimen_found(
    cache: FitCache, last: Rung, label: str, rivals: tuple[str, ...], removes: dict[str, Removed]
) -> SpecimenFound:
    """Return what one specimen has of its own."""
    candidates = cache.space.candidates
    one = candidates[label]
    found = last.estimates.get(f"{one.coordinates[0].name}[{one.specimen}]", Estimate(np.nan, np.nan, ""))
    alike = {
        candidates[other].specimen for other in last.added if candidates[other].effect.label == one.effect.label
    } | {name for name, own in cache.case.specimens.items() if one.effect.name in own.effects}
    others = tuple(name for name in cache.case.specimens if name not in alike)
    return SpecimenFound(
        label, one.specimen, one.effect.label, not one.effect.is_sensor, found.value, found.sd, found.unit, others,
        rivals, removes,
    )  # fmt: skip
