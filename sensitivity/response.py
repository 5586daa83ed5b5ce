"""The results of a run as a pure function of a vector of parameters: what every analysis here differentiates.

Beside the numbers of the model, the curves of the cell and the inputs of the run are parameters too, under their own
names: a curve (R_ints, R_TS, C_TS, R_TL, C_TL) by a factor, the ambient temperature by a shift in K, every other input
by a factor.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxmodel.base.errors import ParameterError, nearest
from jaxmodel.lanes.influence import influential
from jaxmodel.model.curves import CURVE_NAMES, Curve
from jaxmodel.model.declaration import ParameterInfo, Scalar
from jaxmodel.model.electrothermal import Model, initial_state, read
from jaxmodel.model.names import parameter_table, value, with_values
from jaxmodel.model.profile import Profile
from jaxmodel.model.simulation import Cutoff, Track, run_track, track
from jaxmodel.sensitivity.metrics import VALID_SHARE, choose_metrics
from jaxmodel.sweeps.lane import Keep, Outcome, SteppedProfile, lay_out, run_lane
from jaxmodel.sweeps.metrics import Metric

SHIFTED_INPUT = "ambient_degC"
CURVES = CURVE_NAMES[1:]  # the open-circuit voltage has its offset


class Scaled(Curve):
    """A curve by a factor."""

    curve: Curve
    factor: Scalar

    def __call__(self, soc: Scalar, temperature_degC: Scalar) -> Scalar:
        """Return the factor times the curve."""
        return self.factor * self.curve(soc, temperature_degC)

    def inside(self, soc: Scalar, temperature_degC: Scalar) -> Array:
        """Return where the curve itself is defined."""
        return self.curve.inside(soc, temperature_degC)


class Answer(eqx.Module):
    """The results of a run: metrics, and readings over time; derivatives have further axes in front."""

    metrics: Float[Array, "... metric"]
    outputs: Float[Array, "... output rows"]


class Response(eqx.Module):
    """The answer of a model to a profile, as a function of the parameters called `names`.

    The steps of integration are those of the model as it is given: they do not move with the parameters, so that a
    difference between two answers is due to the parameters alone. Metrics are of true values, as in a sweep; outputs
    are what the sensors of the model read.
    """

    model: Model
    stepped: SteppedProfile
    time_s: Float[Array, " rows"]
    cutoff: Cutoff | None
    sensed: Track | None
    names: tuple[str, ...] = eqx.field(static=True)
    metrics: tuple[Metric, ...] = eqx.field(static=True)
    outputs: tuple[str, ...] = eqx.field(static=True)

    def __call__(self, values: Float[Array, " parameter"]) -> Answer:
        """Return the answer at parameter values in the units of the table."""
        return self.run(self.named(values))[0]

    def named(self, values: Float[Array, " parameter"]) -> dict[str, Scalar]:
        """Return parameter values by name."""
        return dict(zip(self.names, values, strict=True))

    def run(self, given: Mapping[str, Scalar]) -> tuple[Answer, Outcome]:
        """Return the answer at parameter values by name, and how the run behind it went, with its `valid_share`."""
        numbers, over_time, outcome = self.parts(given)
        answer = Answer(
            metrics=jnp.stack(numbers) if numbers else jnp.zeros(0),
            outputs=jnp.stack(over_time) if over_time else jnp.zeros((0, self.time_s.size)),
        )
        return answer, outcome

    def parts(self, given: Mapping[str, Scalar]) -> tuple[list[Scalar], list[Array], Outcome]:
        """Return what `run` does, each metric and each output by itself."""
        others = {*_inputs(self.stepped), *CURVES}
        model = with_values(self.model, {name: new for name, new in given.items() if name not in others})
        for name in CURVES:
            if name in given:
                scaled = Scaled(getattr(model.curves, name), given[name])
                model = eqx.tree_at(lambda m, n=name: getattr(m.curves, n), model, scaled)
        stepped = eqx.tree_at(
            lambda c: (c.first, c.later, c.steady),
            self.stepped,
            tuple(_changed(part, given) for part in (self.stepped.first, self.stepped.later, self.stepped.steady)),
        )
        keep = Keep((*self.metrics, VALID_SHARE), () if self.sensed else self.outputs)
        outcome = run_lane(keep, model, stepped, self.cutoff, {})
        readings = outcome.columns
        if self.sensed is not None:
            seen = eqx.tree_at(lambda t: t.inputs, self.sensed, _changed(self.sensed.inputs, given))
            readings = run_track(model, seen, self.time_s, self.cutoff).readings
        numbers = [outcome.values[metric.name] for metric in self.metrics]
        return numbers, [readings[name] for name in self.outputs], outcome

    def values(self) -> Float[Array, " parameter"]:
        """Return the parameters' values as the model and the profile have them; of an input or curve their null."""
        neutral = {name: 0.0 if name == SHIFTED_INPUT else 1.0 for name in (*_inputs(self.stepped), *CURVES)}
        return jnp.asarray([neutral[n] if n in neutral else value(self.model, n) for n in self.names], dtype=float)

    def table(self) -> list[ParameterInfo]:
        """Return unit, bounds and meaning of each parameter."""
        known = parameter_table(self.model) | _curve_table() | _input_table(self.stepped)
        return [known[name] for name in self.names]


def _inputs(stepped: SteppedProfile) -> dict[str, Array]:
    """Return the inputs after the first row by name, those that never change as scalars."""
    return stepped.later | stepped.steady


