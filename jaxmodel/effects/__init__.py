"""The catalogue of candidate effects: battery, drive and sensors, each a class on the ports of the model.

    from jaxmodel.effects import CATALOGUE, PORTS, SensorEffect

    CATALOGUE["self_heating"].equation
    PORTS["series_resistance"]  # what a method of that name receives and returns

An effect of your own derives from `Effect`, a fault of a sensor from `SensorEffect`.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable

from jaxmodel.base.errors import EffectError
from jaxmodel.effects import battery, drive, loads, motion, sensors
from jaxmodel.effects.controllers import SERVO
from jaxmodel.effects.order import refuse_what_comes_later
from jaxmodel.effects.sensors import SensorEffect
from jaxmodel.effects.specimen import scale_of
from jaxmodel.model.declaration import describe
from jaxmodel.model.ports import PORTS, Effect
from jaxmodel.model.sensors import Signal

_DECLARED = [
    cls
    for module in (battery, drive, motion, loads, sensors)
    for _, cls in inspect.getmembers(module, inspect.isclass)
    if issubclass(cls, Effect) and hasattr(cls, "name") and cls.__module__ == module.__name__
]
CATALOGUE: dict[str, type[Effect]] = {cls.name: cls for cls in sorted(_DECLARED, key=lambda cls: cls.rare)}
"""All effects by name; rare ones last, in tables and where candidates are alike."""


def own_effects(classes: Iterable[type[Effect]]) -> dict[str, type[Effect]]:
    """Return the user's own effects by name, after a check that they are complete.

    Raises:
        EffectError: a class lacks a declaration, has the name of another effect, or reads at a port what the model
            does not know there yet.

    Example:
        >>> from jaxmodel import load_effect_class
        >>> from jaxmodel.effects import own_effects
        >>> list(own_effects([load_effect_class("examples/my_effects.py:HotContact")]))
        ['hot_contact']
    """
    found: dict[str, type[Effect]] = {}
    for cls in classes:
        if not (inspect.isclass(cls) and issubclass(cls, Effect)):
            raise EffectError(f"{cls!r} is not an effect; give a class derived from jaxmodel.Effect.")
        if missing := _missing(cls):
            raise EffectError(f"{cls.__name__} has no {missing}; docs/your_own_effect.md shows a complete one.")
        if cls.name in CATALOGUE or cls.name in SERVO or cls.name in found:
            raise EffectError(f"{cls.__name__}: an effect called '{cls.name}' exists already; give it another name.")
        refuse_what_comes_later(cls)
        found[cls.name] = cls
    return found


def _missing(cls: type[Effect]) -> str:
    """Return the first required declaration that an effect class lacks; '' if it is complete.

    Raises:
        EffectError: a parameter scales with an unknown size.
    """
    for attribute in ("name", "kinds", "equation"):
        if not getattr(cls, attribute, None):
            return attribute
    table = describe(cls)
    if not table:
        return "parameter"
    for info in table.values():
        scale_of(info.scales, {})
    unstated = [name for name, info in table.items() if info.typical is None]
    return f"usual range of its parameter '{unstated[0]}', as in typical=(0.01, 0.2)" if unstated else ""


__all__ = ["CATALOGUE", "PORTS", "Effect", "SensorEffect", "Signal", "own_effects"]
