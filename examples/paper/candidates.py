"""Table 1, seven numbers: how much of it each temperature-dependent effect could explain, and with which value.

A direct least-squares fit, in addition to the diagnosis: parameters of an effect and uncertain parameters of the case
are fitted to six of the seven slopes; the seventh, at 40 degC, is the check. Slopes are weighted by their rounding.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import least_squares

from examples.paper.discharges import ASSUMED, DURATION_S
from examples.paper.printed import TABLE_1, TABLE_STEP
from jaxmodel import Model, constant, parameter_table, preset_model, run_track, track, with_values
from jaxmodel.effects import CATALOGUE

HELD_OUT_DEGC = 40.0
# Standard deviations as in examples/paper_table1: assumed.
UNCERTAIN = {"capacity_Ah": 0.15, "k_tau": 0.001, "R_0": 0.003, "tau_0": 0.002, "onboard_current_A": 0.1}
# The effects of the catalogue by which temperature affects resistance, charge, torque or draw, and two pairs.
HYPOTHESES = (
    (),
    ("capacity_temperature",),
    ("onboard_temperature",),
    ("friction_temperature",),
    ("magnet_temperature",),
    ("arrhenius_resistance",),
    ("capacity_temperature", "onboard_temperature"),
    ("capacity_temperature", "friction_temperature"),
)
STEP_S = 60.0


@dataclasses.dataclass(frozen=True)
class Carried:
    """The fit of one hypothesis to Table 1.

    Attributes:
        effects: names; none is the calibrated base model.
        values: of their parameters, fitted.
        usual: whether all are within their usual ranges.
        slopes: fitted, by ambient, 1/s.
        rms: over the fitted six, 1/s.
        held_out: printed minus fitted at 40 degC, 1/s.
        onboard_A: draw of the electronics by ambient, A.
        pack_A: mean current of the pack by ambient, A, as a shunt would measure it.
    """

    effects: tuple[str, ...]
    values: dict[str, float]
    usual: bool
    slopes: dict[float, float]
    rms: float
    held_out: float
    onboard_A: dict[float, float]
    pack_A: dict[float, float]

    @property
    def physical(self) -> bool:
        """Whether the electronics draw current at every temperature of the table, instead of supplying the pack."""
        return min(self.onboard_A.values()) >= 0.0


def carried(progress: Callable[[str], None] = lambda what: None) -> Iterator[Carried]:
    """Fit each hypothesis in turn."""
    for effects in HYPOTHESES:
        progress(" + ".join(effects) or "base model")
        yield _fit(effects)


def _fit(effects: Sequence[str]) -> Carried:
    base = preset_model("paper", "robot")
    model = Model(base.kind, base.parameters, base.curves, tuple(CATALOGUE[name]() for name in effects))
    table = parameter_table(model)
    own = [name for name in table if name.partition(".")[0] in effects]
    names = [*own, *UNCERTAIN]
    ambients = np.array(list(TABLE_1))
    printed, fitted = np.array(list(TABLE_1.values())), ambients != HELD_OUT_DEGC
    slopes = _slopes(model, names, ambients)
    start = np.array([*(_mild(table[name]) for name in own), *(float(table[name].default) for name in UNCERTAIN)])
    sd, centre = np.array(list(UNCERTAIN.values())), start[len(own) :]

    def residuals(unit: np.ndarray) -> np.ndarray:
        values = unit * scale
        off = (np.asarray(slopes(values)[0]) - printed)[fitted] / (TABLE_STEP / np.sqrt(12.0))
        return np.concatenate([off, (values[len(own) :] - centre) / sd])

    scale = np.concatenate([[abs(_mild(table[name])) or 1.0 for name in own], sd])
    lower, upper = (np.array([float(getattr(table[name], end)) for name in names]) for end in ("lower", "upper"))
    found = least_squares(residuals, start / scale, bounds=(lower / scale, upper / scale), diff_step=1e-4)
    values = dict(zip(names, found.x * scale, strict=True))
    ours, currents = map(np.asarray, slopes(found.x * scale))
    off = printed - ours
    a = values.get("onboard_temperature.a", 0.0)
    return Carried(
        effects=tuple(effects),
        values={name: float(values[name]) for name in own},
        usual=all(table[name].typical[0] <= values[name] <= table[name].typical[1] for name in own),  # type: ignore[index]
        slopes=dict(zip(map(float, ambients), map(float, ours), strict=True)),
        rms=float(np.sqrt(np.mean(off[fitted] ** 2))),
        held_out=float(off[~fitted][0]),
        onboard_A={float(t): float(values["onboard_current_A"] * (1.0 + a * (t - 20.0))) for t in ambients},
        pack_A=dict(zip(map(float, ambients), map(float, currents), strict=True)),
    )


def _mild(info) -> float:
    """Return a start value for a fit: small, and on the usual side of the effect."""
    null = 0.0 if info.null is None else float(info.null)
    return null + 0.3 * (float(info.default) - null)


def _slopes(
    model: Model, names: Sequence[str], ambients: np.ndarray
) -> Callable[[np.ndarray], tuple[jax.Array, jax.Array]]:
    """Return the model's slopes (1/s) and mean pack currents (A) at all temperatures as functions of named numbers."""
    inputs = {name: value for name, value in ASSUMED.items() if name != "onboard_current_A"}
    profile = constant(DURATION_S, STEP_S, ambient_degC=20.0, **inputs)
    steps, time_s = track(model, profile), jnp.asarray(profile.time_s)

    @jax.jit
    def over_ambients(values):
        changed = with_values(model, dict(zip(names, values, strict=True)))

        def run(ambient):
            at = steps.inputs | {"ambient_degC": jnp.full_like(steps.inputs["ambient_degC"], ambient)}
            readings = run_track(changed, eqx.tree_at(lambda s: s.inputs, steps, at), time_s).readings
            # In the first row the motors have no current yet.
            return (readings["soc"][-1] - readings["soc"][0]) / DURATION_S, readings["pack_current_A"][1:].mean()

        return jax.vmap(run)(jnp.asarray(ambients))

    return over_ambients
