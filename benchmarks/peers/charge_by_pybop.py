"""PyBOP's unscented Kalman filter of the state of charge, in its own environment: a case folder in, errors out.

    pip install "pybop==25.6" "pybamm<25.9" "jax==0.5.3" "jaxlib==0.5.3"   # later releases have no observer
    python charge_by_pybop.py CASE [--mended] > errors.csv

Its model is PyBaMM's Thevenin cell with one RC pair, held at the run's temperature. As its user would, the open-circuit
voltage is the preset's table, and three numbers (R0, R1, time constant) are fitted to the fit run nearest in
temperature, at its reference charge; their residual is the sd of a reading, and the charge drifts by 1 % in an hour, as
in `jaxmodel.operation.Tuning`. Readings are means over 20 s.

The gain of release 25.6 is the covariance of state and reading, P_xy, and not P_xy/P_yy: of a state known to 1 and a
reading 2 x = 1 of sd 0.1 it makes 2.0 (right: 0.499). `--mended` divides, by the standard update.
"""

import sys
import time
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pybamm
import pybop
from pybop.observers.unscented_kalman import SquareRootUKF
from scipy.optimize import least_squares

STEP_S, CONVERGED_S, WRONG = 20.0, 900.0, 0.3
SOC_SD, PAIR_SD_V, DRIFT_SD_PER_H = 0.3, 0.01, 0.01


def main(folder: Path) -> None:
    """Print a line for each check run and start: run, offset, rms, sd, within 2 sd, seconds of a step."""
    case = tomllib.loads((folder / "case.toml").read_text(encoding="utf-8"))
    preset = tomllib.loads((folder / case["preset"]).read_text(encoding="utf-8"))
    capacity_Ah = preset["parameters"]["capacity_Ah"]["value"]
    table = preset["parameters"]["ocv"]
    soc = np.array(table["soc"])
    ocv = np.maximum.accumulate(np.array(table["voltage_V"]))
    runs = [(entry["split"], entry["label"], means(folder / entry["file"])) for entry in case["runs"]]
    fits = {label: fitted(rows, soc, ocv) for split, label, rows in runs if split == "fit"}
    mean_degC = {label: rows["cell_temperature_degC"].mean() for _, label, rows in runs}
    print("run,offset,rms,sd,within_2_sd,step_s,R0_ohm,R1_ohm,tau_s,residual_V", flush=True)
    for split, label, rows in runs:
        if split != "check":
            continue
        near = min(fits, key=lambda name: abs(mean_degC[name] - mean_degC[label]))
        for offset in (0.0, -WRONG):
            numbers = fits[near]
            try:
                estimate, sd, step_s = filtered(rows, soc, ocv, capacity_Ah, numbers, rows["soc"][0] + offset)
            except (ValueError, np.linalg.LinAlgError, pybamm.SolverError) as error:
                print(f"{label},{offset:g},ends with {type(error).__name__}", flush=True)
                continue
            late = rows["time_s"] > rows["time_s"][0] + CONVERGED_S
            error = (estimate - rows["soc"])[late]
            within = np.mean(np.abs(error) < 2.0 * sd[late])
            values = (np.sqrt(np.mean(error**2)), np.sqrt(np.mean(sd[late] ** 2)), within, step_s, *numbers)
            print(",".join([label, f"{offset:g}", *(f"{value:.4g}" for value in values)]), flush=True)


