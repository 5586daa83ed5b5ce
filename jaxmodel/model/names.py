"""Every number of a model by name: 'k_tau' of the base model, 'ocv_hysteresis.M_V' of an effect."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import equinox as eqx

from jaxmodel.base.errors import ParameterError, instead
from jaxmodel.model.declaration import ParameterInfo, describe
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import TABLE


def parameter_table(model: Model) -> dict[str, ParameterInfo]:
    """Return the declarations of all named numbers of a model: base parameters, then those of its effects.

    Example:
        >>> from jaxmodel import Model, parameter_table
        >>> parameter_table(Model("cell"))["capacity_Ah"].unit
        'A h'
    """
    table = dict(TABLE)
    for effect in model.effects:
        table |= {f"{effect.label}.{name}": info for name, info in describe(effect).items()}
    return table


def value(model: Model, name: str) -> Any:
    """Return the number called `name`; raise ParameterError with the nearest name if there is none."""
    owner, field = _find(model, name)
    return getattr(owner, field)


def with_values(model: Model, values: Mapping[str, Any]) -> Model:
    """Return the model with the named numbers replaced; values may be traced, or carry lanes.

    Raises:
        ParameterError: a name is unknown; the message gives the nearest one.

    Example:
        >>> from jaxmodel import Model, with_values
        >>> with_values(Model("cell"), {"capacity_Ah": 2.5})
        <Model: cell, capacity_Ah=2.5>
    """
    for name, new in values.items():
        _find(model, name)
        label, _, field = name.rpartition(".")
        if not label:
            model = eqx.tree_at(lambda m, f=field: getattr(m.parameters, f), model, new)
        else:
            index = [effect.label for effect in model.effects].index(label)
            model = eqx.tree_at(
                lambda m, i=index, f=field: getattr(m.effects[i], f), model, new, is_leaf=lambda x: x is None
            )
    return model


def _find(model: Model, name: str) -> tuple[Any, str]:
    label, _, field = name.rpartition(".")
    owners = {"": model.parameters} | {effect.label: effect for effect in model.effects}
    owner = owners.get(label)
    # Curves are vectors, and the switch is no physical parameter.
    known_field = owner is not None and (field in describe(owner) or (label and field in ("switch", "values")))
    if owner is None or not known_field or not hasattr(owner, field):
        known = [*TABLE, *(f"{effect.label}.{f}" for effect in model.effects for f in describe(effect))]
        raise ParameterError(f"model: no number is called '{name}'.{instead(name, known)}")
    return owner, field
