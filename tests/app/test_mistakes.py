"""What a user may get wrong: every command says it in one sentence on stderr and leaves with exit code 2."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.app.conftest import Run


def in_toml(old: str, new: str) -> Callable[[Path], None]:
    return lambda folder: replace(folder / "case.toml", old, new)


def in_csv(old: str, new: str) -> Callable[[Path], None]:
    return lambda folder: replace(folder / "run-02.csv", old, new)


def replace(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


SPOILT = {
    "no case": (lambda folder: (folder / "case.toml").unlink(), "There is no"),
    "no TOML": (in_toml('kind = "cell"', "kind = cell"), "line 2"),
    "unknown kind": (in_toml('kind = "cell"', 'kind = "battery"'), '"cell", "motor" or "robot"'),
    "unknown parameter": (in_toml("storage_months", "storage_month"), "Did you mean 'storage_months'?"),
    "parameter out of bounds": (in_toml("value = 3.0", "value = -3.0"), "capacity_Ah"),
    "unknown effect": (in_toml("[sensors]", "[effects]\nself_heat = {}\n[sensors]"), "Did you mean 'self_heating'?"),
    "effect of another kind": (in_toml("[sensors]", "[effects]\nwindage = {}\n[sensors]"), "'windage' applies to"),
    "unknown preset": (in_toml('preset = "paper"', 'preset = "papers"'), "Did you mean 'paper'?"),
    "missing run file": (in_toml("run-02.csv", "run-22.csv"), "there is no 'run-22.csv'"),
    "missing column": (in_csv("current_A", "soc"), "needs the column 'current_A'"),
    "unit misspelt": (in_csv("voltage_V", "voltage_mV"), "voltage_mV"),
    "time not increasing": (in_csv("\n20.0,", "\n5.0,"), "run-02.csv"),
    "empty CSV": (lambda folder: (folder / "run-02.csv").write_text(""), "run-02.csv"),
    "text for a number": (in_csv("\n20.0,", "\n20.0 s,"), "is not a number"),
    "NaN": (in_csv("\n20.0,6.0,", "\n20.0,nan,"), "line 4"),
    "ambient in kelvin": (in_csv(",15.0,", ",288.15,"), "kelvin"),
}


def assert_one_sentence(result, says: str) -> None:
    assert result.exit_code == 2
    assert says in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.strip()[-1] in ".?"
    assert "Traceback" not in result.output


@pytest.mark.parametrize("command", ["simulate", "compare", "diagnose"])
@pytest.mark.parametrize("what", SPOILT)
def test_spoilt_case_is_one_sentence(what: str, command: str, run: Run, case_folder: Path, tmp_path: Path) -> None:
    spoil, says = SPOILT[what]
    spoil(case_folder)
    assert_one_sentence(run(command, case_folder, "--out", tmp_path / "out"), says)


STUDY = """
kind = "cell"
[profile]
duration_s = 20
current_A = 2.0
ambient_degC = 20.0
[axes]
capacity_Ah = [2.0, 3.0]
"""
STUDIES = {
    "unknown axis": ("capacity_Ah", "capacity_ah", "Did you mean 'capacity_Ah'?"),
    "unknown input": ("current_A", "current_mA", "current_mA"),
    "no profile": ("[profile]", "[profiles]", "profile"),
    "no TOML": ("= 20\n", "= twenty\n", "TOML"),
    "axis of text": ("[2.0, 3.0]", '["2.0"]', "axes.capacity_Ah"),
    "unknown effect": ("[axes]", "[effects]\nself_heat = {}\n[axes]", "Did you mean 'self_heating'?"),
}


@pytest.mark.parametrize("command", ["sweep", "sensitivity"])
@pytest.mark.parametrize("what", STUDIES)
def test_spoilt_study_is_one_sentence(what: str, command: str, run: Run, tmp_path: Path) -> None:
    old, new, says = STUDIES[what]
    (tmp_path / "study.toml").write_text(STUDY.replace(old, new, 1), encoding="utf-8")
    assert_one_sentence(run(command, tmp_path / "study.toml", "--out", tmp_path / "out"), says)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["simulat"], "Did you mean 'simulate'"),
        (["simulate"], "Missing argument 'CASE'"),
        (["simulate", "CASE", "--fidelity", "lookup"], "use formula or lut"),
        (["simulate", "CASE", "--fidelty", "lut"], "--fidelity"),
        (["simulate", "CASE", "--effect", "nowhere.py:Ageing"], "--effect nowhere.py:Ageing"),
        (["simulate", "CASE", "--effect", "EFFECT:Absent"], "has no class 'Absent'"),
        (["simulate", "CASE", "--effect", "EFFECT:Nameless"], "has no name"),
        (["simulate", "CASE", "--effect", "EFFECT:SelfHeating"], "an effect called 'self_heating' exists already"),
        (["simulate", "CASE", "--out", "FILE"], "give a file or folder that can be used"),
        (["diagnose", "CASE", "CASE"], "Two of the cases are called 'small'"),
        (["demo", "--case", "nowhere"], "There is no"),
        (["estimate", "CASE", "--tuning", "STUDY"], "is not a tuning.json"),
        (["estimate", "CASE", "--tuning", "nowhere.json"], "cannot be read"),
        (["compensate", "--model", "CASE"], "needs a case of kind robot"),
        (["mission", "--model", "CASE"], "needs a case of kind robot"),
        (["sweep", "nowhere.toml"], "nowhere.toml"),
        (["sensitivity", "STUDY", "--at", "capacity_Ah"], "write a name and a number"),
        (["sensitivity", "STUDY", "--at", "capacity=2"], "capacity"),
    ],
)
def test_wrong_arguments_are_one_sentence(
    arguments: list[str], says: str, run: Run, made_case: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    (tmp_path / "effect.py").write_text(
        "from jaxmodel.effects.battery import SelfHeating\n"
        "from jaxmodel.model.ports import Effect\n\n\n"
        "class Nameless(Effect):\n    pass\n",
        encoding="utf-8",
    )
    places = {"CASE": made_case, "FILE": tmp_path / "file", "STUDY": tmp_path / "study.toml"}
    given = [str(places.get(a, a)).replace("EFFECT", str(tmp_path / "effect.py")) for a in arguments]
    if "--out" not in given and len(given) > 1:
        given += ["--out", str(tmp_path / "out")]
    assert_one_sentence(run(*given), says)
