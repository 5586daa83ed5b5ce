"""The paper's cheap estimator: the charge from the voltage by a polynomial, once the resistance's drop is given back.

A few multiplications a step, for a controller without a filter. The open-circuit voltage is guessed from the reading,
V + R(T) (i + lag), turned into a charge by a polynomial, and blended with the counted charge.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.cell import cycle_resistance, storage_factor
from jaxmodel.declaration import Scalar
from jaxmodel.model import Model
from operation.estimate import Measured

ORDER = 3  # of the polynomial, as in the paper's Fig. 8
FITTED_SOC = (0.1, 1.0)  # below, the open-circuit voltage falls off a cliff that no such polynomial follows
_MIDDLE = 0.5


@dataclasses.dataclass(frozen=True)
class Cheap:
    """The whole estimator in a dozen numbers.

    Attributes:
        soc_of_volts: charge by the open-circuit voltage less `centre_V`, highest power first.
        centre_V: around which it was fitted.
        degC: places of the resistances.
        at_once_ohm: resistance that a current meets at once, by temperature.
        later_ohm: resistance that it meets later: of the RC pairs.
        lag_s: time constant with which it does.
        blend_s: time in which the counted charge follows the voltage's.
        capacity_Ah: for the counting.
        worst_fit: largest error of the polynomial, in charge.
    """

    soc_of_volts: tuple[float, ...]
    centre_V: float
    degC: tuple[float, ...]
    at_once_ohm: tuple[float, ...]
    later_ohm: tuple[float, ...]
    lag_s: float
    blend_s: float
    capacity_Ah: float
    worst_fit: float


def cheap_of(model: Model, degC: np.ndarray, blend_s: float, order: int = ORDER) -> Cheap:
    """Return the estimator of a cell's model: its curves at some temperatures, boiled down.

    Args:
        model: of kind "cell".
        degC: places of the resistances, rising; one alone makes an estimator that knows no temperature.
        blend_s: as in `Cheap`.
        order: of the polynomial.
    """
    p, curves = model.parameters, model.curves
    soc = jnp.linspace(*FITTED_SOC, 91)
    volts = np.asarray(jax.vmap(lambda s: curves.ocv(s, jnp.asarray(25.0)))(soc)) + float(p.ocv_offset_V)
    centre = float(volts.mean())
    polynomial = np.polyfit(volts - centre, np.asarray(soc), order)
    off = np.polyval(polynomial, volts - centre) - np.asarray(soc)

    def at(curve, scale):
        return tuple(float(curve(jnp.asarray(_MIDDLE), jnp.asarray(t)) * scale) for t in degC)

    series = tuple(
        ohm + float(cycle_resistance(p.cycles) * p.series_resistance_scale)
        for ohm in at(curves.R_ints, p.series_resistance_scale)
    )
    later = [np.array(at(curve, p.rc_resistance_scale)) for curve in (curves.R_TS, curves.R_TL)]
    seconds = [
        np.array(at(r, p.rc_resistance_scale)) * np.array(at(c, p.rc_capacitance_scale))
        for r, c in ((curves.R_TS, curves.C_TS), (curves.R_TL, curves.C_TL))
    ]
    return Cheap(
        soc_of_volts=tuple(map(float, polynomial)),
        centre_V=centre,
        degC=tuple(map(float, degC)),
        at_once_ohm=series,
        later_ohm=tuple(map(float, later[0] + later[1])),
        lag_s=float(np.mean((seconds[0] * later[0] + seconds[1] * later[1]) / (later[0] + later[1]))),
        blend_s=blend_s,
        capacity_Ah=float(p.capacity_Ah * storage_factor(p.storage_months, p.storage_temperature_degC)),
        worst_fit=float(np.abs(off).max()),
    )


def run(cheap: Cheap, measured: Measured, start_soc: Scalar) -> Array:
    """Return the estimate at each row, shape (rows,); pure, so that it may be vmapped."""
    duration = jnp.diff(measured.time_s, prepend=measured.time_s[:1])
    at_once, later = (
        jnp.interp(measured.degC, jnp.asarray(cheap.degC), jnp.asarray(ohm))
        for ohm in (cheap.at_once_ohm, cheap.later_ohm)
    )

    def advance(carry, row):
        soc, lagged = carry
        seconds, current, volts, now_ohm, later_ohm = row
        lagged += (current - lagged) * seconds / (cheap.lag_s + seconds)
        soc -= current * seconds / (3600.0 * cheap.capacity_Ah)
        rest_V = volts + now_ohm * current + later_ohm * lagged - cheap.centre_V
        seen = jnp.clip(jnp.polyval(jnp.asarray(cheap.soc_of_volts), rest_V), 0.0, 1.0)
        pull = (seen - soc) * seconds / (cheap.blend_s + seconds)
        soc += jnp.where(jnp.isfinite(volts), pull, 0.0)
        return (soc, lagged), soc

    rows = (duration, measured.current_A, measured.voltage_V, at_once, later)
    return jax.lax.scan(advance, (jnp.asarray(start_soc, dtype=float), jnp.zeros(())), rows)[1]
