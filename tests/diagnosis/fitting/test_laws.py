"""Unknown laws, curves and numbers of single runs in the program of a case: as the same physics written by hand."""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import numpy as np
import pytest

from jaxmodel.case.build import case_model, run_profile
from jaxmodel.case.records import Case
from jaxmodel.diagnosis.fitting import by_vectors
from jaxmodel.diagnosis.fitting.fit import DIFFERENCE_STEP, errors_and_jacobian, errors_at, steps_of
from jaxmodel.diagnosis.fitting.lanes import predictions
from jaxmodel.diagnosis.fitting.model import ModelSpace, View
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
    setting = small_space.setting([])
    problem = small_space.problem_of_all(setting)
    lane = setting.lane(np.zeros(small_space.layout.size))
    assert isinstance(by_vectors.kernel_of(problem, problem.by_run[0], lane, added=()), Kernel)


def test_a_linear_law_is_the_same_physics_written_by_hand(small: Case, small_space: ModelSpace):
    label = "overpotential(current_A)"
    candidate = small_space.candidates[label]
    setting = small_space.setting([label])
    place, settings = candidate.law
    low, high = settings[-4], settings[-3]
    knots = np.linspace(low, high, len(candidate.coordinates))
    count = len(candidate.coordinates)
    own = candidate.mix[candidate.offset : candidate.offset + count, candidate.offset : candidate.offset + count]
    x = np.zeros(small_space.layout.size)
    x[list(small_space.layout.of[label])] = np.linalg.solve(own, CONSTANT + SLOPE * knots)
    found = predictions(small_space.problem(setting), [setting.lane(x)])[0]
    without = predictions(small_space.problem(setting), [setting.lane(0.0 * x)])[0]
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
    expected = small_space.predicted(small_space.setting([]), x)
    found = small_space.predicted(small_space.setting([label]), x)
    for run, by_channel in expected.items():
        for channel, values in by_channel.items():
            np.testing.assert_array_equal(found[run][channel], values)


def test_a_number_of_one_run_moves_that_run_alone(small_space: ModelSpace):
    label = "contact_resistance@run-02"
    setting = small_space.setting([label])
    x = np.zeros(small_space.layout.size)
    still = small_space.predicted(setting, x)
    x[list(small_space.layout.of[label])] = 1.0
    moved = small_space.predicted(setting, x)
    differ = [any(np.any(moved[run][name] != still[run][name]) for name in still[run]) for run in still]
    assert differ == [False, True, False]


def test_numbers_of_different_runs_share_lanes_and_have_their_own_columns(small_space: ModelSpace, small_view: View):
    setting = small_space.setting(["contact_resistance@run-01", "contact_resistance@run-02"])
    layout, problem = small_space.layout, small_space.problem(setting)
    together = steps_of(small_view, setting)
    assert len(together) < len(setting.free)
    moved = [place for places in together for place in places]
    assert len(set(moved)) == len(moved)
    # Those of the check run, which is not fitted, are not moved at all.
    assert set(setting.free) - set(moved) == {place for place in setting.free if layout.runs[place] == 2}
    assert all(len({layout.runs[place] for place in places}) == len(places) for places in together)

    x = np.zeros(layout.size)
    errors, jacobian = errors_and_jacobian(small_view, problem, setting, x)
    places = np.repeat(x[None], len(setting.free) + 1, axis=0)
    places[np.arange(1, len(places)), list(setting.free)] += DIFFERENCE_STEP
    alone = errors_at(small_view, problem, setting, places)
    np.testing.assert_array_equal(errors, alone[:, 0])
    np.testing.assert_allclose(jacobian, (alone[:, 1:] - alone[:, :1]) / DIFFERENCE_STEP, atol=1e-6)
    column = list(setting.free).index(layout.of["contact_resistance@run-01"][0])
    assert np.any(jacobian[small_view.readings.run == 0, column])
    assert not np.any(jacobian[small_view.readings.run == 1, column])


def test_laws_are_one_vector_of_which_each_has_its_part(small_space: ModelSpace):
    layout = small_space.layout
    soc, current = layout.of["overpotential(soc) x current_A"], layout.of["overpotential(current_A)"]
    assert soc == current, "laws at one port share its knots"
    names = [name for name, *_ in layout.vectors]
    assert names.count("law.values") == 1
    assert {"ocv_curve.values", "series_resistance_curve.values"} <= set(names)
    assert not set(soc) & set(range(layout.base))
