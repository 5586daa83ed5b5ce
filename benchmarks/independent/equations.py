"""The continuous-time equations of cell, motor and robot, written from the design, not from the product.

Plain functions of one state vector. Numbers in brackets are equation numbers of the paper. Every effect of the
catalogue is always present, at its null value (`effects.NULL`) where nobody asked for it, so that one compiled
right-hand side serves every case of a kind. Some can have another form than the catalogue's (`forms`).

Units: SI, temperatures in degC, current positive on discharge. Inside one call `slide` is the direction in which the
rotor moves (+1, -1) or 0 where it is stuck: within such a stretch the right-hand side is smooth.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from benchmarks.independent.forms import either, levelling

CELL_STATES = ("soc", "v_ts", "v_tl", "v_3", "hysteresis", "t_cell")
WEAK_CELL_STATES = ("soc_weak", "v_ts_weak", "v_tl_weak")  # one cell of smaller capacity in a robot's pack
MOTOR_STATES = ("i_a", "speed", "x_1", "x_2")
STATES = (*CELL_STATES, *WEAK_CELL_STATES, *MOTOR_STATES, "t_lagged")
ZERO_CELSIUS = 273.15
GAS_CONSTANT = 8.314
FARADAY = 96485.0
GRAVITY = 9.81
LOWEST_SOC_OF_CURVES = 0.012  # the printed capacitances are negative below it
Tree = Mapping[str, Any]


def open_circuit_voltage(soc: jax.Array, temperature: jax.Array, p: Tree) -> jax.Array:
    """Return V_oc of one cell over SOC: Chen and Rincon-Mora 2006, or the case's table."""
    if "ocv" in p:
        return _table(p["ocv"], soc, temperature)
    return -1.031 * jnp.exp(-35.0 * soc) + 3.685 + 0.2156 * soc - 0.1178 * soc**2 + 0.3201 * soc**3


def series_resistance(soc: jax.Array, temperature: jax.Array, p: Tree) -> jax.Array:
    """Return R_ints in ohm (9, 10), or the case's table, which is then the whole of it."""
    if "R_ints" in p:
        return _table(p["R_ints"], soc, temperature)
    held = jnp.maximum(soc, LOWEST_SOC_OF_CURVES)
    return -1.399e-5 * temperature**2 - 2.768e-4 * temperature + 0.1562 * jnp.exp(-24.37 * held) + 0.07446


def pair_values(soc: jax.Array, temperature: jax.Array, p: Tree) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Return R_TS, C_TS, R_TL, C_TL (3-6) in ohm and farad, each from its table where the case has one."""
    held = jnp.maximum(soc, LOWEST_SOC_OF_CURVES)
    formulas = {
        "R_TS": 0.3208 * jnp.exp(-29.14 * held) + 0.04669,
        "C_TS": -752.9 * jnp.exp(-13.51 * held) + 703.6,
        "R_TL": 6.603 * jnp.exp(-155.2 * held) + 0.04984,
        "C_TL": -6056.0 * jnp.exp(-27.12 * held) + 4475.0,
    }
    r_ts, c_ts, r_tl, c_tl = (_table(p[k], soc, temperature) if k in p else formulas[k] for k in formulas)
    return r_ts, c_ts, r_tl, c_tl


def _table(table: Tree, soc: jax.Array, temperature: jax.Array) -> jax.Array:
    """Interpolate linearly over SOC and, where the table has rows for them, temperatures; held at the ends."""
    if "temperature_degC" not in table:
        return jnp.interp(soc, table["soc"], table["values"])
    at_each_temperature = jax.vmap(lambda row: jnp.interp(soc, table["soc"], row))(table["values"])
    return jnp.interp(temperature, table["temperature_degC"], at_each_temperature)


def usable_charge(temperature: jax.Array, p: Tree, e: Tree) -> jax.Array:
    """Return Q_usable in coulomb (1, 8), with its change over temperature."""
    stored_kelvin = p["storage_temperature_degC"] + ZERO_CELSIUS
    storage = 1.0 - 1.544e5 * jnp.exp(-40498.0 / (8.3143 * stored_kelvin)) * p["storage_months"]
    warmer = temperature - 20.0
    change = e["capacity_temperature"]["a"] * either(e["capacity_temperature"], warmer, levelling(warmer))
    faded = 1.0 - e["capacity_fade"]["f"] * p["cycles"] / 100.0
    return 3600.0 * p["capacity_Ah"] * storage * (1.0 + change) * faded


def entropy_slope(soc: jax.Array, e: Tree) -> jax.Array:
    """Return the change of one cell's open-circuit voltage with temperature, V/K."""
    slope = e["entropic_ocv"]["dU_dT"]
    return either(e["entropic_ocv"], slope, slope * (0.5 + 0.5 * soc))


