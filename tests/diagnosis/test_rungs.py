"""A model is evaluated on every reading of its runs, however long they are."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest

from jaxmodel.case.records import Case
from jaxmodel.diagnosis.investigation import Investigation
from jaxmodel.diagnosis.result import RunError
from jaxmodel.diagnosis.rungs import evaluated_rows
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
