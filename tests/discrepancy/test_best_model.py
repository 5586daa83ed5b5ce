"""When a best model counts as far from the sensors' noise."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from discrepancy.best_model import BestModel, _far_beside_any_law
from discrepancy.misfit import Block
from tests.discrepancy.test_explained import Bench


def law(share: float, channel: int = 0) -> Block:
    nothing = np.zeros(3)
    return Block("voltage_V", "", "soc", 100.0, 3, 0.0, nothing, nothing, leaves={channel: share})


@pytest.mark.parametrize(
    ("laws", "far"),
    [
        ([], True),
        ([law(0.4)], True),  # 4 times the noise
        ([law(0.4), law(0.2)], False),  # twice
        ([law(0.2, channel=1)], True),  # of the other channel
    ],
)
def test_what_a_law_leaves_is_told_from_the_error_itself_whatever_its_colour(laws: list[Block], far: bool):
    session = Bench({"": (99.0, 0.0)})  # ten times the noise in the first channel
    best = session.hypothesis()
    best.__dict__["problem"] = SimpleNamespace(channels=("voltage_V", "speed_rad_s"))
    found = BestModel(session, best)
    found.__dict__["laws"] = laws
    assert _far_beside_any_law(found) is far
