"""A case as an estimator: what it fits, what it predicts, and how scikit-learn uses it."""

from __future__ import annotations

import re
import sys
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jaxmodel import Case, CaseRegressor, compare, read_case, simulate_case
from jaxmodel.base.errors import FitError, MeasurementError, ParameterError, UserError
from jaxmodel.fit.regressor import CaseRegressor as OfTheRoom

INPUTS = ["run", "time_s", "current_A", "ambient_degC"]


@pytest.fixture(scope="module")
def case() -> Case:
    return read_case("examples/samsung_30q")


@pytest.fixture(scope="module")
def table(case: Case) -> pd.DataFrame:
    return pd.concat(case.to_dataframes(), names=["run"]).reset_index("run").reset_index(drop=True)


@pytest.fixture(scope="module")
def fitted(case: Case, table: pd.DataFrame) -> CaseRegressor:
    rows = table[table["run"] != "cc4C"]
    return CaseRegressor(case).fit(rows[INPUTS], rows[["voltage_V", "cell_temperature_degC"]])


def test_the_fit_is_that_of_compare(case: Case, table: pd.DataFrame, fitted: CaseRegressor) -> None:
    expected = compare(case, progress=False)
    estimates = expected.final.estimates
    assert list(fitted.estimates_.index) == list(estimates)
    for name, one in estimates.items():
        assert fitted.estimates_.loc[name, "value"] == pytest.approx(one.value, rel=1e-4)
        assert fitted.estimates_.loc[name, "sd"] == pytest.approx(one.sd, rel=1e-3)
    rows = table[table["run"] == "cc4C"]
    error_V = fitted.predict(rows[INPUTS])["voltage_V"] - rows["voltage_V"]
    # A comparison leaves out the first readings of a check run, which adjust its start.
    assert np.sqrt(np.mean(error_V**2)) == pytest.approx(expected.final.errors["voltage_V"].check, rel=0.01)


def test_the_fitted_case_simulates_what_is_predicted(table: pd.DataFrame, fitted: CaseRegressor) -> None:
    """Runs of X begin as they were fitted, the other one as it is stated."""
    assert [run.split for run in fitted.case_.runs] == ["fit", "fit", "fit", "check"]
    simulated = simulate_case(fitted.case_, progress=False).to_dataframe()["voltage_V"]
    np.testing.assert_array_equal(fitted.predict(table[INPUTS])["voltage_V"], simulated)


def test_the_chosen_parameters_are_fitted_and_no_others(case: Case, table: pd.DataFrame) -> None:
    rows = table[table["run"] == "cc1C"]
    model = CaseRegressor(case, parameters=["capacity_Ah", "cycles"], add=["self_heating"])
    model.fit(rows[INPUTS], rows[["voltage_V", "cell_temperature_degC"]])
    of_effect = {"self_heating.C_th", "self_heating.hA"}
    of_start = {"initial_soc[cc1C]", "initial_temperature_rise_K[cc1C]"}
    assert set(model.estimates_.index) == {"capacity_Ah", "cycles", *of_start, *of_effect}
    assert model.case_.parameters["rc_resistance_scale"].value == 1.0
    assert set(model.case_.effects) == {"self_heating"}


def test_the_numbers_of_a_motor_are_found_and_a_run_between_is_predicted() -> None:
    """From two voltages steps and loads that another model made, with the noise of its sensors."""
    time, noise = np.arange(0.0, 20.0, 0.02), np.random.default_rng(0)
    frames = {
        name: pd.DataFrame({"time_s": time, "voltage_V": volt * (time > 1.0) * (1.0 - 0.3 * (time > 10.0))})
        for name, volt in {"low": 6.0, "between": 9.0, "high": 12.0}.items()
    }
    frames = {name: one.assign(load_torque_Nm=0.01 * (time > 5.0), ambient_degC=20.0) for name, one in frames.items()}
    truth = {"k_tau": 0.027, "R_0": 1.4, "J": 5e-5}
    made = Case.from_dataframes(frames, kind="motor", load="measured", parameters=truth)
    X = pd.concat(frames, names=["run"]).reset_index("run").reset_index(drop=True)
    y = made.predict(X)[["current_A", "speed_rad_s"]]
    y = y + noise.normal(size=y.shape) * [0.01, 0.5]
    stated = {"k_tau": (0.025, 0.005), "R_0": (1.2, 0.4), "J": (6e-5, 3e-5)}
    case = Case.from_dataframes({"low": frames["low"]}, kind="motor", load="measured", parameters=stated)
    known = X["run"] != "between"
    model = CaseRegressor(case).fit(X[known], y[known])
    for name, value in truth.items():
        found = model.estimates_.loc[name]
        assert abs(found["value"] - value) < 4.0 * found["sd"]
        assert found["sd"] < 0.01 * value
    assert model.score(X[~known], y[~known]) > 0.999


