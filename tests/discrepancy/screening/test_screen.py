"""Screening: the differences are derivatives, the scores are standard normal without an effect, and foretell refits."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import binom, chi2

from discrepancy.calibrate import fit, look
from discrepancy.hypothesis import Hypothesis
from discrepancy.lanes import predict
from discrepancy.problem import Lane, Layout, Problem, make_problem
from discrepancy.projection import Candidate as Direction
from discrepancy.projection import project
from discrepancy.screen import Screen, Switchboard, screen
from discrepancy.session import Session
from jaxmodel.cases import Known
from jaxmodel.effects.drive import BrushDrop, ViscousFriction
from jaxmodel.model import Model
from jaxmodel.profile import Profile
from jaxmodel.simulate import simulate
from tests.discrepancy.made_cases import case_of, made_cell, run_of, with_candidates

DRAWS = 16


@pytest.fixture(scope="module")
def base(plain_session: Session) -> Hypothesis:
    return plain_session.hypothesis()


@pytest.fixture(scope="module")
def switched(plain_session: Session) -> tuple[Problem, Layout]:
    session = plain_session
    return make_problem(session.case, session.noise, [], list(session.candidates.values()), session.catalogue)


@pytest.fixture(scope="module")
def screened(plain_session: Session, base: Hypothesis) -> Screen:
    return plain_session.screen(base)


def rows_about(problem: Problem, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the sensitivities of the fit readings and their residual, prior rows appended."""
    rows, slopes = look(problem.only("fit"), x)
    counted = np.asarray(problem.only("fit").readings.fit) > 0.0
    return np.concatenate([-slopes[counted], np.eye(x.size)]), np.concatenate([rows[counted], -x])


@eqx.filter_jit
def derivatives(problem: Problem, at: Lane, ways: Lane) -> jax.Array:
    """Return the derivatives of the residuals along many ways, exact to rounding."""
    readings = problem.readings

    def residual(lane: Lane) -> jax.Array:
        predicted = problem.predictions(jax.tree.map(lambda x: x[None], lane))
        return readings.whiten(readings.value - predicted.reshape(-1)[readings.index])

    return jax.vmap(lambda way: jax.jvp(residual, (at,), (way,))[1])(ways)


def test_differences_are_the_derivatives(
    plain_session: Session, switched: tuple[Problem, Layout], base: Hypothesis, screened: Screen
) -> None:
    problem, layout = switched
    count = base.fitted.x.size
    here = np.zeros(len(layout.names))
    here[:count] = base.fitted.x
    off = np.zeros(len(plain_session.candidates))
    own = Lane(jnp.asarray(np.eye(len(here))[:count]), jnp.zeros((count, off.size)))
    counted = np.asarray(problem.readings.fit) > 0.0
    sensitivities = -np.asarray(derivatives(problem, Lane(jnp.asarray(here), jnp.asarray(off)), own))[:, counted].T
    a = np.concatenate([sensitivities, np.eye(count)])
    length = np.linalg.norm(a, axis=0)
    np.testing.assert_allclose(screened.base / length, a / length, atol=1e-5)

    directions, of_screen = {}, {}
    for place, (label, candidate) in enumerate(plain_session.candidates.items()):
        probe = candidate.probes[-1]
        at = here.copy()
        at[list(layout.of_effect[label])] = probe
        on = Lane(jnp.zeros((1, here.size)), jnp.asarray(np.eye(off.size)[place][None]))
        slope = -np.asarray(derivatives(problem, Lane(jnp.asarray(at), jnp.asarray(off)), on))[0, counted]
        directions[label] = Direction([np.concatenate([slope, np.zeros(count)])])
        of_screen[label] = screened.probes[label].index(probe)
    projection = project(a, screened.residual, directions)
    for exact in projection.blocks:
        name = exact.candidate
        found = next(
            block
            for block in screened.table.projection.blocks
            if (block.candidate, block.shape) == (name, of_screen[name])
        )
        assert found.dof == exact.dof
        if exact.dof:
            z = projection.scores(exact)[0] * np.sign(exact.triangle[0, 0])
            z_found = screened.table.projection.scores(found)[0] * np.sign(found.triangle[0, 0])
            assert z_found == pytest.approx(z, abs=1e-3), name
            assert found.projected_length(1.0) == pytest.approx(exact.projected_length(1.0), rel=1e-3), name


