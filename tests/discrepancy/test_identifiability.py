"""What a case tells of its parameters, against the spread of estimates from readings made anew."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array
from scipy.stats import chi2

from discrepancy.calibrate import Fit, fit
from discrepancy.hypothesis import Hypothesis
from discrepancy.identifiability import (
    Identifiability,
    asking_for,
    calibrated,
    deeper,
    identifiability,
    names_of,
    profile_likelihood,
)
from discrepancy.lanes import predict
from discrepancy.problem import make_problem
from discrepancy.session import Session
from jaxmodel.errors import ParameterError
from tests.discrepancy.closed_form import ClosedForm, closed_form
from tests.discrepancy.made_cases import MadeCell

DRAWS = 25
WIDER = 30.0


@pytest.fixture(scope="module")
def model(plain_session: Session) -> Hypothesis:
    return plain_session.hypothesis()


@pytest.fixture(scope="module")
def found(plain_session: Session, model: Hypothesis) -> Identifiability:
    return identifiability(plain_session, model)


def test_information_of_all_runs_is_that_of_the_fit(found: Identifiability, model: Hypothesis) -> None:
    own = [i for i, run in enumerate(model.layout.runs) if run != 3]  # the check run's
    expected = model.fitted.information[np.ix_(own, own)] - np.eye(len(own))
    outer = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(found.information.total / outer, expected / outer, atol=1e-3)
    assert found.runs == ("run-01", "run-02", "run-03")
    assert len(found.information.parts) == len(found.runs) * len(found.sensors)


def test_estimates_scatter_as_the_data_alone_say(found: Identifiability, model: Hypothesis) -> None:
    """Readings made anew of one truth, fitted with priors 30 times as wide: what is left is the Cramer-Rao bound."""
    generator = np.random.default_rng(5)
    problem, centre = model.problem, model.fitted.x
    index, sd = np.asarray(problem.readings.index), np.asarray(problem.readings.sd)
    clean = predict(problem, centre).reshape(-1)[index]
    truth = centre / WIDER
    # A coordinate's number stays what it was: centre + (spread * 30) (x / 30).
    wide = eqx.tree_at(lambda p: p.unknowns.spread, problem, problem.unknowns.spread * WIDER)
    away = []
    for _ in range(DRAWS):
        anew = jnp.asarray(clean + sd * generator.standard_normal(clean.size))
        refit = fit(eqx.tree_at(lambda p: p.readings.value, wide, anew), truth)
        assert refit.converged
        away.append((refit.x - truth) * WIDER)
    own = [i for i, run in enumerate(model.layout.runs) if run != 3]
    away = np.array(away)[:, own]
    bound = found.information.sd_of_data()
    scatter = np.sum((away / bound) ** 2, axis=0)
    low, high = chi2.interval(1.0 - 1e-4 / len(own), DRAWS)
    assert np.all((low < scatter) & (scatter < high))
    whole = np.einsum("di,ij,dj->", away, found.information.total, away)  # correlations too
    low, high = chi2.interval(1.0 - 1e-4, DRAWS * len(own))
    assert low < whole < high


def test_runs_and_sensors_bring_all_there_is(found: Identifiability) -> None:
    before = found.shares_known_before().sum(axis=0)
    np.testing.assert_allclose(found.shares_by_run().sum(axis=0) + before, 1.0, rtol=1e-9)
    np.testing.assert_allclose(found.shares_by_sensor(), found.shares_by_run().sum(axis=0)[None], rtol=1e-12)
    # What a run begins with is told by the run itself alone; no bound falls when a run is left out.
    for run, name in enumerate(("initial_soc[run-01]", "initial_soc[run-02]", "initial_soc[run-03]")):
        i = found.place(name)
        assert np.argmax(found.shares_by_run()[:, i]) == run
        assert found.sd_without_run()[run, i] == pytest.approx(found.prior_sd[i], rel=1e-9)
    assert np.all(found.sd_without_run() >= found.sd * (1.0 - 1e-9))
    np.testing.assert_allclose(found.sd_without_sensor()[0], found.prior_sd)  # there is but one


def test_answer_says_yes_with_the_source(found: Identifiability) -> None:
    said = found.answer("capacity_Ah")
    i = found.place("capacity_Ah")
    assert said.startswith(f"Yes: capacity_Ah = {found.values[i]:.4g} ± {found.sd[i]:.2g} A h")
    assert "voltage_V of run-0" in said
    with pytest.raises(ParameterError, match="Did you mean 'capacity_Ah'"):
        found.answer("capacity")


def test_capacity_and_storage_are_told_only_together(plain_cell: MadeCell) -> None:
    """Eq. 8 multiplies eq. 1's capacity: no current, voltage or time can tell the two factors apart."""
    case, assumed = asking_for(plain_cell.case, ["storage_months", "R_0"])
    assert assumed == ("storage_months", "R_0")
    session = Session(case)
    problem, layout = make_problem(case, session.noise)
    size = len(layout.coordinates)
    model = Hypothesis(
        (),
        problem,
        layout,
        Fit(np.zeros(size), 1.0, 0.0, np.eye(size), np.zeros((1, size, size)), np.zeros((1, size)), 0.0, 0),
    )
    found = identifiability(session, model, assumed=assumed)
    assert np.isinf(found.sd_of_data[[found.place("capacity_Ah"), found.place("storage_months")]]).all()
    assert np.isfinite(found.sd_of_data[found.place("rc_resistance_scale")])
    words = [words for _, words in found.sloppy()]
    assert "R_0 alone" in words
    together = [told for told in words if "capacity_Ah" in told]
    assert len(together) == 1
    assert "storage_months" in together[0]
    assert found.answer("R_0") == "No: nothing that was measured depends on R_0."
    assert found.answer("capacity_Ah").startswith("No: ")  # its own sd is far less than what storage could make up for
    assert "they leave open storage_months, capacity_Ah up together" in found.answer("capacity_Ah")