def test_the_shape_of_y_is_that_of_the_prediction(case: Case, table: pd.DataFrame) -> None:
    rows = table[table["run"] == "cc2C"]
    y = rows["voltage_V"]
    one = CaseRegressor(case).fit(rows[INPUTS], y)
    named = CaseRegressor(case, readings="voltage_V").fit(rows[INPUTS], y.to_numpy())
    inside = CaseRegressor(case).fit(rows)
    for model in (one, named):
        assert model.predict(rows[INPUTS]).shape == y.shape
    pd.testing.assert_series_equal(one.predict(rows[INPUTS]), named.predict(rows[INPUTS]))
    assert list(inside.predict(rows[INPUTS]).columns) == ["voltage_V", "cell_temperature_degC"]
    assert one.score(rows[INPUTS], y) == pytest.approx(named.score(rows[INPUTS], y.to_numpy()))


def test_the_score_is_r2_of_the_readings_that_are_there(table: pd.DataFrame, fitted: CaseRegressor) -> None:
    rows = table[table["run"] == "cc4C"].reset_index(drop=True)
    y = rows[["voltage_V", "cell_temperature_degC"]].copy()
    y.loc[::3, "voltage_V"] = np.nan
    errors = (y - fitted.predict(rows[INPUTS])).to_numpy()
    values = y.to_numpy()
    r2 = [
        1.0 - np.nansum(errors[:, k] ** 2) / np.nansum((values[:, k] - np.nanmean(values[:, k])) ** 2) for k in (0, 1)
    ]
    assert fitted.score(rows[INPUTS], y) == pytest.approx(np.mean(r2), rel=1e-12)
    assert fitted.score(rows.drop(columns=y.columns).assign(**y)) == pytest.approx(np.mean(r2), rel=1e-12)


def test_mistakes_are_one_sentence(case: Case, table: pd.DataFrame, fitted: CaseRegressor) -> None:
    rows = table[table["run"] == "cc2C"].iloc[:400]
    X, y = rows[INPUTS], rows["voltage_V"]
    mistakes: list[tuple[Any, Any, type[UserError], str]] = [
        (
            CaseRegressor(case),
            (X, y.rename("voltage")),
            MeasurementError,
            "'voltage' of y is no reading of a cell",
        ),
        (CaseRegressor(case), (X, y.to_numpy()), MeasurementError, 'name each, as in readings="voltage_V"'),
        (CaseRegressor(case), (X, y[:-1]), MeasurementError, "X has 400 rows and y has 399"),
        (CaseRegressor(case), (X.to_numpy(), y), MeasurementError, "X is a pandas DataFrame, and not a ndarray"),
        (
            CaseRegressor(case),
            (X.drop(columns="current_A"), y),
            MeasurementError,
            "run 'cc2C': a cell needs",
        ),
        (CaseRegressor(case, parameters=["capacity"]), (X, y), ParameterError, "Did you mean 'capacity_Ah'?"),
        (CaseRegressor(case, parameters=["self_heating.hA"]), (X, y), ParameterError, "or name an effect under add"),
        (CaseRegressor(case), (X, None), FitError, "no fit run has a reading"),
    ]
    for model, given, error, sentence in mistakes:
        with pytest.raises(error, match=re.escape(sentence)):
            model.fit(*given)
    with pytest.raises(ParameterError, match=r"no argument 'adds'.*Did you mean 'add'"):
        fitted.set_params(adds=())
    with pytest.raises(MeasurementError, match="no column 'cell_temperature_degC', which was fitted"):
        fitted.score(X, y)
    with pytest.raises(ValueError, match="nothing has been fitted yet"):
        CaseRegressor(case).predict(X)


