"""`jaxmodel export`: the file, what it says, and mistakes."""

from __future__ import annotations

from pathlib import Path

from tests.app.conftest import Run

CASE = "examples/samsung_30q"


def test_the_file_is_written_and_what_it_does_not_carry_is_said(run: Run, tmp_path: Path) -> None:
    done = run("export", CASE, "--to", "pybamm", "--out", tmp_path / "new" / "cell.py")
    assert done.exit_code == 0, done.output
    text = (tmp_path / "new" / "cell.py").read_text(encoding="utf-8")
    compile(text, "cell.py", "exec")
    said = " ".join(done.output.split())
    assert "has the model of samsung_30q" in said
    assert "held to the ambient temperature" in said


def test_an_option_of_the_format_is_given_by_name(run: Run, tmp_path: Path) -> None:
    done = run("export", CASE, "--to", "c", "--option", "precision=float32", "--out", tmp_path / "cell.c")
    assert done.exit_code == 0, done.output
    assert "float v_ts_V;" in (tmp_path / "cell.c").read_text(encoding="utf-8")


def test_mistakes_are_one_sentence(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "cell.c"
    sentences = {
        ("--to", "matlab", "--out", out): "no format 'matlab'",
        ("--to", "c", "--out", tmp_path): "this is a folder",
        ("--to", "c", "--out", f"{CASE}/case.toml"): "this is a file of the case",
        ("--to", "c", "--out", out, "--option", "float32"): "give a name and a value",
        ("--to", "c", "--out", out, "--option", "precison=float32"): "Did you mean 'precision'?",
        ("--to", "mujoco", "--out", out): "it is of a cell",
    }
    for words, sentence in sentences.items():
        done = run("export", CASE, *words)
        assert done.exit_code == 2, done.output
        assert sentence in " ".join(done.output.split())
    assert not out.exists()
