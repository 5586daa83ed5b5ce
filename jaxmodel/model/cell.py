"""One lithium cell: charge, open-circuit voltage, resistances and two RC pairs (eqs. 1-10)."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp

from jaxmodel.model.curves import CellCurves
from jaxmodel.model.declaration import Scalar
from jaxmodel.model.flow import Flow, State, integral, relaxation
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.ports import CellContext, Effect, flows_of, fold

ZERO_DEGC_IN_K = 273.15
STORAGE_GAS_CONSTANT = 8.3143  # J/(mol K), as eq. 8 prints it
GAS_CONSTANT = 8.314  # J/(mol K)
REFERENCE_DEGC = 20.0  # at which tables hold: of the open-circuit voltage, and of resistances with an activation energy


_ELEMENTS = ("series_resistance_ohm", "R_TS", "C_TS", "R_TL", "C_TL", "heat_transfer")
_LATER = (*_ELEMENTS, "current_A", "voltage_V", "counted_current_A")


class Cell(eqx.Module):
    """The quantities of one cell that do not depend on the current; its resistances are in the context."""

    context: CellContext
    effects: tuple[Effect, ...]
    open_circuit_voltage_V: Scalar


def arrhenius(energy: Scalar, celsius: Scalar, reference: float = REFERENCE_DEGC) -> Scalar:
    """Return exp(E/R (1/T - 1/T_ref)), by which what is activated with E [J/mol] is slower than at the reference."""
    colder = 1.0 / (celsius + ZERO_DEGC_IN_K) - 1.0 / (reference + ZERO_DEGC_IN_K)
    return jnp.exp(energy / GAS_CONSTANT * colder)


def heating(share: Scalar) -> Scalar:
    """Return the share of a pair's loss that becomes heat in addition: at -1 and below none of the loss is left.

    A pair that cooled the cell as it loses energy would let it run away to the absolute zero.
    """
    return jnp.maximum(share, -1.0)


def initial_soc(temperature_difference_K: Scalar) -> Scalar:
    """Return the initial state of charge, eq. 2: 1 - 0.000442 (dT + 0.714932)^2 with dT = T_cell - T_amb in K.

    At dT = 0 this is 0.99977; the paper then takes 1, and so does the default of `initial_soc`.
    """
    return 1.0 - 0.000442 * (temperature_difference_K + 0.714932) ** 2


def storage_factor(months: Scalar, storage_temperature_degC: Scalar) -> Scalar:
    """Return F_cc, the share of the capacity left after storage, eq. 8: 1 - 1.544e5 exp(-40498 / (8.3143 T_K)) t."""
    kelvin = storage_temperature_degC + ZERO_DEGC_IN_K
    return 1.0 - 1.544e5 * jnp.exp(-40498.0 / (STORAGE_GAS_CONSTANT * kelvin)) * months


def cycle_resistance(cycles: Scalar) -> Scalar:
    """Return R_cyc in ohm, eq. 7: 0.0015 sqrt(n); its derivative by n at n = 0, which is infinite, is given as 0."""
    positive = jnp.where(cycles > 0.0, cycles, 1.0)
    return jnp.where(cycles > 0.0, 0.0015 * jnp.sqrt(positive), 0.0)


def initial_state(parameters: Parameters) -> State:
    """Return the cell's states at the start of a run: charged to `initial_soc`, RC pairs at rest."""
    return {"soc": parameters.initial_soc, "v_ts_V": jnp.zeros(()), "v_tl_V": jnp.zeros(())}