def cell_part(y: dict[str, jax.Array], ambient: jax.Array, p: Tree, e: Tree) -> dict[str, jax.Array]:
    """Return what a cell's voltage and rates are made of, none of which depends on the present current."""
    heated = e["self_heating"]["on"]
    temperature = heated * y["t_cell"] + (1.0 - heated) * ambient
    kelvin = temperature + ZERO_CELSIUS
    colder = either(e["arrhenius_resistance"], 1.0 / kelvin - 1.0 / 293.15, (20.0 - temperature) / 293.15**2)
    arrhenius = jnp.exp(e["arrhenius_resistance"]["E_a"] / GAS_CONSTANT * colder)
    polarisation = arrhenius * jnp.exp(
        e["arrhenius_polarisation"]["E_rc"] / GAS_CONSTANT * (1.0 / kelvin - 1.0 / 293.15)
    )
    ageing = 0.0015 * jnp.sqrt(p["cycles"]) + e["resistance_ageing"]["c"] * p["cycles"]  # (7)

    def of_cell(soc: jax.Array) -> dict[str, jax.Array]:
        entropic = entropy_slope(soc, e) * (temperature - 20.0)
        r_ts, c_ts, r_tl, c_tl = pair_values(soc, temperature, p)
        return {
            "v_oc": open_circuit_voltage(soc, temperature, p) + p["ocv_offset_V"] + entropic,
            "r_series": (series_resistance(soc, temperature, p) + ageing) * p["series_resistance_scale"] * arrhenius,
            "r_ts": r_ts * p["rc_resistance_scale"] * polarisation,
            "r_tl": r_tl * p["rc_resistance_scale"] * polarisation,
            "c_ts": c_ts * p["rc_capacitance_scale"],
            "c_tl": c_tl * p["rc_capacitance_scale"],
        }

    both = jax.vmap(of_cell)(jnp.stack([y["soc"], y["soc_weak"]]))
    cell = {name: values[0] for name, values in both.items()}
    cell |= {f"{name}_weak": values[1] for name, values in both.items()}
    return cell | {
        "temperature": temperature,
        "kelvin": kelvin,
        "charge": usable_charge(temperature, p, e),
        "slow_drop": y["v_ts"] + y["v_tl"] + y["v_3"] + _loop(y["soc"], e["ocv_hysteresis"]) * y["hysteresis"],
        "weak_gain": cell["v_oc_weak"] - cell["v_oc"] - (y["v_ts_weak"] + y["v_tl_weak"] - y["v_ts"] - y["v_tl"]),
        "charge_transfer_volt": 2.0 * GAS_CONSTANT * kelvin / FARADAY,
        "per_exchange_current": _per_exchange_current(kelvin, e),
    }


def _per_exchange_current(kelvin: jax.Array, e: Tree) -> jax.Array:
    """Return 1 / i_0 at a temperature: zero, with a slope of zero, where there is no charge transfer."""
    slower = jnp.exp(e["charge_transfer"]["E_i"] / GAS_CONSTANT * (1.0 / kelvin - 1.0 / 298.15))
    return slower / e["charge_transfer"]["i_0"]


def cell_voltage(cell: dict[str, jax.Array], current: jax.Array, p: Tree, e: Tree) -> jax.Array:
    """Return the terminal voltage of one cell at `current`."""
    discharging = 0.5 + 0.5 * jnp.tanh(current / (0.01 * p["capacity_Ah"]))  # as a tanh its slope is finite everywhere
    series = cell["r_series"] * (1.0 + e["discharge_resistance"]["d"] * discharging)
    ratio = current * cell["per_exchange_current"]
    tafel = jnp.sign(current) * jnp.log1p(jnp.abs(ratio))
    transfer = cell["charge_transfer_volt"] * either(e["charge_transfer"], jnp.arcsinh(0.5 * ratio), tafel)
    return cell["v_oc"] - current * series - cell["slow_drop"] - transfer


