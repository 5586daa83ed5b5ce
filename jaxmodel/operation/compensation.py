"""Compensation: the duty at which the state of charge falls with its reference slope at any temperature and torque.

At a given torque the motor's current is given too (eq. 12); what a robot can lower is the duty, and with it the current
that a motor draws from the pack (eq. 14) and the speed. The duty is the root of

    slope(duty; ambient, torque) = slope at the reference

over simulated runs, for all grid points of the map at once.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
from scipy.optimize import elementwise

from jaxmodel.base.in_short import InShort
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import Cutoff
from jaxmodel.sweeps.lane import Keep, SteppedProfile, lay_out
from jaxmodel.sweeps.metrics import metrics_of
from jaxmodel.sweeps.points import outcomes_at

# Slopes are means over the paper's half hour. Rows of a minute suffice for a steady run: the map is checked at 1 s.
DURATION_S, STEP_S, CHECK_STEP_S = 1800.0, 60.0, 1.0
TOLERANCE = 1e-9  # of a root, relative to the reference slope
LEAST_DUTY, MOST_DUTY = 1e-3, 1.0
# A run ends here and its slope is that until then: a high duty empties the pack before the half hour.
NEARLY_EMPTY = Cutoff(soc=0.05)  # type: ignore[arg-type]
# The paper, abstract and end of section 3: "15.7 percent per 20 degC deviation", "14.7 percent" per 50 mN m.
SHARE_PER_20_K, SHARE_PER_50_MNM = 0.157, 0.147
_METRICS = ("soc_gradient", "mean_speed_rad_s")


@dataclasses.dataclass(frozen=True)
class Reference(InShort):
    """The operating point whose slope is to be held: ambient, torque of one track motor, duty.

    Example:
        >>> from jaxmodel.operation import Reference
        >>> Reference(ambient_degC=20.0, load_torque_Nm=0.1, duty=0.3).duty
        0.3
    """

    ambient_degC: float = 20.0
    load_torque_Nm: float = 0.175
    duty: float = 0.3


@dataclasses.dataclass(frozen=True)
class Runs:
    """Steady runs over the grid points of a map.

    Attributes:
        soc_gradient: 1/s.
        speed_rad_s: of a motor, mean.
    """

    soc_gradient: np.ndarray
    speed_rad_s: np.ndarray


@dataclasses.dataclass(frozen=True, repr=False)
class Compensation(InShort):
    """The map of a compensation; arrays are of shape (ambients, torques).

    Attributes:
        reference: the operating point whose slope is held.
        slope: of the state of charge at the reference, 1/s.
        ambient_degC: of the rows.
        load_torque_Nm: of the columns.
        duty: the duty that holds the slope; NaN where none within 0.001 to 1 does.
        before: runs at the reference's duty.
        after: runs at the map's duty, in steps of 1 s: the check in simulation.
    """

    reference: Reference
    slope: float
    ambient_degC: np.ndarray
    load_torque_Nm: np.ndarray
    duty: np.ndarray
    before: Runs
    after: Runs

    @property
    def share(self) -> np.ndarray:
        """The duty by the reference's: 1 is no change, 0.8 is a reduction of 20 %."""
        return self.duty / self.reference.duty

    @property
    def drives(self) -> np.ndarray:
        """True where the motors still turn forwards at the map's duty; elsewhere the robot would stand or roll back."""
        return self.after.speed_rad_s > 0.0

    @property
    def error(self) -> float:
        """Largest difference of a slope of the check from the reference's, relative to it."""
        off = np.abs(self.after.soc_gradient / self.slope - 1.0)
        return float(np.max(off[np.isfinite(self.duty)], initial=0.0))

    def interpolated(self, ambient_degC: np.ndarray, load_torque_Nm: np.ndarray) -> np.ndarray:
        """Return the duty between grid points: bilinear, held at the ends; arrays of one shape."""
        return bilinear(self.ambient_degC, self.load_torque_Nm, self.duty, ambient_degC, load_torque_Nm)

    def reduction(self, start: tuple[float, float], end: tuple[float, float]) -> float:
        """Return by what share the duty falls from one point (degC, N m) to another; negative where it rises."""
        points = np.array([start, end])
        first, last = self.interpolated(points[:, 0], points[:, 1])
        return float(1.0 - last / first)

    def to_dataframe(self) -> pd.DataFrame:
        """Return a line for each grid point: duty, its share, slopes before and after [1/s], speed after [rad/s]."""
        ambient, torque = np.meshgrid(self.ambient_degC, self.load_torque_Nm, indexing="ij")
        columns = {
            "ambient_degC": ambient,
            "load_torque_Nm": torque,
            "duty": self.duty,
            "duty_share": self.share,
            "slope_before_per_s": self.before.soc_gradient,
            "slope_after_per_s": self.after.soc_gradient,
            "speed_after_rad_s": self.after.speed_rad_s,
        }
        return pd.DataFrame({name: values.ravel() for name, values in columns.items()})


