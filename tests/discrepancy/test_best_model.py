"""When a best model counts as far from the sensors' noise."""

from __future__ import annotations

import numpy as np
import pytest

from discrepancy.best_model import BestModel, _far_beside_any_law, _plain_over_whitened
from discrepancy.hypothesis import Hypothesis
from discrepancy.misfit import Block
from discrepancy.noise import NoiseModel
from discrepancy.session import Session
from jaxmodel.cases import Case
from tests.discrepancy.made_cases import all_but, made_cell

RHO, NOISE_V = 0.8, 2e-4


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    """Of a cell with a hysteresis, which its base model lacks: it leaves 25 times the noise, slowly."""
    hidden = {"ocv_hysteresis": {"M_V": 0.02, "g": 60.0}}
    return made_cell(tmp_path_factory.mktemp("far"), hidden, sensors={"voltage_V": NOISE_V}).case


def calibrated(case: Case, sd: float, rho: float) -> tuple[Session, Hypothesis]:
    session = Session(case, None, all_but(case))._again(
        noise={"voltage_V": NoiseModel(sd, rho, "stated")}, weights={"voltage_V": NoiseModel(sd, rho, "stated")}
    )
    return session, session.hypothesis()


def law(leaves: float, channel: int) -> Block:
    nothing = np.zeros(3)
    return Block("voltage_V", "", "soc", 100.0, 3, 0.0, nothing, nothing, leaves={channel: leaves})


def test_white_noise_forgives_nothing_and_coloured_noise_slow_errors(case: Case):
    for rho, least, most in ((0.0, 1.0, 1.0), (RHO, 1.5, 3.0)):
        _, model = calibrated(case, NOISE_V, rho)
        channel = model.problem.channels.index("voltage_V")
        assert least <= _plain_over_whitened(model)[channel] <= most


@pytest.mark.parametrize(("rho", "far"), [(0.0, False), (RHO, True)])
def test_what_a_law_leaves_is_told_as_plain_errors(case: Case, rho: float, far: bool):
    session, model = calibrated(case, NOISE_V, rho)
    found = BestModel(session, model)
    found.__dict__["laws"] = [law(2.5, model.problem.channels.index("voltage_V"))]
    assert _far_beside_any_law(found) is far
