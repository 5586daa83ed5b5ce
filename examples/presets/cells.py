"""The curves of a cell from pulse tests and discharges, by separable least squares on the model's own equations.

V = V_oc(SOC) - i R_ints(SOC, T) - V_TS - V_TL with tau dV_x/dt = R_x(SOC, T) i - V_x is linear in the values of all
four tables at their points, once the two time constants are chosen. So the values are one non-negative least-squares
problem, and the time constants a search around it. T is the measured temperature of the cell's surface, not the
chamber's: the tables then hold the cell's own behaviour, without its warming.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import minimize, nnls

JUMP_A = 0.5  # a current that changes by more than this over a gap of the log was off until the gap's end
GAP_S = 5.0
LONGEST_S = 10.0  # a row counts as the root of the time it stands for, up to this: logs are dense in pulses
# Where data say little, ocv goes on straight and a resistance is held: weights of second and of first differences.
SMOOTH_OCV, SMOOTH_OHM = 2.0, 5.0
# What a test's open-circuit voltage differs from the reference's (age, entropy, hysteresis) is its own, at these,
# lest it be charged to resistances: a weight of 0.3 to a row's 1 lets it go as far as the data want.
OWN_SOC = (0.0, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 1.0)
OWN_WEIGHT = 0.3
LEAST_OHM = 5e-4  # of a table: the model wants more than 0
ROUNDS = 4  # of: tables, then from them the state of charge at each test's first rest


@dataclasses.dataclass(frozen=True)
class Test:
    """One file of a cell.

    Attributes:
        file: its name.
        first_soc: state of charge at its start; None: from the voltage there, at rest.
        follows: the test that this one continues.
        least_V: it ends where the voltage falls below this.
        from_s: earlier rows are run through but not fitted.
        weight: of its rows.
        own_ocv: whether its open-circuit voltage may differ from the reference's.
    """

    file: str
    first_soc: float | None = None
    follows: str | None = None
    least_V: float = 0.0
    from_s: float = 0.0
    weight: float = 1.0
    own_ocv: bool = True


@dataclasses.dataclass(frozen=True)
class Plan:
    """What a cell's curves are made of, and where their points lie; `empties` is the test that ends at SOC 0.

    At `hot_degC`, where a cell gets only under way and not at every state of charge, all resistances are one searched
    factor times those of the highest of `degC`.
    """

    folder: str
    tests: tuple[Test, ...]
    empties: str
    degC: tuple[float, ...]
    ocv_soc: tuple[float, ...]
    series_soc: tuple[float, ...]
    pair_soc: tuple[float, ...]
    taus_s: tuple[float, float]
    hot_degC: float | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Rows:
    """One test, ready: the charge drawn since its start, and the mean current over the step that ends at each row."""

    time_s: np.ndarray
    current_A: np.ndarray
    mean_A: np.ndarray
    voltage_V: np.ndarray
    degC: np.ndarray
    drawn_Ah: np.ndarray


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """A cell: capacity, `ocv` over SOC, `R_ints`, `R_TS` and `R_TL` of shape (temperature, soc), and the misfit.

    `degC` are the temperatures of the tables, the hot one included.
    """

    capacity_Ah: float
    ocv: np.ndarray
    degC: tuple[float, ...]
    tables: dict[str, np.ndarray]
    taus_s: tuple[float, float]
    first_soc: dict[str, float]
    rms_V: dict[str, float]


def read(folder: Path, test: Test) -> Rows:
    """Return one test; charge from the file's counter, or from its current where it has none."""
    rows = pd.read_csv(folder / test.file)
    step_s = rows.time_s.diff().fillna(0.0).to_numpy()
    mean_A = rows.current_A.to_numpy().copy()
    mean_A[(step_s > GAP_S) & (rows.current_A.diff().abs() > JUMP_A)] = 0.0
    drawn = np.cumsum(mean_A * step_s) / 3600.0
    if "discharged_Ah" in rows:
        drawn = rows.discharged_Ah.to_numpy() - rows.discharged_Ah.iloc[0]
    low = rows.voltage_V.to_numpy() < test.least_V
    kept = slice(0, int(np.argmax(low)) if low.any() else len(rows))
    columns = (rows.time_s, rows.current_A, mean_A, rows.voltage_V, rows.temperature_degC, drawn)
    return Rows(*(np.asarray(column, dtype=float)[kept] for column in columns))


def weights(x: np.ndarray, points) -> np.ndarray:
    """Return the weights of linear interpolation, held at the ends, shape (rows, points)."""
    return np.column_stack([np.interp(x, points, unit) for unit in np.eye(len(points))])


