"""Unknown laws in the model's equations: how every reading answers to a small addition at a port, over time.

A law in an equation moves all that the equation reaches: a torque moves current, speed and heat. Its additions are
those that a law of the calibrated model's own course would make, so that the readings' answers are exact to first
order; they come from one forward program whose additions are inputs.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator, Mapping

import numpy as np

from discrepancy.conditions import conditions_of_rows
from discrepancy.hypothesis import Hypothesis
from discrepancy.input_noise import row_of_step
from discrepancy.lanes import at, residuals
from discrepancy.misfit import Block, Leftover, Tried, hats, law_unit
from discrepancy.problem import Problem
from discrepancy.session import Session
from jaxmodel.ports import PORTS, Effect

KNOTS, EVEN_KNOTS = 5, 7
# Of a port's usual size: far above rounding, far below what bends.
ADDED = 1e-4


@dataclasses.dataclass(frozen=True)
class Place:
    """A port, or an input, at which an unknown law may act.

    Attributes:
        port: its name.
        equation: how the sentence calls it.
        unit: of the port's value.
        size: a usual value.
        multipliers: conditions that may multiply the law; "" is 1.
    """

    port: str
    equation: str
    unit: str
    size: float
    multipliers: tuple[str, ...] = ("",)


_DRIVE = (
    Place("load_torque", "the torque balance (eq. 13)", "N m", 0.1, ("", "load_torque_Nm")),
    Place("torque_constant", "the torque constant (eqs. 11 and 12)", "N m/A", 0.04),
    Place("motor_loss", "the winding's heat (eq. 16)", "W", 10.0),
)
_COUNTING = Place("counted_current", "the counting of charge (eq. 1)", "A", 5.0, ("", "current_A"))
PLACES = {
    "cell": (_COUNTING,),
    "motor": (*_DRIVE, Place("bridge_voltage", "the armature voltage (eq. 11)", "V", 10.0, ("", "current_A"))),
    "robot": (
        *_DRIVE,
        Place("bridge_voltage", "the armature voltage (eqs. 11 and 14)", "V", 10.0, ("", "motor_current_A")),
        Place("duty", "the duty of the bridge (eq. 14)", "of duty", 0.3),
        Place("onboard_current", "the on-board draw (eq. 20)", "A", 1.0),
        _COUNTING,
    ),
}


def _input(port: str) -> str:
    """Return the input that carries what is added: of a port one of its own, of an input the input itself."""
    return f"law.{port}" if port in PORTS else port


@functools.lru_cache
def _addition(port: str) -> Effect:
    """Return an effect that adds an input of its own to a port; one class for all, as programs are told by it."""

    def add(self, value, context):
        return value + context.state[_input(port)]

    return type(f"AdditionTo_{port}", (Effect,), {"name": "law", "kinds": (), "equation": "", port: add})()


def equation_laws(session: Session, hypothesis: Hypothesis, leftover: Leftover, beside: Hypothesis) -> list[Block]:
    """Return the evidence for an unknown law in each equation of a calibrated model, strongest first.

    Its readings come from the program of the model `beside` which laws are tried too, itself or one with more effects.
    """
    problem, x = session.in_the_program_of(beside, hypothesis)
    places = {place.port: place for place in PLACES[session.case.kind]}
    if session.case.kind == "motor" and "voltage_V" not in problem.courses.inputs:
        del places["bridge_voltage"]  # its current is imposed
    effects = (*problem.models.effects, *(_addition(port) for port in places if port in PORTS))
    problem = dataclasses.replace(problem, models=dataclasses.replace(problem.models, effects=effects)).only("fit")
    counted = np.asarray(problem.readings.fit) > 0.0
    reaches = tuple(np.unique(leftover.channel_of).tolist())
    shapes = list(_shapes(session, hypothesis, problem, places))
    nothing = {_input(port): np.zeros(problem.courses.inputs["ambient_degC"].shape) for port in places}
    still = dataclasses.replace(at(problem, x), added=nothing)
    lanes = [still]
    for place, _, _, on_steps, _ in shapes:
        added = (ADDED * place.size * row for row in on_steps)
        lanes += [dataclasses.replace(still, added=nothing | {_input(place.port): more}) for more in added]
    rows = residuals(problem, lanes)[:, counted]
    unmoved, moved = rows[0], rows[1:]
    everywhere = np.arange(counted.sum())

    def laws() -> Iterator[Tried]:
        first = 0
        for place, multiplier, variable, on_steps, knots in shapes:
            mine = moved[first : first + len(on_steps)]
            first += len(on_steps)
            answers = -(mine - unmoved).T / (ADDED * place.size)
            if np.all(np.isfinite(answers)):
                unit = law_unit(place.unit, multiplier)
                yield Tried(place.equation, multiplier, variable, answers, everywhere, knots, reaches, unit, place.port)

    return leftover.blocks(laws())


def _shapes(
    session: Session, hypothesis: Hypothesis, part: Problem, places: Mapping[str, Place]
) -> Iterator[tuple[Place, str, str, np.ndarray, np.ndarray]]:
    """Yield place, multiplier, variable, the law's free shapes over the steps (knots, runs, 1 + steps), and knots."""
    fitted = hypothesis.problem.runs_read("fit")
    rows = part.times.shape[1]
    conditions = {name: values[fitted, :rows] for name, values in conditions_of_rows(session, hypothesis).items()}
    at_step = row_of_step(part.courses)
    shown = np.zeros(part.times.shape, dtype=bool)
    for place, number in enumerate(fitted):
        shown[place, : session.case.runs[number].measured.time_s.size] = True
    for place in places.values():
        for multiplier in place.multipliers:
            if multiplier and multiplier not in conditions:
                continue
            factor = conditions[multiplier] if multiplier else np.ones(part.times.shape)
            for variable, values in conditions.items():
                made = hats(values[shown], KNOTS, EVEN_KNOTS) if variable not in ("run", multiplier) else None
                if made is None:
                    continue
                knots = made[1]
                on_rows = [np.interp(values, knots, unit) * factor for unit in np.eye(knots.size)]
                on_steps = np.stack([np.take_along_axis(row, at_step, 1) for row in on_rows])
                yield place, multiplier, variable, on_steps, knots