def test_scores_are_standard_normal_where_nothing_is_missing(
    plain_session: Session, base: Hypothesis, switched: tuple[Problem, Layout]
) -> None:
    problem, layout = switched
    readings = base.problem.readings
    generator = np.random.default_rng(0)
    count, names = base.fitted.x.size, base.layout.names
    candidates = tuple(plain_session.candidates.values())
    squares: dict[str, list[float]] = {}
    alarms = 0
    for _ in range(DRAWS):
        truth = 0.5 * generator.standard_normal(count)
        clean = predict(base.problem, truth).reshape(-1)[np.asarray(readings.index)]
        anew = jnp.asarray(clean + np.asarray(readings.sd) * generator.standard_normal(clean.size))
        measured = eqx.tree_at(lambda p: p.readings.value, base.problem, anew)
        fitted = fit(measured, truth)
        board = Switchboard(eqx.tree_at(lambda p: p.readings.value, problem, anew), layout, candidates)
        table = screen(board, {"": fitted.x}, *rows_about(measured, fitted.x), names).table
        assert np.max(np.abs(table.projection.base_z)) < 0.1
        alarms += bool(table.significant)
        for block in table.projection.blocks:
            if block.shape == 0 and block.dof == 1:
                squares.setdefault(block.candidate, []).append(table.projection.scores(block)[0] ** 2)
    tested = {name: values for name, values in squares.items() if len(values) == DRAWS}
    assert len(tested) >= 10
    low, high = chi2.interval(1.0 - 1e-3 / len(tested), DRAWS)
    for name, values in tested.items():
        assert low < np.sum(values) < high, name
    assert alarms <= binom.isf(1e-3, DRAWS, 0.05)


def test_squared_score_is_the_drop_that_a_refit_brings(tmp_path: Path) -> None:
    # As faint as this the model is linear in the effect; its prior, far wider than the data's word, costs next to
    # nothing.
    session = Session(made_cell(tmp_path / "faint", {"entropic_ocv": {"dU_dT": 3e-4}}, seed=5).case)
    base = session.hypothesis()
    scored = session.screen(base)
    effect = scored.table["entropic_ocv"]
    assert effect.z > 4.0
    refitted = session.hypothesis(["entropic_ocv"], session.starts(scored, "entropic_ocv"))
    drop = base.fitted.objective - refitted.fitted.objective
    assert drop == pytest.approx(effect.chi2, rel=0.03)
    (own,) = refitted.layout.of_effect["entropic_ocv"]
    coordinate = refitted.layout.coordinates[own]
    probe = session.candidates["entropic_ocv"].probes[0][0]
    suggested = effect.amplitude[0] * coordinate.number(probe)
    found, sd = coordinate.number(refitted.fitted.x[own]), coordinate.spread * refitted.fitted.sd[own]
    assert suggested == pytest.approx(found, abs=0.1 * sd)
    assert found == pytest.approx(3e-4, abs=4.0 * sd)


def test_what_no_reading_shows_is_not_scored(
    plain_session: Session, base: Hypothesis, switched: tuple[Problem, Layout]
) -> None:
    problem, layout = switched
    candidates = tuple(plain_session.candidates.values())
    dead = [dataclasses.replace(c, probes=((-400.0,),)) if c.label == "resistance_ageing" else c for c in candidates]
    board, names = Switchboard(problem, layout, tuple(dead)), base.layout.names
    scored = screen(board, {"": base.fitted.x}, *rows_about(base.problem, base.fitted.x), names)
    assert "resistance_ageing" not in scored.probes
    assert "resistance_ageing" not in scored.table.names
    assert set(scored.table.names) == set(plain_session.candidates) - {"resistance_ageing"}


def test_steps_of_the_base_model_are_fine_enough_to_score_beside_a_drop_at_the_brushes() -> None:
    """The model of a drop is solved in finer steps; what others would add to it is asked in those of the base model."""
    time = 0.25 * np.arange(400)
    known = {"R_0": Known(0.103, 0.003), "k_tau": Known(0.0385, 0.001), "tau_0": Known(0.01, 0.0015)}
    noise = {"current_A": 0.02, "speed_rad_s": 0.3}
    rng, runs = np.random.default_rng(3), []
    for number in range(2):
        inputs = {
            "voltage_V": np.repeat(rng.uniform(2.0, 14.0, 20), 20),
            "load_torque_Nm": np.repeat(rng.uniform(0.0, 0.15, 20), 20),
            "ambient_degC": np.full(time.size, 20.0),
        }
        hidden = (BrushDrop(V_b=jnp.asarray(0.5)), ViscousFriction(b=jnp.asarray(2e-5)))
        readings = simulate(Model("motor", effects=hidden), Profile(time, inputs)).readings
        outputs = {name: np.asarray(readings[name]) + sd * rng.normal(size=time.size) for name, sd in noise.items()}
        runs.append(run_of(number + 1, inputs, outputs, step_s=0.25))
    case = case_of("motor", known, runs, noise)
    session = with_candidates(case, "brush_drop", "viscous_friction", "stribeck_friction", "gear_loss")
    model = session.hypothesis(["brush_drop"], [{"brush_drop": np.zeros(1)}])
    board = session._board
    assert board.problem.courses.duration_s.shape == session.hypothesis().problem.courses.duration_s.shape
    assert board.problem.courses.duration_s.shape[1] < model.problem.courses.duration_s.shape[1]
    coarse = session.screen(model)
    names = [model.layout.names[number] for number in model.own]
    fine = screen(board.over(model.problem.courses), model.start, coarse.base, coarse.residual, names).table
    assert coarse.table.names[0] == fine.names[0] == "viscous_friction"
    assert coarse.table["viscous_friction"].z > 10.0
    for name in fine.names:
        assert coarse.table[name].z == pytest.approx(fine[name].z, abs=0.2, rel=0.02), name
