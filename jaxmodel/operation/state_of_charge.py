"""Estimators of the state of charge, tuned on the fit runs of a case and scored on its check runs.

Five are compared: a Kalman filter and the paper's polynomial, each with the measured temperature and with 25 degC
assumed, and coulomb counting.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Mapping
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
from jaxmodel.case.build import case_model
from jaxmodel.case.measurements import file_label, read_utf8
from jaxmodel.case.records import Case
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.evaluation import FIXED_DEGC, Trial, filters, polynomials, trials, tune_filter, tune_polynomial
from jaxmodel.operation.kalman import Measured, Tuning
from jaxmodel.operation.polynomial import PolynomialEstimator, polynomial_estimator

FILTER, FILTER_FIXED = "filter, with temperature", "filter, 25 °C assumed"
POLYNOMIAL, POLYNOMIAL_FIXED = "polynomial, with temperature", "polynomial, 25 °C assumed"
COUNTED = "coulomb counting"
ESTIMATORS = (FILTER, FILTER_FIXED, POLYNOMIAL, POLYNOMIAL_FIXED, COUNTED)
POLYNOMIAL_DEGC = (-20.0, -10.0, 0.0, 10.0, 20.0, 30.0)
BATCH, BATCH_ROWS = 4096, 200


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Evaluation(InShort):
    """Estimators of a cell's state of charge and their errors.

    Attributes:
        tunings: of the two filters, by the name of the estimator.
        polynomials: the two polynomial estimators, by name.
        errors: a line for each check run, trial, start and estimator: run; from, "start" or the state of charge where
            the trial begins; offset of the assumed start; estimator; rms and largest error after 15 minutes;
            to_5_percent_s, after which the error stays within 0.05; and of filters nis, within_2_sd (share of the rows
            within two standard deviations of the filter) and scale (of the resistances, median).
        estimates: by check run, each estimator's state of charge over time_s from a start 20 % too low, beside soc, the
            reference.
    """

    tunings: dict[str, Tuning]
    polynomials: dict[str, PolynomialEstimator]
    errors: pd.DataFrame
    estimates: dict[str, dict[str, np.ndarray]]

    def worst_errors(self, *, from_start: bool = True) -> pd.DataFrame:
        """Return the largest RMS error over the trials of each check run, a column for each estimator.

        Args:
            from_start: trials that start with the run, after a rest; False for those that start under load.
        """
        chosen = self.errors[(self.errors["from"] == "start") == from_start]
        table = chosen.pivot_table(values="rms", index="run", columns="estimator", aggfunc="max", sort=False)
        return table.reindex(index=list(dict.fromkeys(self.errors["run"])), columns=list(ESTIMATORS))

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
    model = case_model(case)
    chosen = dict(tunings or {})
    for name, with_temperature in ((FILTER, True), (FILTER_FIXED, False)):
        if name not in chosen:
            of_fit = trials(fit, with_temperature=with_temperature)
            chosen[name], _ = tune_filter(model, of_fit, count, lambda run, n=name: report(f"tuning: {n}, {run}"))
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
    for with_temperature, names in ((True, (FILTER, POLYNOMIAL, COUNTED)), (False, (FILTER_FIXED, POLYNOMIAL_FIXED))):
        for trial in trials(check, with_temperature=with_temperature):
            report(f"scoring: {'with' if with_temperature else 'without'} the temperature, {trial.name}")
            for name in names:
                soc, output = _estimate(model, trial, chosen.get(name), made.get(name))
                rows += [_row(trial, name, start, soc, output) for start in range(len(trial.offsets))]
                if trial.rested:
                    of_run = estimates.setdefault(trial.name, {"time_s": trial.time_s, "soc": trial.soc})
                    of_run[name] = soc[1][: trial.soc.size]
    return Evaluation(chosen, made, pd.DataFrame(rows), estimates)


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
            isinstance(values, dict) and values.keys() == fields and all(map(_is_finite, values.values()))
            for values in found.values()
        )
    ):
        sentence = f"{file_label(path)} is not a tuning.json of `jaxmodel estimate`; name one that it wrote."
        raise MeasurementError(sentence)
    return {name: Tuning(**values) for name, values in found.items()}


def _is_finite(value: Any) -> bool:
    return isinstance(value, int | float) and abs(value) <= sys.float_info.max


def _estimate(
    model: Model, trial: Trial, tuning: Tuning | None, polynomial: PolynomialEstimator | None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return the state of charge from each start, shape (starts, rows), and a filter's further outputs."""
    if tuning is not None:
        one = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], tuning)
        found = filters(model, one, trial.measured, trial.starts, trial.pairs_sd_V)
        output = jax.tree.map(lambda x: np.asarray(x)[0], found)
        return output.soc, {"nis": output.nis, "sd": output.sd, "scale": output.scale}
    if polynomial is not None:
        return np.asarray(polynomials(polynomial, trial.measured, trial.starts)), {}
    return trial.soc + np.array(trial.offsets)[:, None], {}


def _row(trial: Trial, name: str, start: int, soc: np.ndarray, output: Mapping[str, np.ndarray]) -> dict[str, Any]:
    error = np.abs(trial.late(soc[start]) - trial.late(trial.soc))
    return {
        "run": trial.name,
        "from": "start" if trial.rested else f"{trial.soc[0]:.1f}",
        "offset": trial.offsets[start],
        "estimator": name,
        "rms": float(trial.errors(soc[start])),
        "largest": float(error.max()),
        "to_5_percent_s": trial.convergence_s(soc[start]),
        "nis": float(np.nanmean(trial.late(output["nis"][start]))) if output else np.nan,
        "within_2_sd": float(np.mean(error < 2.0 * trial.late(output["sd"][start]))) if output else np.nan,
        "scale": float(np.median(trial.late(output["scale"][start]))) if output else np.nan,
    }


def cost_per_step(case: Case, evaluation: Evaluation) -> dict[str, float]:
    """Return the seconds that a step of an estimator takes on this machine, alone and in a batch, once compiled.

    Args:
        case: as in `evaluate_estimators`; its first check run is timed.
        evaluation: the estimators.
    """
    model = case_model(case)
    first = next(run for run in case.runs if run.split == "check")
    measured: Measured = trials([first], with_temperature=True)[0].measured
    part = jax.tree.map(lambda x: x[:BATCH_ROWS], measured)
    tuning = jax.tree.map(lambda leaf: jnp.asarray(leaf)[None], evaluation.tunings[FILTER])
    polynomial = evaluation.polynomials[POLYNOMIAL]
    many, alone, rested = jnp.linspace(0.5, 1.0, BATCH), jnp.asarray([1.0]), jnp.zeros(())
    found = {}
    for name, call, steps in (
        ("filter, alone", lambda: filters(model, tuning, measured, alone, rested), measured.time_s.size),
        ("filter, batch", lambda: filters(model, tuning, part, many, rested), BATCH * BATCH_ROWS),
        ("polynomial, alone", lambda: polynomials(polynomial, measured, alone), measured.time_s.size),
        ("polynomial, batch", lambda: polynomials(polynomial, part, many), BATCH * BATCH_ROWS),
    ):
        jax.block_until_ready(call())
        began = time.perf_counter()
        jax.block_until_ready(call())
        found[name] = (time.perf_counter() - began) / steps
    return found