def pack_voltage(cell: dict[str, jax.Array], current: jax.Array, p: Tree, e: Tree) -> jax.Array:
    """Return the voltage of n_series cells, one of which may be at another state of charge.

    "The same resistances" of that cell are read as the same curves, at its own state of charge: the development
    case with this effect is reproduced to its noise so, and missed by twice the noise at low charge otherwise.
    """
    weak_gain = cell["weak_gain"] - current * (cell["r_series_weak"] - cell["r_series"])
    return p["n_series"] * cell_voltage(cell, current, p, e) + weak_gain


def robot_draw(
    cell: dict[str, jax.Array], motors: jax.Array, ambient: jax.Array, p: Tree, e: Tree
) -> tuple[jax.Array, jax.Array]:
    """Return the pack's current and voltage (21): the constant-power part of the load depends on the voltage.

    Newton from the constant-current draw; each pass squares a relative error that starts at a few percent.
    """
    onboard = p["onboard_current_A"] * (1.0 + e["onboard_temperature"]["a"] * (ambient - 20.0))
    share = e["constant_power_load"]["s"]
    nominal = p["nominal_cell_voltage_V"] * p["n_series"]

    def newton(_: int, current: jax.Array) -> jax.Array:
        voltage = pack_voltage(cell, current, p, e)
        per = cell["per_exchange_current"]
        slopes = 0.5 * per / jnp.sqrt(1.0 + (0.5 * per * current) ** 2), per / (1.0 + per * jnp.abs(current))
        transfer_slope = cell["charge_transfer_volt"] * either(e["charge_transfer"], *slopes)
        slope = cell["r_series"] - cell["r_series_weak"] - p["n_series"] * (cell["r_series"] + transfer_slope)
        excess = current - motors - onboard * ((1.0 - share) + share * nominal / voltage)
        return current - excess / (1.0 + onboard * share * nominal / voltage**2 * slope)

    current = jax.lax.fori_loop(0, 6, newton, motors + onboard)
    return current, pack_voltage(cell, current, p, e)


def motor_part(
    y: dict[str, jax.Array], load_torque: jax.Array, ambient: jax.Array, slide: jax.Array, p: Tree, e: Tree
) -> dict[str, jax.Array]:
    """Return the motor's coefficients, torques and losses (12, 13, 16, 17), bridge apart."""
    i_a, speed = y["i_a"], y["speed"]
    case = ambient + y["x_2"]
    winding = case + y["x_1"]
    warmer = winding - p["T_0"]
    resistance = p["R_0"] * (1.0 + p["psi_R"] * warmer)
    magnet, thinning, stribeck, windage = (
        e[name] for name in ("magnet_temperature", "friction_temperature", "stribeck_friction", "windage")
    )
    k = p["k_tau"] * (1.0 + magnet["psi_k"] * either(magnet, warmer, warmer * (1.0 + warmer / 150.0)))
    coulomb = p["tau_0"] * jnp.exp(-thinning["b_T"] * either(thinning, case - 20.0, levelling(case - 20.0)))
    # Of the speed's size: the offset keeps its slope finite where the rotor comes to rest.
    size = jnp.sqrt(speed**2 + 1e-6)
    fading = either(stribeck, jnp.exp(-((speed / stribeck["w_s"]) ** 2)), jnp.exp(-size / stribeck["w_s"]))
    saturating = (i_a / e["saturation"]["i_s"]) ** 2
    saturated = either(e["saturation"], 1.0 / (1.0 + saturating), 1.0 / jnp.sqrt(1.0 + 2.0 * saturating))
    gear = e["gear_loss"]["e"]
    gear = either(e["gear_loss"], gear, gear * ((load_torque / 0.1) ** 2 + 1e-6) ** -0.1)
    # `slide` in place of the sign of the speed keeps the equations smooth up to, and a little past, the reversal.
    one_way = p["tau_0"] * e["directional_friction"]["a"] * speed * jnp.abs(speed) / (speed**2 + 1.0)
    # Eddy and hysteresis losses of the iron drag as friction does, and their heat is the stator's.
    iron = e["iron_loss"]["T_h"] * (slide + speed / e["iron_loss"]["w_e"])
    friction = (
        slide * (coulomb + one_way + stribeck["tau_s"] * fading)
        + e["viscous_friction"]["b"] * speed
        + windage["c"] * slide * either(windage, speed**2, 250.0**0.3 * size**1.7)
    )
    return {
        "winding": winding,
        "case": case,
        "resistance": resistance,
        "inductance": p["L_a"] * (1.0 + p["psi_L"] * warmer),
        "back_emf": k * speed,
        "brush": e["brush_drop"]["V_b"] * jnp.tanh(i_a / 0.1)
        + e["brush_current_drop"]["V_l"] * jnp.arcsinh(i_a / e["brush_current_drop"]["i_b"]),
        "drive": k * i_a * saturated - load_torque * (1.0 + gear),
        "breakaway": coulomb + stribeck["tau_s"] + e["iron_loss"]["T_h"],
        "friction": friction + iron,
        "loss": i_a**2 * resistance + speed * friction,
        "iron_loss": speed * iron,
    }


