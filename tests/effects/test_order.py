"""An effect that reads at a port what the model does not know there yet is refused; every shipped one is not."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any, ClassVar

import pytest

from jaxmodel import Effect, parameter
from jaxmodel.base.errors import EffectError
from jaxmodel.effects import CATALOGUE, own_effects
from jaxmodel.effects.order import LATER
from jaxmodel.model.ports import CELL_PORTS, MOTOR_PORTS

EXAMPLES = Path(__file__).parents[2] / "examples"


def effect_of(port: str, method: Any, kinds: tuple[str, ...] = ("cell", "robot")) -> type[Effect]:
    """Return an effect that acts on one port."""

    class Own(Effect):
        """An effect of a user."""

        name: ClassVar[str] = "own"
        equation: ClassVar[str] = "value + a x"
        a: float = parameter(0.1, unit="1", meaning="its size", null=0.0, typical=(0.1, 1.0))

    return type("Own", (Own,), {"kinds": kinds, port: method, "__annotations__": {}, "__doc__": "Own."})


@pytest.mark.parametrize(
    ("port", "quantity", "instead"),
    [
        ("cell_temperature", "current_A", "overpotential"),
        ("series_resistance", "current_A", "cell_heat"),
        ("usable_charge", "R_TS", "overpotential"),
        ("overpotential", "voltage_V", "counted_current"),
        ("cell_heat", "voltage_V", "counted_current"),
    ],
)
def test_a_quantity_that_is_not_known_yet_is_refused(port: str, quantity: str, instead: str):
    cls = effect_of(port, lambda self, value, context: value + self.a * getattr(context, quantity))
    with pytest.raises(EffectError, match=rf"Own\.{port}: context\.{quantity} is not known at this port.*{instead}"):
        own_effects([cls])


def test_a_robot_knows_its_pack_voltage_late():
    def drag(self: Any, value: Any, context: Any) -> Any:
        return value + self.a * context.pack_voltage_V

    with pytest.raises(EffectError, match=r"pack_voltage_V is not known .* bridge_voltage"):
        own_effects([effect_of("friction_torque", drag, ("motor", "robot"))])
    assert own_effects([effect_of("friction_torque", drag, ("motor",))])  # there it is the terminal voltage
    assert own_effects([effect_of("bridge_voltage", drag, ("robot",))])


@pytest.mark.parametrize(
    ("port", "method"),
    [
        ("cell_temperature", lambda self, value, context: value + self.a * context.soc),
        ("overpotential", lambda self, value, context: value + self.a * context.current_A * context.R_TS),
        ("counted_current", lambda self, value, context: value + self.a * context.voltage_V),
        ("cell_temperature", lambda self, value, context: value + context.state["another.x_K"]),
        ("series_resistance", lambda self, value, context: value * context.curves.ocv(context.soc, 20.0)),
    ],
)
def test_what_is_known_is_not_refused(port: str, method: Any):
    assert set(own_effects([effect_of(port, method)])) == {"own"}


def test_shipped_effects_read_only_what_is_known():
    """At run time the fields of `LATER` are zeros: the catalogue and the example of the documentation read none."""
    own = {
        name: type(cls.__name__, (cls,), {"name": f"own_{name}", "__doc__": "Own."}) for name, cls in CATALOGUE.items()
    }
    assert len(own_effects([cls for cls in own.values() if not cls.is_sensor])) > 20
    spec = importlib.util.spec_from_file_location("my_effects", EXAMPLES / "my_effects.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    mine = [
        cls
        for cls in vars(module).values()
        if isinstance(cls, type) and issubclass(cls, Effect) and hasattr(cls, "name")
    ]
    assert own_effects(mine)


def test_every_port_is_in_the_order():
    assert LATER.keys() == CELL_PORTS.keys() | MOTOR_PORTS.keys()