def evaluate(
    parameters: Parameters, curves: CellCurves, effects: tuple[Effect, ...], state: State, ambient_degC: Scalar
) -> Cell:
    """Return the cell's open-circuit voltage (V), resistances (ohm) and capacitances (F) at a state, eqs. 3-10."""
    p = parameters
    soc = state["soc"]
    nominal_charge = 3600.0 * p.capacity_Ah * storage_factor(p.storage_months, p.storage_temperature_degC)
    context = CellContext(
        parameters=p,
        curves=curves,
        state=state,
        soc=soc,
        ambient_degC=ambient_degC,
        temperature_degC=ambient_degC,
        usable_charge_C=nominal_charge,
        **{name: jnp.zeros(()) for name in _LATER},
    )
    temperature = fold(effects, "cell_temperature", ambient_degC, context)
    context = eqx.tree_at(lambda c: c.temperature_degC, context, temperature)
    context = eqx.tree_at(lambda c: c.usable_charge_C, context, fold(effects, "usable_charge", nominal_charge, context))

    ageing = fold(effects, "cycle_resistance", cycle_resistance(p.cycles), context)
    series = (curves.R_ints(soc, temperature) + ageing) * p.series_resistance_scale

    def rc_resistance(curve, pair):
        both = fold(effects, "rc_resistance", curve(soc, temperature) * p.rc_resistance_scale, context)
        return fold(effects, f"{pair}_rc_resistance", both, context)

    def rc_capacitance(curve, pair):
        both = fold(effects, "rc_capacitance", curve(soc, temperature) * p.rc_capacitance_scale, context)
        return fold(effects, f"{pair}_rc_capacitance", both, context)

    open_circuit = curves.ocv(soc, temperature) + p.ocv_offset_V
    if curves.dU_dT is not None:
        open_circuit = open_circuit + curves.dU_dT(soc, temperature) * (temperature - REFERENCE_DEGC)
    voltage = fold(effects, "open_circuit_voltage", open_circuit, context)
    elements = (
        fold(effects, "series_resistance", series, context),
        rc_resistance(curves.R_TS, "short"),
        rc_capacitance(curves.C_TS, "short"),
        rc_resistance(curves.R_TL, "long"),
        rc_capacitance(curves.C_TL, "long"),
        fold(effects, "heat_transfer", jnp.ones(()), context),
    )
    context = eqx.tree_at(lambda c: tuple(getattr(c, name) for name in _ELEMENTS), context, elements)
    return Cell(context=context, effects=effects, open_circuit_voltage_V=voltage)


def carrying(cell: Cell, current_A: Scalar) -> CellContext:
    """Return the cell's context with a current in it (A)."""
    return eqx.tree_at(lambda c: c.current_A, cell.context, current_A)


def voltage(cell: Cell, current_A: Scalar) -> Scalar:
    """Return the terminal voltage of one cell in V at a current (A, positive on discharge).

    V_cell = V_oc - i (R_ints + R_cyc) - V_TS - V_TL - overpotentials of the effects.
    """
    lost = fold(cell.effects, "overpotential", jnp.zeros(()), carrying(cell, current_A))
    state = cell.context.state
    return (
        cell.open_circuit_voltage_V
        - current_A * cell.context.series_resistance_ohm
        - state["v_ts_V"]
        - state["v_tl_V"]
        - lost
    )


def surface_temperature(cell: Cell) -> Scalar:
    """Return the temperature at a thermometer on the cell, in degC: that of the cell, unless an effect changes it."""
    return fold(cell.effects, "surface_temperature", cell.context.temperature_degC, cell.context)


def heat(cell: Cell, current_A: Scalar, current_variance_A2: Scalar) -> Scalar:
    """Return the mean heat generated in one cell in W: i (V_oc - V_cell) - i T_K dU/dT, plus that of effects.

    The variance of the current over the step (A^2) adds ohmic heat: a motor start draws ten times the mean current.
    """
    polarisation = current_A * (cell.open_circuit_voltage_V - voltage(cell, current_A))
    own = polarisation + current_variance_A2 * cell.context.series_resistance_ohm
    context = cell.context
    if context.curves.dU_dT is not None:
        kelvin = context.temperature_degC + ZERO_DEGC_IN_K
        own = own - current_A * kelvin * context.curves.dU_dT(context.soc, context.temperature_degC)
    return fold(cell.effects, "cell_heat", own, carrying(cell, current_A))


def flows(cell: Cell, current_A: Scalar, current_variance_A2: Scalar) -> dict[str, Flow]:
    """Return the flows of the cell's states under a mean current: eq. 1 and the RC pairs of eqs. 3-6."""
    context = carrying(cell, current_A)
    context = eqx.tree_at(lambda c: c.voltage_V, context, voltage(cell, current_A))
    counted = fold(cell.effects, "counted_current", current_A, context)
    context = eqx.tree_at(lambda c: c.counted_current_A, context, counted)
    own = {
        "soc": integral(-counted / context.usable_charge_C),
        "v_ts_V": relaxation(current_A * context.R_TS, context.R_TS * context.C_TS),
        "v_tl_V": relaxation(current_A * context.R_TL, context.R_TL * context.C_TL),
    }
    heat_W = heat(cell, current_A, current_variance_A2)
    return own | flows_of(cell.effects, context, None, heat_W)