def over_both(soc: np.ndarray, over_degC: np.ndarray, soc_points) -> np.ndarray:
    """Return the weights of a table over temperature and SOC, shape (rows, temperatures x socs)."""
    both = over_degC[:, :, None] * weights(soc, soc_points)[:, None, :]
    return both.reshape(len(soc), -1)


def relaxed(time_s: np.ndarray, drive: np.ndarray, tau_s: float) -> np.ndarray:
    """Return the first-order response to a drive of shape (rows, any) that holds over the step ending at its row."""
    kept = np.exp(-np.diff(time_s, prepend=time_s[0]) / tau_s)
    response = np.zeros_like(drive)
    for row in range(1, len(time_s)):
        response[row] = kept[row] * response[row - 1] + (1.0 - kept[row]) * drive[row]
    return response


def second_differences(points) -> np.ndarray:
    """Return second differences over uneven points, of the scale of differences between neighbours."""
    x = np.asarray(points)
    rows = np.zeros((len(x) - 2, len(x)))
    for k, (left, right) in enumerate(zip(np.diff(x)[:-1], np.diff(x)[1:], strict=True)):
        rows[k, k : k + 3] = (1.0 / left, -1.0 / left - 1.0 / right, 1.0 / right)
    return rows * np.mean(np.diff(x))


