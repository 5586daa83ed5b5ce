"""The compensation map: its roots, its check in simulation, its look-up, and the C header made of it."""

from __future__ import annotations

import dataclasses
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from jaxmodel.case.build import preset_model
from jaxmodel.operation import compensation
from jaxmodel.operation.c_code import Q15, c_header, looked_up
from jaxmodel.operation.compensation import Compensation, Reference, Runs, bilinear, compensate, paper_rule_error

AMBIENT = np.array([-20.0, 20.0, 60.0])
TORQUE = np.array([0.05, 0.175, 0.3])


@pytest.fixture(scope="module")
def solved() -> Compensation:
    return compensate(preset_model("paper", "robot"), AMBIENT, TORQUE, Reference(duty=0.32))


def made_up(duty: np.ndarray, ambient: np.ndarray, torque: np.ndarray) -> Compensation:
    runs = Runs(*(np.ones_like(duty) for _ in range(2)))
    return Compensation(Reference(), -2e-4, ambient, torque, duty, runs, runs)


def test_duty_is_that_of_the_steady_equations(solved: Compensation) -> None:
    """i = 2 duty (tau + tau_0) / k_tau + I_ob, eqs. 12, 14 and 21: what holds i holds the slope."""
    p = preset_model("paper", "robot").parameters
    motors = 2.0 * 0.32 * (0.175 + p.tau_0) / p.k_tau
    by_hand = np.asarray(motors * p.k_tau / (2.0 * (TORQUE + p.tau_0)))
    there = by_hand <= 1.0
    assert there.tolist() == [True, True, True]
    np.testing.assert_allclose(solved.duty, np.broadcast_to(by_hand, solved.duty.shape), rtol=3e-4)


def test_slope_is_held_in_simulation(solved: Compensation) -> None:
    assert np.abs(solved.before.soc_gradient / solved.slope - 1.0).max() > 0.3
    np.testing.assert_allclose(solved.after.soc_gradient, solved.slope, rtol=3e-5)
    assert solved.error < 3e-5


def test_reference_needs_no_compensation(solved: Compensation) -> None:
    np.testing.assert_allclose(solved.share[1, 1], 1.0, rtol=1e-6)
    assert solved.share[1, 2] < 1.0 < solved.share[1, 0]


def test_place_that_no_duty_holds_has_none() -> None:
    """Hardly any torque draws, at full duty, less than the reference does."""
    found = compensate(preset_model("paper", "robot"), np.array([20.0, 30.0, 40.0]), np.array([0.0, 0.175, 0.3]))
    assert np.isnan(found.duty[:, 0]).all()
    assert np.isfinite(found.duty[:, 1:]).all()


def test_look_up_between_places_is_exact_for_what_is_linear_in_both() -> None:
    x, y = np.array([0.0, 1.0, 3.0]), np.array([-1.0, 2.0])
    table = 1.0 + x[:, None] + 2.0 * y + 0.5 * x[:, None] * y
    rng = np.random.default_rng(3)
    at_x, at_y = rng.uniform(0, 3, 50), rng.uniform(-1, 2, 50)
    np.testing.assert_allclose(bilinear(x, y, table, at_x, at_y), 1.0 + at_x + 2.0 * at_y + 0.5 * at_x * at_y)
    np.testing.assert_allclose(
        bilinear(x, y, table, np.array([9.0, -9.0]), np.array([9.0, -9.0])), [table[-1, -1], table[0, 0]]
    )


PROGRAM = """#include <stdio.h>
#include "map.h"
int main(void) {
    int t, m;
    while (scanf("%d %d", &t, &m) == 2) printf("%.9g\\n", (double)duty_map(t, m));
    return 0;
}
"""


@pytest.mark.parametrize("integers", [True, False])
def test_header_compiles_and_answers_as_the_map(integers: bool, tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler here")
    rng = np.random.default_rng(1)
    ambient, torque = np.arange(-20.0, 61.0, 20.0), np.round(np.arange(0.1, 0.36, 0.05), 3)
    map_ = made_up(rng.uniform(0.05, 1.0, (ambient.size, torque.size)), ambient, torque)
    (tmp_path / "map.h").write_text(c_header(map_, "a test", 0.0, integers=integers, name="duty_map"), encoding="utf-8")
    (tmp_path / "main.c").write_text(PROGRAM, encoding="utf-8")
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run([compiler, *strict, "main.c", "-o", "main"], cwd=tmp_path, check=True, timeout=60)
    t, m = rng.integers(-3000, 7000, 200), rng.integers(5000, 40000, 200)
    asked = "\n".join(f"{a} {b}" for a, b in zip(t, m, strict=True))
    out = subprocess.run([tmp_path / "main"], input=asked, capture_output=True, text=True, check=True, timeout=60)
    said = np.array(out.stdout.split(), dtype=float) / (Q15 if integers else 1.0)
    np.testing.assert_allclose(said, looked_up(map_, t / 100.0, m / 1e5, integers=integers), atol=0.51 / Q15)


def test_place_without_a_duty_stops_the_robot(tmp_path: Path) -> None:
    duty = np.array([[0.3, np.nan], [0.3, 0.2]])
    text = c_header(made_up(duty, np.array([0.0, 10.0]), np.array([0.1, 0.2])), "a test", 0.0, integers=True)
    assert "{9830, 0}," in text


def test_header_wants_even_steps() -> None:
    map_ = made_up(np.full((3, 2), 0.3), np.array([0.0, 10.0, 15.0]), np.array([0.1, 0.2]))
    with pytest.raises(ValueError, match="even steps"):
        c_header(map_, "a test", 0.0, integers=True)


def test_table_has_a_line_for_each_point(solved: Compensation) -> None:
    table = solved.to_dataframe().set_index(["ambient_degC", "load_torque_Nm"])
    assert table.loc[(20.0, 0.3), "duty"] == solved.duty[1, 2]
    assert table.loc[(60.0, 0.05), "slope_before_per_s"] == solved.before.soc_gradient[2, 0]
    assert len(table) == 9


def test_reduction_is_that_of_the_duties(solved: Compensation) -> None:
    expected = 1.0 - solved.duty[1, 2] / solved.duty[1, 1]
    assert solved.reduction((20.0, 0.175), (20.0, 0.3)) == pytest.approx(expected)
    assert solved.reduction((20.0, 0.3), (20.0, 0.175)) < 0.0


def test_rule_of_the_paper_is_exact_at_the_reference_alone() -> None:
    """At other points the printed equations hold the slope with another duty: 21 % less for 50 mN m, not 14.7 %."""
    model = preset_model("paper", "robot")
    reference = Reference()
    here = made_up(np.array([[reference.duty]]), np.array([20.0]), np.array([0.175]))
    slope = compensation.steady(model, np.array([20.0]), np.array([0.175]), np.array([0.3])).soc_gradient[0]
    there = made_up(np.array([[0.236]]), np.array([20.0]), np.array([0.225]))
    at_reference, away = (
        paper_rule_error(model, dataclasses.replace(map_, slope=float(slope))) for map_ in (here, there)
    )
    assert at_reference < 1e-12
    # The draw is duty (tau + tau_0) 2 / k_tau + I_ob: the rule leaves it too high.
    p = model.parameters
    draws = [
        2.0 * duty * (torque + p.tau_0) / p.k_tau + p.onboard_current_A
        for duty, torque in ((0.3, 0.175), (0.3 * (1 - 0.147), 0.225))
    ]
    assert away == pytest.approx(float(draws[1] / draws[0] - 1.0), rel=1e-3)
