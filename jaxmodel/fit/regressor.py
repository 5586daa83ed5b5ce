"""A case as an estimator of scikit-learn: `fit`, `predict`, `score`, `get_params` and `set_params`.

It needs no scikit-learn: that one asks an estimator for these methods, and for its tags, which are made when it asks.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import FitError, MeasurementError, ParameterError, instead
from jaxmodel.case.known import Known
from jaxmodel.case.prediction import predict, runs_of_frame, with_runs
from jaxmodel.case.records import Case, Run
from jaxmodel.fit.asked import asking_for
from jaxmodel.fit.cache import FitCache
from jaxmodel.fit.estimates import estimates_of
from jaxmodel.fit.fitted_case import FittedNumbers, fitted_case
from jaxmodel.fit.lanes import one_thread_of_blas


class CaseRegressor:
    """A case as an estimator of scikit-learn, whose parameters are fitted to tables of measured runs.

    `fit` minimises what a calibration by `compare` does: squared errors under the weights of each channel, and squared
    distances of the parameters from their stated values in their sd. `X` is a table as `Case.predict` takes it, with a
    column `run` where it has several runs. Split it by runs (`GroupKFold` with `groups=X["run"]`): a run that is cut in
    two has no start for its second part.

    Attributes:
        case: with the parameters and their sd; of its own runs only the start that they state is used, by their names.
        parameters: names of those that are fitted; None for all that the case states with an sd. One that it states as
            exact gets an sd of 30 %. The start of a run is fitted where it is stated with an sd.
        add: effects that are added to the model, their parameters fitted.
        readings: names of the columns of `y`, if it is an array without names.
        case_: after `fit`, the fitted case: its fit runs are those of `X`, its check runs the other ones of `case`.
        estimates_: after `fit`, a row for each fitted number: name, value, sd and unit.
        readings_: after `fit`, the columns that are predicted.
        remarks_: after `fit`, sentences on readings that are doubtful or were excluded.

    Example:
        >>> import pandas as pd
        >>> from jaxmodel import CaseRegressor, read_case
        >>> case = read_case("examples/samsung_30q")
        >>> X = pd.concat(case.to_dataframes(), names=["run"]).reset_index("run").query("run != 'cc4C'")
        >>> y = X.pop("voltage_V")
        >>> model = CaseRegressor(case, parameters=["series_resistance_scale"]).fit(X, y)
        >>> model.estimates_.loc["series_resistance_scale", "unit"], model.predict(X).name
        ('', 'voltage_V')
    """

    _estimator_type = "regressor"

    def __init__(
        self,
        case: Case,
        *,
        parameters: Sequence[str] | None = None,
        add: Sequence[str] = (),
        readings: Sequence[str] | str | None = None,
    ) -> None:
        self.case = case
        self.parameters = parameters
        self.add = add
        self.readings = readings

    @one_thread_of_blas
    def fit(self, X: Any, y: Any = None) -> CaseRegressor:
        """Fit the parameters to measured runs, and return the estimator.

        Args:
            X: a row for each time, as of `Case.predict`.
            y: the readings of these rows: a Series or DataFrame with their names, or an array and `readings`. None:
                all readings among the columns of `X`.

        Raises:
            FitError: nothing is uncertain, or there are no readings.
            MeasurementError: a table cannot be used.
            ParameterError: a parameter is unknown.
            EffectError: an effect is no candidate of this case.
        """
        table, names = self._with_readings(X, y)
        found = [run for run, _ in runs_of_frame(self.case, table, {})]
        if names is None:
            read = {name for run in found for name in run.measured.outputs}
            names = [name for name in self.case.vocabulary.outputs if name in read]
        runs = tuple(_with_outputs(run, names) for run in found)
        cache = FitCache(with_runs(self._asked(runs), runs), only=self.add)
        labels = cache.space.labels_to_add(self.add)
        estimates, _ = estimates_of(cache, cache.fit(labels, "none"))
        fitted, _ = fitted_case(cache.case, FittedNumbers(estimates), labels)
        # With their inputs as they were given, and not as they were prepared for the fit.
        own = {run.name: run.measured for run in runs}
        used = [dataclasses.replace(run, measured=own[run.name]) for run in fitted.runs]
        others = [dataclasses.replace(run, split="check") for run in self.case.runs if run.name not in own]
        self.case_ = dataclasses.replace(fitted, runs=(*used, *others))
        self.estimates_ = pd.DataFrame.from_dict(
            {name: (one.value, one.sd, one.unit) for name, one in estimates.items()},
            orient="index",
            columns=["value", "sd", "unit"],
        )
        self.readings_ = tuple(names)
        self.remarks_ = cache.preparation
        self.feature_names_in_ = np.array([str(name) for name in X.columns], dtype=object)
        self.n_features_in_ = self.feature_names_in_.size
        self._is_single = y is not None and np.ndim(y) == 1
        return self

    def predict(self, X: Any) -> pd.DataFrame | pd.Series:
        """Return the predicted readings of each row of `X`, in the shape that `y` had.

        A cut-off of the case ends no run here, so that each row has a prediction.

        Raises:
            FitError: nothing has been fitted yet.
            MeasurementError: a table cannot be used.
        """
        if not hasattr(self, "case_"):
            # Where scikit-learn is in use, the error is that of its own, which is a ValueError too.
            sklearn = sys.modules.get("sklearn.exceptions")
            error = FitError if sklearn is None else sklearn.NotFittedError
            raise error("CaseRegressor: nothing has been fitted yet; call fit first.")
        found = predict(dataclasses.replace(self.case_, cutoff={}), X, {})
        found = found.loc[:, [name for name in self.readings_ if name in found]]
        return found.iloc[:, 0] if self._is_single else found

    def score(self, X: Any, y: Any = None) -> float:
        """Return R^2 = 1 - sum (y - prediction)^2 / sum (y - mean y)^2, the mean over the readings; 1 at best.

        Args:
            X: as of `predict`.
            y: as of `fit`; readings that are missing do not count.

        Raises:
            FitError: as `predict`, or a reading does not change.
            MeasurementError: a table cannot be used.
        """
        table, _ = self._with_readings(X, y)
        predicted = self.predict(X)
        shares = []
        for name in self.readings_:
            if name not in table.columns:
                raise MeasurementError(f"CaseRegressor.score: there is no column '{name}', which was fitted; add it.")
            measured = table[name].to_numpy(dtype=float)
            errors = measured - (predicted if isinstance(predicted, pd.Series) else predicted[name]).to_numpy()
            scatter = np.nansum((measured - np.nanmean(measured)) ** 2)
            if not scatter > 0.0:
                raise FitError(f"CaseRegressor.score: '{name}' never changes, so that R^2 has no meaning.")
            shares.append(1.0 - np.nansum(errors**2) / scatter)
        return float(np.mean(shares))

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Return the arguments of the constructor by name; none of them is an estimator that `deep` could open."""
        return {name: getattr(self, name) for name in _arguments()}

    def set_params(self, **params: Any) -> CaseRegressor:
        """Change arguments of the constructor, and return the estimator.

        Raises:
            ParameterError: there is no such argument.
        """
        for name, value in params.items():
            if name not in _arguments():
                raise ParameterError(f"CaseRegressor has no argument '{name}'.{instead(name, _arguments())}")
            setattr(self, name, value)
        return self

    def _asked(self, runs: tuple[Run, ...]) -> Case:
        """Return the case with an sd for the parameters that are to be fitted, and for no other one."""
        if self.parameters is None:
            return self.case
        names = [self.parameters] if isinstance(self.parameters, str) else list(self.parameters)
        of_effects = {name for name in names if "." in name}
        asked, _ = asking_for(dataclasses.replace(self.case, runs=runs), [n for n in names if n not in of_effects])
        stated = {f"{effect}.{field}" for effect, sds in self.case.effect_sd.items() for field in sds}
        for name in of_effects - stated:
            raise ParameterError(
                f"CaseRegressor: parameters names '{name}', of which the case states no sd; state it, or name an "
                f"effect under add.{instead(name, stated) if stated else ''}"
            )
        return dataclasses.replace(
            asked,
            parameters={n: k if n in names else Known(k.value) for n, k in asked.parameters.items()},
            effect_sd={
                effect: {field: sd for field, sd in sds.items() if f"{effect}.{field}" in of_effects}
                for effect, sds in asked.effect_sd.items()
            },
        )

    def _with_readings(self, X: Any, y: Any) -> tuple[pd.DataFrame, list[str] | None]:
        """Return a table with the readings of `y`, and their names; None where they are in `X`."""
        if not isinstance(X, pd.DataFrame):
            raise MeasurementError(f"CaseRegressor: X is a pandas DataFrame, and not a {type(X).__name__}.")
        if y is None:
            return X, None
        values = y.to_frame() if isinstance(y, pd.Series) else y
        if not isinstance(values, pd.DataFrame):
            values = np.asarray(y, dtype=float)
            values = pd.DataFrame(values[:, None] if values.ndim == 1 else values, columns=self._named(values))
        elif self.readings is not None:
            values = values.set_axis(self._named(values), axis=1)
        names = [str(name) for name in values.columns]
        outputs = self.case.vocabulary.outputs
        for name in names:
            if name not in outputs:
                raise MeasurementError(
                    f"CaseRegressor: the column '{name}' of y is no reading of a {self.case.kind}."
                    f"{instead(name, outputs)}"
                )
        if len(values) != len(X):
            raise MeasurementError(f"CaseRegressor: X has {len(X)} rows and y has {len(values)}; give one for each.")
        return X.assign(**{name: values[name].to_numpy() for name in names}), names

    def _named(self, values: Any) -> list[str]:
        """Return the names of readings that have none."""
        names = [self.readings] if isinstance(self.readings, str) else list(self.readings or ())
        columns = 1 if np.ndim(values) == 1 else np.shape(values)[1]
        if len(names) != columns:
            raise MeasurementError(
                f"CaseRegressor: y has {columns} column{'' if columns == 1 else 's'} and readings names {len(names)}; "
                'name each, as in readings="voltage_V", or give a DataFrame.'
            )
        return names

    def __sklearn_tags__(self) -> Any:
        """Return what scikit-learn asks for: a regressor of tables whose columns have names, and no array."""
        of = importlib.import_module("sklearn.utils")
        return of.Tags(
            estimator_type="regressor",
            target_tags=of.TargetTags(required=False, two_d_labels=True, multi_output=True),
            regressor_tags=of.RegressorTags(poor_score=True),
            input_tags=of.InputTags(two_d_array=False, string=True, allow_nan=True),
            no_validation=True,
        )

    def __sklearn_clone__(self) -> CaseRegressor:
        """Return an estimator with the same arguments: a case never changes, and its runs are not copied."""
        return type(self)(**self.get_params())

    def __repr__(self) -> str:
        said = [f"case={self.case!r}"]
        said += [f"{name}={value!r}" for name, value in self.get_params().items() if name != "case" and value]
        return f"CaseRegressor({', '.join(said)})"


def _arguments() -> list[str]:
    return list(inspect.signature(CaseRegressor).parameters)


def _with_outputs(run: Run, names: Sequence[str]) -> Run:
    """Return a run with some of its readings."""
    for name in names:
        if name in run.measured.inputs:
            raise MeasurementError(f"CaseRegressor: '{name}' is an input of the run '{run.name}'; leave it out of y.")
    outputs = {name: values for name, values in run.measured.outputs.items() if name in names}
    return dataclasses.replace(run, split="fit", measured=dataclasses.replace(run.measured, outputs=outputs))
