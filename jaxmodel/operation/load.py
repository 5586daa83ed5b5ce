"""The torque that a load asked of a motor, where nobody measured it: from current and speed, with a band.

J dw/dt = tau_D - tau_l - friction (eq. 13), solved for tau_l. Speed and torque are the states of a Kalman smoother
(Rauch, Tung and Striebel 1965): the speed is read, the torque is a random walk whose pace has the highest likelihood.
"""

from __future__ import annotations

import dataclasses
import html
import math
import re
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array
from scipy.optimize import minimize_scalar

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.in_short import InShort
from jaxmodel.base.late_binding import late_bound
from jaxmodel.case.build import case_model
from jaxmodel.case.known import Known
from jaxmodel.case.measurements import OPEN, REFERENCES, SET_BY
from jaxmodel.case.records import Case, Run
from jaxmodel.case.signals import after_pauses, duty_of, white_sd
from jaxmodel.case.simulation import simulate_case
from jaxmodel.case.specimens import together
from jaxmodel.effects.controllers import SERVO
from jaxmodel.effects.loads import LAW_EFFECTS
from jaxmodel.model import motor as motors
from jaxmodel.model.armature import Pair
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import info

# A motor slower than this share of its fastest stands: there its dry friction may be anything up to tau_0.
STILL = 0.01
# Decades of the random walk's pace that are searched, around the largest torque over the square root of the run's time.
DECADES = (-4.0, 4.0)
# Relative sd of a torque constant that a case does not state, and does not say how well it is known. Assumed.
UNSTATED = 0.3
# Blocks of a run over which a mean is compared: it holds many readings that are alike.
BLOCKS = 10


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RunLoad(InShort):
    """The load along one run.

    Attributes:
        run: its name.
        group: what its name begins with, before numbers: `asphalt` of `asphalt_01`.
        table: time_s, speed_rad_s, current_A, load_torque_Nm, sd_Nm (of each row, beside the common share), work_W
            (torque times speed), and drawn_W (voltage times current) where a voltage is known.
        common: relative sd that all torques of a case share: that of the torque constant.
        metres: driven, by speed, gear and wheel; NaN if the case does not state these.
    """

    run: str
    group: str
    table: pd.DataFrame
    common: float
    metres: float

    def _in_short(self) -> str:
        torque = self.table["load_torque_Nm"]
        return f"{self.run}, {len(self.table)} rows, {torque.mean():.3g} N m in the mean"


@dataclasses.dataclass(frozen=True, eq=False)
class LoadEstimate:
    """The load of a motor over the runs of a case.

    Example:
        >>> import numpy as np
        >>> import pandas as pd
        >>> from jaxmodel import Case
        >>> from jaxmodel.operation import estimate_load
        >>> time_s = np.arange(0.0, 5.0, 0.05)
        >>> frame = pd.DataFrame({"time_s": time_s, "voltage_V": 12.0, "current_A": 4.0 + np.sin(time_s)})
        >>> frame = frame.assign(speed_rad_s=250.0, ambient_degC=20.0)
        >>> known = {"k_tau": (0.04, 0.002)}
        >>> case = Case.from_dataframes({"ride": frame}, kind="motor", load="unknown", parameters=known)
        >>> estimate_load(case)
        <LoadEstimate case: 1 runs, 0.11 to 0.19 N m>
    """

    name: str
    runs: tuple[RunLoad, ...]

    def to_dataframe(self) -> pd.DataFrame:
        """Return all rows: run, group, and the columns of `RunLoad.table`."""
        return pd.concat([one.table.assign(run=one.run, group=one.group) for one in self.runs], ignore_index=True)

    def by_group(self) -> pd.DataFrame:
        """Return a row for each group of runs: torque, its spread, power and energy per metre.

        `torque_Nm` is the mean while it turns, `sd_Nm` its sd (readings, blocks of each run, and the common share),
        `spread_Nm` how much it varies, `work_W` and `drawn_W` mean powers, `J_per_m` the drawn energy per metre (the
        work of the shaft where no voltage is known).
        """
        rows = []
        for group in dict.fromkeys(one.group for one in self.runs):
            some = [one for one in self.runs if one.group == group]
            rows.append({"group": group, "runs": len(some)} | _means(some))
        return pd.DataFrame(rows).set_index("group")

    def summary(self) -> str:
        """Return the table of `by_group`, and what is common to all."""
        table = self.by_group()
        common = max(one.common for one in self.runs)
        lines = [table.to_string(float_format=lambda x: f"{x:.3g}")]
        lines.append(f"All torques of {self.name} share the sd of its torque constant, {100.0 * common:.2g} %.")
        return "\n".join(lines)

    @property
    def plot(self):
        """Return the picture of a run: `plot("run name")`, the first by default."""
        return late_bound("jaxmodel.plots.load:load_of_run")(self)

    def __repr__(self) -> str:
        torques = np.concatenate([one.table["load_torque_Nm"].to_numpy() for one in self.runs])
        low, high = np.nanquantile(torques, [0.05, 0.95])
        return f"<LoadEstimate {self.name}: {len(self.runs)} runs, {low:.2g} to {high:.2g} N m>"

    def _repr_html_(self) -> str:
        return f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>{self.by_group().to_html(border=0)}"


