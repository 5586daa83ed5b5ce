"""The C program that the benchmark times does the same work as the engine; nothing is timed here."""

from __future__ import annotations

import pytest

from benchmarks.against_c import MOST_APART, differences
from benchmarks.by_hand import ByHand, NoCompiler
from benchmarks.work import Ours, study_of


@pytest.mark.parametrize("kind", ["cell", "robot"])
def test_c_program_gives_the_engines_results(kind: str):
    # Steps of a minute, lanes that fill no whole block of either.
    ours = Ours(study_of(kind, 192, step_s=60.0))
    try:
        by_hand = ByHand(ours, threads=2)
    except NoCompiler as reason:
        pytest.skip(str(reason))
    apart = differences(ours(), by_hand())
    assert {name: apart[name] for name, most in MOST_APART.items() if not apart[name] <= most} == {}
