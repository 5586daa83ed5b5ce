"""The judge of the blind cases counts what it says it counts, and seeds draw what they drew."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.discrepancy import generate
from benchmarks.discrepancy.generate import moves
from benchmarks.discrepancy.hidden import Blind, Drawn
from benchmarks.discrepancy.judge import Judged, calibration_error, keep, metrics, power, reliability, report
from benchmarks.discrepancy.publish import filled, publish
from benchmarks.discrepancy.rates import Rate
from benchmarks.independent.make_case import Run
from benchmarks.independent.profiles import make_profile


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
        "several at once: all named, no other": "0 of 0",
        "several, each above 12 sigma: all named": "0 of 0",
        "several at once: half of them at least": "0 of 0",
        "a wrong table told, and the effects": "0 of 0",
        "a wrong table told, or the effects": "0 of 0",
        "one bad run told as that run": "0 of 0",
        "wrong stated noise: right all the same": "0 of 0",
        "numbers and sizes that no prior foretells": "0 of 0",
        "extrapolation told": "0 of 0",
        "the immaterial left alone": "0 of 0",
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


def test_calibration_error_is_the_distance_between_what_is_said_and_what_is_right():
    sure = [case("single", said("missing_effect", "windage", probability=0.9), "windage")] * 9
    wrong = case("single", said("missing_effect", "saturation", probability=0.9), "windage")
    assert calibration_error([*sure, wrong]) == pytest.approx(0.0, abs=1e-12)
    assert calibration_error([*sure, wrong, wrong]) == pytest.approx(0.9 - 9 / 11)


def test_probabilities_of_the_kept_answers_are_calibrated(tmp_path: Path):
    """The cases of the page's section on reliability."""
    cases = []
    for name in ("before.jsonl", "sealed.jsonl"):
        (tmp_path / name).write_bytes((Path(__file__).parents[1] / "docs" / "proving_ground" / name).read_bytes())
        cases += keep([], tmp_path / name)
    assert len(cases) > 400
    assert calibration_error(cases) < 0.05


def test_the_misses_are_listed():
    misses = report(CASES).partition("not right\n")[2].splitlines()
    assert len(misses) == 4
    assert "0001 motor: windage | missing_effect: saturation" in misses


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
