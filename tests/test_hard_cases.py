"""Cases nearer to a bench: seeds draw what they say, truths hold, and the judge tells right from part and wrong."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.discrepancy import bench, generate, hard
from benchmarks.discrepancy.bench import BENCH_FROM, GROUPS, draw_bench
from benchmarks.discrepancy.grades import curve_within, judge, named, parameters_within
from benchmarks.discrepancy.hidden import Blind
from benchmarks.discrepancy.judge import Judged, metrics, read_blind, report
from benchmarks.discrepancy.ranges import CONFUSABLE, EFFECTS
from benchmarks.discrepancy.rates import Rate
from benchmarks.discrepancy.tables import DRIVEN_FROM, OFF, SOC, VALUES
from jaxmodel.case.reading import read_case

SEEDS = range(BENCH_FROM, BENCH_FROM + 250)
DRAWN = {seed: draw_bench(seed) for seed in SEEDS}


def of_group(group: str) -> list:
    return [drawn for drawn in DRAWN.values() if drawn.blind.group == group]


def answer(verdict: str, *names: str, probability: float = 0.95, **more: Any) -> dict[str, Any]:
    effects = [
        {"name": name, "probability": probability, "parameters": {}, "cannot_tell_apart_from": []} for name in names
    ]
    candidates = [{"name": "+".join(names) or "base", "probability": probability}]
    return {"verdict": verdict, "effects": effects, "candidates": candidates, "error": {}} | more


def perfect(truth: dict[str, Any]) -> dict[str, Any]:
    """The answer that tells all of a truth."""
    names = [name for name in truth["effects"] if not name.startswith("x_")]
    said = answer(truth["verdict"], *names, curves=[], runs=[], extrapolated=[], remarks=[])
    for effect in said["effects"]:
        numbers = truth["effect_parameters"].get(effect["name"], {})  # of a battery simulated otherwise: none
        effect["parameters"] = {n: v if n == "column" else {"value": v, "sd": abs(v)} for n, v in numbers.items()}
    if "table" in truth:
        port = {"ocv": "open_circuit_voltage", "R_ints": "series_resistance"}[truth["table"]]
        said["curves"] = [{"port": port, "over": "soc", "at": [0, 0.5, 1], "value": [0, 0, 0], "sd": [1, 1, 1]}]
    if "run" in truth:
        said["runs"] = [{"file": truth["run"], "parameter": "series_resistance_ohm", "value": 0.01, "sd": 0.001}]
    if truth["class"] == "noise":
        said["remarks"] = ["The stated noise of voltage_V is a fifth of what the readings scatter."]
    if truth["class"] == "prior":
        said["remarks"] = [f"{truth['parameter']} is fitted 5.0 sd from what is stated."]
    if truth["class"] == "extrapolation":
        said["extrapolated"] = [{"file": "run-05.csv", "condition": "ambient_degC"}]
    return said


def shared_truths(shared: Path) -> dict[str, dict[str, Any]]:
    return {p.parent.name: tomllib.loads(p.read_text()) for p in sorted((shared / "cases").glob("*/answer.toml"))}


def test_the_truth_of_every_shared_case_is_judged_right(shared: Path):
    grades = {name: judge(truth, perfect(truth)) for name, truth in shared_truths(shared).items()}
    assert len(grades) > 30
    assert {name: found for name, found in grades.items() if found.grade != "right"} == {}


def test_saying_that_nothing_is_missing_is_right_where_nothing_is(shared: Path):
    right = {
        truth["class"] for truth in shared_truths(shared).values() if judge(truth, answer("adequate")).grade == "right"
    }
    assert right == {"null"}


TWO = {
    "class": "double",
    "verdict": "missing_effect",
    "effects": ["windage", "current_offset"],
    "effect_parameters": {"current_offset": {"c": 0.1, "column": "current_A"}},
}
ONE = {"class": "single", "verdict": "missing_effect", "effects": ["windage"]}
FAINT = ONE | {"faint": True, "also_fits": ["viscous_friction"]}
TABLE = {"class": "table", "verdict": "missing_effect", "effects": ["self_heating"], "table": "ocv"}
TABLE_ALONE = {"class": "table", "verdict": "adequate", "effects": [], "table": "R_ints"}
RUN = {"class": "run", "verdict": "adequate", "effects": [], "run": "run-03.csv"}
NOISE = {"class": "noise", "verdict": "missing_effect", "effects": ["windage"]}
PRIOR = {"class": "prior", "verdict": "adequate", "effects": [], "parameter": "capacity_Ah"}
BEYOND = {"class": "extrapolation", "verdict": "undecided", "effects": []}
SMALL = {"class": "immaterial", "verdict": "adequate", "effects": []}
OUTSIDE = {"class": "outside", "verdict": "unknown_effect", "effects": ["x_brake"]}
OCV = {"port": "open_circuit_voltage", "over": "soc"}
R_0 = {"port": "series_resistance", "over": "soc"}
ALIKE = answer("missing_effect", "viscous_friction")
ALIKE["effects"][0]["cannot_tell_apart_from"] = ["windage"]
OTHER_COLUMN = answer("missing_effect", "windage", "current_offset")
OTHER_COLUMN["effects"][1]["parameters"] = {"column": "pack_current_A"}


@pytest.mark.parametrize(
    ("truth", "said", "grade"),
    [
        (TWO, answer("missing_effect", "current_offset", "windage"), "right"),
        (TWO, OTHER_COLUMN, "part"),
        (TWO, answer("missing_effect", "windage"), "part"),
        (TWO, answer("sensor_fault", "windage", "current_offset"), "part"),
        (TWO, answer("missing_effect", "windage", "current_offset", "gear_loss"), "part"),
        (TWO, answer("unknown_effect"), "wrong"),
        (ONE, answer("missing_effect", "viscous_friction"), "wrong"),
        (ONE, ALIKE, "part"),
        (ONE, answer("undecided", candidates=[{"name": "windage", "probability": 0.4}]), "part"),
        (FAINT, answer("missing_effect", "viscous_friction"), "right"),
        (FAINT, answer("adequate"), "part"),
        (FAINT, answer("missing_effect", "gear_loss"), "wrong"),
        (TABLE, answer("missing_effect", "self_heating", curves=[OCV]), "right"),
        (TABLE, answer("missing_effect", "self_heating", curves=[R_0]), "part"),
        (TABLE, answer("adequate", curves=[OCV]), "part"),
        (TABLE, answer("unknown_effect"), "wrong"),
        (TABLE_ALONE, answer("adequate", curves=[R_0]), "right"),
        (TABLE_ALONE, answer("adequate"), "wrong"),
        (TABLE_ALONE, answer("missing_effect", "slow_diffusion"), "wrong"),
        (RUN, answer("adequate", runs=[{"file": "run-03.csv"}]), "right"),
        (RUN, answer("adequate", runs=[{"file": "run-03.csv"}, {"file": "run-01.csv"}]), "part"),
        (RUN, answer("missing_effect", "slow_diffusion", runs=[{"file": "run-03.csv"}]), "part"),
        (RUN, answer("adequate", runs=[{"file": "run-01.csv"}]), "wrong"),
        (NOISE, answer("missing_effect", "windage", remarks=["its scatter is 5 times what is stated"]), "right"),
        (NOISE, answer("missing_effect", "windage", remarks=["nothing"]), "part"),
        (NOISE, answer("unknown_effect", remarks=["noise"]), "wrong"),
        (PRIOR, answer("adequate", remarks=["capacity_Ah is 5 sd off"]), "right"),
        (PRIOR, answer("adequate"), "part"),
        (PRIOR, answer("missing_effect", "rate_capacity"), "wrong"),
        (BEYOND, answer("undecided", extrapolated=[{"file": "run-05.csv"}]), "right"),
        (BEYOND, answer("missing_effect", "arrhenius_resistance", remarks=["outside what was fitted"]), "right"),
        (BEYOND, answer("undecided"), "part"),
        (BEYOND, answer("adequate"), "wrong"),
        (SMALL, answer("adequate", immaterial=[{"name": "windage"}]), "right"),
        (SMALL, answer("missing_effect", "windage"), "wrong"),
        (OUTSIDE, answer("unknown_effect", "windage"), "right"),
        (OUTSIDE, answer("adequate", curves=[R_0]), "part"),
        (OUTSIDE, answer("missing_effect", "windage"), "wrong"),
        (ONE, {"error": "took more than 900 s", "seconds": 900.0}, "wrong"),
    ],
)
def test_grades(truth: dict[str, Any], said: dict[str, Any], grade: str):
    assert judge(truth, said).grade == grade


def test_a_name_with_little_belief_is_no_claim():
    said = answer("missing_effect", "windage")
    said["effects"] += answer("", "gear_loss", probability=0.3)["effects"]
    assert judge(ONE, said).grade == "right"
    assert list(named(said)) == ["windage", "gear_loss"]


def test_numbers_and_curves_are_held_against_the_truth():
    said = answer("missing_effect", "windage")
    said["effects"][0]["parameters"] = {"c": {"value": 1.3, "sd": 0.2}}
    assert parameters_within({"effect_parameters": {"windage": {"c": 1.0}}}, said) == (1, 1)
    assert parameters_within({"effect_parameters": {"windage": {"c": 2.0}}}, said) == (0, 1)
    at = np.linspace(0.0, 1.0, 11)
    bump = 0.02 * np.exp(-0.5 * ((at - 0.5) / 0.15) ** 2)
    true = {"soc": at.tolist(), "voltage_V": (3.6 + bump).tolist()}
    stated = {"ocv": {"soc": at.tolist(), "voltage_V": [3.6] * 11}}
    truth = {"table": "ocv", "true_tables": {"ocv": true}}

    def told(value: np.ndarray) -> dict[str, Any]:
        return {"curves": [OCV | {"at": at.tolist(), "value": value.tolist(), "sd": [0.002] * 11}]}

    assert curve_within(truth, stated, told(bump)) == (11, 11)
    assert curve_within(truth, stated, told(bump + 0.01 - 0.02 * at)) == (11, 11), "a start and a capacity have these"
    assert curve_within(truth, stated, told(0.0 * bump))[0] < 8


def test_the_table_of_shared_cases_is_printed_from_answers_that_are_kept(shared: Path, tmp_path: Path, capsys):
    folders = [shared / "cases" / name for name in ("hard-01", "hard-04", "dev-01")]
    for folder in folders:
        truth = tomllib.loads((folder / "answer.toml").read_text())
        said = perfect(truth) if folder.name != "hard-04" else answer("missing_effect", "slow_diffusion")
        (tmp_path / f"{folder.name}.json").write_text(json.dumps(said | {"seconds": 12.0}))
    hard.main(folders, out=tmp_path)
    printed = capsys.readouterr().out
    assert "2 right, 0 part, 1 wrong of 3" in printed
    assert "no correction of ocv" in printed
    assert "numbers in 2 sd: 6 of 6" in printed
    assert [row["grade"] for row in json.loads((tmp_path / "grades.json").read_text())] == ["right", "wrong", "right"]


# What seeds draw.
def test_every_group_is_drawn_about_as_often_as_it_says():
    shares = {group: len(of_group(group)) / len(DRAWN) for group in GROUPS}
    assert shares == pytest.approx(GROUPS, abs=0.08)
    assert {drawn.blind.kind for drawn in DRAWN.values()} == {"cell", "motor", "robot"}


def test_a_seed_draws_the_same_again():
    for seed in (BENCH_FROM, BENCH_FROM + 7):
        assert draw_bench(seed).blind == DRAWN[seed].blind
        assert draw_bench(seed).true == DRAWN[seed].true


def test_several_are_three_to_five_of_which_no_two_are_alike():
    several = [drawn.blind for drawn in of_group("several")]
    assert {len(blind.effects) for blind in several} == {3, 4, 5}
    faults = [sum(EFFECTS[name].is_sensor for name in blind.effects) for blind in several]
    assert set(faults) == {0, 1}
    pairs = [set(pair) for pairs in CONFUSABLE.values() for pair in pairs]
    assert not any(pair <= set(blind.effects) for blind in several for pair in pairs)
    assert {blind.verdict for blind in several} == {"missing_effect"}


def test_a_wrong_table_is_off_where_the_cell_is_driven_by_what_nothing_calibrates():
    for drawn in of_group("table"):
        name = drawn.blind.beside["table"]
        true, stated = (np.array(tables[name][VALUES[name]]) for tables in (drawn.true, drawn.stated))
        off = (stated - true if name == "ocv" else np.log(stated / true))[SOC >= DRIVEN_FROM]
        assert OFF[name][0] * 0.95 < np.abs(off).max() < OFF[name][1] * 1.05
        assert abs(off.mean()) < 0.02 * np.abs(off).max()
        others = {other for other in VALUES if other in drawn.true} - {name}
        assert all(drawn.true[other] == drawn.stated[other] for other in others)


def test_other_groups_hide_what_they_say():
    for drawn in of_group("run"):
        runs = [f"run-{n:02d}.csv" for n, run in enumerate(drawn.runs, 1) if run.hidden and run.split == "fit"]
        assert runs == [drawn.blind.beside["run"]]
        assert (drawn.blind.verdict, drawn.blind.effects) == ("adequate", {})
    for drawn in of_group("noise"):
        ((column, told),) = drawn.options["stated_sensors"].items()
        assert told / drawn.sensors[column] == pytest.approx(drawn.blind.beside["stated_over_true"][0])
    for drawn in of_group("prior"):
        if "parameter" in drawn.blind.beside:
            value, sd = drawn.stated[drawn.blind.beside["parameter"]]
            off = (drawn.true[drawn.blind.beside["parameter"]] - value) / sd
            assert off == pytest.approx(drawn.blind.beside["off_by_sd"], abs=1e-3)
            assert 4.0 <= abs(off) <= 6.0
            assert (drawn.blind.verdict, drawn.blind.told_as) == ("adequate", "prior")
        else:
            assert drawn.blind.effects
    for drawn in of_group("extrapolation"):
        ambients = {run.split: [] for run in drawn.runs}
        for run in drawn.runs:
            ambients[run.split].append(run.profile["ambient_degC"][0])
        assert max(ambients["check"]) < 0.0
        assert min(ambients["fit"]) > 15.0
        assert all(bool(run.hidden) == (run.split == "check") for run in drawn.runs)
    for drawn in of_group("immaterial"):
        assert drawn.blind.truth["effects"] == []
        assert drawn.blind.truth["immaterial"] == list(drawn.blind.effects)
        assert drawn.options["accepted"]


def test_a_cell_is_driven_neither_beyond_empty_nor_beyond_full():
    for drawn in DRAWN.values():
        for run in drawn.runs if drawn.blind.kind == "cell" else ():
            taken = np.cumsum(run.profile["current_A"][1:] * np.diff(run.profile["time_s"]))
            soc = run.initial_soc - taken / (3600.0 * drawn.true["capacity_Ah"])
            off_by_sd = drawn.blind.beside.get("parameter") == "capacity_Ah"
            assert soc.min() > (0.0 if off_by_sd else 0.2), drawn.blind
            assert soc.max() < (1.1 if off_by_sd else 1.01)


# What is made of them.
@pytest.fixture(scope="module")
def bad_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Blind]:
    """A short cell of which one run has a contact of its own."""
    seed = next(s for s, d in DRAWN.items() if d.blind.group == "run" and d.blind.kind == "cell")
    folder = tmp_path_factory.mktemp("bad") / f"{seed}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "ROWS", 200)
        return folder, generate.make(folder, seed)


def test_a_case_that_is_made_tells_its_truth(bad_run: tuple[Path, Blind]):
    folder, blind = bad_run
    truth, case = tomllib.loads((folder / "answer.toml").read_text()), read_case(folder)
    assert (truth["class"], truth["verdict"], truth["effects"]) == ("run", "adequate", [])
    assert truth["run"] in [run.file for run in case.runs if run.split == "fit"]
    assert truth["true_of_runs"][truth["run"].removesuffix(".csv")] == {"contact_ohm": blind.beside["of_the_run"]}
    assert truth["snr_without"]["run"] == pytest.approx(blind.stands_out["run"], rel=1e-3)
    assert blind.stands_out["run"] > 4.0
    assert truth["before_fit"]["voltage_V"] > 1.02 * truth["reachable_fit"]["voltage_V"]
    assert truth["reachable_check"]["voltage_V"] == pytest.approx(truth["noise_sd"]["voltage_V"], rel=0.6)


def test_it_is_judged_like_a_shared_case(bad_run: tuple[Path, Blind]):
    folder, blind = bad_run
    (folder / "blind.json").write_text(json.dumps(dataclasses.asdict(blind)))
    assert read_blind(folder) == blind
    row = hard.read_row(folder, perfect(tomllib.loads((folder / "answer.toml").read_text())))
    assert row.judgement.grade == "right"
    told = Judged(BENCH_FROM, blind, perfect(blind.truth), 10.0)
    missed = Judged(BENCH_FROM + 1, blind, answer("missing_effect", "slow_diffusion"), 10.0)
    assert metrics([told, missed])["one bad run told as that run"] == Rate(1, 2)
    assert f"{BENCH_FROM + 1} cell: run: " in report([told, missed])


@pytest.mark.parametrize("group", GROUPS)
def test_the_truth_of_every_group_is_judged_right(group: str):
    for drawn in of_group(group):
        assert Judged(0, drawn.blind, perfect(drawn.blind.truth), 1.0).right, drawn.blind
