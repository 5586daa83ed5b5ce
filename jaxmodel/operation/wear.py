"""Whether a motor wears: its numbers from each run alone, and a straight line through them over the runs or cycles."""

from __future__ import annotations

import dataclasses
import html
import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import norm
from scipy.stats import t as student

from jaxmodel.base.errors import FitError
from jaxmodel.base.in_short import InShort
from jaxmodel.case.build import case_model
from jaxmodel.case.load import free_number
from jaxmodel.case.records import Case, Run
from jaxmodel.case.simulation import simulate_case
from jaxmodel.parameterisation.motor_electrical import electrical
from jaxmodel.parameterisation.motor_rows import MotorRows, motor_rows

# A change is told where a change as large would come by chance in fewer than this share of motors that do not change.
CHANCE = 0.003
LEAST_RUNS = 4  # a line through three points leaves one degree of freedom
# Inputs of the runs differ whose means vary by more than this share, and follow the order from this correlation on.
# Assumed.
DIFFERENT, ORDERED = 0.02, 0.7
BLOCKS = 10  # of a run; rows within one are alike
WHAT = {"k_tau": "torque constant", "R_0": "resistance", "friction": "friction"}
UNITS = {"k_tau": "N m/A", "R_0": "ohm", "friction": "N m"}


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Trend(InShort):
    """One number of a motor over its runs.

    Attributes:
        name: `k_tau`, `R_0` or `friction`.
        unit: of it.
        over: "cycles" where each run states them, else "run" (their order).
        points: run, at, value, sd (of the run alone).
        mean: of the line, at the middle of the runs.
        slope: of the line, in units for each cycle or run.
        sd: of the slope, from how the runs lie about the line, and at least from their own sd.
        chance: how probable so large a slope would be without a change: by how the runs lie about the line (Student's
            t) or by their own sd (normal), whichever is larger.
        least: the smallest slope that these runs would tell.
        confounded: the input whose mean follows the order of the runs too, as `load_torque_Nm`; "" where none does.
    """

    name: str
    unit: str
    over: str
    points: pd.DataFrame
    mean: float
    slope: float
    sd: float
    chance: float
    least: float
    confounded: str = ""

    @property
    def told(self) -> bool:
        """Return whether the runs tell a change, and not one of what the motor was asked for."""
        return self.chance < CHANCE and not self.confounded

    @property
    def change(self) -> tuple[float, float]:
        """Return the change from the first run to the last as a share of the mean, and its sd."""
        span = float(np.ptp(self.points["at"]))
        return self.slope * span / self.mean, self.sd * span / abs(self.mean)

    def sentence(self) -> str:
        """Return what the runs tell of it, in one sentence."""
        share, sd = (100.0 * one for one in self.change)
        size, way = f"{abs(share):.2g} ± {sd:.2g} %", "rises" if share > 0.0 else "falls"
        if self.told:
            return f"The {WHAT[self.name]} {way} by {size} from the first run to the last."
        if self.chance < CHANCE:
            return (
                f"The {WHAT[self.name]} {way} by {size}, but {self.confounded} of the runs follows their order too: "
                "its effect and wear are not told apart; repeat a run of the beginning."
            )
        least = 100.0 * self.least * float(np.ptp(self.points["at"])) / abs(self.mean)
        return (
            f"The {WHAT[self.name]} shows no change: {share:+.2g} ± {sd:.2g} %; "
            f"one of less than {least:.2g} % would not be seen in these runs."
        )

    def _in_short(self) -> str:
        return self.sentence()