def test_it_needs_no_scikit_learn() -> None:
    assert CaseRegressor is OfTheRoom
    assert "sklearn" not in vars(sys.modules["jaxmodel.fit.regressor"])


# With scikit-learn, where it is installed


def test_scikit_learn_finds_an_estimator(case: Case) -> None:
    """The checks that need no array as X; all others of scikit-learn fit arrays of made-up numbers."""
    pytest.importorskip("sklearn")
    from sklearn.base import clone, is_classifier, is_regressor
    from sklearn.utils import estimator_checks

    names = (
        "check_estimator_cloneable",
        "check_estimator_tags_renamed",
        "check_valid_tag_types",
        "check_estimator_repr",
        "check_no_attributes_set_in_init",
        "check_get_params_invariance",
        "check_set_params",
        "check_do_not_raise_errors_in_init_or_set_param",
        "check_parameters_default_constructible",
        "check_mixin_order",
        "check_estimators_unfitted",
    )
    for name in names:
        if check := getattr(estimator_checks, name, None):
            check("CaseRegressor", CaseRegressor(case))
    with pytest.warns(Warning, match="requires input"):  # it tells by its tag that X is no array
        done = estimator_checks.check_estimator(CaseRegressor(case), on_skip=None, on_fail=None)
    assert {one["status"] for one in done} == {"passed"}
    assert is_regressor(CaseRegressor(case))
    assert not is_classifier(CaseRegressor(case))
    model = CaseRegressor(case, add=("self_heating",))
    assert clone(model).get_params() == model.get_params()
    assert clone(model).case is case


def test_scikit_learn_leaves_runs_out_in_turn(case: Case, table: pd.DataFrame) -> None:
    pytest.importorskip("sklearn")
    from sklearn.model_selection import GroupKFold, cross_val_predict, cross_val_score

    X, y, groups = table[INPUTS], table["voltage_V"], table["run"]
    folds = GroupKFold(4)
    scores = cross_val_score(CaseRegressor(case), X, y, groups=groups, cv=folds)
    assert len(scores) == 4
    for (train, test), score in zip(folds.split(X, y, groups), scores, strict=True):
        model = CaseRegressor(case).fit(X.iloc[train], y.iloc[train])
        assert score == pytest.approx(model.score(X.iloc[test], y.iloc[test]), rel=1e-6)
        assert set(groups.iloc[train]).isdisjoint(groups.iloc[test])
    predicted = cross_val_predict(CaseRegressor(case), X, y, groups=groups, cv=folds)
    last = np.flatnonzero(groups == "cc4C")
    others = X.drop(index=last)
    model = CaseRegressor(case).fit(others, y.drop(index=last))
    np.testing.assert_allclose(predicted[last], model.predict(X.iloc[last]), rtol=1e-6)


def test_scikit_learn_chooses_the_effect_that_is_there(case: Case, table: pd.DataFrame) -> None:
    """The temperature of the cell rises by 14 K, which only a cell that heats itself predicts."""
    pytest.importorskip("sklearn")
    from sklearn.model_selection import GridSearchCV, GroupKFold

    readings = ["voltage_V", "cell_temperature_degC"]
    search = GridSearchCV(
        CaseRegressor(case),
        {"add": [(), ("self_heating",)]},
        cv=GroupKFold(2),
        scoring="neg_root_mean_squared_error",
    )
    search.fit(table[INPUTS], table[readings], groups=table["run"])
    assert search.best_params_ == {"add": ("self_heating",)}
    assert search.best_estimator_.predict(table[INPUTS])["cell_temperature_degC"].max() > 35.0
