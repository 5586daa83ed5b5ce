"""Figs. 8 and 9 and the experiment of section 4: motors without load at 20 and 30 degC."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import xarray as xr
from scipy.optimize import brentq

from examples.paper.printed import LINEAR_SPAN_S, REDUCTION, TEST_DURATION_S, TESTS, VOLTMETER_V, Test, cycle_ohm
from jaxmodel import Model, Profile, constant, preset_model, simulate, sweeps, with_values
from jaxmodel.sensitivity import doubling_test

FIG_8_DURATION_S, STEP_S = 3000.0, 10.0
N_SERIES = 6.0
# The paper states no duty for Fig. 8: that of its tables, and full speed as in its experiment.
DUTIES = (0.3, 1.0 - REDUCTION, 1.0)
PULSE_S = 60.0  # on, and as long off: assumed; the paper says "pulse discharge" and no more
CIRCUIT = ("series_resistance_scale", "rc_resistance_scale", "rc_capacitance_scale")
MOTOR_CIRCUIT = ("R_0", "L_a", "k_tau")
GAS_CONSTANT = 8.314


@dataclasses.dataclass(frozen=True)
class Gradients:
    """Slopes of a cell's voltage in V/s, each by a method that the paper names for Fig. 8.

    Attributes:
        cubic_mean: of the third-order polynomial, from its start to its end.
        linear: of a straight line over 30 to 1080 s.
        first_order: of a straight line over all.
        cubic: coefficients of the polynomial, highest power first, V over s.
    """

    cubic_mean: float
    linear: float
    first_order: float
    cubic: tuple[float, ...]


def gradients(time_s: np.ndarray, cell_V: np.ndarray) -> Gradients:
    """Return the slopes of a trajectory from its second row on: in the first row the motors have no current yet."""
    time_s, cell_V = time_s[1:], cell_V[1:]
    cubic = np.polynomial.Polynomial.fit(time_s, cell_V, 3).convert().coef
    at = np.polynomial.polynomial.polyval(time_s[[0, -1]], cubic)
    straight = (time_s >= LINEAR_SPAN_S[0]) & (time_s <= LINEAR_SPAN_S[1])
    return Gradients(
        cubic_mean=float((at[1] - at[0]) / (time_s[-1] - time_s[0])),
        linear=float(np.polyfit(time_s[straight], cell_V[straight], 1)[0]),
        first_order=float(np.polyfit(time_s, cell_V, 1)[0]),
        cubic=tuple(float(c) for c in np.pad(cubic, (0, 4 - cubic.size))[::-1]),
    )


def soc_at_rest(cell_V: float) -> float:
    """Return the state of charge at which the model's open-circuit voltage is this, in V."""
    ocv = preset_model("paper", "robot").curves.ocv
    return float(brentq(lambda soc: float(ocv(jnp.asarray(soc), jnp.asarray(20.0))) - cell_V, 0.01, 1.0))  # type: ignore[arg-type]


def no_load() -> xr.Dataset:
    """Return voltage and draw over duty, ambient and the charge at the start: full, and that of the measured 22.6 V."""
    study = sweeps.Study(
        title="No load",
        kind="robot",
        profile={"duration_s": FIG_8_DURATION_S, "step_s": STEP_S, "load_torque_Nm": 0.0},  # type: ignore[arg-type]
        axes={
            "duty": list(DUTIES),
            "ambient_degC": [20.0, 30.0],
            "initial_soc": [1.0, soc_at_rest(TESTS[0].initial_V / N_SERIES)],
        },
        metrics=["soc_gradient"],
        store=["pack_voltage_V", "pack_current_A", "soc"],
    )
    return sweeps.run(study)


def trajectory(data: xr.Dataset, duty: float, ambient_degC: float = 20.0, full: bool = True) -> np.ndarray:
    """Return the voltage of one cell over the stored times."""
    lane = data["pack_voltage_V"].sel(duty=duty, ambient_degC=ambient_degC).isel(initial_soc=0 if full else 1)
    return lane.to_numpy() / N_SERIES


def pulsed() -> tuple[np.ndarray, np.ndarray]:
    """Return time and voltage of one cell where full speed and standstill alternate, at 0 N m and 20 degC."""
    still = constant(FIG_8_DURATION_S, STEP_S, duty=1.0, load_torque_Nm=0.0, ambient_degC=20.0)
    on = np.mod(still.time_s - 0.5 * STEP_S, 2.0 * PULSE_S) < PULSE_S
    ran = simulate(
        preset_model("paper", "robot"), Profile(still.time_s, still.inputs | {"duty": np.where(on, 1.0, 0.0)})
    )
    return still.time_s, np.asarray(ran.readings["pack_voltage_V"]) / N_SERIES