def estimate_load(case: Case) -> LoadEstimate:
    """Return the torque that the load asked of each motor's shaft, from current and speed of a case's runs.

    Where the current is not read it is that of the model, by eq. 11 at the measured speed and voltage.

    Args:
        case: of a motor or robot whose runs have a speed, and a current or what gives it (voltage or duty).

    Returns:
        Torques [N m] at the motor's shaft, positive against a positive speed, with their sd.

    Raises:
        MeasurementError: a run has no speed.
    """
    at_speed = _driven_by_speed(case)
    simulated = {one.run.name: one.table for one in simulate_case(at_speed, progress=False)}
    return LoadEstimate(case.name, tuple(_of_run(at_speed, run, simulated[run.name]) for run in at_speed.runs))


def _driven_by_speed(case: Case) -> Case:
    """Return a case whose runs are driven by their speed, whatever it says of the load."""
    runs = []
    for run in case.runs:
        measured = run.measured
        speed = measured.inputs.get("speed_rad_s", measured.outputs.get("speed_rad_s"))
        if speed is None:
            raise MeasurementError(f"{run.file}: the load is found from current and speed; add the column speed_rad_s.")
        of_load = ("load_torque_Nm", "incline_deg", *REFERENCES.values())
        inputs = {name: values for name, values in measured.inputs.items() if name not in of_load}
        inputs["speed_rad_s"] = _filled(measured.time_s, speed)
        if case.servo.controller:  # what it set was read
            drive = SET_BY[case.servo.drive or "voltage"]
            if drive not in measured.outputs:
                raise MeasurementError(
                    f"{run.file}: the load is found from what the drive set; add the column {drive}."
                )
            inputs[drive] = _filled(measured.time_s, measured.outputs[drive])
        outputs = {name: values for name, values in measured.outputs.items() if name not in inputs}
        measured = dataclasses.replace(measured, inputs=inputs, outputs=outputs)
        runs.append(dataclasses.replace(run, measured=measured))
    effects = {name: values for name, values in case.effects.items() if name not in LAW_EFFECTS | SERVO.keys()}
    sd = {name: values for name, values in case.effect_sd.items() if name in effects}
    return dataclasses.replace(case, runs=tuple(runs), effects=effects, effect_sd=sd, load="unknown", servo=OPEN)


