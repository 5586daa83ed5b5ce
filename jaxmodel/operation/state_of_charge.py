"""Estimators of the state of charge, tuned on the fit runs of a case and scored on its check runs.

Six are compared: an extended Kalman filter and the paper's polynomial, each with the measured temperature and with 25
degC assumed, a sigma-point filter with the tuning of the first, and coulomb counting.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.in_short import InShort
from jaxmodel.base.progress import Stage, stages
from jaxmodel.base.schema import with_schema, without_schema
from jaxmodel.case.build import case_model, with_preset
from jaxmodel.case.measurements import file_label, read_utf8
from jaxmodel.case.records import Case
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.calibration import calibrated
from jaxmodel.operation.controller import SinglePrecision, single_precision
from jaxmodel.operation.evaluation import (
    FIXED_DEGC,
    Trial,
    filters,
    known_of,
    polynomials,
    rms,
    trials,
    tune_filter,
    tune_polynomial,
)
from jaxmodel.operation.innovations import consistency
from jaxmodel.operation.kalman import Measured, Tuning, ekf
from jaxmodel.operation.polynomial import PolynomialEstimator, polynomial_estimator
from jaxmodel.operation.preparation import for_estimation
from jaxmodel.operation.sigma_points import cubature_filter

FILTER, FILTER_FIXED = "filter, with temperature", "filter, 25 °C assumed"
POLYNOMIAL, POLYNOMIAL_FIXED = "polynomial, with temperature", "polynomial, 25 °C assumed"
SIGMA_POINTS = "sigma points, with temperature"
COUNTED = "coulomb counting"
ESTIMATORS = (FILTER, FILTER_FIXED, SIGMA_POINTS, POLYNOMIAL, POLYNOMIAL_FIXED, COUNTED)
TARGET = 0.02
COVERED = 0.95  # share of the time in which two standard deviations hold the truth, of a band that is right
POLYNOMIAL_DEGC = (-20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
BATCH, BATCH_ROWS = 4096, 200
# What a tuning of an older version lacks, at the values of that version.
ADDED = {"capacity_sd": 0.0, "current_sd": 0.0, "bias_sd_V": 0.0, "error_s": 0.0}
ADDED |= {"shift_sd": 0.0, "lasting_share": 0.0}
SCORED = ("innovation", "sd", "scale", "capacity_scale")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Evaluation(InShort):
    """Estimators of a cell's state of charge and their errors.

    Attributes:
        tunings: of the two filters, by the name of the estimator.
        polynomials: the two polynomial estimators, by name.
        errors: a line for each check run, trial, start and estimator: run; from, "start" or the state of charge where
            the trial begins; offset of the assumed start; estimator; rms and largest error after 15 minutes;
            to_5_percent_s, after which the error stays within 0.05; and of filters nis, nis_low, nis_high and verdict
            (see `consistency`), sd (of the state of charge, RMS), within_2_sd (share of the rows within two standard
            deviations of the filter), scale (of the resistances, median) and capacity (its scale at the end).
        estimates: by check run, each estimator's state of charge over time_s from a start 30 % too low, beside soc, the
            reference; and the bands of the filters, named after them with ", sd".
        single_precision: the filter with temperature in float32 over the first check run, and what a step takes.
        model: that the tunings are for: of the case, its table of the open-circuit voltage corrected by the fit runs.
    """

    tunings: dict[str, Tuning]
    polynomials: dict[str, PolynomialEstimator]
    errors: pd.DataFrame
    estimates: dict[str, dict[str, np.ndarray]]
    single_precision: SinglePrecision | None = None
    model: Model | None = None

    def worst_errors(self, *, from_start: bool = True) -> pd.DataFrame:
        """Return the largest RMS error over the trials of each check run, a column for each estimator.

        Args:
            from_start: trials that start with the run, after a rest; False for those that start under load.
        """
        chosen = self.errors[(self.errors["from"] == "start") == from_start]
        table = chosen.pivot_table(values="rms", index="run", columns="estimator", aggfunc="max", sort=False)
        return table.reindex(index=list(dict.fromkeys(self.errors["run"])), columns=list(ESTIMATORS))

    def bands(self) -> pd.DataFrame:
        """Return whether each filter's band tells its error, over the trials of each check run from its start.

        Columns: run, estimator, rms and sd (the largest and its trial's), within_2_sd (least), verdict of the
        innovations, and honest: the error is within 2 %, or the truth within two sd in 95 % of the time.
        """
        rows = []
        filters_only = self.errors[
            (self.errors["from"] == "start") & self.errors["estimator"].isin((FILTER, FILTER_FIXED, SIGMA_POINTS))
        ]
        for (run, name), trials_of in filters_only.groupby(["run", "estimator"], sort=False):
            worst = trials_of.loc[trials_of["rms"].fillna(np.inf).idxmax()]
            honest = bool(((trials_of["rms"] <= TARGET) | (trials_of["within_2_sd"] >= COVERED)).all())
            least = float(trials_of["within_2_sd"].min())
            rows.append((run, name, worst["rms"], worst["sd"], least, worst["nis"], worst["verdict"], honest))
        columns = ["run", "estimator", "rms", "sd", "within_2_sd", "nis", "verdict", "honest"]
        return pd.DataFrame(rows, columns=columns)

    def write_tunings(self, path: str | Path) -> None:
        """Write the filters' tunings as JSON, for `read_tunings`."""
        values = {name: {key: float(value) for key, value in vars(t).items()} for name, t in self.tunings.items()}
        write_whole(Path(path), json.dumps(with_schema(values), indent=2) + "\n")


def evaluate_estimators(
    case: Case,
    *,
    count: int = 32,
    tunings: Mapping[str, Tuning] | None = None,
    progress: bool | Stage = True,
) -> Evaluation:
    """Tune estimators of the state of charge on the fit runs of a case, and score them on its check runs.

    Args:
        case: of kind "cell"; its runs have `voltage_V` and a reference `soc`, and `cell_temperature_degC` where that
            is measured.
        count: tunings that are tried for each filter, a power of two.
        tunings: of an earlier evaluation, from `read_tunings`; the filters are then not tuned.
        progress: True shows it at a terminal or in a notebook, False shows nothing; a function is called with
            what is done next.

    Raises:
        MeasurementError: the case is of another kind, or lacks runs of a split or columns.
    """
    with stages(progress, case.name) as report:
        return _evaluated(case, count, tunings, report)


def _evaluated(case: Case, count: int, tunings: Mapping[str, Tuning] | None, report: Stage) -> Evaluation:
    fit, check = ([run for run in case.runs if run.split == split] for split in ("fit", "check"))
    if case.kind != "cell" or not fit or not check:
        raise MeasurementError(
            f"{case.label}: estimate needs a case of kind cell with runs of both splits, fit and check."
        )
    model, capacity_sd = _estimators_model(case), _capacity_sd(case)
    chosen = dict(tunings or {})
    for name, with_temperature in ((FILTER, True), (FILTER_FIXED, False)):
        if name not in chosen:
            of_fit = trials(fit, with_temperature=with_temperature, capacity_sd=capacity_sd)
            models = [_estimators_model(case, without=trial.name) for trial in of_fit]
            chosen[name], _ = tune_filter(models, of_fit, count, lambda run, n=name: report(f"tuning: {n}, {run}"))
    made = {
        name: tune_polynomial(
            lambda blend, degC=degC: polynomial_estimator(model, np.array(degC), blend),
            trials(fit, with_temperature=with_temperature),
        )
        for name, degC, with_temperature in (
            (POLYNOMIAL, POLYNOMIAL_DEGC, True),
            (POLYNOMIAL_FIXED, (FIXED_DEGC,), False),
        )
    }
    rows: list[dict[str, Any]] = []
    estimates: dict[str, dict[str, np.ndarray]] = {}
    chosen_or_same = chosen | {SIGMA_POINTS: chosen[FILTER]}
    for with_temperature, names in (
        (True, (FILTER, SIGMA_POINTS, POLYNOMIAL, COUNTED)),
        (False, (FILTER_FIXED, POLYNOMIAL_FIXED)),
    ):
        of_fit = trials(fit, with_temperature=with_temperature)
        for trial in known_of(trials(check, with_temperature=with_temperature, capacity_sd=capacity_sd), of_fit):
            report(f"scoring: {'with' if with_temperature else 'without'} the temperature, {trial.name}")
            for name in names:
                soc, output = _estimate(model, trial, name, chosen_or_same.get(name), made.get(name))
                rows += [_row(trial, name, start, soc, output) for start in range(len(trial.offsets))]
                if trial.rested:
                    of_run = estimates.setdefault(trial.name, {"time_s": trial.time_s, "soc": trial.soc})
                    of_run[name] = soc[1][: trial.soc.size]
                    if output:
                        of_run[f"{name}, sd"] = output["sd"][1][: trial.soc.size]
    first = known_of(trials(check[:1], with_temperature=True), trials(fit, with_temperature=True))[0]
    start = float(first.starts[1])
    single = single_precision(model, chosen[FILTER], first.measured, start)
    return Evaluation(chosen, made, pd.DataFrame(rows), estimates, single, model)


def _capacity_sd(case: Case) -> float:
    """Return the sd of the capacity of a case, by which its references count, as a share of it."""
    capacity = with_preset(case).parameters["capacity_Ah"]
    return (capacity.sd or 0.0) / capacity.value


def _estimators_model(case: Case, without: str = "") -> Model:
    """Return the model of a case as its estimators use it: see `for_estimation` and `calibrated`.

    Args:
        case: of kind "cell".
        without: a fit run that does not correct the table, unless it is the only one: so that a band that is tuned on
            it holds the errors of runs that corrected nothing.
    """
    fit = trials([run for run in case.runs if run.split == "fit"], with_temperature=True)
    rested = [trial for trial in _others(fit, without) if trial.rested]
    return calibrated(for_estimation(case_model(case)), rested)


def _others(trials: Sequence[Trial], name: str) -> list[Trial]:
    """Return the trials of other runs than one; all if there are no others."""
    return [trial for trial in trials if trial.name != name] or list(trials)


def read_tunings(path: str | Path) -> dict[str, Tuning]:
    """Read the filters' tunings that an evaluation wrote.

    Raises:
        MeasurementError: the file does not exist, or is not one of these.
    """
    path = Path(path)
    fields = {field.name for field in dataclasses.fields(Tuning)}
    try:
        found = json.loads(read_utf8(path))
    except (ValueError, RecursionError) as error:
        if isinstance(error, MeasurementError):
            raise
        found = None
    if isinstance(found, dict):
        found = without_schema(found, file_label(path))
    if (
        not isinstance(found, dict)
        or found.keys() != {FILTER, FILTER_FIXED}
        or not all(
            isinstance(values, dict)
            and fields - ADDED.keys() <= values.keys() <= fields
            and all(map(_is_finite, values.values()))
            for values in found.values()
        )
    ):
        sentence = f"{file_label(path)} is not a tuning.json of `jaxmodel estimate`; name one that it wrote."
        raise MeasurementError(sentence)
    return {name: Tuning(**ADDED | values) for name, values in found.items()}


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and abs(value) <= sys.float_info.max


def _estimate(
    model: Model, trial: Trial, name: str, tuning: Tuning | None, polynomial: PolynomialEstimator | None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the state of charge from each start, shape (starts, rows), and a filter's further outputs."""
    if tuning is not None:
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], tuning)
        run = cubature_filter if name == SIGMA_POINTS else ekf
        hysteresis = jnp.asarray(trial.hysteresis)
        found = filters(model, one, trial.measured, trial.starts, trial.pairs_sd_V, hysteresis, run)
        output = jax.tree.map(lambda x: np.asarray(x)[0], found)
        return output.soc, {field: np.asarray(getattr(output, field)) for field in SCORED}
    if polynomial is not None:
        return np.asarray(polynomials(polynomial, trial.measured, trial.starts)), {}
    return trial.soc + np.asarray(trial.starts)[:, None] - trial.soc[0], {}


