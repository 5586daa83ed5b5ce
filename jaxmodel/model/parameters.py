"""The one table of parameters: name, symbol, equation, unit, meaning, default, bounds, transform and source."""

from __future__ import annotations

import equinox as eqx

from jaxmodel.base.errors import ParameterError, instead
from jaxmodel.base.in_short import InShort
from jaxmodel.model.declaration import ParameterInfo, Scalar, describe, parameter

_PAPER = "Specht et al., section 3"
_RE50 = "maxon RE50 24 V data sheet"


class Parameters(InShort, eqx.Module):
    """Every parameter of the base model; one set serves the kinds cell, motor and robot.

    A pytree whose leaves are scalars: any leaf may be differentiated, and under `vmap` any leaf may carry lanes.

    Example:
        >>> from jaxmodel import Parameters
        >>> Parameters(capacity_Ah=2.5, cycles=100)
        <Parameters: capacity_Ah=2.5, cycles=100>
    """

    capacity_Ah: Scalar = parameter(
        5.2,
        unit="A h",
        meaning="nominal capacity of a cell",
        symbol="Q",
        equation="1",
        lower=1e-7,
        upper=1e4,
        transform="log",
        source=_PAPER,
    )
    initial_soc: Scalar = parameter(
        1.0,
        unit="",
        meaning="state of charge at the start of a run",
        symbol="SOC_0",
        equation="2",
        lower=0.0,
        upper=1.1,
        source="eq. 2 with T_cell = T_amb gives 0.9998; the paper takes 1",
    )
    initial_temperature_rise_K: Scalar = parameter(
        0.0,
        unit="K",
        meaning="cell above ambient at the start of a run, where it has a temperature of its own",
        lower=-150.0,
        upper=150.0,
        source="design: a cell that has rested long",
    )
    initial_hysteresis: Scalar = parameter(
        0.0,
        unit="",
        meaning="state of the hysteresis loop at the start of a run, 1 after a discharge, -1 after a charge",
        symbol="h_0",
        lower=-1.0,
        upper=1.0,
        source="design: the middle of the loop",
    )
    cycles: Scalar = parameter(
        25.0, unit="", meaning="charging cycles done", symbol="n", equation="7", lower=0.0, upper=1e5, source=_PAPER
    )
    storage_months: Scalar = parameter(
        18.0,
        unit="months",
        meaning="time spent in storage",
        symbol="t",
        equation="8",
        lower=0.0,
        upper=600.0,
        source=_PAPER,
    )
    storage_temperature_degC: Scalar = parameter(
        20.0,
        unit="degC",
        meaning="temperature of the storage",
        symbol="T",
        equation="8",
        lower=-60.0,
        upper=100.0,
    )
    series_resistance_scale: Scalar = parameter(
        1.0,
        unit="",
        meaning="multiplies R_ints + R_cyc",
        equation="7, 9, 10",
        lower=1e-3,
        upper=1e3,
        transform="log",
        source="design: 1 is the formula or table itself",
    )
    rc_resistance_scale: Scalar = parameter(
        1.0,
        unit="",
        meaning="multiplies R_TS and R_TL",
        equation="3, 5",
        lower=1e-3,
        upper=1e3,
        transform="log",
        source="design: 1 is the formula or table itself",
    )
    rc_capacitance_scale: Scalar = parameter(
        1.0,
        unit="",
        meaning="multiplies C_TS and C_TL",
        equation="4, 6",
        lower=1e-3,
        upper=1e3,
        transform="log",
        source="design: 1 is the formula or table itself",
    )
    ocv_offset_V: Scalar = parameter(
        0.0,
        unit="V",
        meaning="added to the open-circuit voltage of each cell",
        lower=-1.0,
        upper=1.0,
        source="design: 0 is the formula or table itself",
    )
    n_series: Scalar = parameter(
        6.0, unit="", meaning="cells in series in the pack", lower=1.0, upper=1000.0, whole=True, source=_PAPER
    )
    nominal_cell_voltage_V: Scalar = parameter(
        3.8,
        unit="V",
        meaning="nominal voltage of a cell, for a constant-power load",
        lower=0.5,
        upper=10.0,
        source=_PAPER,
    )
    R_0: Scalar = parameter(
        0.103,
        unit="ohm",
        meaning="winding resistance at T_0",
        symbol="R_0",
        equation="17",
        lower=1e-5,
        upper=1e4,
        transform="log",
        source=_PAPER,
    )
    psi_R: Scalar = parameter(
        0.0039,
        unit="1/K",
        meaning="temperature coefficient of the winding resistance",
        symbol="psi",
        equation="17",
        lower=0.0,
        upper=0.02,
        source=_PAPER,
    )
    psi_L: Scalar = parameter(
        0.0,
        unit="1/K",
        meaning="temperature coefficient of the armature inductance",
        symbol="psi",
        equation="17",
        lower=-0.005,
        upper=0.005,
        source="neglected in the paper's section 4",
    )
    k_tau: Scalar = parameter(
        0.0385,
        unit="N m/A",
        meaning="torque constant and, in SI, back-EMF constant",
        symbol="k_tau",
        equation="11, 12",
        lower=1e-6,
        upper=1e3,
        transform="log",
        source=_RE50,
    )
    L_a: Scalar = parameter(
        7.2e-5,
        unit="H",
        meaning="armature inductance",
        symbol="L_a",
        equation="11",
        lower=1e-9,
        upper=10.0,
        transform="log",
        source=_RE50,
    )
    J: Scalar = parameter(
        5.42e-5,
        unit="kg m2",
        meaning="inertia of the rotor and what it drives, seen by the rotor",
        symbol="J",
        equation="13",
        lower=1e-12,
        upper=1e3,
        transform="log",
        source=_RE50,
    )
    initial_speed_rad_s: Scalar = parameter(
        0.0,
        unit="rad/s",
        meaning="speed of the motor at the start of a run",
        symbol="omega_0",
        equation="13",
        lower=-5e3,
        upper=5e3,
        source="the paper starts at rest",
    )
    initial_current_A: Scalar = parameter(
        0.0,
        unit="A",
        meaning="current of a motor driven by its voltage at the start of a run; a case has that of the first row",
        equation="11",
        lower=-1e4,
        upper=1e4,
        source="the paper starts at rest",
    )
    initial_winding_rise_K: Scalar = parameter(
        0.0,
        unit="K",
        meaning="winding above case at the start of a run",
        equation="15",
        lower=-200.0,
        upper=300.0,
        source="the paper starts at ambient",
    )
    initial_case_rise_K: Scalar = parameter(
        0.0,
        unit="K",
        meaning="case of the motor above ambient at the start of a run",
        equation="15",
        lower=-200.0,
        upper=300.0,
        source="the paper starts at ambient",
    )
    tau_0: Scalar = parameter(
        0.010,
        unit="N m",
        meaning="no-load (Coulomb) torque",
        symbol="tau_0",
        equation="13",
        lower=0.0,
        upper=1e3,
        transform="log",
        source=_PAPER,
    )
    T_0: Scalar = parameter(
        25.0,
        unit="degC",
        meaning="temperature at which R_0 holds",
        symbol="T_0",
        equation="17",
        lower=-60.0,
        upper=200.0,
        source=_RE50,
    )
    R_wc: Scalar = parameter(
        1.2,
        unit="K/W",
        meaning="thermal resistance, winding to case",
        symbol="R_wc",
        equation="15",
        lower=1e-6,
        upper=1e4,
        transform="log",
        source=_RE50,
    )
    R_ca: Scalar = parameter(
        3.8,
        unit="K/W",
        meaning="thermal resistance, case to ambient",
        symbol="R_ca",
        equation="15",
        lower=1e-6,
        upper=1e4,
        transform="log",
        source=_RE50,
    )
    tau_wc: Scalar = parameter(
        71.7,
        unit="s",
        meaning="thermal time constant, winding to case",
        symbol="tau_wc",
        equation="15",
        lower=1e-3,
        upper=1e7,
        transform="log",
        source=_RE50,
    )
    tau_ca: Scalar = parameter(
        1370.0,
        unit="s",
        meaning="thermal time constant, case to ambient",
        symbol="tau_ca",
        equation="15",
        lower=1e-3,
        upper=1e7,
        transform="log",
        source=_RE50,
    )
    n_motors: Scalar = parameter(
        2.0,
        unit="",
        meaning="track motors, equal and equally loaded",
        lower=1.0,
        upper=100.0,
        whole=True,
        source=_PAPER,
    )
    n_flipper_motors: Scalar = parameter(2.0, unit="", meaning="flipper motors", lower=0.0, upper=100.0, whole=True)
    n_arm_motors: Scalar = parameter(1.0, unit="", meaning="arm motors", lower=0.0, upper=100.0, whole=True)
    onboard_current_A: Scalar = parameter(
        0.3,
        unit="A",
        meaning="draw of the on-board electronics",
        symbol="I_ob",
        equation="20",
        lower=0.0,
        upper=1e3,
        transform="log",
        source="design: reproduces the paper's Table 2",
    )
    mass_kg: Scalar = parameter(
        40.0,
        unit="kg",
        meaning="mass that one track motor moves",
        symbol="m",
        equation="18",
        lower=0.0,
        upper=1e5,
        transform="log",
    )
    friction_coefficient: Scalar = parameter(
        0.7,
        unit="",
        meaning="friction of the tracks on the ground",
        symbol="mu",
        equation="18",
        lower=0.0,
        upper=5.0,
        transform="log",
        source=_PAPER,
    )
    wheel_radius_m: Scalar = parameter(
        0.1,
        unit="m",
        meaning="radius of the drive wheel",
        symbol="r",
        equation="18",
        lower=1e-4,
        upper=10.0,
        transform="log",
    )
    gear_ratio: Scalar = parameter(
        156.0,
        unit="",
        meaning="motor turns per wheel turn",
        symbol="G",
        equation="18",
        lower=1e-3,
        upper=1e5,
        transform="log",
        source=_PAPER,
    )
    drive_efficiency: Scalar = parameter(
        0.94,
        unit="",
        meaning="efficiency of motor and gear",
        symbol="eta",
        equation="18",
        lower=0.01,
        upper=1.0,
        transform="log",
        source=_PAPER,
    )


TABLE = describe(Parameters)


def info(name: str, where: str = "parameter table") -> ParameterInfo:
    """Return the entry of the table for `name`; raise ParameterError with the nearest name if there is none."""
    if name not in TABLE:
        raise ParameterError(f"{where}: no parameter is called '{name}'.{instead(name, TABLE)}")
    return TABLE[name]