def _changed(inputs: Mapping[str, Array], given: Mapping[str, Scalar]) -> dict[str, Array]:
    """Shift or scale the inputs that are among the parameters."""

    def change(name: str, column: Array) -> Array:
        if name not in given:
            return column
        return column + given[name] if name == SHIFTED_INPUT else column * given[name]

    return {name: change(name, column) for name, column in inputs.items()}


def _curve_table() -> dict[str, ParameterInfo]:
    """Return unit and meaning of the curves as parameters."""
    return {
        name: ParameterInfo(name, unit="", meaning=f"factor on the curve {name}", default=1.0, lower=0.0)
        for name in CURVES
    }


def _input_table(stepped: SteppedProfile) -> dict[str, ParameterInfo]:
    """Return unit, bounds and meaning of the inputs as parameters."""
    table = {}
    for name, column in _inputs(stepped).items():
        if name == SHIFTED_INPUT:
            table[name] = ParameterInfo(name, unit="K", meaning="shift of the ambient temperature", default=0.0)
        else:
            largest = float(np.max(np.abs(np.asarray(column))))
            upper = 1.0 / largest if name.endswith("duty") and largest > 0.0 else math.inf
            table[name] = ParameterInfo(name, unit="", meaning=f"factor on the input {name}", default=1.0, upper=upper)
    return table


def make_response(
    model: Model,
    profile: Profile,
    names: Iterable[str] | None = None,
    metrics: Iterable[str | Metric] | None = None,
    outputs: Iterable[str] | None = None,
    cutoff: Cutoff | None = None,
) -> Response:
    """Return the response of a model to a profile.

    Args:
        model: any kind; its leaves are scalars.
        profile: inputs over time.
        names: parameters of the model, of its effects ("effect.parameter"), curves of the cell and inputs of the
            profile; None takes all that enter the answer.
        metrics: names of `jaxmodel.sensitivity.metrics`, or instances of `jaxmodel.sweeps.Metric`; None takes all of
            the kind.
        outputs: readings wanted over time; None takes all, () none.
        cutoff: where the run ends, if before the end of the profile.

    Raises:
        ParameterError: a parameter or output is unknown; the message gives the nearest name.
        SweepError: a metric is unknown.
    """
    steps = track(model, profile)
    stepped = lay_out(model, profile, np.arange(profile.time_s.size))
    readings = _reading_names(model, steps)
    chosen_outputs = readings if outputs is None else tuple(map(str, outputs))
    _check(chosen_outputs, readings, "outputs", "output")
    known = (*parameter_table(model), *(CURVES if model.kind != "motor" else ()), *_inputs(stepped))
    # Ideal sensors read what a sweep's lane keeps; others depend on the whole run, and need a run of their own.
    sensed = steps if chosen_outputs and any(effect.is_sensor for effect in model.effects) else None
    response = Response(
        model=model,
        stepped=stepped,
        time_s=jnp.asarray(profile.time_s),
        cutoff=cutoff,
        sensed=sensed,
        names=known if names is None else tuple(map(str, names)),  # NumPy's strings are arrays
        metrics=choose_metrics(metrics, model.kind),
        outputs=chosen_outputs,
    )
    if names is None:
        enter = influential(lambda given: response.run(given)[0], response.named(response.values()))
        return dataclasses.replace(response, names=tuple(name for name in known if name in enter))
    if not response.names:
        raise ParameterError("names: none is given; name at least one parameter or input, or leave names out for all.")
    _check(response.names, known, "names", "parameter or input")
    return response


def _reading_names(model: Model, steps: Track) -> tuple[str, ...]:
    first = {name: column[0] for name, column in steps.inputs.items()}
    return tuple(jax.eval_shape(lambda m, u: read(m, initial_state(m, u), u), model, first))


def _check(wanted: Sequence[str], known: Sequence[str], argument: str, what: str) -> None:
    for name in wanted:
        if name not in known:
            raise ParameterError(
                f"{argument}: this run has no {what} '{name}'.{nearest(name, known)} It has {', '.join(known)}."
            )


@dataclasses.dataclass(frozen=True)
class Steps:
    """By how much each parameter is moved when changes are compared.

    Attributes:
        size: in the parameter's unit: its value, which is a doubling, or where that means nothing a stated step.
        doubles: True where the step is the parameter's value.
        in_bounds: True where value + step is a value that the parameter may have.
    """

    size: np.ndarray
    doubles: np.ndarray
    in_bounds: np.ndarray


def steps_of(response: Response) -> Steps:
    """Return the step of each parameter of a response.

    A proportional change means nothing for a temperature in degC, whose zero is arbitrary, and for a parameter that is
    zero (or infinite: an effect at its null). Their steps are 1 K; else the table's default, for an effect a middling
    value; else, where that is zero too, a hundredth of the parameter's range.
    """
    values = np.asarray(response.values())
    table = response.table()
    temperature = np.array([info.unit == "degC" for info in table], dtype=bool)
    doubles = (values != 0.0) & np.isfinite(values) & ~temperature
    size = np.where(doubles, values, [_stated_step(info) for info in table])
    lower, upper = np.array([(info.lower, info.upper) for info in table]).reshape(-1, 2).T
    moved = values + size
    return Steps(size, doubles, (moved >= lower) & (moved <= upper))


def _stated_step(info: ParameterInfo) -> float:
    if info.unit == "degC" or info.name == SHIFTED_INPUT:
        return 1.0
    if info.default != 0.0:
        return info.default
    width = info.upper - info.lower
    return 0.01 * width if math.isfinite(width) else 1.0