@partial(jax.jit, static_argnames="kind")  # traced once, though the solver uses it in many places
def algebra(kind: str, vector: jax.Array, inputs: jax.Array, slide: jax.Array, p: Tree, e: Tree) -> dict[str, Any]:
    """Return every algebraic quantity of `kind` for one state.

    Args:
        kind: "cell", "motor" or "robot".
        vector: the state in the order of STATES, shape (14,).
        inputs: what drives it (current_A, voltage_V or duty), load_torque_Nm, ambient_degC; shape (3,).
        slide: direction of the rotor's motion, 0 where it is stuck.
        p: parameters as `prepare_parameters` gives them.
        e: every effect's parameters as `effects.complete` gives them.
    """
    y: dict[str, jax.Array] = dict(zip(STATES, vector, strict=True))
    drive, load_torque, ambient = inputs
    out: dict[str, Any] = {"y": y, "ambient": ambient}
    if kind != "cell":
        out["motor"] = motor_part(y, load_torque, ambient, slide, p, e)
    if kind in ("cell", "robot"):
        out["cell"] = cell_part(y, ambient, p, e)
    if kind == "cell":
        out["current"] = drive
        out["v_cell"] = cell_voltage(out["cell"], drive, p, e)
    elif kind == "robot":
        out["current"], out["v_pack"] = robot_draw(out["cell"], p["n_motors"] * drive * y["i_a"], ambient, p, e)  # (14)
        out["v_cell"] = cell_voltage(out["cell"], out["current"], p, e)
        dead = e["bridge_dead_time"]["d"]
        given = drive - dead * jnp.tanh(drive / (0.02 + dead))
        out["v_motor"] = given * out["v_pack"] - e["bridge_resistance"]["R_on"] * y["i_a"]
        out["motor"]["loss"] += e["pwm_ripple"]["k_r"] * (drive * (1.0 - drive) * out["v_pack"]) ** 2
    else:
        out["v_motor"] = drive
    return out


@partial(jax.jit, static_argnames="kind")  # traced once, though the solver uses it in many places
def derivative(kind: str, vector: jax.Array, inputs: jax.Array, slide: jax.Array, p: Tree, e: Tree) -> jax.Array:
    """Return the time derivative of the state vector; arguments as those of `algebra`."""
    a = algebra(kind, vector, inputs, slide, p, e)
    rate = dict.fromkeys(STATES, jnp.zeros(()))
    if "cell" in a:
        rate |= _cell_rates(a, p, e)
    if "motor" in a:
        rate |= _motor_rates(a, slide, p, e)
    rate["t_lagged"] = (_lag_target(a, e) - a["y"]["t_lagged"]) / e["temperature_lag"]["tau"]
    return jnp.stack([rate[name] for name in STATES])


def _loop(soc: jax.Array, effect: Tree) -> jax.Array:
    return effect["M_V"] * (1.0 + effect["b"] * (1.0 - 2.0 * soc))


