"""The model of a case as an estimator of its charge uses it: at a given temperature, its voltage rising with charge."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import isotonic_regression

from jaxmodel.model.curves import Table
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.ports import touches


def for_estimation(model: Model) -> Model:
    """Return a cell's model as the filters use it: without heating of its own, and with V_oc rising with the charge.

    The temperature of a row is that of the cell, so that effects on the port `cell_temperature` would count its heat
    twice. A table of the open-circuit voltage is replaced by the nearest one that nowhere falls (isotonic least
    squares, weighted by the charge between knots): in equilibrium dV_oc/dSOC >= 0, and where a fitted table falls, one
    voltage would mean two charges.

    Args:
        model: of kind "cell".

    Example:
        >>> from jaxmodel import operation, preset_model
        >>> operation.for_estimation(preset_model("samsung_30q", "cell")).kind
        'cell'
    """
    effects = tuple(effect for effect in model.effects if not touches((effect,), "cell_temperature"))
    model = eqx.tree_at(lambda m: m.effects, model, effects, is_leaf=lambda x: x is model.effects)
    table = model.curves.ocv
    if not isinstance(table, Table):
        return model
    return eqx.tree_at(lambda m: m.curves.ocv.values, model, rising(np.asarray(table.soc), np.asarray(table.values)))


def rising(soc: np.ndarray, volts: np.ndarray) -> Array:
    """Return the nearest voltages that nowhere fall over the charge, shape (temperature, soc)."""
    widths = np.gradient(soc) if soc.size > 1 else np.ones(1)
    return jnp.asarray(np.stack([isotonic_regression(row, weights=widths).x for row in volts]))
