"""Elasticities at every lane of a grid are those of the study at that point alone."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.lanes import NotNative
from jaxmodel.model.electrothermal import Model
from jaxmodel.model.parameters import Parameters
from jaxmodel.model.profile import constant
from jaxmodel.sensitivity import by_vectors, over_axes
from jaxmodel.sensitivity.derivatives import local_sensitivities
from jaxmodel.sensitivity.over_axes import elasticity_map
from jaxmodel.sweeps.study import Study

METRICS = ["final_soc", "delivered_energy_Wh"]
NAMES = ("capacity_Ah", "series_resistance_scale", "current_A")


def study(**axes: list[float]) -> Study:
    profile = {"duration_s": 200.0, "step_s": 20.0, "current_A": 2.0, "ambient_degC": 20.0}
    return Study(kind="cell", metrics=METRICS, profile=profile, axes=axes)


def refuse(*given: object) -> None:
    raise NotNative("anything")


@pytest.mark.slow("XLA")
@pytest.mark.parametrize("way", ["vector instructions", "XLA"])
def test_each_lane_is_the_run_at_its_own_point(monkeypatch: pytest.MonkeyPatch, way: str):
    """Through XLA in three batches, the last one not full."""
    if way == "XLA":
        monkeypatch.setattr(by_vectors, "slopes", refuse)
        monkeypatch.setattr(over_axes, "_AT_ONCE", 5)
    reported: list[tuple[int, int]] = []
    axes = {"ambient_degC": [0.0, 30.0], "current_A": [1.0, 4.0, 6.0], "capacity_Ah": [3.0, 5.2]}
    grid = elasticity_map(study(**axes), NAMES, lambda done, total: reported.append((done, total)))
    batches = [(5, 12), (10, 12)] if way == "XLA" else []
    assert reported == [(0, 12), *batches, (12, 12)]
    assert dict(grid.sizes) == {"ambient_degC": 2, "current_A": 3, "capacity_Ah": 2, "metric": 2, "parameter": 3}
    for ambient, current, capacity in ((30.0, 6.0, 3.0), (0.0, 1.0, 5.2), (0.0, 6.0, 3.0)):
        alone = local_sensitivities(
            Model("cell", Parameters(capacity_Ah=capacity)),
            constant(200.0, 20.0, current_A=current, ambient_degC=ambient),
            NAMES,
            METRICS,
            (),
        )
        lane = grid.sel(ambient_degC=ambient, current_A=current, capacity_Ah=capacity)
        np.testing.assert_allclose(lane.metric_value, alone.metric_value, rtol=1e-12)
        np.testing.assert_allclose(lane.elasticity, alone.elasticity, rtol=1e-9, atol=1e-12)


def test_an_axis_may_pass_through_zero():
    """At rest nothing is used up, and the charge falls by the current: the derivative by it is the same everywhere."""
    grid = elasticity_map(study(current_A=[0.0, 2.0, -1.0], ambient_degC=[20.0]), ("capacity_Ah", "current_A"))
    soc = grid.sel(metric="final_soc").isel(ambient_degC=0)
    rate = soc.metric_derivative.sel(parameter="current_A")
    np.testing.assert_allclose(rate, rate[1], rtol=1e-12)
    np.testing.assert_allclose(soc.metric_value, 1.0 + rate * grid.current_A, rtol=1e-12)
    assert np.isnan(soc.elasticity.sel(current_A=0.0, parameter="current_A"))
