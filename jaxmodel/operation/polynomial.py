"""The paper's polynomial estimator: state of charge from the voltage, corrected for the drop across the resistances.

A few multiplications a step, for a controller without a filter. The open-circuit voltage is estimated from the reading,
V + R(T) i + R_rc(T) i_lagged; a polynomial gives the state of charge, which corrects the coulomb count (a complementary
filter).
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.base.in_short import InShort
from jaxmodel.model.cell import Cell, evaluate, storage_factor
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.electrothermal import Model, initial_state, read
from jaxmodel.operation.kalman import HYSTERESIS, Measured
from jaxmodel.operation.preparation import for_estimation

ORDER = 3  # of the polynomial, as in the paper's Fig. 8
FITTED_SOC = (0.1, 1.0)  # below, the open-circuit voltage falls too steeply for such a polynomial
_MIDDLE = 0.5


@dataclasses.dataclass(frozen=True, repr=False)
class PolynomialEstimator(InShort):
    """The whole estimator in a dozen numbers.

    Attributes:
        soc_of_volts: coefficients of the state of charge over the open-circuit voltage less `centre_V`, highest first.
        centre_V: mean voltage of the fit.
        degC: temperatures of the resistances.
        series_ohm: what the current takes at once at these temperatures, by the current: series resistance and
            overpotentials of effects, at a discharge in one hour.
        rc_ohm: resistance of both RC pairs at these temperatures.
        lag_s: mean time constant of the pairs.
        blend_s: time constant with which the count follows the voltage's state of charge.
        capacity_Ah: for the counting.
        worst_fit: largest error of the polynomial, in state of charge.
    """

    soc_of_volts: tuple[float, ...]
    centre_V: float
    degC: tuple[float, ...]
    series_ohm: tuple[float, ...]
    rc_ohm: tuple[float, ...]
    lag_s: float
    blend_s: float
    capacity_Ah: float
    worst_fit: float


def polynomial_estimator(model: Model, degC: np.ndarray, blend_s: float, order: int = ORDER) -> PolynomialEstimator:
    """Return the polynomial estimator of a cell's model with its effects, from its voltages at some temperatures.

    Args:
        model: of kind "cell".
        degC: temperatures of the resistances, rising; one alone makes an estimator without temperature.
        blend_s: as in `PolynomialEstimator`.
        order: of the polynomial.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import operation, preset_model
        >>> model, degC = preset_model("samsung_30q", "cell"), np.array([0.0, 20.0])
        >>> estimator = operation.polynomial_estimator(model, degC, blend_s=600.0)
        >>> len(estimator.soc_of_volts)
        4
    """
    model, p = for_estimation(model), model.parameters
    soc = jnp.linspace(*FITTED_SOC, 91)
    one_hour_A = p.capacity_Ah * storage_factor(p.storage_months, p.storage_temperature_degC)

    def at(charge: Scalar, celsius: Scalar) -> tuple[Array, Array, Cell]:
        """Return the voltage without current, what the current of an hour's discharge takes of it, and the cell."""
        inputs = {"current_A": jnp.zeros(()), "ambient_degC": celsius}
        state = initial_state(model, inputs) | {"soc": charge}
        if HYSTERESIS in state:
            state[HYSTERESIS] = jnp.ones(())  # the branch of a discharge
        volts = read(model, state, inputs)["voltage_V"]
        loaded = read(model, state, inputs | {"current_A": one_hour_A})["voltage_V"]
        return volts, volts - loaded, evaluate(p, model.curves, model.effects, state, celsius)

    volts = np.asarray(jax.vmap(lambda s: at(s, jnp.asarray(25.0))[0])(soc))
    centre = float(volts.mean())
    polynomial = np.polyfit(volts - centre, np.asarray(soc), order)
    off = np.polyval(polynomial, volts - centre) - np.asarray(soc)
    drops, cells = zip(
        *(at(jnp.asarray(_MIDDLE), jnp.asarray(celsius, dtype=float))[1:] for celsius in degC), strict=True
    )
    series = tuple(float(drop / one_hour_A) for drop in drops)
    pairs = [np.array([float(getattr(cell.context, name)) for cell in cells]) for name in ("R_TS", "R_TL")]
    farads = [np.array([float(getattr(cell.context, name)) for cell in cells]) for name in ("C_TS", "C_TL")]
    seconds = [r * c for r, c in zip(pairs, farads, strict=True)]
    return PolynomialEstimator(
        soc_of_volts=tuple(map(float, polynomial)),
        centre_V=centre,
        degC=tuple(map(float, degC)),
        series_ohm=series,
        rc_ohm=tuple(map(float, pairs[0] + pairs[1])),
        lag_s=float(np.mean((seconds[0] * pairs[0] + seconds[1] * pairs[1]) / (pairs[0] + pairs[1]))),
        blend_s=blend_s,
        capacity_Ah=float(one_hour_A),
        worst_fit=float(np.abs(off).max()),
    )


def run_polynomial(estimator: PolynomialEstimator, measured: Measured, start_soc: Scalar) -> Array:
    """Return the estimate at each row, shape (rows,); pure, so that it may be vmapped.

    Example:
        >>> import jax.numpy as jnp
        >>> from jaxmodel import operation, preset_model
        >>> time_s = jnp.arange(0.0, 600.0, 10.0)
        >>> current_A, degC, voltage_V = jnp.full(60, 2.0), jnp.full(60, 20.0), jnp.linspace(4.0, 3.9, 60)
        >>> measured = operation.Measured(time_s, current_A, degC, voltage_V)
        >>> import numpy as np
        >>> model, degC = preset_model("samsung_30q", "cell"), np.array([0.0, 20.0])
        >>> estimator = operation.polynomial_estimator(model, degC, blend_s=600.0)
        >>> operation.run_polynomial(estimator, measured, jnp.array(0.9)).shape
        (60,)
    """
    duration = jnp.diff(measured.time_s, prepend=measured.time_s[:1])
    series, pairs = (
        jnp.interp(measured.degC, jnp.asarray(estimator.degC), jnp.asarray(ohm))
        for ohm in (estimator.series_ohm, estimator.rc_ohm)
    )

    def advance(carry: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[tuple[Array, Array], Array]:
        soc, lagged = carry
        seconds, current, volts, series_ohm, rc_ohm = row
        lagged += (current - lagged) * seconds / (estimator.lag_s + seconds)
        soc -= current * seconds / (3600.0 * estimator.capacity_Ah)
        rest_V = volts + series_ohm * current + rc_ohm * lagged - estimator.centre_V
        by_voltage = jnp.clip(jnp.polyval(jnp.asarray(estimator.soc_of_volts), rest_V), 0.0, 1.0)
        correction = (by_voltage - soc) * seconds / (estimator.blend_s + seconds)
        soc += jnp.where(jnp.isfinite(volts), correction, 0.0)
        return (soc, lagged), soc

    rows = (duration, measured.current_A, measured.voltage_V, series, pairs)
    return jax.lax.scan(advance, (jnp.asarray(start_soc, dtype=float), jnp.zeros(())), rows)[1]