def means(path: Path) -> dict[str, np.ndarray]:
    """Return the columns of a run as means over `STEP_S`."""
    names = path.read_text(encoding="utf-8").splitlines()[0].split(",")
    rows = np.genfromtxt(path, delimiter=",", skip_header=1)
    bins = ((rows[:, 0] - rows[0, 0]) // STEP_S).astype(int)
    kept = np.unique(bins)
    made = np.stack([rows[bins == one].mean(axis=0) for one in kept])
    return dict(zip(names, made.T, strict=True))


def fitted(rows: dict[str, np.ndarray], soc: np.ndarray, ocv: np.ndarray) -> tuple[float, float, float, float]:
    """Return R0, R1, the time constant and the residual's RMS of a run at its reference charge."""
    drop = np.interp(rows["soc"], soc, ocv) - rows["voltage_V"]
    duration, current = np.diff(rows["time_s"], prepend=rows["time_s"][0] - STEP_S), rows["current_A"]

    def left(logs: np.ndarray) -> np.ndarray:
        R0, R1, tau = np.exp(logs)
        pair, out = 0.0, np.empty(current.size)
        for row, (dt, ampere) in enumerate(zip(duration, current, strict=True)):
            keep = np.exp(-dt / tau)
            pair = keep * pair + (1.0 - keep) * R1 * ampere
            out[row] = drop[row] - R0 * ampere - pair
        return out

    found = least_squares(left, np.log([0.03, 0.03, 60.0]))
    return (*np.exp(found.x), float(np.sqrt(np.mean(found.fun**2))))


def filtered(rows, soc, ocv, capacity_Ah, numbers, start) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the charge, its sd and the seconds of a step by PyBOP's filter from an assumed start."""
    R0, R1, tau, residual_V = numbers
    degC = float(rows["cell_temperature_degC"].mean())
    time_s = rows["time_s"] - rows["time_s"][0]
    beyond_soc = np.concatenate([[-1.0], soc, [2.0]])
    beyond_V = np.concatenate([[ocv[0] - 1.0], ocv, [ocv[-1] + 1.0]])  # sigma points lie beyond full
    values = pybamm.equivalent_circuit.Thevenin().default_parameter_values
    values.update(
        {
            "Cell capacity [A.h]": capacity_Ah,
            "Nominal cell capacity [A.h]": capacity_Ah,
            "Initial SoC": start,
            "Initial temperature [K]": degC + 273.15,
            "Ambient temperature [K]": degC + 273.15,
            "Lower voltage cut-off [V]": 0.5,
            "Upper voltage cut-off [V]": 5.5,
            "Open-circuit voltage [V]": lambda s: pybamm.Interpolant(beyond_soc, beyond_V, s),
            "Entropic change [V/K]": 0.0,
            "R0 [Ohm]": R0,
            "R1 [Ohm]": R1,
            "C1 [F]": tau / R1,
            "Element-1 initial overpotential [V]": 0.0,
        },
        check_already_exists=False,
    )
    model = pybop.empirical.Thevenin(parameter_set=values, options={"number of rc elements": 1})
    data = pybop.Dataset(
        {"Time [s]": time_s, "Current function [A]": rows["current_A"], "Voltage [V]": rows["voltage_V"]}
    )
    first = np.diag([SOC_SD**2, PAIR_SD_V**2, 0.0, 0.0])
    # The filter takes this for one step of any duration: its scaling by the time has no effect (25.6).
    drift = np.diag([DRIFT_SD_PER_H**2 * STEP_S / 3600.0, (0.1 * PAIR_SD_V) ** 2, 0.0, 0.0])
    observer = pybop.UnscentedKalmanFilterObserver(
        pybop.Parameters(), model, first, drift, np.array([[residual_V**2]]), dataset=data, signal=["Voltage [V]"]
    )
    observer._model._solver = pybamm.CasadiSolver(mode="fast")  # by IDAKLU, its default, a step has no states
    observer._model._built_model.events = []  # sigma points of a full cell are beyond it, where the model stops
    estimate, sd = np.full(time_s.size, start), np.full(time_s.size, SOC_SD)
    began = time.perf_counter()
    for row in range(1, time_s.size):
        observer.observe(time_s[row], np.array([rows["voltage_V"][row]]))
        estimate[row] = observer._ukf.x[0, 0]
        sd[row] = np.sqrt(abs(observer.get_current_covariance()[0, 0]))
    return estimate, sd, (time.perf_counter() - began) / (time_s.size - 1)


def mended(self, y: np.ndarray) -> float:
    """Replace `SquareRootUKF.step` by the standard update for one reading."""
    points, w_m, w_c = self.gen_sigma_points(self.x, self.S, self.alpha, self.beta, self.states)
    points = np.apply_along_axis(self.f, 0, points)
    x, S = self.unscented_transform(points, w_m, w_c, self.sqrtRp, self.states)
    read = np.apply_along_axis(self.h, 0, points)
    expected, _ = self.unscented_transform(read, w_m, w_c, self.sqrtRm)
    off, off_V = points - x, read - expected
    spread = float(np.sum(w_c * off_V**2)) + float(self.sqrtRm[0, 0]) ** 2
    gain = (off * w_c) @ off_V.T / spread
    self.x = x + gain * (y - expected)
    covariance = S.T @ S - spread * gain @ gain.T
    kept = np.ix_(self.states, self.states)
    self.S = np.zeros_like(S)
    self.S[kept] = np.linalg.cholesky(covariance[kept] + 1e-12 * np.eye(len(self.states)))
    return 0.0


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    if "--mended" in sys.argv:
        SquareRootUKF.step = mended
    main(Path(sys.argv[1]))
