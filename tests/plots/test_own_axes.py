"""Pictures of one axes are drawn on the axes of a caller, who may have more in the figure."""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from matplotlib.figure import Figure

from jaxmodel import sensitivity, sweeps
from jaxmodel.diagnosis.result import Diagnosis
from jaxmodel.plots import evidence, global_indices, lanes, sensitivities, uncertainty
from jaxmodel.plots.style import new_figure

PLOTS = Path(evidence.__file__).parent


@pytest.fixture(scope="module")
def study() -> sweeps.Study:
    return sweeps.Study(
        kind="cell",
        metrics=["final_soc", "min_voltage_V"],
        profile={"duration_s": 40, "step_s": 10, "current_A": 2.0, "ambient_degC": 20.0},
        sample={"count": 8, "ranges": {"capacity_Ah": (2.0, 4.0), "current_A": (1.0, 2.0)}},
    )


def artists(axes) -> list[tuple[str, int]]:
    """What is drawn on axes, by kind."""
    return [(kind, len(getattr(axes, kind))) for kind in ("lines", "patches", "collections", "texts", "images")]


def check(draw: Callable[..., Figure]) -> None:
    """The picture on own axes has what the picture in a figure of its own has, and nothing outside of them."""
    alone = draw()
    own = new_figure(20.0, 9.0)
    left, right = own.subplots(1, 2)
    right.plot([0.0, 1.0], [0.0, 1.0], label="mine")
    assert draw(ax=left) is own
    assert artists(left) == artists(alone.axes[0])
    assert len(right.lines) == 1
    assert own.legends == []
    of_figure = [text.get_text() for legend in alone.legends for text in legend.get_texts()]
    if of_figure:
        assert [text.get_text() for text in left.get_legend().get_texts()] == of_figure
    assert right.get_legend() is None


def test_those_of_a_diagnosis(diagnosis: Diagnosis) -> None:
    check(functools.partial(evidence.scores, diagnosis))
    check(functools.partial(evidence.candidates, diagnosis))
    table = pd.DataFrame({"name": ["a", "b"], "group": ["effect", "sensor"], "log_evidence": [3.0, -1.0]})
    check(functools.partial(evidence.promises, table))


def test_those_of_a_sensitivity(study: sweeps.Study) -> None:
    check(functools.partial(sensitivities.doubling_beside_gradient, sensitivity.local(study)))
    check(
        functools.partial(uncertainty.metric_intervals, sensitivity.uncertainty(study, {"capacity_Ah": 0.1}, draws=16))
    )
    sobol = sensitivity.global_indices(study, count=32)
    for draw in (global_indices.bars, global_indices.pairs, global_indices.convergence):
        check(functools.partial(draw, sobol))
    check(functools.partial(global_indices.effects_plane, sensitivity.global_indices(study, "morris", count=8)))


def test_those_of_a_sample(study: sweeps.Study) -> None:
    dataset = sweeps.run(study)
    check(functools.partial(lanes.parallel, dataset))
    check(functools.partial(lanes.points, dataset))


def test_every_picture_of_one_axes_takes_those_of_the_caller() -> None:
    """A function that returns a Figure and makes one axes for it makes them by `one_axes`."""
    wrong = []
    for path in sorted(PLOTS.glob("*.py")):
        module = ast.parse(path.read_text(encoding="utf-8"))
        for function in (one for one in module.body if isinstance(one, ast.FunctionDef)):
            if function.name.startswith("_") or function.name == "one_axes":
                continue
            for node in ast.walk(function):
                if isinstance(node, ast.Call) and ast.unparse(node) == "figure.subplots()":
                    wrong.append(f"{path.name}: {function.name}")
    assert wrong == []
