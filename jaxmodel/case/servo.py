"""What a case says of the drive of its motor: what the drive sets, and the controller that tells it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import jax.numpy as jnp
import numpy as np

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import SET_BY, Servo
from jaxmodel.case.records import Case, Run
from jaxmodel.effects.controllers import CONTROLLERS, Controller, ShaftPosition
from jaxmodel.model.ports import Effect

_DRIVES = (
    "with a controller the speed is an answer, and with an unknown load it drives the model; state another load, as in "
    'load = "free", or remove the controller.'
)


def stated_servo(
    drive: str | None, controller: str | None, effects: Iterable[str], kind: str, load: str, where: str
) -> Servo:
    """Return what a case says of its drive: in so many words, or by an effect that is a controller.

    Args:
        drive: "voltage" or "current"; None for what the columns of a run say.
        controller: a key of `CONTROLLERS`; None for an open loop.
        effects: names of those of the case.
        kind: of the case.
        load: what it says of its load.
        where: the case in messages.

    Raises:
        MeasurementError: the case is not of a motor, says two different things, or leaves a gain out.
    """
    stated = set(effects)
    loops = [name for name, effect in CONTROLLERS.items() if effect.name in stated]
    if (drive or controller or loops) and kind != "motor":
        raise MeasurementError(f"{where}: drive and controller are of a motor, not of a {kind}; remove them.")
    if len(loops) > 1 or (loops and controller and controller not in loops):
        said = " and ".join(dict.fromkeys([*([controller] if controller else []), *loops]))
        raise MeasurementError(f"{where}: {said} are two controllers of one motor; keep one of them.")
    if controller and not loops:
        name = CONTROLLERS[controller].name
        raise MeasurementError(
            f'{where}: controller = "{controller}" has no gains; state them under [effects], as in '
            f"{name} = {{ k_p = 10 }}."
        )
    if loops and load == "unknown":
        raise MeasurementError(f"{where}: {_DRIVES}")
    return Servo(drive or "", loops[0] if loops else "")


def refuse_driven_speed(servo: Servo, runs: Iterable[Run], where: str) -> None:
    """Raise MeasurementError where the speed drives the model of a motor under a controller, as no load is stated."""
    if servo.controller and any("speed_rad_s" in run.measured.inputs for run in runs):
        raise MeasurementError(f"{where}: {_DRIVES}")


def servo_effects(case: Case, run: Run | None, effects: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """Return the effects of a case's model with what its drive needs: a position, and what the controller sets.

    Args:
        case: of a motor.
        run: of it, whose first position begins the state; None for 0.
        effects: of the case.
    """
    set_by = SET_BY[case.servo.drive or "voltage"]
    told = tuple(dataclasses.replace(one, column=set_by) if isinstance(one, Controller) else one for one in effects)
    turns = any(hasattr(one, "initial_position_rad") for one in effects)
    reads = any("position_rad" in one.measured.outputs for one in case.runs)
    if turns or not (reads or case.servo.controller == "position"):
        return told
    begin = None if run is None else first_of(run, "position_rad", "reference_position_rad")
    return (*told, ShaftPosition(initial_position_rad=jnp.asarray(begin or 0.0)))


def first_of(run: Run, *names: str) -> float | None:
    """Return the first value of the first of some columns of a run that begins with one; None if none does."""
    columns = run.measured.inputs | run.measured.outputs
    return next((float(columns[name][0]) for name in names if name in columns and np.isfinite(columns[name][0])), None)