def _row(trial: Trial, name: str, start: int, soc: np.ndarray, output: Mapping[str, np.ndarray]) -> dict[str, Any]:
    error = np.abs(trial.late(soc[start]) - trial.late(trial.soc))
    late = {field: trial.late(values[start]) for field, values in output.items()}
    test = consistency(late.get("innovation", np.empty(0)))
    return {
        "run": trial.name,
        "from": "start" if trial.rested else f"{trial.soc[0]:.1f}",
        "offset": trial.offsets[start],
        "estimator": name,
        "rms": float(trial.errors(soc[start])),
        "largest": float(error.max()),
        "to_5_percent_s": trial.convergence_s(soc[start]),
        "nis": test.nis,
        "nis_low": test.low,
        "nis_high": test.high,
        "verdict": test.verdict,
        "sd": rms(late["sd"]) if output else np.nan,
        "within_2_sd": float(np.mean(error < 2.0 * np.hypot(late["sd"], trial.late(trial.reference_sd))))
        if output
        else np.nan,
        "scale": float(np.median(late["scale"])) if output else np.nan,
        "capacity": float(late["capacity_scale"][-1]) if output else np.nan,
    }


def cost_per_step(case: Case, evaluation: Evaluation) -> dict[str, float]:
    """Return the seconds that a step of an estimator takes on this machine, alone and in a batch, once compiled.

    Args:
        case: as in `evaluate_estimators`; its first check run is timed.
        evaluation: the estimators.
    """
    model = _estimators_model(case)
    first = next(run for run in case.runs if run.split == "check")
    measured: Measured = trials([first], with_temperature=True)[0].measured
    part = jax.tree.map(lambda x: x[:BATCH_ROWS], measured)
    tuning = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], evaluation.tunings[FILTER])
    polynomial = evaluation.polynomials[POLYNOMIAL]
    many, alone, rested = jnp.linspace(0.5, 1.0, BATCH), jnp.asarray([1.0]), jnp.zeros(())
    found = {}
    for name, call, steps in (
        ("filter, alone", lambda: filters(model, tuning, measured, alone, rested), measured.time_s.size),
        ("sigma points, alone", lambda: filters(model, tuning, part, alone, rested, None, cubature_filter), BATCH_ROWS),
        ("filter, batch", lambda: filters(model, tuning, part, many, rested), BATCH * BATCH_ROWS),
        ("polynomial, alone", lambda: polynomials(polynomial, measured, alone), measured.time_s.size),
        ("polynomial, batch", lambda: polynomials(polynomial, part, many), BATCH * BATCH_ROWS),
    ):
        jax.block_until_ready(call())
        began = time.perf_counter()
        jax.block_until_ready(call())
        found[name] = (time.perf_counter() - began) / steps
    return found
