"""Unknown laws, curves and numbers of single runs in the program of a case: as the same physics written by hand."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.records import Case
from jaxmodel.fit import kernels
from jaxmodel.fit.gauss_newton import DIFFERENCE_STEP, errors_at, linearised
from jaxmodel.fit.lanes import predictions
from jaxmodel.fit.space import ModelSpace, View
from jaxmodel.lanes import Kernel
from jaxmodel.model.ports import Effect
from jaxmodel.model.simulation import simulate

SLOPE, CONSTANT = 0.004, 0.01


class Linear(Effect):
    """A voltage that is off in proportion to the current, as a law could say."""

    name: ClassVar[str] = "linear"
    kinds: ClassVar[tuple[str, ...]] = ("cell",)
    equation: ClassVar[str] = ""

    def overpotential(self, value, context):
        return value + CONSTANT + SLOPE * context.current_A


def test_all_candidates_have_vector_instructions(small_space: ModelSpace):
    """Else a diagnosis would go through XLA, and say nothing."""
    spec = small_space.spec([])
    problem = small_space.problem_of_all(spec)
    lane = spec.lane(np.zeros(small_space.layout.size))
    assert isinstance(kernels.kernel_of(problem, problem.by_run[0], lane), Kernel)


def test_a_linear_law_is_the_same_physics_written_by_hand(small: Case, small_space: ModelSpace):
    label = "overpotential(current_A)"
    candidate = small_space.candidates[label]
    spec = small_space.spec([label])
    place, own_settings = candidate.law
    low, high = own_settings[-4], own_settings[-3]
    knots = np.linspace(low, high, len(candidate.coordinates))
    count = len(candidate.coordinates)
    own = candidate.mix[candidate.offset : candidate.offset + count, candidate.offset : candidate.offset + count]
    x = np.zeros(small_space.layout.size)
    x[list(small_space.layout.of[label])] = np.linalg.solve(own, CONSTANT + SLOPE * knots)
    found = predictions(small_space.problem(spec), [spec.lane(x)])[0]
    without = predictions(small_space.problem(spec), [spec.lane(0.0 * x)])[0]
    assert place == 0
    for number, run in enumerate(small.runs):
        base, rows = case_model(small, run), run.measured.time_s.size
        inside = (run.measured.inputs["current_A"] >= low) & (run.measured.inputs["current_A"] <= high)
        model = eqx.tree_at(lambda m: m.effects, base, (*base.effects, Linear()))
        both = [np.asarray(simulate(one, run_profile(run)).readings["voltage_V"]) for one in (model, base)]
        moved = found[number, :rows, 0] - without[number, :rows, 0]
        # Beyond the currents of the fitted runs a law is held at its ends.
        assert inside.all() or run.split == "check"
        np.testing.assert_allclose(moved[inside], (both[0] - both[1])[inside], atol=1e-9)
        assert np.max(np.abs(moved)) > 0.02


@pytest.mark.parametrize("label", ["overpotential(soc) x current_A", "ocv_curve", "contact_resistance@run-01"])
def test_a_candidate_at_its_null_leaves_the_base_model_to_the_bit(small_space: ModelSpace, label: str):
    x = np.zeros(small_space.layout.size)
    x[: small_space.layout.base] = 0.3 * np.random.default_rng(0).standard_normal(small_space.layout.base)
    expected = small_space.predicted(small_space.spec([]), x)
    found = small_space.predicted(small_space.spec([label]), x)
    for run, by_channel in expected.items():
        for channel, values in by_channel.items():
            np.testing.assert_array_equal(found[run][channel], values)


def test_a_number_of_one_run_moves_that_run_alone(small_space: ModelSpace):
    label = "contact_resistance@run-02"
    spec = small_space.spec([label])
    x = np.zeros(small_space.layout.size)
    still = small_space.predicted(spec, x)
    x[list(small_space.layout.of[label])] = 1.0
    moved = small_space.predicted(spec, x)
    differ = [any(np.any(moved[run][name] != still[run][name]) for name in still[run]) for run in still]
    assert differ == [False, True, False]


def test_numbers_of_different_runs_share_lanes_and_have_their_own_columns(
    small_space: ModelSpace, small_view: View, monkeypatch: pytest.MonkeyPatch
):
    spec = small_space.spec(["contact_resistance@run-01", "contact_resistance@run-02"])
    layout, problem = small_space.layout, small_space.problem(spec)
    # Those of the check run, which is not fitted, are not free.
    assert {layout.runs[place] for place in spec.free} == {-1, 0, 1}
    x, lanes, at = np.zeros(layout.size), [], small_view.at
    with monkeypatch.context() as patched:
        patched.setattr(small_view, "at", lambda problem, given: lanes.append(len(given)) or at(problem, given))
        errors, jacobian = linearised(small_view, problem, spec, x)
    assert sum(lanes) < 1 + len(spec.free)
    places = np.repeat(x[None], len(spec.free) + 1, axis=0)
    places[np.arange(1, len(places)), list(spec.free)] += DIFFERENCE_STEP
    alone = errors_at(small_view, problem, spec, places)
    np.testing.assert_array_equal(errors, alone[:, 0])
    np.testing.assert_allclose(jacobian, (alone[:, :1] - alone[:, 1:]) / DIFFERENCE_STEP, atol=1e-6)
    column = spec.free.index(layout.of["contact_resistance@run-01"][0])
    assert np.any(jacobian[small_view.data.run == 0, column])
    assert not np.any(jacobian[small_view.data.run == 1, column])


def test_laws_are_one_vector_of_which_each_has_its_part(small_space: ModelSpace):
    layout = small_space.layout
    soc, current = layout.of["overpotential(soc) x current_A"], layout.of["overpotential(current_A)"]
    assert soc == current, "laws at one port share its knots"
    names = [name for name, *_ in layout.vectors]
    assert names.count("law.values") == 1
    assert {"ocv_curve.values", "series_resistance_curve.values"} <= set(names)
    assert not set(soc) & set(range(layout.base))
