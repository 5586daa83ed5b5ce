"""Pictures of a diagnosis."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.diagnosis.wording import final_in_short
from jaxmodel.effects.curves import MEDIUM
from jaxmodel.plots.errors import errors_by_run
from jaxmodel.plots.evidence import curves, ladder
from jaxmodel.plots.style import png
from tests.made_up import contact, factor_curve, law, ocv_curve, with_additions


def test_every_curve_is_drawn_about_its_value(diagnosis: Diagnosis) -> None:
    """An uncertain knot does not flatten the others; a factor is drawn in percent."""
    resistance = factor_curve("series_resistance_curve", np.array(MEDIUM))
    figure = curves((ocv_curve(), resistance, law()))
    drawn = [axes for axes in figure.axes if axes.get_visible()]
    assert [axes.get_ylabel() for axes in drawn] == ["correction [mV]", "correction [%]", "correction [mV]"]
    assert drawn[0].get_ylim()[1] < 20.0
    assert drawn[1].get_ylim()[1] == pytest.approx(100.0 * (np.exp(0.38) - 1.0), rel=0.15)
    assert "unknown law" in drawn[2].get_title(loc="left")
    assert png(figure).startswith(b"\x89PNG")


def test_errors_by_run_hold_each_run_once(diagnosis: Diagnosis) -> None:
    figure = errors_by_run(diagnosis.errors, ("cell_temperature_degC",))
    names = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert names == ["run-01", "run-02", "run-03 (check)"]
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == ["calibrated base model", "final model", "sensor noise", "tolerance"]
    base = errors_by_run(diagnosis.errors[diagnosis.errors["model"] == "base"], ("voltage_V",))
    assert [text.get_text() for text in base.legends[0].get_texts()] == ["calibrated base model", "sensor noise"]


def test_long_models_keep_short_names_in_pictures(diagnosis: Diagnosis) -> None:
    long = with_additions(diagnosis, curves=(ocv_curve(), law()), runs=(contact(),))
    assert final_in_short(diagnosis) == "with self_heating and arrhenius_resistance"
    assert final_in_short(long) == "final model"
    labels = [label.get_text() for label in ladder(long).axes[0].get_yticklabels()]
    assert max(label.count("\n") for label in labels) <= 2
