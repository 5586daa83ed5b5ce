"""What a case says of a load that is not measured: which law it follows, and which of its numbers is free."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.build import case_model
from jaxmodel.case.records import Case, Run
from jaxmodel.effects.loads import LAWS, GravityLoad, Law
from jaxmodel.effects.specimen import usual_range
from jaxmodel.model import motor as motors
from jaxmodel.model.declaration import describe
from jaxmodel.model.parameters import Parameters


def stated_load(load: str | None, effects: Iterable[str], kind: str, where: str) -> str:
    """Return what a case says of its load: in so many words, or by an effect that is a law of it; "" for nothing.

    Raises:
        MeasurementError: the case is of a cell, or says two different things.
    """
    laws = [name for name, effect in LAWS.items() if effect is not None and effect.name in set(effects)]
    if kind == "cell" and (load or laws):
        raise MeasurementError(f"{where}: a cell turns nothing; remove load" + (" and its effect." if laws else "."))
    if len(laws) > 1 or (laws and load and load not in laws):
        said = " and ".join([*([f'load = "{load}"'] if load and load not in laws else []), *laws])
        raise MeasurementError(f"{where}: {said} are two laws of one load; keep one of them.")
    return laws[0] if laws else load or ""


def with_law(case: Case) -> Case:
    """Return a case with the effect of its law; a free number that it does not state gets an sd as large as itself."""
    law = LAWS.get(case.load)
    if law is None:
        return case
    stated: dict[str, float | str] = dict(case.effects.get(law.name, {}))
    effects, sd = dict(case.effects), dict(case.effect_sd)
    if (free := law.free) and free not in stated:
        numbers = {name: known.value for name, known in case.parameters.items()}
        low, high = usual_range(describe(law)[free], numbers)
        middle = math.sqrt(low * high)
        stated[free] = middle
        sd[law.name] = sd.get(law.name, {}) | {free: middle}
    effects[law.name] = stated
    return dataclasses.replace(case, effects=effects, effect_sd=sd)


@dataclasses.dataclass(frozen=True, eq=False)
class LawTorque:
    """The torque [N m] that a law asks of the shaft along a measured run, shape (rows,).

    Attributes:
        known: as the case states it.
        per_unit: for one unit of the law's free number; None where that is exact, or the law has none.
    """

    known: np.ndarray
    per_unit: np.ndarray | None


def free_number(case: Case) -> tuple[str, str, str] | None:
    """Return effect, name and unit of the number that the data are asked for; None if the load has none."""
    law = LAWS.get(case.load)
    if law is None or law.free not in case.effect_sd.get(law.name, {}):
        return None
    return law.name, law.free, describe(law)[law.free].unit


def law_torque(case: Case, run: Run, speed_rad_s: np.ndarray, rate_rad_s2: np.ndarray) -> LawTorque | None:
    """Return the torque of a case's law along a run: what resists, and what its inertia takes.

    Args:
        case: of a motor or robot.
        run: of it; position is read, else the integral of the speed.
        speed_rad_s: of the motor, shape (rows,).
        rate_rad_s2: its acceleration, the same shape.
    """
    law = LAWS.get(case.load)
    if law is None:
        return None
    model = case_model(case, run)
    (effect,) = (one for one in model.effects if isinstance(one, law))
    free = free_number(case)
    given = _along(effect, model.parameters, run, speed_rad_s, rate_rad_s2)
    return LawTorque(given, None if free is None else given / float(getattr(effect, free[1])))


def _along(effect: Law, parameters: Parameters, run: Run, speed: np.ndarray, rate: np.ndarray) -> np.ndarray:
    inputs = run.measured.inputs
    states = {"incline_deg": inputs["incline_deg"]} if "incline_deg" in inputs else {}
    if isinstance(effect, GravityLoad):
        states[f"{effect.name}.position_rad"] = _position(effect, run, speed)

    def asked(state, ambient, speed, rate):
        zero = jnp.zeros(())
        state = motors.initial_state(parameters) | state | {"speed_rad_s": speed}
        motor = motors.evaluate(parameters, (effect,), state, ambient, zero, jnp.ones(()), zero)
        return motors.asked_torque(motor, rate)

    return np.asarray(jax.vmap(asked)(*jax.tree.map(jnp.asarray, (states, inputs["ambient_degC"], speed, rate))))


def _position(effect: GravityLoad, run: Run, speed: np.ndarray) -> np.ndarray:
    """Return the position of the arm [rad] along a run: read, else the integral of the speed from its start."""
    read, time_s = run.measured.outputs.get("position_rad"), run.measured.time_s
    steps = np.diff(time_s) * 0.5 * (speed[1:] + speed[:-1])
    moved = np.append(0.0, np.cumsum(np.nan_to_num(steps))) / float(effect.gear_ratio)
    turned = float(effect.initial_position_rad) + moved
    return turned if read is None else np.where(np.isfinite(read), read, turned)