def _filled(time_s: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return readings with what is missing between its neighbours."""
    there = np.isfinite(values)
    return np.interp(time_s, time_s[there], values[there])


def _of_run(case: Case, run: Run, simulated: pd.DataFrame) -> RunLoad:
    model, measured = case_model(case, run), run.measured
    name = "motor_current_A" if case.kind == "robot" else "current_A"
    read = measured.outputs.get(name, measured.inputs.get(name))
    current = simulated[name].to_numpy() if read is None else read
    speed = measured.inputs["speed_rad_s"]
    shaft = np.asarray(_shaft_torque(model, measured.inputs, simulated, jnp.asarray(current), jnp.asarray(speed)))
    k = float(model.parameters.k_tau)
    noise = {"current": _noise(case, name, current), "speed": max(_noise(case, "speed_rad_s", speed), 1e-9)}
    inertia = float(model.parameters.J)
    torque, sd, _ = smoothed(measured.time_s, speed, shaft, noise["speed"], k * noise["current"], inertia)
    still = np.abs(speed) < STILL * np.max(np.abs(speed), initial=1e-12)
    sd = np.where(still, np.hypot(sd, float(model.parameters.tau_0) / math.sqrt(3.0)), sd)
    table = pd.DataFrame({"time_s": measured.time_s, "speed_rad_s": speed, "current_A": current})
    table = table.assign(load_torque_Nm=torque, sd_Nm=sd, work_W=torque * speed)
    if (voltage := _voltage(case, run, simulated)) is not None:
        table["drawn_W"] = voltage * current
    return RunLoad(
        run.name, group_of(together(run.name, run.specimen)), table, _common(case), _metres(case, run, speed)
    )


def _shaft_torque(model: Model, inputs: Mapping, simulated: pd.DataFrame, current: Array, speed: Array) -> Array:
    """Return what drives the load and the inertia [N m]: the motor's torque less its own friction, shape (rows,)."""
    winding, case = (jnp.asarray(simulated[f"{name}_temperature_degC"].to_numpy()) for name in ("winding", "case"))
    ambient = jnp.asarray(inputs["ambient_degC"])

    def one(winding_K, case_K, ambient, current, speed):
        state = motors.initial_state(model.parameters) | {"x_winding_K": winding_K, "x_case_K": case_K}
        state |= {"motor_current_A": current, "speed_rad_s": speed}
        zero = jnp.zeros(())
        motor = motors.evaluate(model.parameters, model.effects, state, ambient, zero, jnp.ones(()), zero)
        return motors.shaft_torque(motor, Pair(current, speed))

    return jax.vmap(one)(winding - case, case - ambient, ambient, current, speed)


def smoothed(
    time_s: np.ndarray, speed: np.ndarray, shaft_Nm: np.ndarray, speed_sd: float, shaft_sd: float, inertia: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return load torque and its sd [N m], shape (rows,), and the pace of the torque's random walk [N m / sqrt(s)].

    x = (w, tau):  w+ = w + h/J (T - tau),  tau+ = tau + N(0, q^2 h);  w is read with an sd, T known with another.

    Args:
        time_s: (rows,) of the readings; a pause begins anew.
        speed: (rows,) read [rad/s].
        shaft_Nm: (rows,) T, the motor's torque less its friction.
        speed_sd: of a reading.
        shaft_sd: of T.
        inertia: J [kg m2].
    """
    steps = np.append(0.0, np.diff(time_s))
    fresh = after_pauses(time_s)
    size = float(np.sqrt(np.mean(shaft_Nm**2))) + shaft_sd + 1e-12
    # In units of its own size, so that the filter is as exact for a watch as for a truck.
    unit = size * float(np.median(steps[1:])) / inertia
    scaled = (jnp.asarray(speed / unit), jnp.asarray(shaft_Nm / size), jnp.asarray(steps), jnp.asarray(fresh))
    per_torque = size / (inertia * unit)
    numbers = (speed_sd / unit, shaft_sd / size, per_torque)
    span = float(time_s[-1] - time_s[0])

    def cost(decade: float) -> float:
        return -float(_filtered(*scaled, *numbers, 10.0**decade / math.sqrt(span))[0])

    best = minimize_scalar(cost, bounds=DECADES, method="bounded", options={"xatol": 0.05})
    pace = 10.0 ** float(best.x) / math.sqrt(span)
    torque, variance = _smooth(*scaled, *numbers, pace)
    return size * np.asarray(torque), size * np.sqrt(np.asarray(variance)), size * pace


def _moved(state, covariance, shaft, step, shaft_sd, per_torque, pace):
    a = step * per_torque
    F = jnp.array([[1.0, -a], [0.0, 1.0]])
    q = pace**2 * step
    noise = jnp.array([[q * a**2 / 3.0 + (a * shaft_sd) ** 2, -q * a / 2.0], [-q * a / 2.0, q]])
    return F @ state + jnp.array([a * shaft, 0.0]), F @ covariance @ F.T + noise, F


@jax.jit
def _filtered(speed, shaft, steps, fresh, speed_sd, shaft_sd, per_torque, pace):
    """Return the log likelihood, and means and covariances before and after each reading."""
    start = jnp.array([speed[0], shaft[0]]), jnp.diag(jnp.array([speed_sd**2, 1.0]))

    def one(carry, given):
        w, T, step, new = given
        state, spread = carry
        mean, covariance, _ = _moved(state, spread, T, step, shaft_sd, per_torque, pace)
        mean = jnp.where(new, jnp.array([w, T]), mean)
        covariance = jnp.where(new, start[1], covariance)
        spread = covariance[0, 0] + speed_sd**2
        off = w - mean[0]
        gain = covariance[:, 0] / spread
        after = mean + gain * off, covariance - jnp.outer(gain, covariance[0])
        log = -0.5 * (off**2 / spread + jnp.log(spread))
        return after, (jnp.where(new, 0.0, log), mean, covariance, *after)

    _, (log, *course) = jax.lax.scan(one, start, (speed, shaft, steps, fresh))
    return jnp.sum(log), course


@jax.jit
def _smooth(speed, shaft, steps, fresh, speed_sd, shaft_sd, per_torque, pace):
    """Return means and variances of the torque from all readings, before and after."""
    _, (before, before_cov, after, after_cov) = _filtered(
        speed, shaft, steps, fresh, speed_sd, shaft_sd, per_torque, pace
    )

    def back(carry, given):
        later, later_cov = carry
        mean, covariance, predicted, predicted_cov, step, new = given
        _, _, F = _moved(mean, covariance, 0.0, step, shaft_sd, per_torque, pace)
        gain = jnp.linalg.solve(predicted_cov, F @ covariance).T
        smooth = mean + gain @ (later - predicted)
        smooth_cov = covariance + gain @ (later_cov - predicted_cov) @ gain.T
        smooth, smooth_cov = jnp.where(new, mean, smooth), jnp.where(new, covariance, smooth_cov)
        return (smooth, smooth_cov), (smooth[1], smooth_cov[1, 1])

    last = after[-1], after_cov[-1]
    given = (after[:-1], after_cov[:-1], before[1:], before_cov[1:], steps[1:], fresh[1:])
    _, (torque, variance) = jax.lax.scan(back, last, given, reverse=True)
    return jnp.append(torque, last[0][1]), jnp.append(variance, last[1][1, 1])


def group_of(name: str) -> str:
    """Return what the name of a run begins with, before a number at its end."""
    return re.sub(r"[\W_]*\d+[a-z]?$", "", name) or name


def _noise(case: Case, column: str, values: np.ndarray) -> float:
    return case.sensors.get(column) or white_sd(values)


def _common(case: Case) -> float:
    known = case.parameters.get("k_tau", Known(float(info("k_tau").default), None))
    if "k_tau" not in case.parameters:
        return UNSTATED
    return 0.0 if known.sd is None else known.sd / known.value


def _voltage(case: Case, run: Run, simulated: pd.DataFrame) -> np.ndarray | None:
    """Return the voltage at the motor's terminals [V]; None if it is not known."""
    if case.kind == "motor":
        return run.measured.inputs.get("voltage_V")
    return duty_of(run) * run.measured.outputs.get("pack_voltage_V", simulated["pack_voltage_V"].to_numpy())


def _metres(case: Case, run: Run, speed: np.ndarray) -> float:
    if not {"wheel_radius_m", "gear_ratio"} <= case.parameters.keys():
        return math.nan
    radius, ratio = (case.parameters[name].value for name in ("wheel_radius_m", "gear_ratio"))
    return float(np.trapezoid(np.abs(speed), run.measured.time_s)) * radius / ratio


def _means(runs: Sequence[RunLoad]) -> dict[str, float]:
    """Return means over the rows of some runs in which the motor turns, and the sd of that of the torque."""
    parts = []
    for one in runs:
        size = np.abs(one.table["speed_rad_s"].to_numpy())
        parts.append(one.table[size > STILL * size.max(initial=1e-12)])
    table = pd.concat(parts, ignore_index=True)
    sense = np.sign(table["speed_rad_s"].to_numpy())
    against = table["load_torque_Nm"].to_numpy() * sense
    blocks = [
        float(np.mean(block["load_torque_Nm"] * np.sign(block["speed_rad_s"])))
        for part in parts
        for place in np.array_split(np.arange(len(part)), BLOCKS)
        if len(block := part.iloc[place])
    ]
    mean = float(np.mean(against))
    random = float(np.std(blocks, ddof=1)) / math.sqrt(len(blocks)) if len(blocks) > 1 else math.nan
    common = max(one.common for one in runs)
    energy = sum(_energy(one) for one in runs)
    metres = sum(one.metres for one in runs)
    return {
        "torque_Nm": mean,
        "sd_Nm": math.hypot(random, common * mean),
        "sd_of_blocks_Nm": random,
        "spread_Nm": float(np.std(against)),
        "speed_rad_s": float(np.mean(np.abs(table["speed_rad_s"]))),
        "work_W": float(np.mean(table["work_W"])),
        "drawn_W": float(np.mean(table["drawn_W"])) if "drawn_W" in table else math.nan,
        "J_per_m": energy / metres if metres > 0.0 else math.nan,
    }


def _energy(one: RunLoad) -> float:
    """Return what a run took [J]: drawn by the motor, or the work of its shaft where no voltage is known."""
    power = one.table["drawn_W" if "drawn_W" in one.table else "work_W"].to_numpy()
    return float(np.trapezoid(power, one.table["time_s"].to_numpy()))


def sides(estimates: Sequence[LoadEstimate]) -> pd.DataFrame:
    """Return by group how the first of some motors differs from each other one: ratio of torques, and its sd.

    The motors are taken as alike: what they share, such as an error of the torque constant, is not in the sd.
    """
    tables = [one.by_group() for one in estimates]
    rows = []
    for other, table in zip(estimates[1:], tables[1:], strict=True):
        for group in tables[0].index.intersection(table.index):
            ours, theirs = tables[0].loc[group], table.loc[group]
            ratio = float(theirs["torque_Nm"] / ours["torque_Nm"])
            share = math.hypot(
                ours["sd_of_blocks_Nm"] / ours["torque_Nm"], theirs["sd_of_blocks_Nm"] / theirs["torque_Nm"]
            )
            off = (ratio - 1.0) / max(abs(ratio) * share, 1e-12)
            rows.append(
                {"group": group, "motor": other.name, "ratio": ratio, "sd": abs(ratio) * share, "sds_from_1": off}
            )
    return pd.DataFrame(rows)


def pooled(ratios: pd.DataFrame) -> tuple[float, float]:
    """Return the mean ratio of one motor over its groups, weighted by their sd, and its sd: by these or their scatter.

    Args:
        ratios: rows of `sides` of one motor.
    """
    weights = 1.0 / ratios["sd"] ** 2
    mean = float((ratios["ratio"] * weights).sum() / weights.sum())
    between = float(ratios["ratio"].std(ddof=1)) / math.sqrt(len(ratios)) if len(ratios) > 1 else 0.0
    return mean, max(float(weights.sum()) ** -0.5, between)
