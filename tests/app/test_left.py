"""The time left follows from the parts that are left: replayed on diagnoses of which each part was timed."""

from __future__ import annotations

import pytest

from jaxmodel.app import left as of_left
from jaxmodel.app.left import Left

SHARES = {"calibrating": 0.0, "refitting": 0.35, "adding": 0.5, "comparing models": 0.85}
# Seconds at which a part of a diagnosis began, on two busy cores.
CELL = [
    (0.0, "calibrating the base model"), (8.0, "trying 8 candidates"), (11.2, "refitting with a, b"),
    (15.7, "adding self_heating"), (15.7, "calibrating with charge_transfer"),
    (17.9, "calibrating with slow_diffusion"),
    (19.8, "trying 7 candidates"), (22.1, "refitting with c, d"), (23.7, "refitting with e, f"),
    (31.1, "refitting with g, h"), (32.4, "refitting with i"), (40.8, "comparing models"), (45.5, "end"),
]  # fmt: skip
ROBOT = [
    (0.0, "calibrating the base model"), (15.9, "trying 5 candidates"), (17.1, "refitting with a, b"),
    (17.5, "adding onboard_temperature"), (17.7, "trying 9 candidates"), (18.5, "refitting with c, d"),
    (18.6, "refitting with e, f"), (18.6, "refitting with g, h"), (18.7, "refitting with i, j"),
    (18.9, "refitting with k"), (20.1, "comparing models"), (21.0, "end"),
]  # fmt: skip


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time that the work sees."""
    now = [0.0]
    monkeypatch.setattr(of_left.time, "perf_counter", lambda: now[0])
    return now


@pytest.mark.parametrize("parts", [CELL, ROBOT], ids=["cell", "robot"])
def test_of_a_search_the_time_left_is_right_within_a_factor(parts: list[tuple[float, str]], clock: list[float]) -> None:
    left, end = Left(SHARES), parts[-1][0]
    estimated = {}
    for clock[0], part in parts[:-1]:
        left.begin(part)
        estimated[part] = left.seconds(), end - clock[0]
    named = {part: pair for part, pair in estimated.items() if pair[0] is not None}
    assert list(estimated)[:2] == [part for part in estimated if part not in named]  # nothing is known before
    for part, (seconds, true) in named.items():
        assert seconds is not None
        assert seconds < 2.5 * true + 1.0, part
        assert seconds > true / 2.0 - 1.5, part
    shares = left.share
    assert shares is not None
    assert shares > 0.8


def test_a_part_that_comes_again_does_not_add_the_time_that_was_used(clock: list[float]) -> None:
    """A search of many rounds: what is left of each is what the last ones took, however long it has gone on."""
    left, last = Left(SHARES), []
    for number in range(20):
        for part in ("trying 4 candidates", "refitting with a, b", "refitting with c, d", f"adding effect {number}"):
            left.begin(part)
            clock[0] += 1.0 if part.startswith("trying") else 0.8 if part.startswith("refitting") else 0.0
        last.append(left.seconds())
    assert last[-1] == pytest.approx(last[1], rel=0.05)


def test_while_a_part_lasts_the_time_left_falls_to_what_follows_and_then_none_is_named(clock: list[float]) -> None:
    left = Left({"calibrating": 0.5, "writing": 0.9})
    clock[0] = 5.0
    left.begin("calibrating")
    at_first = left.seconds()
    clock[0] = 7.0
    later = left.seconds()
    clock[0] = 10.0
    assert (at_first, later, left.seconds()) == (pytest.approx(5.0), pytest.approx(3.0), pytest.approx(1.0))
    clock[0] = 100.0  # far longer than it should have taken: nobody knows what is left
    assert left.seconds() is None


def test_of_work_that_nobody_knows_no_time_is_named() -> None:
    left = Left({})
    left.begin("looking around")
    assert left.seconds() is None
    assert left.share is None