@dataclasses.dataclass(frozen=True, eq=False)
class Wear:
    """What the runs of a motor tell of its wear.

    Attributes:
        name: of the case.
        trends: of what could be found in each run.
        missing: by name, why a number could not be followed.

    Example:
        >>> import numpy as np
        >>> import pandas as pd
        >>> from jaxmodel import Case
        >>> from jaxmodel.operation import trend
        >>> time_s = np.arange(0.0, 20.0, 0.1)
        >>> current, speed = 3.0 + np.sin(time_s), 100.0 + 50.0 * np.cos(0.7 * time_s)
        >>> frame = pd.DataFrame({"time_s": time_s, "current_A": current, "speed_rad_s": speed, "ambient_degC": 20.0})
        >>> frame["voltage_V"] = 0.5 * current + 0.05 * speed
        >>> noise = 0.01 * np.random.default_rng(0).normal(size=(5, time_s.size))
        >>> runs = {f"day_{day}": frame.assign(current_A=current + noise[day]) for day in range(5)}
        >>> trend(Case.from_dataframes(runs, kind="motor", load="unknown")).trends[0].told
        False
    """

    name: str
    trends: tuple[Trend, ...]
    missing: dict[str, str]

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each number and run: name, run, at, value, sd."""
        return pd.concat([one.points.assign(name=one.name) for one in self.trends], ignore_index=True)

    def summary(self) -> str:
        """Return a sentence for each number, and one for each that cannot be followed."""
        return "\n".join([*(one.sentence() for one in self.trends), *self.missing.values()])

    def __repr__(self) -> str:
        told = [WHAT[one.name] for one in self.trends if one.told]
        return f"<Wear {self.name}: {', '.join(told) + ' changes' if told else 'no change is told'}>"

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(line)}</p>" for line in self.summary().splitlines())


def trend(case: Case) -> Wear:
    """Return whether resistance, torque constant and friction of a motor change over its runs.

    Each run alone gives them by least squares: eq. 11 at rest of the current, V = R_0 (1 + psi_R (T_w - T_0)) i + k w,
    and eqs. 12 and 13, k i - tau_l - J dw/dt = friction sgn(w), with k and J of the case and friction the mean over the
    speeds of the run. A line by least squares goes through the runs, over `cycles` where each states them, else over
    their order. T_w is read, else that of the model: a winding that warms is not taken for wear.

    Args:
        case: of a motor, with current and speed; with voltage for R_0 and k_tau, with a known load for the friction.

    Raises:
        FitError: fewer than four runs, runs of several motors, or no run has current and speed.
    """
    if len(case.specimens) > 1:
        raise FitError(
            f"{case.label}: its runs are of {len(case.specimens)} motors ({', '.join(case.specimens)}), and a trend is "
            "of one; give one of case.of_specimens()."
        )
    if len(case.runs) < LEAST_RUNS:
        raise FitError(f"{case.label}: {len(case.runs)} runs tell no trend; give {LEAST_RUNS} or more.")
    found: dict[str, list[tuple[Run, float, float]]] = {name: [] for name in WHAT}
    for one in simulate_case(case, progress=False):
        for name, value, sd in _of_run(case, one.run, one.table["winding_temperature_degC"].to_numpy()):
            found[name].append((one.run, value, sd))
    trends = tuple(_line(case, name, points) for name, points in found.items() if len(points) >= LEAST_RUNS)
    if not trends:
        raise FitError(f"{case.label}: no number is found in {LEAST_RUNS} runs; voltage, current and speed give them.")
    few = {name: points for name, points in found.items() if len(points) < LEAST_RUNS}
    return Wear(case.name, trends, {name: _why(name, len(points)) for name, points in few.items()})


def _of_run(case: Case, run: Run, winding_degC: np.ndarray) -> list[tuple[str, float, float]]:
    """Return name, value and sd of what one run alone tells."""
    rows, parameters = motor_rows(case, run), case_model(case, run).parameters
    if rows.winding_degC is None:
        rows = dataclasses.replace(rows, winding_degC=winding_degC)
    known = case.parameters.get("k_tau")
    known = known if known is not None and known.sd else None
    numbers, _ = electrical([rows], float(parameters.psi_R), float(parameters.T_0), known)
    found = [(one.name, one.value, one.sd) for one in numbers]
    if rows.current_A is not None and rows.speed_rad_s is not None and rows.load_known:
        found += _friction(case, rows, float(parameters.k_tau), float(parameters.J))
    return found


def _friction(case: Case, rows: MotorRows, k: float, J: float) -> list[tuple[str, float, float]]:
    """Return the mean torque that friction takes while the motor turns, with the sd of that mean."""
    assert rows.current_A is not None
    assert rows.speed_rad_s is not None
    load, free = rows.load_Nm, free_number(case)
    if rows.law is not None and free is not None:
        load = load + rows.law * float(case.effects[free[0]][free[1]])
    at = rows.read & rows.moving
    against = ((k * rows.current_A - load - J * rows.rate) * np.sign(rows.speed_rad_s))[at]
    blocks = [float(np.mean(block)) for block in np.array_split(against, BLOCKS) if block.size]
    if len(blocks) < BLOCKS:
        return []
    return [("friction", float(np.mean(against)), float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS))]


def _line(case: Case, name: str, found: Sequence[tuple[Run, float, float]]) -> Trend:
    """Return the line through a number over the runs."""
    cycles = [run.overrides.get("cycles") for run, _, _ in found]
    known = [one.value for one in cycles if one is not None]
    counted = len(known) == len(found) and np.ptp(known) > 0.0
    order = {run.name: number for number, run in enumerate(case.runs)}
    at = np.array(known if counted else [order[run.name] for run, _, _ in found], dtype=float)
    value, own = np.array([one[1] for one in found]), np.array([one[2] for one in found])
    away = at - at.mean()
    slope = float(away @ value) / float(away @ away)
    left = value - value.mean() - slope * away
    scatter = math.sqrt(float(left @ left) / (at.size - 2) / float(away @ away))
    sum_of_own = math.sqrt(float(away**2 @ own**2)) / float(away @ away)
    sizes = (abs(slope) / max(scatter, 1e-300), abs(slope) / max(sum_of_own, 1e-300))
    chance = 2.0 * max(float(student.sf(sizes[0], at.size - 2)), float(norm.sf(sizes[1])))
    points = pd.DataFrame({"run": [run.name for run, _, _ in found], "at": at, "value": value, "sd": own})
    over = "cycles" if counted else "run"
    least = max(scatter * float(student.isf(CHANCE / 2.0, at.size - 2)), sum_of_own * float(norm.isf(CHANCE / 2.0)))
    confounded = _followed([run for run, _, _ in found], at)
    sd, mean = max(scatter, sum_of_own), float(value.mean())
    return Trend(name, UNITS[name], over, points, mean, slope, sd, chance, least, confounded)


def _followed(runs: Sequence[Run], at: np.ndarray) -> str:
    """Return which input of the runs differs between them as their order does; "" for none."""
    for column in sorted(set.intersection(*(set(run.measured.inputs) for run in runs))):
        means = np.array([float(np.mean(np.abs(run.measured.inputs[column]))) for run in runs])
        differs = float(np.std(means)) > DIFFERENT * float(np.mean(means))
        if differs and abs(float(np.corrcoef(means, at)[0, 1])) > ORDERED:
            return column
    return ""


def _why(name: str, runs: int) -> str:
    needs = {
        "k_tau": "voltage, current and a speed that changes within each run",
        "R_0": "voltage, speed and a current that changes within each run",
        "friction": "a current, and a load that is measured, that follows a law, or that is free",
    }
    return f"The {WHAT[name]} is found in {runs} run{'s' * (runs != 1)}, which tells no trend: it needs {needs[name]}."