def _cell_rates(a: dict[str, Any], p: Tree, e: Tree) -> dict[str, jax.Array]:
    y, cell, current = a["y"], a["cell"], a["current"]
    # abs(i)^(p-1) has no derivative at rest; the floor of 1e-30 A only keeps the Jacobian finite there.
    power, rate = e["rate_capacity"]["p"] - 1.0, jnp.maximum(jnp.abs(current), 1e-30) / p["capacity_Ah"]
    stress = either(e["rate_capacity"], jnp.exp(power * jnp.log(rate)), 1.0 + power * (rate - 1.0))
    drained = current * stress + a["v_cell"] / e["self_discharge"]["R_self"]
    heat = current * (cell["v_oc"] - a["v_cell"]) - current * cell["kelvin"] * entropy_slope(y["soc"], e)
    heating, diffusion = e["self_heating"], e["slow_diffusion"]
    warmer = y["t_cell"] - a["ambient"]
    lost = heating["hA"] * either(heating, warmer, warmer * (0.8 + 0.02 * jnp.abs(warmer)))
    third = diffusion["R_3"] * either(diffusion, jnp.ones(()), 1.5 - y["soc"])
    turn, turned = e["ocv_hysteresis"]["g"] / cell["charge"], y["hysteresis"]
    turned = either(e["ocv_hysteresis"], turned, turned * jnp.abs(turned))
    rates = {
        f"v_{pair}": current / cell[f"c_{pair}"] - y[f"v_{pair}"] / (cell[f"r_{pair}"] * cell[f"c_{pair}"])
        for pair in ("ts", "tl", "ts_weak", "tl_weak")
    }
    return rates | {
        "soc": -drained / cell["charge"],
        "soc_weak": -drained / (cell["charge"] * (1.0 - e["cell_imbalance"]["d"])),
        "v_3": (current * third - y["v_3"]) / diffusion["tau_3"],
        "hysteresis": turn * (current - jnp.abs(current) * turned),
        "t_cell": heating["on"] * (heat - lost) / heating["C_th"],
    }


def _motor_rates(a: dict[str, Any], slide: jax.Array, p: Tree, e: Tree) -> dict[str, jax.Array]:
    y, motor = a["y"], a["motor"]
    share = e["heat_path"]["s"]
    through = y["x_1"] / p["R_wc"]
    to_case = (1.0 - share) * motor["loss"] + share * through + motor["iron_loss"]
    case_rate = (to_case - y["x_2"] / p["R_ca"]) * p["R_ca"] / p["tau_ca"]  # (15)
    electrical = a["v_motor"] - y["i_a"] * motor["resistance"] - motor["back_emf"] - motor["brush"]
    return {
        "i_a": electrical / motor["inductance"],  # (11)
        "speed": jnp.where(slide == 0.0, 0.0, (motor["drive"] - motor["friction"]) / p["J"]),  # (13)
        "x_1": (motor["loss"] - through) * p["R_wc"] / p["tau_wc"] - share * case_rate,
        "x_2": case_rate,
    }


def _lag_target(a: dict[str, Any], e: Tree) -> jax.Array:
    """Return the true temperature that a lagging sensor follows, picked by the effect's weights."""
    weight = e["temperature_lag"]
    target = jnp.zeros(())
    if "cell" in a:
        target = target + weight["cell"] * a["cell"]["temperature"]
    if "motor" in a:
        target = target + weight["winding"] * a["motor"]["winding"] + weight["case"] * a["motor"]["case"]
    return target


def readings(kind: str, vector: jax.Array, inputs: jax.Array, p: Tree, e: Tree) -> dict[str, jax.Array]:
    """Return what ideal sensors read, and some inner quantities, under the names of the design."""
    speed = vector[STATES.index("speed")]
    a = algebra(kind, vector, inputs, jnp.sign(speed), p, e)
    out: dict[str, jax.Array] = {"lag_target": _lag_target(a, e), "t_lagged": a["y"]["t_lagged"]}
    if "cell" in a:
        out |= {
            "cell_temperature_degC": a["cell"]["temperature"],
            "soc": a["y"]["soc"],
            "open_circuit_voltage_V": a["cell"]["v_oc"],
            "v_ts_V": a["y"]["v_ts"],
            "v_tl_V": a["y"]["v_tl"],
        }
    if "motor" in a:
        out |= {
            "speed_rad_s": speed,
            "winding_temperature_degC": a["motor"]["winding"],
            "case_temperature_degC": a["motor"]["case"],
            "motor_loss_W": a["motor"]["loss"],
        }
    if kind == "cell":
        return out | {"voltage_V": a["v_cell"] - a["current"] * p["contact_ohm"]}
    if kind == "robot":
        return out | {
            "pack_voltage_V": a["v_pack"],
            "pack_current_A": a["current"],
            "motor_current_A": a["y"]["i_a"],
        }
    held = a["y"]["i_a"] * a["motor"]["resistance"] + a["motor"]["back_emf"] + a["motor"]["brush"]
    return out | {"current_A": a["y"]["i_a"], "voltage_V": held}  # the voltage of a steady current
