"""Candidate effects of the cell and the pack."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.model.cell import GAS_CONSTANT, REFERENCE_DEGC, ZERO_DEGC_IN_K, arrhenius, cycle_resistance, heating
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.flow import Flow, State, integral, relaxation
from jaxmodel.model.ports import CellContext, Effect

FARADAY = 96485.0  # C/mol
KINETICS_DEGC = 25.0  # at which an exchange current is stated

CELL = ("cell", "robot")
CHANGEOVER = 0.01  # share of the one-hour current over which a resistance of one direction sets in
LEAST_CAPACITY = 0.05  # share that is left however far a law of the capacity is extrapolated


class ArrheniusResistance(Effect):
    """All resistances fall with temperature (Arrhenius): exp(E_a / 8.314 (1/T_K - 1/293.15)), on top of eq. 9."""

    name: ClassVar[str] = "arrhenius_resistance"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R -> R exp(E_a/8.314 (1/T_K - 1/293.15)) for R_ints + R_cyc, R_TS, R_TL"
    E_a: Scalar = parameter(
        20e3, unit="J/mol", meaning="activation energy", null=0.0, lower=-2e4, upper=1.2e5, typical=(5e3, 40e3)
    )

    def _factor(self, context: CellContext) -> Scalar:
        return arrhenius(self.E_a, context.temperature_degC)

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale R_ints + R_cyc."""
        return value * self._factor(context)

    def rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale R_TS and R_TL."""
        return value * self._factor(context)


class CapacityTemperature(Effect):
    """The usable capacity follows the temperature: Q (1 + a (T - 20))."""

    name: ClassVar[str] = "capacity_temperature"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "Q -> Q (1 + a (T - 20))"
    a: Scalar = parameter(
        0.004, unit="1/K", meaning="change of capacity", null=0.0, lower=-0.03, upper=0.03, typical=(0.0005, 0.012)
    )

    def usable_charge(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the usable charge; it keeps a twentieth of itself far outside the range of the law."""
        return value * jnp.maximum(1.0 + self.a * (context.temperature_degC - REFERENCE_DEGC), 0.05)