def compensate(
    model: Model, ambient_degC: np.ndarray, load_torque_Nm: np.ndarray, reference: Reference | None = None
) -> Compensation:
    """Solve for the duty that holds the slope of the state of charge, over a grid of ambient and torque.

    Args:
        model: a robot.
        ambient_degC: shape (ambients,), rising.
        load_torque_Nm: torque of one track motor, shape (torques,), rising.
        reference: the operating point whose slope is held; the paper's 20 degC, 0.175 N m and 0.3 if none is given.

    Returns:
        The map, with simulated runs at the reference's duty and at the map's.

    Example:
        >>> import numpy as np
        >>> from jaxmodel import operation, preset_model
        >>> robot = preset_model("paper", "robot")
        >>> found = operation.compensate(robot, np.array([0.0, 20.0]), np.array([0.1, 0.175]))
        >>> found.duty[1].round(3).tolist()  # at 20 degC
        [0.505, 0.3]
    """
    reference = reference or Reference()
    ambients, torques = (grid.ravel() for grid in np.meshgrid(ambient_degC, load_torque_Nm, indexing="ij"))
    shape = (len(ambient_degC), len(load_torque_Nm))
    at = np.array([reference.ambient_degC]), np.array([reference.load_torque_Nm])
    slope = float(steady(model, *at, np.array([reference.duty])).soc_gradient[0])

    def off(duty: np.ndarray, ambient: np.ndarray, torque: np.ndarray) -> np.ndarray:
        return steady(model, ambient, torque, duty).soc_gradient / slope - 1.0

    # NaN where the bounds have no root between them.
    duty = elementwise.find_root(
        off, (LEAST_DUTY, MOST_DUTY), args=(ambients, torques), tolerances={"fatol": TOLERANCE}
    ).x
    before = steady(model, ambients, torques, np.full_like(ambients, reference.duty), CHECK_STEP_S)
    after = steady(model, ambients, torques, duty, CHECK_STEP_S)

    def mapped(runs: Runs) -> Runs:
        return Runs(
            soc_gradient=runs.soc_gradient.reshape(shape),
            speed_rad_s=runs.speed_rad_s.reshape(shape),
        )

    return Compensation(
        reference=reference,
        slope=slope,
        ambient_degC=np.asarray(ambient_degC, dtype=float),
        load_torque_Nm=np.asarray(load_torque_Nm, dtype=float),
        duty=duty.reshape(shape),
        before=mapped(before),
        after=mapped(after),
    )


def steady(
    model: Model, ambient_degC: np.ndarray, load_torque_Nm: np.ndarray, duty: np.ndarray, step_s: float = STEP_S
) -> Runs:
    """Return runs of half an hour at constant inputs, one for each point; all arrays of one shape (points,)."""
    own = {"ambient_degC": ambient_degC, "load_torque_Nm": load_torque_Nm, "duty": duty}
    found = outcomes_at(_keep(), model, _half_hour(model, step_s), NEARLY_EMPTY, own).values
    return Runs(np.asarray(found["soc_gradient"]), np.asarray(found["mean_speed_rad_s"]))


def paper_rule_error(model: Model, compensation: Compensation) -> float:
    """Return the RMS relative error of the slope under the paper's rule, over the grid points that have a duty.

    The rule: 15.7 % less duty for each 20 K colder and 14.7 % less for each 50 mN m more than the reference (abstract
    and end of section 3).
    """
    r = compensation.reference
    grids = np.meshgrid(compensation.ambient_degC, compensation.load_torque_Nm, indexing="ij")
    t, m = (grid.ravel() for grid in grids)
    colder, more = (r.ambient_degC - t) / 20.0, (m - r.load_torque_Nm) / 0.05
    duty = r.duty * (1.0 - SHARE_PER_20_K * colder) * (1.0 - SHARE_PER_50_MNM * more)
    error = steady(model, t, m, np.clip(duty, LEAST_DUTY, MOST_DUTY)).soc_gradient / compensation.slope - 1.0
    return float(np.sqrt(np.mean(error[np.isfinite(compensation.duty).ravel()] ** 2)))


def bilinear(x: np.ndarray, y: np.ndarray, table: np.ndarray, at_x: np.ndarray, at_y: np.ndarray) -> np.ndarray:
    """Return a table's values between its grid points, held at its ends; `table` is of shape (x, y)."""
    at_x, at_y = np.clip(at_x, x[0], x[-1]), np.clip(at_y, y[0], y[-1])
    row = np.clip(np.searchsorted(x, at_x, side="right") - 1, 0, len(x) - 2)
    column = np.clip(np.searchsorted(y, at_y, side="right") - 1, 0, len(y) - 2)
    u, v = (at_x - x[row]) / (x[row + 1] - x[row]), (at_y - y[column]) / (y[column + 1] - y[column])
    low = (1.0 - v) * table[row, column] + v * table[row, column + 1]
    high = (1.0 - v) * table[row + 1, column] + v * table[row + 1, column + 1]
    return (1.0 - u) * low + u * high


def _half_hour(model: Model, step_s: float) -> SteppedProfile:
    """Return half an hour of constant inputs; lanes bring their own values."""
    return lay_out(model, constant(DURATION_S, step_s, ambient_degC=20.0, load_torque_Nm=0.1, duty=0.3), np.array([0]))


def _keep() -> Keep:
    shipped = metrics_of("robot")
    return Keep(tuple(shipped[name] for name in _METRICS))
