"""The judge of the blind cases counts what it says it counts; baselines and ablations do what they are called."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.discrepancy import generate
from benchmarks.discrepancy.ablations import by_score, weighed, with_one_shape, without_projection
from benchmarks.discrepancy.baselines import Says, correlation, stepwise
from benchmarks.discrepancy.compare import Compared, rates
from benchmarks.discrepancy.evidence import Evidence, _ratios, read_evidence, stands_out
from benchmarks.discrepancy.generate import Blind, Drawn, moves
from benchmarks.discrepancy.judge import Judged, Rate, keep, metrics, power, reliability, report
from benchmarks.discrepancy.publish import filled, publish
from discrepancy.candidates import make_candidate
from discrepancy.whitening import chain_starts, whiten
from jaxmodel.declaration import describe
from jaxmodel.effects import CATALOGUE
from tests.discrepancy.made_cases import made_cell, with_candidates
from tests.independent.make_case import Run
from tests.independent.profiles import make_profile


def said(verdict: str, *names: str, probability: float = 0.97, sd: float = 0.1, **more: Any) -> dict[str, Any]:
    estimate = {"a": {"value": 1.0, "sd": sd}}
    effects = [{"name": name, "parameters": estimate, "cannot_tell_apart_from": []} for name in names]
    candidates = [
        {"name": "+".join(names) or "base", "probability": probability},
        {"name": "windage", "probability": 0.01},
    ]
    error = {"speed_rad_s": {"noise_floor": 0.5, "after": {"fit": 0.5, "check": 0.6}}}
    return {
        "verdict": verdict,
        "effects": effects,
        "candidates": candidates,
        "error": error,
        "unexplained": None,
    } | more


def case(group: str, answer: dict[str, Any], *hidden: str, outside: str = "", hostile: bool = False, a: float = 1.1):
    return Judged(1, Blind("motor", group, {name: {"a": a} for name in hidden}, outside, hostile), answer, 10.0)


CASES = [
    case("null", said("adequate")),
    case("null", said("missing_effect", "windage"), hostile=True),
    dataclasses.replace(case("single", said("missing_effect", "saturation"), "saturation"), sigma=9.0),
    case("single", said("missing_effect", "saturation"), "windage", a=1.5),
    case("single", said("unknown_effect", unexplained="a law"), "saturation"),
    dataclasses.replace(
        case("double", said("missing_effect", "gear_loss", "windage", probability=0.7), "windage", "gear_loss", a=2.0),
        sigma=4.5,
    ),
    case("sensor", said("missing_effect", "windage"), "current_offset"),
    case("outside", said("unknown_effect", unexplained="acts on the torque balance"), outside="brake_that_fades"),
    case("outside", said("unknown_effect", unexplained="acts on the duty"), outside="brake_that_fades"),
]


def test_each_rate_counts_its_own_cases():
    counts = {name: f"{r.hits} of {r.of}" for name, r in metrics(CASES).items() if isinstance(r, Rate)}
    assert counts == {
        "false alarms on clean nulls": "0 of 1",
        "false alarms on hostile nulls": "1 of 1",
        "right verdict": "6 of 9",
        "singles: right effect first": "1 of 3",
        "singles: right effect in the first three": "2 of 3",
        "singles above 4 sigma: right effect first": "1 of 1",
        "singles above 4 sigma: in the first three": "1 of 1",
        "doubles exactly right": "1 of 1",
        "doubles both above 4 sigma: exactly right": "1 of 1",
        "outside the catalogue recognised": "2 of 2",
        "outside the catalogue: in the right equation": "1 of 2",
        "confusable pairs: the right one named": "0 of 0",
        "confusable pairs: the right one not ruled out": "0 of 0",
        "confusable pairs: its rival alone named": "0 of 0",
        "all that is hidden named": "2 of 5",
        "known effects called unknown": "1 of 5",
        "physics called a sensor's fault": "0 of 4",
        "a sensor's fault called physics": "1 of 1",
        "answers above 0.95 that are right": "4 of 8",
        "parameters in their 95 % interval": "1 of 3",
    }
    assert metrics(CASES)["check error over floor, median"] == pytest.approx(1.2)


def test_of_two_effects_that_are_alike_the_right_one_may_stand_beside_its_rival():
    def alike(answer: dict[str, Any]) -> Judged:
        hidden = case("single", answer, "windage")
        return dataclasses.replace(hidden, blind=dataclasses.replace(hidden.blind, rival="viscous_friction"))

    told_apart, sure_and_wrong = said("missing_effect", "windage"), said("missing_effect", "viscous_friction")
    both_told = said("missing_effect", "viscous_friction")
    both_told["effects"][0]["cannot_tell_apart_from"] = ["windage"]
    undecided = said("undecided", candidates=[{"name": "windage", "probability": 0.3}])
    counts = metrics([alike(one) for one in (told_apart, sure_and_wrong, both_told, undecided)])
    assert counts["confusable pairs: the right one named"] == Rate(1, 4)
    assert counts["confusable pairs: the right one not ruled out"] == Rate(3, 4)
    assert counts["confusable pairs: its rival alone named"] == Rate(1, 4)


@pytest.mark.parametrize("seed", range(generate.CONFUSABLE_FROM, generate.CONFUSABLE_FROM + 6))
def test_runs_of_confusable_pairs_are_narrow(seed: int):
    drawn = generate.draw(seed)
    (hidden,) = drawn.blind.effects
    assert {hidden, drawn.blind.rival} in [set(pair) for pair in generate.CONFUSABLE[drawn.blind.kind]]
    assert len({run.profile["ambient_degC"][0] for run in drawn.runs}) == 1
    drive = next(name for name in ("current_A", "voltage_V", "duty") if name in drawn.runs[0].profile)
    driven = np.concatenate([run.profile[drive][run.profile[drive] != 0.0] for run in drawn.runs])
    assert driven.min() >= 0.79 * driven.max()


def test_seeds_draw_what_they_drew_when_their_answers_were_kept():
    """Else no kept answer could be made again; the seeds drawn are the first and the last of each file."""
    for file in ("sealed.jsonl", "harder-before.jsonl"):
        lines = (Path(__file__).parents[1] / "docs" / "proving_ground" / file).read_text().splitlines()
        for line in (lines[0], lines[-1]):
            kept = json.loads(line)
            assert generate.draw(kept["number"]).blind.effects == kept["blind"]["effects"]


def test_power_and_reliability_count_by_effect_and_by_probability():
    assert power(CASES)["saturation"] == Rate(1, 2)
    assert power(CASES)["windage"] == Rate(1, 2)
    assert reliability(CASES)["0.50 to 0.80"] == Rate(1, 1)


def test_the_misses_are_listed():
    misses = report(CASES).partition("not right\n")[2].splitlines()
    assert len(misses) == 4
    assert "0001 motor: windage | missing_effect: saturation" in misses


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


def test_a_table_is_written_over_the_one_before():
    page = "text\n<!-- power --><!-- end -->\nmore\n<!-- other -->\nkept\n<!-- end -->"
    once = filled(page, {"power": "| 1 |"})
    assert once == "text\n<!-- power -->\n\n| 1 |\n\n<!-- end -->\nmore\n<!-- other -->\nkept\n<!-- end -->"
    assert filled(once, {"power": "| 1 |"}) == once


def test_kept_cases_come_back_as_they_were(tmp_path: Path):
    first = [dataclasses.replace(case, number=number, sigma=2.0) for number, case in enumerate(CASES[:3])]
    assert keep(first, tmp_path / "sealed.jsonl") == first
    again = dataclasses.replace(first[1], said=said("adequate"))
    other = dataclasses.replace(CASES[4], number=7, sigma=0.0)
    assert keep([other, again], tmp_path / "sealed.jsonl") == [first[0], again, first[2], other]
    unscreened = dataclasses.replace(CASES[6], number=9)
    keep([unscreened], tmp_path / "sealed.jsonl")
    assert np.isnan(keep([], tmp_path / "sealed.jsonl")[-1].sigma)


def test_cases_of_one_group_are_kept_and_told_apart_from_those_of_all(tmp_path: Path):
    def made(name: str, numbered: dict[int, Judged]) -> Path:
        for number, one in numbered.items():
            path = tmp_path / name / str(number)
            path.mkdir(parents=True)
            (path / "blind.json").write_text(json.dumps(dataclasses.asdict(one.blind)))
            (path / "said.json").write_text(json.dumps(one.said | {"seconds": 10.0}))
        return tmp_path / name

    page = tmp_path / "page.md"
    (tmp_path / "page").mkdir()
    page.write_text("<!-- metrics --><!-- end -->")
    publish(made("all", {1001: CASES[0], 1002: CASES[5], 999: CASES[1]}), page)
    kept = (tmp_path / "page" / "sealed.jsonl").read_text()
    missed = dataclasses.replace(CASES[5], said=said("missing_effect", "windage"))
    publish(made("some", {1003: missed, 1004: CASES[5], 1005: CASES[0]}), page, "double")
    assert (tmp_path / "page" / "sealed.jsonl").read_text() == kept
    assert len(kept.splitlines()) == 2
    row = next(line for line in page.read_text().splitlines() if line.startswith("| doubles exactly right"))
    assert [cell.split(" (")[0].strip() for cell in row.split("|")[3:5]] == ["1 of 1", "1 of 2"]


def test_a_seed_that_empties_its_cell_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    ends = [0.2, 0.1, -0.01, 0.3]
    emptied = [{"soc": np.array([0.9, end])} for end in ends]
    monkeypatch.setattr(generate, "moves", lambda drawn: {})
    monkeypatch.setattr(generate, "write_case", lambda *arguments, **options: emptied)
    with pytest.raises(RuntimeError, match="beyond empty"):
        generate.make(tmp_path, 1)
    monkeypatch.setattr(generate, "write_case", lambda *arguments, **options: emptied[:2])
    assert generate.make(tmp_path, 1).kind in generate.KINDS


def test_a_seed_whose_effect_moves_no_reading_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(generate, "write_case", lambda *arguments, **options: [])
    monkeypatch.setattr(generate, "moves", lambda drawn: {"entropic_ocv": 0.3, "self_heating": 40.0})
    with pytest.raises(RuntimeError, match=r"^no reading is moved by entropic_ocv$"):
        generate.make(tmp_path, 1)
    assert not list(tmp_path.iterdir())
    monkeypatch.setattr(generate, "moves", lambda drawn: {"entropic_ocv": 1.5})
    assert generate.make(tmp_path, 1).moves == {"entropic_ocv": 1.5}


def test_an_effect_that_no_run_of_a_case_lets_act_moves_no_reading():
    profile = make_profile("cell", "load steps", 3, duration_s=60.0, step_s=2.0, ambient_degC=20.0, largest_drive=6.0)
    hidden = {"arrhenius_resistance": {"E_a": 2e4}, "resistance_ageing": {"c": 1e-3}}
    blind = Blind("cell", "double", hidden, "", False)
    runs = [Run(profile, initial_soc=0.9, parameters={"cycles": 300.0})]
    drawn = Drawn(blind, {}, {"storage_months": 0.0}, {"current_A": 0.01, "voltage_V": 1e-3}, runs, 1.0, {})
    found = moves(drawn)
    assert found["arrhenius_resistance"] == 0.0
    assert found["resistance_ageing"] > 10.0


def test_of_two_effects_that_are_alike_each_stands_out_less_than_alone(tmp_path):
    hidden = {"self_discharge": {"R_self": 60.0}, "current_offset": {"c": 0.07, "column": "current_A"}}
    made = made_cell(tmp_path, hidden)
    session = with_candidates(made.case, *hidden)
    screen = session.screen(session.hypothesis())
    together = {name: stands_out(session, screen, name, hidden) for name in hidden}
    alone = {name: stands_out(session, screen, name, {name: own}) for name, own in hidden.items()}
    assert all(0.5 * alone[name] < together[name] < 0.8 * alone[name] for name in hidden)
    assert stands_out(session, screen, "self_heating", {"self_heating": {"C_th": 80.0, "hA": 0.1}}) is None