class RateCapacity(Effect):
    """High currents use up more charge than they deliver (Peukert): i_eff = i (|i|/I_ref)^(p-1) in eq. 1."""

    name: ClassVar[str] = "rate_capacity"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "i -> i (|i|/I_ref)^(p-1) in eq. 1 only, I_ref = the nominal capacity in A"
    p: Scalar = parameter(1.1, unit="", meaning="Peukert exponent", null=1.0, lower=0.7, upper=2.0, typical=(1.02, 1.3))

    def counted_current(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the counted current; below a microampere the current is counted as it is."""
        flowing = jnp.abs(value) > 1e-6
        relative = jnp.where(flowing, jnp.abs(value), 1.0) / context.parameters.capacity_Ah
        return jnp.where(flowing, value * relative ** (self.p - 1.0), value)


class OcvHysteresis(Effect):
    """The open-circuit voltage lies below itself after discharge and above after charge: V -= M h."""

    name: ClassVar[str] = "ocv_hysteresis"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V -= M (1 + b (1 - 2 z)) h; dh/dt = |g i/Q| (sgn(i) - h); h(0) = h_0"
    M_V: Scalar = parameter(
        0.02, unit="V", meaning="half width of the loop", null=0.0, lower=0.0, upper=0.5, typical=(0.005, 0.06)
    )
    g: Scalar = parameter(
        40.0,
        unit="",
        meaning="how fast the loop is crossed, per full charge",
        lower=0.5,
        upper=5e3,
        transform="log",
        typical=(5.0, 200.0),
        shape_grid=(8.0, 30.0, 120.0),
    )
    b: Scalar = parameter(
        0.0, unit="", meaning="how much wider the loop is empty than at half charge, as a share of M",
        lower=-1.0, upper=1.0, typical=(-0.8, 0.8), shape_grid=(0.0,),
    )  # fmt: skip

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start where the run's `initial_hysteresis` says; 0, the default, is the middle of the loop."""
        return {"ocv_hysteresis.h": parameters.initial_hysteresis}

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Relax towards the branch that the current's sign chooses, by charge passed."""
        if cell is None:
            return {}
        pace = jnp.abs(self.g * cell.current_A / cell.usable_charge_C)
        return {"ocv_hysteresis.h": Flow(jnp.sign(cell.current_A) * pace, pace)}

    def overpotential(self, value: Scalar, context: CellContext) -> Scalar:
        """Lose M h; as an overpotential it dissipates, and the heat's V_oc is free of it."""
        width = self.M_V * (1.0 + self.b * (1.0 - 2.0 * context.soc))
        return value + width * context.state["ocv_hysteresis.h"]


class EntropicOcv(Effect):
    """The open-circuit voltage moves with temperature, and reversible heat comes with it."""

    name: ClassVar[str] = "entropic_ocv"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V_oc += dU_dT (T - 20); heat -i T_K dU_dT"
    dU_dT: Scalar = parameter(
        2e-4, unit="V/K", meaning="entropy coefficient", null=0.0, lower=-5e-3, upper=5e-3, typical=(-1e-3, 1e-3)
    )

    def open_circuit_voltage(self, value: Scalar, context: CellContext) -> Scalar:
        """Shift V_oc from its value at 20 degC."""
        return value + self.dU_dT * (context.temperature_degC - REFERENCE_DEGC)

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the reversible heat."""
        return value - context.current_A * (context.temperature_degC + ZERO_DEGC_IN_K) * self.dU_dT


class SelfHeating(Effect):
    """The cell warms by its own losses: C_th dT/dt = heat - hA (T - T_amb), T(0) = ambient + the run's initial rise."""

    name: ClassVar[str] = "self_heating"
    shown_by: ClassVar[str] = "cell_temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "C_th dT/dt = heat - hA (T - T_amb)"
    C_th: Scalar = parameter(
        80.0,
        unit="J/K",
        meaning="heat capacity of one cell",
        lower=1e-2,
        upper=1e5,
        transform="log",
        source="8 to 60 J/K per A h: 18650s 15 to 17, a 26650 of LiFePO4 about 30, a Leaf pouch of 33 A h 30 to 40",
        typical=(42.0, 312.0),
        shape_grid=(60.0, 200.0),
        scales="capacity",
    )
    hA: Scalar = parameter(
        0.3,
        unit="W/K",
        meaning="heat transfer of one cell to the ambient",
        lower=1e-3,
        upper=1e3,
        transform="log",
        typical=(0.05, 1.0),
        shape_grid=(0.1, 0.5),
        scales="surface",
    )

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start at the ambient temperature and what the run says that the cell is above it."""
        return {"self_heating.T_degC": jnp.asarray(ambient_degC) + parameters.initial_temperature_rise_K}

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Relax towards the ambient, warmed by the heat of the cell."""
        if cell is None:
            return {}
        transfer = self.hA * cell.heat_transfer
        target = cell.ambient_degC + heat_W / transfer
        return {"self_heating.T_degC": relaxation(target, self.C_th / transfer)}

    def cell_temperature(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the temperature rise of the cell to the ambient temperature that other effects give."""
        return value + (context.state["self_heating.T_degC"] - context.ambient_degC)


class SlowDiffusion(Effect):
    """A third, slow RC pair: diffusion in the electrodes."""

    name: ClassVar[str] = "slow_diffusion"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V -= V_3; tau_3 dV_3/dt = i R_3 - V_3"
    R_3: Scalar = parameter(
        0.015,
        unit="ohm",
        meaning="resistance of the pair",
        null=0.0,
        lower=0.0,
        upper=10.0,
        typical=(0.005, 0.05),
        scales="1/capacity",
    )
    tau_3: Scalar = parameter(
        800.0,
        unit="s",
        meaning="time constant of the pair",
        lower=1.0,
        upper=1e5,
        transform="log",
        typical=(200.0, 4000.0),
        shape_grid=(300.0, 800.0, 2500.0),
    )

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start at rest."""
        return {"slow_diffusion.v_V": jnp.zeros(())}

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Relax towards i R_3."""
        return {} if cell is None else {"slow_diffusion.v_V": relaxation(cell.current_A * self.R_3, self.tau_3)}

    def overpotential(self, value: Scalar, context: CellContext) -> Scalar:
        """Lose V_3."""
        return value + context.state["slow_diffusion.v_V"]


class ChargeTransfer(Effect):
    """Activation overpotential of the electrode reaction (Butler-Volmer, symmetric): an asinh of the current."""

    name: ClassVar[str] = "charge_transfer"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "V -= (2*8.314 T_K/96485) asinh(i/(2 i_0 exp(-E_i/8.314 (1/T_K - 1/298.15))))"
    i_0: Scalar = parameter(
        1.0,
        unit="A",
        meaning="exchange current",
        null=jnp.inf,
        lower=1e-3,
        upper=1e3,
        transform="log",
        typical=(0.1, 10.0),
        shape_grid=(0.2, 1.0, 4.0),
        scales="capacity",
    )
    E_i: Scalar = parameter(
        0.0,
        unit="J/mol",
        meaning="activation energy of the exchange current; 0: the same at every temperature",
        lower=-2e4,
        upper=1e5,
        typical=(0.0, 60e3),
        source="30 to 60 kJ/mol in physics-based models of cells",
        shape_grid=(0.0, 30e3),
    )

    def overpotential(self, value: Scalar, context: CellContext) -> Scalar:
        """Lose the activation overpotential."""
        kelvin = context.temperature_degC + ZERO_DEGC_IN_K
        slower = arrhenius(self.E_i, context.temperature_degC, KINETICS_DEGC)
        # Divided by i_0 first: without the effect that is infinite, and its product would have no derivative.
        ratio = context.current_A / (2.0 * self.i_0) * slower
        return value + 2.0 * GAS_CONSTANT * kelvin / FARADAY * jnp.arcsinh(ratio)


class SelfDischarge(Effect):
    """Charge leaks inside the cell: i + V_cell / R_self is counted."""

    name: ClassVar[str] = "self_discharge"
    rare: ClassVar[bool] = True  # sound cells lose a few percent a month, which is far less
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "i -> i + V_cell/R_self in eq. 1"
    R_self: Scalar = parameter(
        200.0,
        unit="ohm",
        meaning="leakage resistance of one cell",
        null=jnp.inf,
        lower=1.0,
        upper=1e7,
        transform="log",
        typical=(20.0, 2000.0),
        scales="1/capacity",
    )

    def counted_current(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the leakage."""
        return value + context.voltage_V / self.R_self


class CellImbalance(Effect):
    """One cell of the pack has less capacity: it starts full like the others and falls behind."""

    name: ClassVar[str] = "cell_imbalance"
    kinds: ClassVar[tuple[str, ...]] = ("robot",)
    equation: ClassVar[str] = "one of n_series cells has capacity Q (1 - d)"
    d: Scalar = parameter(
        0.1, unit="", meaning="missing share of its capacity", null=0.0, lower=0.0, upper=0.9, typical=(0.03, 0.3)
    )

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start at the state of charge of the others, at rest."""
        at_rest = {f"cell_imbalance.{name}": jnp.zeros(()) for name in ("v_ts_V", "v_tl_V")}
        return {"cell_imbalance.soc": parameters.initial_soc, **at_rest}

    def _rc(self, context: CellContext, pair: str) -> tuple[Scalar, Scalar]:
        """Return R (ohm) and C (F) of the weak cell's pair: the curves of the others, at its own state of charge."""
        weak, temperature = context.state["cell_imbalance.soc"], context.temperature_degC

        def at_own_charge(name: str) -> Scalar:
            curve = getattr(context.curves, name)
            return getattr(context, name) * curve(weak, temperature) / curve(context.soc, temperature)

        return at_own_charge(f"R_{pair}"), at_own_charge(f"C_{pair}")

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Count the same current on a smaller charge; polarise by the weak cell's own pairs."""
        if cell is None:
            return {}
        flows = {"cell_imbalance.soc": integral(-cell.counted_current_A / (cell.usable_charge_C * (1.0 - self.d)))}
        for pair in ("TS", "TL"):
            resistance, capacitance = self._rc(cell, pair)
            flows[f"cell_imbalance.v_{pair.lower()}_V"] = relaxation(
                cell.current_A * resistance, resistance * capacitance
            )
        return flows

    def weakest_cell_voltage(self, value: Scalar, context: CellContext) -> Scalar:
        """Fall short by the difference of open-circuit voltage, series drop and polarisation."""
        state, temperature = context.state, context.temperature_degC
        weak, curves = state["cell_imbalance.soc"], context.curves
        open_circuit = curves.ocv(context.soc, temperature) - curves.ocv(weak, temperature)
        ageing = cycle_resistance(context.parameters.cycles)
        ratio = (curves.R_ints(weak, temperature) + ageing) / (curves.R_ints(context.soc, temperature) + ageing)
        series = context.current_A * context.series_resistance_ohm * (ratio - 1.0)
        polarised = sum(state[f"cell_imbalance.{name}"] - state[name] for name in ("v_ts_V", "v_tl_V"))
        return value + open_circuit + series + polarised


class ResistanceAgeing(Effect):
    """R_cyc grows linearly too: + c n."""

    name: ClassVar[str] = "resistance_ageing"
    distinguished_by: ClassVar[str] = "cycles"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_cyc += c n"
    c: Scalar = parameter(
        1e-4,
        unit="ohm",
        meaning="resistance gained a cycle",
        null=0.0,
        lower=0.0,
        upper=0.1,
        typical=(1e-5, 1e-3),
        scales="1/capacity",
    )

    def cycle_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the linear growth."""
        return value + self.c * context.parameters.cycles


class ArrheniusPolarisation(Effect):
    """The RC pairs follow an activation energy of their own, on top of that of all resistances."""

    name: ClassVar[str] = "arrhenius_polarisation"
    rare: ClassVar[bool] = True
    needs: ClassVar[tuple[str, ...]] = ("arrhenius_resistance",)  # its activation energy is what differs from that
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R -> R exp(E_rc/8.314 (1/T_K - 1/293.15)) for R_TS, R_TL"
    E_rc: Scalar = parameter(
        10e3,
        unit="J/mol",
        meaning="activation energy beyond that of the series resistance",
        null=0.0,
        lower=-1e5,
        upper=1.2e5,
        typical=(-20e3, 20e3),
    )

    def rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale R_TS and R_TL."""
        return value * arrhenius(self.E_rc, context.temperature_degC)


class CapacityFade(Effect):
    """Capacity is lost with every cycle, in addition to storage: Q (1 - f n/100)."""

    name: ClassVar[str] = "capacity_fade"
    rare: ClassVar[bool] = True
    distinguished_by: ClassVar[str] = "cycles"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "Q -> Q (1 - f n/100)"
    f: Scalar = parameter(
        0.03,
        unit="",
        meaning="share of the capacity lost in 100 cycles",
        null=0.0,
        lower=0.0,
        upper=2.0,
        typical=(0.005, 0.3),
    )

    def usable_charge(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the usable charge."""
        return value * jnp.maximum(1.0 - self.f * context.parameters.cycles / 100.0, LEAST_CAPACITY)


class DischargeResistance(Effect):
    """The series resistance of a discharge is another than that of a charge, by a share d."""

    name: ClassVar[str] = "discharge_resistance"
    kinds: ClassVar[tuple[str, ...]] = CELL
    is_candidate: ClassVar[bool] = False
    equation: ClassVar[str] = "V -= d R i (1 + tanh(i/i_1))/2, i_1 = 0.01 of the nominal capacity in A"
    d: Scalar = parameter(
        0.1,
        unit="",
        meaning="share by which the series resistance is larger on discharge",
        null=0.0,
        lower=-0.9,
        upper=5.0,
        typical=(-0.3, 0.3),
    )

    def overpotential(self, value: Scalar, context: CellContext) -> Scalar:
        """Lose d times the series drop, on discharge alone."""
        current = context.current_A
        discharging = 0.5 * (1.0 + jnp.tanh(current / (CHANGEOVER * context.parameters.capacity_Ah)))
        return value + self.d * context.series_resistance_ohm * current * discharging


class ContactHeating(Effect):
    """A contact warms by its own loss, and its resistance with it."""

    name: ClassVar[str] = "contact_heating"
    rare: ClassVar[bool] = True
    shown_by: ClassVar[str] = "contact_temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_ints + R_cyc -> R_ints + R_cyc + k y; tau_c dy/dt = i^2 - y"
    k: Scalar = parameter(
        5e-5,
        unit="ohm/A2",
        meaning="resistance gained by the square of a lasting current",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(1e-5, 3e-4),
        scales="1/capacity3",
    )
    tau_c: Scalar = parameter(
        80.0,
        unit="s",
        meaning="time constant of the contact's warming",
        lower=0.1,
        upper=1e5,
        transform="log",
        typical=(20.0, 400.0),
        shape_grid=(30.0, 200.0),
    )

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start cold."""
        return {"contact_heating.y_A2": jnp.zeros(())}

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Follow the square of the current."""
        return {} if cell is None else {"contact_heating.y_A2": relaxation(cell.current_A**2, self.tau_c)}

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Add what the contact has gained."""
        return value + self.k * context.state["contact_heating.y_A2"]


class ContactDrift(Effect):
    """A contact gets worse while the run lasts, as a screw that loosens or an oxide that grows."""

    name: ClassVar[str] = "contact_drift"
    rare: ClassVar[bool] = True
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "R_ints + R_cyc -> R_ints + R_cyc + r t/3600, t from the start of the run"
    r: Scalar = parameter(
        2e-3,
        unit="ohm/h",
        meaning="resistance gained in an hour",
        null=0.0,
        lower=0.0,
        upper=100.0,
        typical=(3e-4, 2e-2),
        scales="1/capacity",
    )

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start the clock."""
        return {"contact_drift.time_h": jnp.zeros(())}

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Let the clock run."""
        return {} if cell is None else {"contact_drift.time_h": integral(1.0 / 3600.0)}

    def series_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Add what the contact has gained."""
        return value + self.r * context.state["contact_drift.time_h"]


class CoreTemperature(Effect):
    """The core is warmer than the surface that a thermometer sees; resistances and the like follow the core."""

    name: ClassVar[str] = "core_temperature"
    rare: ClassVar[bool] = True
    shown_by: ClassVar[str] = "core_temperature_degC"
    kinds: ClassVar[tuple[str, ...]] = CELL
    equation: ClassVar[str] = "T -> T + x inside the cell, T at its surface; tau_i dx/dt = R_i heat - x"
    R_i: Scalar = parameter(
        2.0,
        unit="K/W",
        meaning="thermal resistance from core to surface",
        null=0.0,
        lower=0.0,
        upper=1e3,
        typical=(0.5, 5.0),
        scales="1/surface",
    )
    tau_i: Scalar = parameter(
        40.0,
        unit="s",
        meaning="time constant of the core against the surface",
        lower=0.1,
        upper=1e5,
        transform="log",
        typical=(10.0, 200.0),
        shape_grid=(20.0, 120.0),
    )

    def initial_state(self, parameters, ambient_degC: Scalar) -> State:
        """Start as warm inside as outside."""
        return {"core_temperature.x_K": jnp.zeros(())}

    def flows(self, cell: CellContext | None, motor, heat_W) -> dict[str, Flow]:
        """Follow the heat that flows from core to surface."""
        return {} if cell is None else {"core_temperature.x_K": relaxation(self.R_i * heat_W, self.tau_i)}

    def cell_temperature(self, value: Scalar, context: CellContext) -> Scalar:
        """Give the cell the temperature of its core."""
        return value + context.state["core_temperature.x_K"]

    def surface_temperature(self, value: Scalar, context: CellContext) -> Scalar:
        """Leave the thermometer at the surface."""
        return value - context.state["core_temperature.x_K"]


class ArrheniusLongPolarisation(Effect):
    """The long RC pair follows an activation energy of its own, on top of that of both pairs."""

    name: ClassVar[str] = "arrhenius_long_polarisation"
    kinds: ClassVar[tuple[str, ...]] = CELL
    is_candidate: ClassVar[bool] = False
    equation: ClassVar[str] = "R_TL -> R_TL exp(E_l/8.314 (1/T_K - 1/293.15))"
    E_l: Scalar = parameter(
        5e3,
        unit="J/mol",
        meaning="activation energy beyond that of both RC pairs",
        null=0.0,
        lower=-1e5,
        upper=1.2e5,
        typical=(-20e3, 20e3),
    )

    def long_rc_resistance(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale R_TL."""
        return value * arrhenius(self.E_l, context.temperature_degC)


class HeatDetails(Effect):
    """Details of a self-heating cell: which share of its RC pairs' loss becomes heat, and free convection."""

    name: ClassVar[str] = "heat_details"
    kinds: ClassVar[tuple[str, ...]] = CELL
    is_candidate: ClassVar[bool] = False
    equation: ClassVar[str] = "heat += i (max(s, -1) V_TS + max(l, -1) V_TL); hA -> hA exp(c (T - T_amb)/10)"
    s: Scalar = parameter(
        0.0, unit="", meaning="share of the short RC pair's loss that is heat in addition", null=0.0, lower=-2.0,
        upper=2.0, typical=(-0.5, 0.5),
    )  # fmt: skip
    l: Scalar = parameter(  # noqa: E741
        0.0, unit="", meaning="the same of the long RC pair", lower=-2.0, upper=2.0, typical=(-0.5, 0.5)
    )
    c: Scalar = parameter(
        0.0,
        unit="",
        meaning="logarithm by which hA grows with 10 K above the ambient",
        lower=-1.0,
        upper=1.0,
        typical=(-0.15, 0.15),
        source="free convection: hA grows with the fourth root of the rise",
    )

    def cell_heat(self, value: Scalar, context: CellContext) -> Scalar:
        """Add the shares."""
        state = context.state
        return value + context.current_A * (heating(self.s) * state["v_ts_V"] + heating(self.l) * state["v_tl_V"])

    def heat_transfer(self, value: Scalar, context: CellContext) -> Scalar:
        """Scale the heat transfer."""
        return value * jnp.exp(self.c * (context.temperature_degC - context.ambient_degC) / 10.0)
