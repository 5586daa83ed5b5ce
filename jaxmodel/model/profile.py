"""Input profiles, and the grid of steps on which a run is integrated."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.in_short import InShort
from jaxmodel.model.robot import duty_of_signal

# Of a profile that is described in numbers, which may be any: 120 days at a row a second. Its inputs, steps and
# readings take some 2 GB. Steps of a motor are more than rows, a few for each that changes the inputs.
MOST_ROWS, MOST_STEPS = 10_000_000, 40_000_000
# The linear armature is solved exactly; steps after a jump grow from a fraction of the electrical time constant, to
# resolve nonlinear effects (friction, saturation, brushes) and the heat of the inrush.
FIRST_STEP_SHARE = 0.25
GROWTH = 2.0
# Growth of steps with saturation, which prolongs the inrush. For 25 motors of low resistance, each started and braked a
# dozen times, the heat of the inrush is then correct to 0.006 K in three quarters of them; to 0.16 K if steps double.
GROWTH_SATURATING = 1.2
# A kink within a step changes the speed by some share^2 / 8 of the acceleration there; a motor has settled to 1 part in
# 150 after five time constants.
BENDING_STEP_SHARE = 0.25
SETTLED = 5.0
# A rotor slower than this still draws its inrush while the winding warms: its resistance is not constant over a step.
# A start from rest by 14 V then ends a row within 1 mA and 0.01 rad/s (29 mA and 0.036 rad/s without).
SLOW_ROTOR_S, WARMING_STEP_SHARE = 0.03, 1.0 / 16.0
LOOP_SHARE = 0.25  # longest step of a closed loop, as a share of its time constant
WARMING_S = 0.2  # in which the inrush warms a winding: the first steps are no longer, however slow the rotor


@dataclasses.dataclass(frozen=True, repr=False)
class Profile(InShort):
    """Inputs over time: those of row k hold over (t[k-1], t[k]]; row 0 is the initial state under its own inputs.

    Attributes:
        time_s: shape (rows,), increasing.
        inputs: by name, each of shape (rows,).

    Example:
        >>> import numpy as np
        >>> from jaxmodel import Profile
        >>> inputs = {"current_A": np.array([0.0, 1.0, 1.0]), "ambient_degC": np.full(3, 20.0)}
        >>> Profile(np.array([0.0, 10.0, 20.0]), inputs)
        <Profile: 3 rows, 0 to 20 s, current_A, ambient_degC>
    """

    time_s: np.ndarray
    inputs: dict[str, np.ndarray]

    def _in_short(self) -> str:
        return f"{self.time_s.size} rows, {self.time_s[0]:g} to {self.time_s[-1]:g} s, {', '.join(self.inputs)}"

    def __post_init__(self) -> None:
        """Check shapes and order, and convert the operator's signal to a duty (eq. 22)."""
        time = np.asarray(self.time_s, dtype=float)
        inputs = {name: np.broadcast_to(np.asarray(v, dtype=float), time.shape) for name, v in self.inputs.items()}
        if time.size < 2 or np.any(np.diff(time) <= 0.0):
            raise MeasurementError("profile: time_s needs at least two values, each later than the one before it.")
        if "V_set" in inputs:
            inputs["duty"] = duty_of_signal(inputs.pop("V_set"))
        object.__setattr__(self, "time_s", time)
        object.__setattr__(self, "inputs", inputs)


def constant(duration_s: float, step_s: float, **inputs: float) -> Profile:
    """Return a profile of constant inputs from 0 to `duration_s` in steps of `step_s`, both in s.

    Example:
        >>> from jaxmodel import constant
        >>> constant(60.0, 1.0, current_A=2.0, ambient_degC=20.0)
        <Profile: 61 rows, 0 to 60 s, current_A, ambient_degC>
    """
    time = np.arange(0.0, duration_s + 0.5 * step_s, step_s)
    return Profile(time, {name: np.full_like(time, value) for name, value in inputs.items()})


@dataclasses.dataclass(frozen=True)
class Grid:
    """The steps of a run: durations, profile row of each step, and last step of each row.

    Attributes:
        duration_s: shape (steps,); padding steps at the end have zero length and no effect.
        row: shape (steps,), the row of the profile whose inputs hold over the step.
        last_step: shape (rows - 1,), the step that ends at each row after the first.
        jumped_s: time of the last jump; 0 without a motor.
    """

    duration_s: np.ndarray
    row: np.ndarray
    last_step: np.ndarray
    jumped_s: float = 0.0

    def padded(self, steps: int) -> Grid:
        """Return the same grid with steps of zero length appended."""
        extra = steps - self.duration_s.size
        return dataclasses.replace(
            self,
            duration_s=np.append(self.duration_s, np.zeros(extra)),
            row=np.append(self.row, np.full(extra, self.row[-1])),
        )

    def cut(self, longest_s: float) -> Grid:
        """Return the same grid with every step cut into equal ones of at most so many seconds."""
        count = np.maximum(np.ceil(self.duration_s / longest_s), 1)
        _refuse_too_many(count)
        step, _ = _parts(count.astype(int))
        row = self.row[step]
        last = np.cumsum(np.bincount(row - 1, minlength=self.last_step.size)) - 1
        return dataclasses.replace(self, duration_s=(self.duration_s / count)[step], row=row, last_step=last)


