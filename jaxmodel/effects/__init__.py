"""The catalogue of candidate effects: battery, drive and sensors, each a class on the ports of the model."""

from __future__ import annotations

import inspect

from jaxmodel.effects import battery, drive, further_battery, further_drive, further_sensors, sensors
from jaxmodel.ports import Effect

CATALOGUE: dict[str, type[Effect]] = {
    cls.name: cls
    for module in (battery, drive, sensors, further_battery, further_drive, further_sensors)
    for _, cls in inspect.getmembers(module, inspect.isclass)
    if issubclass(cls, Effect) and hasattr(cls, "name") and cls.__module__ == module.__name__
}

__all__ = ["CATALOGUE", "Effect"]
