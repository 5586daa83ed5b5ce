"""Pictures of pulses, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.base.errors import MeasurementError
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.plots.pulses import pulse_by_pulse
from jaxmodel.plots.style import png


def test_every_pulse_has_its_panel_with_its_residual_on_one_scale(diagnosis: Diagnosis) -> None:
    figure = diagnosis.plot.pulses("run-02")
    drawn = [axes for axes in figure.axes if axes.get_visible()]
    titles = [axes.get_title(loc="left") for axes in drawn if axes.get_title(loc="left")]
    # An input holds over the interval that ends at its row: the load of the row at 60 s comes at 50 s.
    assert titles[0] == "3 A, at 50 s"
    residuals = [axes for axes in drawn if not axes.get_title(loc="left")]
    assert len(titles) == len(residuals) == 9
    assert len({axes.get_ylim() for axes in residuals}) == 1
    assert png(figure).startswith(b"\x89PNG")


def test_of_many_pulses_the_worst_is_shown(diagnosis: Diagnosis) -> None:
    run = diagnosis.case.runs[1]
    predicted = {"voltage_V": run.measured.outputs["voltage_V"].copy()}
    predicted["voltage_V"][26:30] += 1.0
    figure = pulse_by_pulse(run, {"model": predicted}, "voltage_V", 0.001, most=3)
    titles = [axes.get_title(loc="left") for axes in figure.axes if axes.get_title(loc="left")]
    assert len(titles) == 3
    assert any("at 230 s" in title or "at 240 s" in title for title in titles)


def test_run_without_pulses_is_refused_with_what_to_do(diagnosis: Diagnosis) -> None:
    with pytest.raises(MeasurementError, match=r"no pulse or step .* plot\.run\('run-01'\)"):
        diagnosis.plot.pulses("run-01")
    with pytest.raises(MeasurementError, match="no channel 'voltage'"):
        diagnosis.plot.pulses("run-02", "voltage")
    assert np.isfinite(diagnosis.final.predictions["run-02"]["voltage_V"]).all()