class Track(eqx.Module):
    """A run as arrays on the device: steps, inputs of the first row and of each step, and last step of each later row.

    Steps are counted from 0 in `last_step`, shape (rows - 1,); `inputs` have shape (1 + steps,).
    """

    duration_s: Array
    inputs: dict[str, Array]
    last_step: Array

    @property
    def at_rows(self) -> Array:
        """Return the indices of the rows among the start and the ends of all steps, shape (rows,)."""
        return jnp.concatenate([jnp.zeros(1, dtype=self.last_step.dtype), self.last_step + 1])


def make_grid(
    profile: Profile,
    electrical_time_constant_s: float | None,
    settling_time_constants_s: tuple[float, float] | None = None,
    step_share: float = BENDING_STEP_SHARE,
    growth: float = GROWTH,
    jumped_s: float | None = None,
) -> Grid:
    """Return the grid of a profile: one step a row, and after a jump of the inputs steps that grow from milliseconds.

    Args:
        profile: inputs over time.
        electrical_time_constant_s: L_a / R of the motor, or None without a motor.
        settling_time_constants_s: R J / k^2 of a motor with a kink at zero current, or of a slow rotor: while its
            speed settles after a jump, steps stay a small share of it. The shortest and the longest of motors in many
            lanes.
        step_share: that share.
        growth: ratio of each step after a jump to the previous one.
        jumped_s: time of the last jump, if the profile is a later part of a run; None if the run begins with it.
    """
    rows = np.diff(profile.time_s)
    if electrical_time_constant_s is None:
        return Grid(rows, np.arange(1, rows.size + 1), np.arange(rows.size))
    jumps = _jumps(profile, begins=jumped_s is None)
    count = np.where(jumps, _growing(rows, FIRST_STEP_SHARE * electrical_time_constant_s, growth), 1)
    _refuse_too_many(count)
    share = growth ** np.arange(count.max())
    before = np.append(0.0, np.cumsum(share))
    row, number = _parts(count)
    unit = rows[row] / before[count][row]
    duration = unit * share[number]
    started = profile.time_s[:-1]
    jumped = np.maximum.accumulate(np.where(jumps, started, -np.inf if jumped_s is None else jumped_s))
    if settling_time_constants_s is not None:
        since_jump = (started - jumped)[row] + unit * before[number]
        fine = _while_settling(duration, since_jump, *settling_time_constants_s, step_share)
        _refuse_too_many(fine)
        step, _ = _parts(fine)
        duration, row = (duration / fine)[step], row[step]
    return Grid(duration, row + 1, np.cumsum(np.bincount(row, minlength=rows.size)) - 1, float(jumped[-1]))


def _refuse_too_many(count: np.ndarray) -> None:
    """Raise MeasurementError for more steps than there is memory for."""
    if (steps := float(count.sum(dtype=float))) > MOST_STEPS:
        raise MeasurementError(
            f"profile: {steps:.3g} steps of the motor are more than {MOST_STEPS:,}, for which there is no memory; take "
            "a shorter run, or fewer rows in which its inputs change."
        )


def _growing(span: np.ndarray, first: float, growth: float) -> np.ndarray:
    """Return into how many steps spans are cut that start near `first` and grow by a constant factor, in s."""
    count = np.ceil(np.log1p(span / first * (growth - 1.0)) / np.log(growth)).astype(int)
    return np.maximum(count, 1)


def _parts(count: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the owner of every part, and its number among those of its owner, if owner k has `count[k]` parts."""
    owner = np.repeat(np.arange(count.size), count)
    return owner, np.arange(owner.size) - (np.cumsum(count) - count)[owner]


def _while_settling(
    duration: np.ndarray, since_jump: np.ndarray, shortest: float, longest: float, step_share: float
) -> np.ndarray:
    """Return into how many each step is divided that begins while a motor settles: none exceeds a share of its time.

    Motors with shorter time constants have settled before; the others determine the step.
    """
    time_constant = np.maximum(shortest, since_jump / SETTLED)
    count = np.ceil(duration / (step_share * time_constant)).astype(int)
    return np.where(since_jump < SETTLED * longest, count, 1)


def _jumps(profile: Profile, begins: bool) -> np.ndarray:
    """Return after which rows an input of the motor changed; the first interval of a run starts the motor."""
    moving = [values for name, values in profile.inputs.items() if name != "ambient_degC"]
    changed = np.any([np.diff(values) != 0.0 for values in moving], axis=0)
    changed[0] |= begins
    return changed