def test_what_is_stated_with_an_sd_is_left_as_it_is(plain_cell: MadeCell) -> None:
    case, assumed = asking_for(plain_cell.case, ["capacity_Ah", "initial_soc"])
    assert assumed == ()
    assert case.parameters == plain_cell.case.parameters
    with pytest.raises(ParameterError, match="Did you mean 'k_tau'"):
        asking_for(plain_cell.case, ["k_tao"])


class Curved(ClosedForm):
    """Readings that are sinh(2 x) of the first unknown and straight in the second."""

    def readings_at(self, x: Array) -> Array:
        first, second = jnp.sinh(2.0 * x[:, 0]), x[:, 1]
        return jnp.stack([-first, first - 3.0 * second], axis=1)


def test_profile_is_the_quadratic_where_it_holds_and_tells_where_it_lies(
    plain_session: Session, model: Hypothesis
) -> None:
    size = len(model.layout.coordinates)
    problem = closed_form(Curved, model.problem, np.zeros(2), jnp.ones(2))
    toy = dataclasses.replace(model, problem=problem, fitted=fit(problem, np.zeros(size)))
    first, second, *_ = names_of(plain_session.case, toy)
    curved = profile_likelihood(plain_session, toy, first)
    x = np.linspace(-3.0, 3.0, 9) * toy.fitted.sd[0]
    s = np.sinh(2.0 * x)
    expected = s**2 + (s - 3.0 * (0.3 * s)) ** 2 + (0.3 * s) ** 2 + x**2  # at the best second unknown, 3 s / 10
    np.testing.assert_allclose(curved.rise, expected, rtol=1e-3, atol=1e-6)
    assert curved.lies
    straight = profile_likelihood(plain_session, toy, names_of(plain_session.case, toy)[2])
    np.testing.assert_allclose(straight.rise, straight.quadratic, atol=1e-6)
    assert not straight.lies
    assert deeper(toy, curved) is None
    # A calibration that stopped short is found out, and begun again.
    short = dataclasses.replace(toy, fitted=dataclasses.replace(toy.fitted, x=np.full(size, 0.5)))
    again = deeper(short, profile_likelihood(plain_session, short, second))
    assert again is not None
    np.testing.assert_allclose(again.fitted.x, 0.0, atol=1e-3)


def test_what_no_model_fits_is_weighed_as_noise(plain_cell: MadeCell) -> None:
    """With an absurdly fine sensor the same readings say no more than with an honest one."""
    case = dataclasses.replace(plain_cell.case, sensors={"voltage_V": 2e-5})
    session, model, misfit = calibrated(Session(case))
    assert misfit > 10.0
    found = identifiability(session, model, misfit)
    left = session.weights["voltage_V"]
    assert left.sd == pytest.approx(plain_cell.noise_rms("fit"), rel=0.05)
    assert abs(left.rho) < 0.1
    assert "misses the data by" in found.answer("capacity_Ah")
