"""A model is evaluated on every reading of its runs, however long they are."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.held_out import prediction_sd
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.result import NamedEffect, RunError
from jaxmodel.diagnosis.rungs import evaluated_rows, with_adjusted_starts
from jaxmodel.diagnosis.wording import named_sentence
from jaxmodel.fit.estimates import Estimate
from jaxmodel.fit.settings import SETTINGS
from jaxmodel.fit.space import ModelSpace
from tests.diagnosis.made_cases import all_but
from tests.fit.preparation.made import drive


def test_what_is_thinned_for_the_fits_is_predicted_whole():
    """A long case is predicted run by run in pieces, a short one all runs together: the readings are the same."""
    measured = drive(2000)
    frame = pd.DataFrame({"time_s": measured.time_s} | measured.inputs | measured.outputs)
    case = Case.from_dataframes(
        {"drive": frame, "later": frame.head(1500)},
        kind="cell",
        check=["later"],
        parameters={"capacity_Ah": {"value": 10.0, "sd": 0.1}, "series_resistance_scale": {"value": 1.0, "sd": 0.1}},
    )
    ruled_out = all_but(case, "self_heating", "voltage_offset")
    whole = ModelSpace(case, ruled_out)
    long = ModelSpace(case, ruled_out, dataclasses.replace(SETTINGS, most_steps=600))
    assert whole.fitted is case
    assert long.fitted is not case
    x = 0.3 * np.random.default_rng(0).standard_normal(long.layout.size)
    for labels in ((), ("self_heating", "voltage_offset:voltage_V")):
        spec = long.spec(labels)
        found, expected = long.predicted(spec, x), whole.predicted(spec, x)
        for run, by_channel in expected.items():
            for channel, values in by_channel.items():
                np.testing.assert_allclose(found[run][channel], values, rtol=1e-9, atol=1e-9)


def test_errors_are_those_of_all_evaluated_readings(plain_small: Investigation):
    present, table = plain_small.present(), plain_small.errors()
    for row in table.to_dict("records"):
        run = next(one for one in plain_small.case.runs if one.name == row["run"])
        rows, channel = evaluated_rows(run, SETTINGS), row["channel"]
        error = (run.measured.outputs[channel] - present.predictions[run.name][channel])[rows]
        assert row["readings"] == np.isfinite(error).sum()
        assert row["rms"] == pytest.approx(np.sqrt(np.nanmean(error**2)), rel=1e-12)
        assert row["max"] == pytest.approx(np.nanmax(np.abs(error)))
    for channel, found in present.errors.items():
        fitted = table[(table["split"] == "fit") & (table["channel"] == channel)]
        together = np.sqrt(np.average(fitted["rms"] ** 2, weights=fitted["readings"]))
        assert found.fit == pytest.approx(together, rel=1e-12)


def test_missing_readings_do_not_count():
    assert RunError.of(np.full(3, np.nan)) is None
    error = RunError.of(np.array([np.nan, 3.0, -4.0]))
    assert error == RunError(2, np.sqrt(12.5), -0.5, 4.0)


def test_a_prediction_is_as_wide_as_the_models_that_are_not_told_apart(plain_small: Investigation):
    cache = plain_small.cache
    models = {(): 0.75, ("self_heating",): 0.25}
    base = cache.fit((), "all")
    x = with_adjusted_starts(cache, base).x
    alone = prediction_sd(cache, base, x, {(): 1.0})
    both = prediction_sd(cache, base, x, models)
    checks = [run for run in cache.case.runs if run.split == "check"]
    assert checks
    assert (
        both["cell_temperature_degC"] > 2.0 * alone["cell_temperature_degC"] or both["voltage_V"] > alone["voltage_V"]
    )
    for channel, sd in both.items():
        predicted = [
            cache.space.predicted(fit.spec, with_adjusted_starts(cache, fit).x) for fit in map(cache.fit, models)
        ]
        off = np.concatenate([(predicted[1][run.name][channel] - predicted[0][run.name][channel]) for run in checks])
        assert sd == pytest.approx(np.sqrt(alone[channel] ** 2 + 0.75 * 0.25 * np.mean(off**2)), rel=1e-3)


def test_a_number_that_is_not_told_is_not_printed():
    numbers = {"R_ca": Estimate(55.0, 1300.0, "K/W"), "tau": Estimate(900.0, 20.0, "s")}
    effect = NamedEffect("heat_path", "heat_path", "", 0.99, numbers, ())
    assert named_sentence(effect) == "heat_path, tau = 900 ± 20 s; these data do not tell R_ca."
