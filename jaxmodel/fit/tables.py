"""Corrected tables of a case: its tables or formulas plus the curves of a calibrated model."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.case.known import MotorTable, Table
from jaxmodel.case.records import Case
from jaxmodel.effects.curves import CURVES
from jaxmodel.fit.estimates import CurveAtKnots
from jaxmodel.model import curves as formulas
from jaxmodel.model.cell import cycle_resistance
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.ports import fold, touches

TEMPERATURE_KNOTS = (-30.0, -20.0, -10.0, 0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0)
# Largest error of linear interpolation between points of a table: V of a voltage, a share of everything else.
_TOLERANCE_V, _TOLERANCE_V_PER_K, _TOLERANCE, _TOLERANCE_OF_FACTOR = 5e-5, 1e-7, 3e-4, 1e-5
# States of charge at which a formula is sampled first: the ends of a table, and the kink of the formula.
_FORMULA_SOC = (-0.01, formulas.SOC_FORMULA_FLOOR, 1.05)
_HALVINGS = 7
_DIGITS = 7
# Points of a curve that are computed together.
_BATCH = 1024
# Smallest resistance that is written, where a formula gives none above zero, ohm.
_LEAST = 1e-6


def corrected_tables(
    model: Model, found: Sequence[CurveAtKnots], *, between: bool = True
) -> tuple[dict[str, Table], list[str]]:
    """Return the tables that some curves change, by name, and notes on what they cannot hold.

    Args:
        model: the final model without its curves.
        found: the curves; those that no table holds are skipped.
        between: add points between the knots, where a line between these is not accurate enough.
    """
    by_table: dict[str, list[tuple[float, CurveAtKnots]]] = {}
    for curve in found:
        for table, sign in _tables_of(curve, "cell").items():
            by_table.setdefault(table, []).append((sign, curve))
    tables = {name: _corrected(name, model, curves, _HALVINGS if between else 0) for name, curves in by_table.items()}
    return tables, _notes(model, tables)


def corrected_motor_tables(case: Case, found: Sequence[CurveAtKnots]) -> dict[str, MotorTable]:
    """Return the tables of a motor that some curves change, by name.

    Args:
        case: with the tables that it states.
        found: the curves; those that no table of a motor holds are skipped.
    """
    return {
        table: _motor_table(case.motor_tables.get(table), curve)
        for curve in found
        for table in _tables_of(curve, "motor")
    }


def _tables_of(curve: CurveAtKnots, kind: str) -> Mapping[str, float]:
    """Return the tables of a cell or motor that a curve corrects, with their signs; none for an unknown law."""
    of = CURVES.get(curve.label)
    return of.tables if of is not None and kind in of.kinds else {}


def _motor_table(before: MotorTable | None, curve: CurveAtKnots) -> MotorTable:
    adds = curve.label == "friction_curve"
    stated = before or MotorTable(np.zeros(1), np.full(1, 0.0 if adds else 1.0))

    def values(at: np.ndarray) -> np.ndarray:
        """Return the values of the table, shape (points, 1)."""
        base, off = np.interp(at, stated.at, stated.values), np.interp(at, curve.at, curve.value)
        return (base + off if adds else base * np.exp(off))[:, None]

    at = np.unique(np.concatenate([stated.at, curve.at]))
    at = np.unique(_rounded(at if adds else _refined(at, values, _TOLERANCE_OF_FACTOR, _HALVINGS)))
    sd = float(np.sqrt(np.mean(np.square(curve.sd))))
    return MotorTable(at, _rounded(values(at)[:, 0]), sd if np.isfinite(sd) and sd > 0.0 else None)


def _corrected(name: str, model: Model, found: Sequence[tuple[float, CurveAtKnots]], halvings: int) -> Table:
    adds = name in ("ocv", "dU_dT")
    base = getattr(model.curves, name) or formulas.Table([0.0, 1.0], [0.0, 0.0])
    ageing = float(_cycle_resistance(model)) if name == "R_ints" else 0.0
    sample = _sampler(base)

    def values(soc: np.ndarray, temperature_degC: np.ndarray) -> np.ndarray:
        """Return the values of the table, shape (temperature, soc)."""
        off = sum(sign * np.interp(soc, curve.at, curve.value)[None, :] for sign, curve in found)
        before = sample(soc, temperature_degC)
        return before + off if adds else np.maximum((before + ageing) * np.exp(off) - ageing, _LEAST)

    soc = _start_of_soc(base, [curve for _, curve in found])
    temperature = _start_of_temperature(base, sample)
    limit = {"ocv": _TOLERANCE_V, "dU_dT": _TOLERANCE_V_PER_K}.get(name)
    # As they are written: knots that differ in no written digit are one.
    soc = np.unique(_rounded(_refined(soc, lambda x: values(x, temperature).T, limit, halvings)))
    if temperature.size > 1:
        temperature = np.unique(_rounded(_refined(temperature, lambda x: values(soc, x), limit, halvings)))
    held = _rounded(values(soc, temperature))
    sd = float(np.sqrt(sum(np.mean(np.square(curve.sd)) for _, curve in found)))
    one_row = temperature.size == 1
    return Table(
        soc=soc,
        values=held[0] if one_row else held,
        temperature_degC=None if one_row else temperature,
        sd=sd if np.isfinite(sd) and sd > 0.0 else None,
    )


def _cycle_resistance(model: Model) -> jax.Array:
    """Return R_cyc in ohm; a curve of the series resistance scales it too."""
    context = SimpleNamespace(parameters=model.parameters)
    return jnp.asarray(fold(model.effects, "cycle_resistance", cycle_resistance(model.parameters.cycles), context))


def _sampler(curve: formulas.Curve) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """Return a function of states of charge and of temperatures that gives the curve's values at both.

    The points are in batches of one size: JAX compiles the curve once, and not for each number of knots.
    """

    def sample(soc: np.ndarray, temperature_degC: np.ndarray) -> np.ndarray:
        at_temperature, at_soc = (grid.ravel() for grid in np.meshgrid(temperature_degC, soc, indexing="ij"))
        padded = np.stack([np.resize(at, -(-at.size // _BATCH) * _BATCH) for at in (at_soc, at_temperature)])
        found = [_at_batch(curve, jnp.asarray(batch)) for batch in np.split(padded, padded.shape[1] // _BATCH, axis=1)]
        return np.concatenate(found)[: at_soc.size].reshape(temperature_degC.size, soc.size)

    return sample


@eqx.filter_jit
def _at_batch(curve: formulas.Curve, points: jax.Array) -> jax.Array:
    """Return the values of a curve at points (SOC; degC), shape (points,)."""
    return jax.vmap(curve)(*points)


def _start_of_soc(base: formulas.Curve, found: Sequence[CurveAtKnots]) -> np.ndarray:
    own = np.asarray(base.soc) if isinstance(base, formulas.Table) else np.array(_FORMULA_SOC)
    return np.unique(np.concatenate([own, *(np.asarray(curve.at, dtype=float) for curve in found)]))


def _start_of_temperature(base: formulas.Curve, sample: Callable) -> np.ndarray:
    """Return initial temperatures; a single one if nothing depends on temperature."""
    if isinstance(base, formulas.Table):
        own = np.asarray(base.temperature_degC) if base.values.shape[0] > 1 else np.zeros(0)
    else:
        knots = np.array(TEMPERATURE_KNOTS)
        own = knots if np.ptp(sample(np.array([0.5]), knots)) > 0.0 else np.zeros(0)
    return np.unique(own) if own.size else np.array([formulas.Table([0.0], [0.0]).temperature_degC[0]])


def _refined(
    knots: np.ndarray, values: Callable[[np.ndarray], np.ndarray], limit: float | None, halvings: int
) -> np.ndarray:
    """Return knots, including those given, between which linear interpolation is accurate enough.

    Args:
        knots: initial ones, increasing.
        values: at knots, shape (knots, columns).
        limit: largest error; None for a share of the value.
        halvings: of the distance between knots at most.
    """
    for _ in range(halvings):
        middle, at = 0.5 * (knots[1:] + knots[:-1]), values(knots)
        straight = 0.5 * (at[1:] + at[:-1])
        allowed = np.full_like(straight, limit) if limit else _TOLERANCE * np.abs(straight)
        off = np.any(np.abs(values(middle) - straight) > np.maximum(allowed, 1e-12), axis=1)
        if not off.any():
            break
        knots = np.sort(np.concatenate([knots, middle[off]]))
    return knots


def _rounded(values: np.ndarray) -> np.ndarray:
    return np.array([float(f"{value:.{_DIGITS}g}") for value in values.ravel()]).reshape(values.shape)


def _notes(model: Model, by_table: Mapping[str, Table]) -> list[str]:
    """Return notes on tables that differ from their curves."""
    notes = []
    adding = [effect.label for effect in model.effects if effect.name in ("contact_heating", "contact_drift")]
    if "R_ints" in by_table and adding and touches(model.effects, "series_resistance"):
        notes.append(f"R_ints contains its curve, which here does not scale what {' and '.join(adding)} adds.")
    return notes