class Fitting:
    """The least-squares problem of one cell."""

    def __init__(self, source: Path, plan: Plan) -> None:
        self.plan = plan
        self.tests = {test: read(source / plan.folder, test) for test in plan.tests}
        self.voltage = np.concatenate([rows.voltage_V for rows in self.tests.values()])
        self.weight = np.concatenate([self._weight(test, rows) for test, rows in self.tests.items()])
        self.own = [test for test in plan.tests if test.own_ocv]
        self.first_soc = {test.file: 1.0 if test.first_soc is None else test.first_soc for test in plan.tests}
        self.place()
        # Of V_oc the rises from point to point are the values: as they are not negative, it never falls.
        self.risen = np.tril(np.ones((len(plan.ocv_soc), len(plan.ocv_soc))))
        tables = [SMOOTH_OCV * second_differences(plan.ocv_soc) @ self.risen]
        for points in (plan.series_soc, plan.pair_soc, plan.pair_soc):
            tables += [SMOOTH_OHM * np.diff(np.eye(len(points)), axis=0)] * len(plan.degC)
        tables += [OWN_WEIGHT * np.eye(2 * len(OWN_SOC) * len(self.own))]
        self.extra = np.zeros((sum(t.shape[0] for t in tables), sum(t.shape[1] for t in tables)))
        row = column = 0
        for table in tables:
            self.extra[row : row + table.shape[0], column : column + table.shape[1]] = table
            row, column = row + table.shape[0], column + table.shape[1]

    @staticmethod
    def _weight(test: Test, rows: Rows) -> np.ndarray:
        step_s = np.clip(np.diff(rows.time_s, prepend=rows.time_s[0]), 0.0, LONGEST_S)
        return np.where(rows.time_s < test.from_s, 0.0, test.weight * np.sqrt(step_s))

    def place(self, ocv: np.ndarray | None = None) -> None:
        """Set each test's state of charge at its start, and the capacity with it."""
        for test, rows in self.tests.items():
            if ocv is not None and test.first_soc is None and test.follows is None:
                self.first_soc[test.file] = float(np.interp(rows.voltage_V[0], ocv, self.plan.ocv_soc))
        drawn = {test.file: rows.drawn_Ah[-1] for test, rows in self.tests.items()}
        last = next(test for test in self.tests if test.file == self.plan.empties)
        before = drawn.get(last.follows, 0.0)
        self.capacity_Ah = (before + drawn[last.file]) / self.first_soc[last.follows or last.file]
        for test in self.tests:
            if test.follows:
                self.first_soc[test.file] = self.first_soc[test.follows] - drawn[test.follows] / self.capacity_Ah

    def design(self, searched: np.ndarray) -> np.ndarray:
        """Return the voltage's derivatives by all values, shape (rows, values).

        Args:
            searched: both time constants in s, and the factor of the hot row if there is one.
        """
        plan, blocks, taus_s = self.plan, [], searched[:2]
        for test, rows in self.tests.items():
            soc = self.first_soc[test.file] - rows.drawn_Ah / self.capacity_Ah
            over_degC = weights(rows.degC, plan.degC)
            if plan.hot_degC is not None:
                all_rows = weights(rows.degC, (*plan.degC, plan.hot_degC))
                over_degC = all_rows[:, :-1]
                over_degC[:, -1] += searched[2] * all_rows[:, -1]
            series = over_both(soc, over_degC, plan.series_soc) * rows.current_A[:, None]
            drive = over_both(soc, over_degC, plan.pair_soc) * rows.mean_A[:, None]
            own = weights(soc, OWN_SOC)
            owns = [np.hstack([own, -own]) * (other is test) for other in self.own]  # two signs: all values are >= 0
            pairs = [-relaxed(rows.time_s, drive, tau) for tau in taus_s]
            blocks.append(np.hstack([weights(soc, plan.ocv_soc) @ self.risen, -series, *pairs, *owns]))
        return np.vstack(blocks)

    def solve(self, searched: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the values that fit best and what they miss by row, in V, from the normal equations."""
        matrix = self.design(searched)
        weighted = matrix * self.weight[:, None]
        normal = weighted.T @ weighted + self.extra.T @ self.extra + 1e-9 * np.eye(matrix.shape[1])
        root = np.linalg.cholesky(normal)
        aim = np.linalg.solve(root, weighted.T @ (self.weight * self.voltage))
        values = nnls(root.T, aim, maxiter=20000)[0]
        return values, matrix @ values - self.voltage

    def misfit(self, logarithms: np.ndarray) -> float:
        """Return the weighted mean square at what is searched, in mV^2."""
        missed = self.solve(np.exp(logarithms))[1]
        return 1e6 * float(np.sum((self.weight * missed) ** 2) / np.sum(self.weight**2))


def fit(source: Path, plan: Plan) -> Fit:
    """Return the tables of a cell."""
    fitting, hot = Fitting(source, plan), plan.hot_degC is not None
    searched = np.array([*plan.taus_s, 0.8][: 2 + hot])
    for _ in range(ROUNDS):
        found = minimize(fitting.misfit, np.log(searched), method="Nelder-Mead", options={"maxfev": 30})
        searched = np.exp(found.x)
        values, _ = fitting.solve(searched)
        fitting.place(np.cumsum(values[: len(plan.ocv_soc)]))
    values, missed = fitting.solve(searched)
    sizes = np.cumsum([len(plan.ocv_soc)] + [len(plan.degC) * len(x) for x in (plan.series_soc, *[plan.pair_soc] * 2)])
    ocv, *ohms, _ = np.split(values, sizes)
    missed[fitting.weight == 0.0] = np.nan
    parts = np.split(missed, np.cumsum([rows.time_s.size for rows in fitting.tests.values()])[:-1])
    tables = {}
    for name, ohm in zip(("R_ints", "R_TS", "R_TL"), ohms, strict=True):
        rows = ohm.reshape(len(plan.degC), -1)
        hot_rows = [searched[2] * rows[-1]] if hot else []
        tables[name] = np.maximum(np.vstack([rows, *hot_rows]), LEAST_OHM)
    return Fit(
        capacity_Ah=float(fitting.capacity_Ah),
        ocv=np.cumsum(ocv),
        degC=(*plan.degC, plan.hot_degC) if plan.hot_degC is not None else plan.degC,
        tables=tables,
        taus_s=(float(searched[0]), float(searched[1])),
        first_soc=dict(fitting.first_soc),
        rms_V={t.file: float(np.sqrt(np.nanmean(part**2))) for t, part in zip(fitting.tests, parts, strict=True)},
    )


def scale(fitted: Fit, plan: Plan, rows: Rows, first_soc: float) -> float:
    """Return the factor on all resistances that a run asks for, above the lowest states of charge."""
    soc = first_soc - rows.drawn_Ah / fitted.capacity_Ah
    over_degC = weights(rows.degC, fitted.degC)
    drop = over_both(soc, over_degC, plan.series_soc) @ fitted.tables["R_ints"].ravel() * rows.current_A
    driven = over_both(soc, over_degC, plan.pair_soc) * rows.mean_A[:, None]
    for name, tau_s in zip(("R_TS", "R_TL"), fitted.taus_s, strict=True):
        drop += relaxed(rows.time_s, driven @ fitted.tables[name].ravel()[:, None], tau_s)[:, 0]
    measured = np.interp(soc, plan.ocv_soc, fitted.ocv) - rows.voltage_V
    kept = soc > plan.pair_soc[1]
    return float(drop[kept] @ measured[kept] / (drop[kept] @ drop[kept]))
