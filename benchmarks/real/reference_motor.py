"""A motor as an engineer models it in an afternoon: its equations, linear in their numbers, by least squares.

    V = R i + k w                                               (steady armature)
    k i = g load + tau_0 + b w + c w^2 + J dw/dt                (torque; g, b, c and J where they pay)

None is negative.
The first gives R and k. The second, divided by k, foretells the current; which of g, b and c are free is chosen by the
error at the fit run left out. A change of speed between two rows is followed by J where the rows are close enough to
show it, and is otherwise over before the next reading.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
from scipy.optimize import nnls

from jaxmodel.case.records import Case, Run

CHOICES = tuple(("tau_0", *more) for size in range(4) for more in itertools.combinations(("g", "b", "c"), size))
FOLLOWED_S = 0.2  # a longer step is too coarse for the mechanical time constant of a small motor


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """One run; every array has shape (rows,); `read` are the rows that have all readings."""

    time_s: np.ndarray
    voltage_V: np.ndarray
    load_Nm: np.ndarray
    current_A: np.ndarray
    speed_rad_s: np.ndarray
    read: np.ndarray


def rows_of(run: Run) -> Rows:
    """Return a run's arrays."""
    inputs, outputs, time_s = run.measured.inputs, run.measured.outputs, run.measured.time_s
    current, speed = outputs["current_A"], outputs["speed_rad_s"]
    load = inputs.get("load_torque_Nm", np.zeros(time_s.size))
    return Rows(time_s, inputs["voltage_V"], load, current, speed, np.isfinite(current) & np.isfinite(speed))


@dataclasses.dataclass(frozen=True)
class Motor:
    """The numbers of one motor, SI."""

    R: float
    k: float
    torque: dict[str, float]

    def steady(self, voltage: np.ndarray, load: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return current and speed at rest of all rates; a motor that its load would turn backwards stands still."""
        t = {"g": 1.0, "b": 0.0, "c": 0.0} | self.torque
        # k (V - k w) / R = g load + tau_0 + b w + c w^2
        linear, rest = t["b"] + self.k**2 / self.R, t["g"] * load + t["tau_0"] - self.k * voltage / self.R
        if abs(t["c"]) > 1e-30:
            root = np.sqrt(np.maximum(linear**2 - 4.0 * t["c"] * rest, 0.0))
            speed = 2.0 * -rest / (linear + root)
        else:
            speed = -rest / linear
        speed = np.maximum(speed, 0.0)
        return (voltage - self.k * speed) / self.R, speed

    def predict(self, rows: Rows) -> dict[str, np.ndarray]:
        """Return current and speed at each row: steady, or on the way there by its own mechanical time constant."""
        current, speed = self.steady(rows.voltage_V, rows.load_Nm)
        inertia = self.torque.get("J", 0.0)
        if inertia > 0.0:
            tau = inertia / (self.torque.get("b", 0.0) + self.k**2 / self.R)
            steady, state = speed.copy(), 0.0
            for row, step in enumerate(np.diff(rows.time_s, prepend=rows.time_s[0])):
                state = steady[row] + (state - steady[row]) * np.exp(-step / tau)
                speed[row] = state
            current = (rows.voltage_V - self.k * speed) / self.R
        return {"current_A": current, "speed_rad_s": speed}


class MotorReference:
    """The model, fitted to the fit runs of a case.

    Attributes:
        chosen: the numbers found, by name.
    """

    def __init__(self, case: Case) -> None:
        self._sd = {name: case.sensors.get(name, 1.0) for name in ("current_A", "speed_rad_s")}
        runs = [rows_of(run) for run in case.runs if run.split == "fit"]
        best, terms = np.inf, CHOICES[0]
        for choice in CHOICES:
            score = self._left_out(runs, choice)
            if score < best:
                best, terms = score, choice
        self._motor = fit(runs, terms)
        self.chosen = {"R": self._motor.R, "k": self._motor.k, **self._motor.torque}

    def predict(self, run: Run) -> dict[str, np.ndarray]:
        """Return what the model foretells of a run from its inputs."""
        return self._motor.predict(rows_of(run))

    def _left_out(self, runs: list[Rows], terms: tuple[str, ...]) -> float:
        """Return the mean square in sd at each run of what the others foretell of it, as a mean over runs."""
        found = []
        for out in runs:
            others = [run for run in runs if run is not out] or runs
            said = fit(others, terms).predict(out)
            for name, sd in self._sd.items():
                found.append(np.mean(((said[name] - getattr(out, name))[out.read] / sd) ** 2))
        return float(np.mean(found))


def fit(runs: list[Rows], terms: tuple[str, ...]) -> Motor:
    """Return the motor whose two equations are met best by the readings of some runs."""
    current, speed, voltage, load = (
        np.concatenate([getattr(run, name)[run.read] for run in runs])
        for name in ("current_A", "speed_rad_s", "voltage_V", "load_Nm")
    )
    rates = np.concatenate([acceleration(run)[run.read] for run in runs])
    moving = bool(np.any(rates != 0.0))
    R, k = nnls(np.column_stack([current, speed]), voltage)[0]
    columns = {"tau_0": np.sign(speed), "g": load, "b": speed, "c": speed * np.abs(speed), "J": rates}
    names = [*terms, "J"] if moving else list(terms)
    names = [name for name in names if np.any(columns[name] != 0.0)]
    target = k * current - (0.0 if "g" in names else load)
    matrix = np.column_stack([columns[name] for name in names])
    size = np.sqrt(np.mean(matrix**2, axis=0))
    values = nnls(matrix / size, target)[0] / size
    return Motor(float(R), float(k), dict(zip(names, map(float, values), strict=True)))


def acceleration(rows: Rows) -> np.ndarray:
    """Return dw/dt at each row (rad/s^2), zero where rows are too far apart to show it."""
    if np.median(np.diff(rows.time_s)) > FOLLOWED_S or not rows.read.all():
        return np.zeros(rows.time_s.size)
    return np.gradient(rows.speed_rad_s, rows.time_s)
