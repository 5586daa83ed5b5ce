"""Rounding is told from the readings, and a programme of currents is none."""

from __future__ import annotations

import numpy as np
import pytest

from jaxmodel.parameterisation.noise import rounding


@pytest.mark.parametrize("step", [0.5, 0.01])
def test_rounded_readings_tell_their_step(step: float) -> None:
    values = np.linspace(20.0, 23.0, 3000) + 0.3 * np.random.default_rng(0).standard_normal(3000)
    assert rounding(step * np.round(values / step)) == pytest.approx(step)


def test_a_few_neighbouring_levels_are_rounded() -> None:
    values = 25.0 + 1.2 * np.sin(np.arange(500) / 5.0)
    assert rounding(np.round(values)) == 1.0


def test_levels_of_a_programme_are_not_rounded() -> None:
    pulses = np.tile(np.repeat([0.0, 5.0, 0.0, -2.5, 0.0, 2.5, 0.0], 30), 10)
    assert rounding(pulses) == 0.0
