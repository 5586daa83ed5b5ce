"""Further candidate effects of the cell: polarisation in the cold, ageing, contacts and a core that is warmer."""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from jaxmodel.effects.battery import CELL, GAS_CONSTANT, REFERENCE_DEGC
from jaxmodel.model.cell import ZERO_DEGC_IN_K
from jaxmodel.model.declaration import Scalar, parameter
from jaxmodel.model.flow import Flow, State, integral, relaxation
from jaxmodel.model.ports import CellContext, Effect

CHANGEOVER = 0.01  # share of the one-hour current over which a resistance of one direction sets in
LEAST_CAPACITY = 0.05  # share that is left however far a law of the capacity is extrapolated


class ArrheniusPolarisation(Effect):
    """The RC pairs follow an activation energy of their own, on top of that of all resistances."""

    name: ClassVar[str] = "arrhenius_polarisation"
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
        kelvin = context.temperature_degC + ZERO_DEGC_IN_K
        colder = 1.0 / kelvin - 1.0 / (REFERENCE_DEGC + ZERO_DEGC_IN_K)
        return value * jnp.exp(self.E_rc / GAS_CONSTANT * colder)


class CapacityFade(Effect):
    """Capacity is lost with every cycle, in addition to storage: Q (1 - f n/100)."""

    name: ClassVar[str] = "capacity_fade"
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
