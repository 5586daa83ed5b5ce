"""One motor of a case, as the formats of motors see it: its numbers, and the effects that they may carry."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case
from jaxmodel.effects.controllers import PositionController, ShaftPosition
from jaxmodel.effects.drive import ViscousFriction
from jaxmodel.effects.loads import GravityLoad
from jaxmodel.effects.motion import Presliding
from jaxmodel.export.wording import ideal_readings, own_values_of_runs
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.sensors import sensors_of


class OneMotor(NamedTuple):
    """One motor.

    Attributes:
        model: of the case.
        case_degC: mean temperature of its case at the start of the runs.
        viscous: viscous friction at the shaft, N m s/rad.
        weight: on an arm, if it lifts one.
        controller: of the position by the voltage, if it has one.
        presliding: of its friction, if it has that.
    """

    model: Model
    case_degC: float
    viscous: float
    weight: GravityLoad | None
    controller: PositionController | None
    presliding: Presliding | None

    @property
    def gear(self) -> float:
        """Return the ratio of the gear between motor and arm."""
        return 1.0 if self.weight is None else float(self.weight.gear_ratio)

    @property
    def resistance_ohm(self) -> float:
        """Return R_0 (1 + psi_R (T - T_0)) at the temperature of the motor's case."""
        p = self.model.parameters
        return float(p.R_0) * (1.0 + float(p.psi_R) * (self.case_degC - float(p.T_0)))

    def without(self, carried: Collection[type] = ()) -> tuple[str, ...]:
        """Say which effects of a motor an actuator lacks; `carried` are more than these here."""
        parts = (self.weight, self.controller, self.presliding)
        kept = (ViscousFriction, ShaftPosition, *carried, *(type(part) for part in parts if part is not None))
        sensors = {effect.label for effect in sensors_of(self.model)}
        others = [one.label for one in self.model.effects if "motor" in one.kinds and not isinstance(one, kept)]
        others = [name for name in others if name not in sensors]
        return (f"The actuator is without {', '.join(others)} of the case.",) if others else ()

    def of_its_case(self, case: Case) -> tuple[str, ...]:
        """Say what is left out of the case that it is of."""
        of_robot = "It is one motor of a robot: pack, duty, slope, gear and electronics are left out."
        said = (of_robot,) if case.kind == "robot" else ()
        return (*said, *own_values_of_runs(case), *ideal_readings(self.model))


def one_motor(case: Case) -> OneMotor:
    """Return the motor of a case, or one of those of a robot's tracks.

    Raises:
        ParameterError: the case is of a cell.
    """
    if case.kind == "cell":
        raise ParameterError(f"{case.label}: it is of a cell, and this format is of a motor; give a case of a motor.")
    model = case_model(case)

    def first(kind: type) -> Any:
        return next((effect for effect in model.effects if isinstance(effect, kind)), None)

    viscous = sum(float(effect.b) for effect in model.effects if isinstance(effect, ViscousFriction))
    loop = first(PositionController)
    of_voltage = loop is not None and loop.column == "voltage_V"
    parts = (first(GravityLoad), loop if of_voltage else None, first(Presliding))
    return OneMotor(model, _case_degC(case), viscous, *parts)


def _case_degC(case: Case) -> float:
    rises = [float(case_model(case, run).parameters.initial_case_rise_K) for run in case.runs]
    ambients = [float(run.measured.inputs["ambient_degC"][0]) for run in case.runs]
    return float(np.mean(np.add(rises, ambients)))
