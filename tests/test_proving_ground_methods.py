"""Baselines and ablations of the proving ground do what they are called; they look inside the method."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.discrepancy.ablations import by_score, weighed, with_one_shape, without_projection
from benchmarks.discrepancy.baselines import Says, correlation, stepwise
from benchmarks.discrepancy.compare import Compared, rates
from benchmarks.discrepancy.evidence import Evidence, _ratios, read_evidence, stands_out
from benchmarks.discrepancy.hidden import Blind
from benchmarks.discrepancy.rates import Rate
from discrepancy.candidates import make_candidate
from discrepancy.whitening import chain_starts, whiten
from jaxmodel.declaration import describe
from jaxmodel.effects import CATALOGUE
from tests.discrepancy.made_cases import made_cell, with_candidates

ROWS = 600


def evidence(residual, base, effects: dict[str, np.ndarray], rho: float = 0.0) -> Evidence:
    """Two runs of one channel, whitened; one calibrated unknown with its prior row."""
    starts = chain_starts([range(ROWS // 2), range(ROWS // 2)])

    def rows(column, prior=0.0):
        return np.append(whiten(column, starts, rho, 1.0), prior)

    return Evidence(
        residual=rows(residual),
        base=rows(base, 1.0)[:, None],
        effects=np.stack([rows(column) for column in effects.values()], axis=1),
        names=np.array(list(effects)),
        signs=np.zeros(len(effects)),
        channel=np.zeros(ROWS, dtype=int),
        run=np.repeat([0, 1], ROWS // 2),
        weight=np.where(starts, 0.0, rho),
        conditions={"time_s": np.tile(np.arange(ROWS / 2), 2)},
    )


def hidden_behind_the_base(amplitude: float, rho: float = 0.0) -> Evidence:
    """The true effect is mostly imitated by calibration; another one looks like what calibration leaves of nothing."""
    rng = np.random.default_rng(3)
    base, own, other = rng.standard_normal((3, ROWS))
    true = 5.0 * base + own
    stranger = own + 0.5 * other
    noise = rng.standard_normal(ROWS)
    for row in range(1, ROWS):
        if row != ROWS // 2:
            noise[row] = rho * noise[row - 1] + np.sqrt(1.0 - rho**2) * noise[row]
    measured = amplitude * true + noise
    fitted = measured - base * (base @ measured) / (base @ base)
    return evidence(fitted, base, {"true": true, "stranger": stranger}, rho)


def test_projection_finds_what_correlation_does_not():
    case = hidden_behind_the_base(0.5)
    assert correlation(case).ranking[0] == "stranger"
    assert by_score(without_projection(case)).ranking[0] == "stranger"
    assert by_score(case) == Says(False, ("true", "stranger"), 1)
    assert stepwise(case, bic=True).effects == ["true"]


def test_nothing_is_found_in_white_noise():
    case = hidden_behind_the_base(0.0)
    assert correlation(case).adequate
    assert by_score(case).adequate
    assert stepwise(case, bic=True) == Says(True, (), 0)


def test_whitening_can_be_undone():
    case = hidden_behind_the_base(0.3, rho=0.8)
    plain = case.coloured()
    again = evidence(plain.residual[:-1], plain.base[:-1, 0], {"true": plain.effects[:-1, 0]}, 0.8)
    assert np.allclose(again.residual, case.residual)
    assert np.allclose(again.base, case.base)
    assert np.corrcoef(plain.residual[:-2], plain.residual[1:-1])[0, 1] > 0.5
    assert abs(np.corrcoef(case.residual[:-2], case.residual[1:-1])[0, 1]) < 0.15
    assert np.all(plain.weight == 0.0)


def test_without_whitening_coloured_noise_is_a_false_alarm():
    drift = np.sin(np.arange(ROWS / 2) / 60.0)
    alarms = {"white": 0, "coloured": 0}
    for seed in range(20):
        noise = np.random.default_rng(seed).standard_normal(ROWS)
        for row in range(1, ROWS):
            noise[row] = 0.9 * noise[row - 1] + np.sqrt(0.19) * noise[row] if row != ROWS // 2 else noise[row]
        case = evidence(noise, np.ones(ROWS), {"drift": np.tile(drift, 2), "turn": np.tile(drift[::-1], 2)}, 0.9)
        alarms["white"] += not by_score(case).adequate
        alarms["coloured"] += not by_score(case.coloured()).adequate
    assert alarms["white"] <= 4
    assert alarms["coloured"] >= 10


def test_evidence_is_read_as_it_was_written(tmp_path):
    case = hidden_behind_the_base(0.3, rho=0.5)
    case.write(tmp_path / "evidence.npz")
    found = read_evidence(tmp_path / "evidence.npz")
    assert np.array_equal(found.residual, case.residual)
    assert np.allclose(found.effects, case.effects, rtol=1e-6)
    assert found.names.tolist() == ["true", "stranger"]
    assert list(found.conditions) == ["time_s"]


def test_one_shape_is_the_middle_one():
    case = evidence(np.ones(ROWS), np.ones(ROWS), {"a": np.zeros(ROWS), "b": np.ones(ROWS), "c": np.full(ROWS, 2.0)})
    case.names[:] = ["a", "a", "a"]
    assert with_one_shape(case).effects[0].tolist() == [1.0]


@pytest.mark.parametrize("name", sorted(n for n, e in CATALOGUE.items() if not e.is_sensor))
def test_an_effect_is_as_strong_at_the_ends_of_its_range_as_the_range_says(name):
    effect = CATALOGUE[name]()
    candidate = make_candidate(effect)
    info = next(iter(describe(effect).values()))
    probe = candidate.probes[0][0]
    ratios = _ratios(candidate, probe)
    if info.null is None:
        assert np.all(ratios == 1.0)
        return
    assert np.all(np.diff(ratios) > 0.0)
    number = candidate.coordinates[0].number(probe)
    if candidate.null_at_infinity:
        assert ratios[[0, -1]] == pytest.approx(number / np.array(info.typical)[::-1])
    elif candidate.one_sided:
        ends = np.sort(np.abs(np.array(info.typical) - info.null))
        assert ratios[[0, -1]] == pytest.approx(ends / abs(number - info.null))
    else:
        assert ratios[-1] * abs(number - info.null) == pytest.approx(np.abs(np.array(info.typical) - info.null).max())


def test_hypotheses_left_out_have_no_say():
    answer = {
        "candidates": [
            {"name": "something_else", "probability": 0.6},
            {"name": "a+b", "probability": 0.3},
            {"name": "c", "probability": 0.1},
        ]
    }
    assert weighed(answer).unknown
    assert weighed(answer, without_something_else=True).effects == ["a", "b"]
    assert weighed(answer, without_something_else=True, effects=1).effects == ["c"]
    assert weighed(answer, effects=1).first == ""


def test_methods_are_held_against_the_same_truth():
    nothing, wrong = Says(True, (), 0), Says(False, ("a:speed", "b"), 2)
    cases = [
        Compared(Blind("cell", "null", {}, "", False), {"one": nothing, "two": wrong}),
        Compared(Blind("cell", "single", {"a": {}}, "", False), {"one": nothing, "two": wrong}),
        Compared(Blind("cell", "double", {"b": {}, "a": {}}, "", False), {"one": nothing, "two": wrong}),
        Compared(Blind("cell", "outside", {}, "law", False), {"one": Says(False, (), 0, unknown=True), "two": nothing}),
    ]
    found = rates(cases)
    assert found["one"]["false alarms, clean"] == Rate(0, 1)
    assert found["two"]["false alarms, clean"] == Rate(1, 1)
    assert found["two"]["singles: right first"] == Rate(1, 1)
    assert found["one"]["doubles: these two alone"] == Rate(0, 1)
    assert found["two"]["doubles: these two alone"] == Rate(1, 1)
    assert (found["one"]["outside: called unknown"], found["two"]["outside: called adequate"]) == (
        Rate(1, 1),
        Rate(1, 1),
    )
    assert found["two"]["effects named where any is"] == 2.0


def test_of_two_effects_that_are_alike_each_stands_out_less_than_alone(tmp_path):
    hidden = {"self_discharge": {"R_self": 60.0}, "current_offset": {"c": 0.07, "column": "current_A"}}
    made = made_cell(tmp_path, hidden)
    session = with_candidates(made.case, *hidden)
    screen = session.screen(session.hypothesis())
    together = {name: stands_out(session, screen, name, hidden) for name in hidden}
    alone = {name: stands_out(session, screen, name, {name: own}) for name, own in hidden.items()}
    assert all(0.5 * alone[name] < together[name] < 0.8 * alone[name] for name in hidden)
    assert stands_out(session, screen, "self_heating", {"self_heating": {"C_th": 80.0, "hA": 0.1}}) is None