def doubled(duty: float) -> tuple[xr.Dataset, Gradients]:
    """Return the paper's parametric test by `jaxmodel.sensitivity`, and the slopes with all components doubled.

    The data set is that of `jaxmodel.sensitivity.doubling_test` for each component alone, at 0 N m and 20 degC over
    Fig. 8's time; the slopes are those of a cell whose whole equivalent circuit is doubled at once, motors' included.
    """
    model = preset_model("paper", "robot")
    profile = constant(FIG_8_DURATION_S, STEP_S, duty=duty, load_torque_Nm=0.0, ambient_degC=20.0)
    data = doubling_test(model, profile, [*CIRCUIT, *MOTOR_CIRCUIT], (), ["pack_voltage_V"])
    ran = simulate(_doubled(model), profile)
    return data, gradients(profile.time_s, np.asarray(ran.readings["pack_voltage_V"]) / N_SERIES)


def _doubled(model: Model) -> Model:
    names = (*CIRCUIT, *MOTOR_CIRCUIT)
    return with_values(model, {name: 2.0 * getattr(model.parameters, name) for name in names})


@dataclasses.dataclass(frozen=True)
class Held:
    """One test of section 4 and its simulation; gradients in V/s of one cell, resistances in ohm.

    Attributes:
        test: as printed.
        implied_s: the time over which the drop of Table 3 gives the gradient of Table 5; NaN without a drop.
        over_test: the drop of Table 3 over the whole half hour.
        least: the steepest gradient over the half hour that two readings good to 0.1 V allow.
        greatest: the flattest.
        from_full: the model's, from a full pack, over the half hour.
        from_rest: the model's, from the charge at which its pack rests at the measured 22.6 V.
        final_V: pack voltage that the model ends with from there.
        cell_ohm: R_ints + R_cyc of one cell there, as the model has it.
    """

    test: Test
    implied_s: float
    over_test: float
    least: float
    greatest: float
    from_full: float
    from_rest: float
    final_V: float
    cell_ohm: float

    @property
    def consistent(self) -> bool:
        """Whether the model's gradient lies within what the readings allow."""
        return self.least <= self.from_rest <= self.greatest


def experiment(data: xr.Dataset) -> list[Held]:
    """Compare the four tests with the model: 15 % less motor current is 15 % less duty, as i_Mx = rho i_a."""
    held = []
    for test in TESTS:
        duty = 1.0 - REDUCTION if test.compensated else 1.0
        drop = test.final_V - test.initial_V
        per_second = 1.0 / (N_SERIES * TEST_DURATION_S)
        lane = data.sel(duty=duty, ambient_degC=test.ambient_degC)
        kept = (lane["time_s"] >= STEP_S) & (lane["time_s"] <= TEST_DURATION_S)
        during = lane.isel(time_s=np.flatnonzero(kept.to_numpy()))
        change = (during["pack_voltage_V"].isel(time_s=-1) - during["pack_voltage_V"].isel(time_s=0)) * per_second
        soc = float(lane["initial_soc"][1])
        held.append(
            Held(
                test=test,
                implied_s=drop / N_SERIES / test.gradient_V_s if test.gradient_V_s else float("nan"),
                over_test=drop * per_second,
                least=(drop - 2.0 * VOLTMETER_V) * per_second,
                greatest=(drop + 2.0 * VOLTMETER_V) * per_second,
                from_full=float(change.isel(initial_soc=0)),
                from_rest=float(change.isel(initial_soc=1)),
                final_V=float(during["pack_voltage_V"].isel(initial_soc=1, time_s=-1)),
                cell_ohm=cell_resistance(soc, test.ambient_degC),
            )
        )
    return held


def cell_resistance(soc: float, ambient_degC: float) -> float:
    """Return R_ints + R_cyc of one cell in ohm, eqs. 7, 9 and 10."""
    model = preset_model("paper", "robot")
    series = model.curves.R_ints(jnp.asarray(soc), jnp.asarray(ambient_degC))
    return float(series) + cycle_ohm(float(model.parameters.cycles))


def activation_energy(ohm_20: float, ohm_30: float) -> float:
    """Return the E_a in J/mol with which a resistance falls from one value to the other between 20 and 30 degC."""
    return float(GAS_CONSTANT * np.log(ohm_20 / ohm_30) / (1.0 / 293.15 - 1.0 / 303.15))
