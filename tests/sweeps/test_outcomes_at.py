"""Lanes at points of a model: as vector instructions, and through XLA where an operation has none."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.case.build import preset_model
from jaxmodel.lanes import NotNative
from jaxmodel.model.profile import constant
from jaxmodel.model.simulation import Cutoff, Status
from jaxmodel.sweeps import Study, points, run
from jaxmodel.sweeps.lane import Keep, Outcome, lay_out
from jaxmodel.sweeps.metrics import metrics_of
from jaxmodel.sweeps.points import outcomes_at

POINTS = {"current_A": np.array([0.5, 3.0, 9.0]), "cycles": np.array([0.0, 200.0, 100.0])}
METRICS = ("final_soc", "min_voltage_V")


def found() -> Outcome:
    model = preset_model("paper", "cell")
    stepped = lay_out(model, constant(1800.0, 60.0, ambient_degC=20.0, current_A=1.0), np.array([0]))
    keep = Keep(tuple(metrics_of("cell")[name] for name in METRICS))
    return outcomes_at(keep, model, stepped, Cutoff(soc=0.2), POINTS)  # type: ignore[arg-type]


def test_a_lane_at_a_point_is_that_of_a_sweep() -> None:
    outcome = found()
    assert list(outcome.status) == [Status.COMPLETE, Status.COMPLETE, Status.REACHED_CUTOFF]
    for number in range(3):
        study = Study(
            kind="cell",
            profile={"duration_s": 1800, "step_s": 60, "ambient_degC": 20.0},
            axes={name: [float(values[number])] for name, values in POINTS.items()},
            metrics=list(METRICS),
            cutoff={"soc": 0.2},
        )
        swept = run(study)
        for name in METRICS:
            assert swept[name].item() == outcome.values[name][number]


def test_without_vector_instructions_it_runs_through_xla(monkeypatch: pytest.MonkeyPatch) -> None:
    by_vectors = found()

    def none(*args: object, **more: object) -> None:
        raise NotNative("an operation")

    monkeypatch.setattr(points, "kernel_of_a_lane", none)
    through_xla = found()
    assert through_xla.status.tolist() == by_vectors.status.tolist()
    for name in METRICS:
        np.testing.assert_allclose(through_xla.values[name], by_vectors.values[name], rtol=1e-12)
