"""Files that are no logs: each gets one clear sentence and exit code 2, never a traceback."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.app.conftest import Run

HEADER = "time_s,current_A,voltage_V\n"
ROWS = "".join(f"{10 * n},{n > 4:d},{4.1 - 0.05 * (n > 4) - 0.001 * n:.3f}\n" for n in range(40))

NO_LOGS: dict[str, tuple[bytes, str]] = {
    "empty.csv": (b"", "is empty"),
    "blank.csv": (b"\n \n\n", "is empty"),
    "empty.xlsx": (b"", "cannot be read as a spreadsheet"),
    "empty.parquet": (b"", "cannot be read"),
    "empty.mat": (b"", "cannot be read as a MATLAB file"),
    "binary.csv": (np.random.default_rng(0).bytes(4000), "is not text"),
    "picture.csv": (b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" * 50, "is not text"),
    "text.ods": (b"a spreadsheet in name only\n", "no rows of numbers"),
    "header.csv": (HEADER.encode(), "names of columns and no rows"),
    "units.csv": ((HEADER + "s,A,V\n").encode(), "names of columns and no rows"),
    "one_column.csv": (b"voltage_V\n" + b"4.0\n3.9\n" * 20, "one column of numbers"),
    "one_row.csv": ((HEADER + "0,0,4.1\n").encode(), "fewer than two rows"),
    "two_rows.csv": ((HEADER + "0,0,4.1\n10,1,4.0\n").encode(), "--sign"),
    "letter.txt": (
        "Sehr geehrte Frau Müller,\ndas Gerät ist defekt\nund kommt zurück.\n".encode("latin-1"),
        "no rows of numbers",
    ),
    "no_current.csv": (b"time_s,voltage_V\n" + b"".join(b"%d,4.0\n" % n for n in range(30)), "current_A"),
    "missing.csv": (b"", "There is no file"),
}


def assert_one_sentence(result, says: str) -> None:
    assert result.exit_code == 2, result.output
    assert says in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert result.stderr.strip().endswith(".")


@pytest.mark.parametrize("name", NO_LOGS)
def test_what_is_no_log_is_one_sentence(run: Run, tmp_path: Path, name: str):
    content, says = NO_LOGS[name]
    path = tmp_path / name
    if name != "missing.csv":
        path.write_bytes(content)
    result = run("import", path, "--kind", "cell", "--ambient", "25", "--out", tmp_path / "case")
    assert_one_sentence(result, says)
    assert not (tmp_path / "case" / "case.toml").exists()


def test_a_folder_without_logs_is_one_sentence(run: Run, tmp_path: Path):
    folder = tmp_path / "logs.csv"
    folder.mkdir()
    (folder / "README.md").write_text("no log")
    options = ("--kind", "cell", "--ambient", "25", "--out", tmp_path / "case")
    assert_one_sentence(run("import", folder, *options), "is a folder without logs")


def imported(run: Run, path: Path) -> str:
    options = ("--kind", "cell", "--ambient", "25", "--answer-only", "--out", path.parent / "case")
    result = run("import", path, *options)
    assert result.exit_code == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("name", ["voltage_V", "current_A"])
def test_a_name_that_occurs_twice_is_told(run: Run, tmp_path: Path, name: str):
    path = tmp_path / "twice.csv"
    path.write_text(HEADER.strip() + f",{name}\n" + ROWS.replace("\n", ",3.3\n"))
    said = imported(run, path)
    assert f"several columns are called '{name}'; the first is taken" in said
    assert f'--column {name}="{name} 2"' in said


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-8-sig", "gb18030"])
def test_any_encoding_is_read(run: Run, tmp_path: Path, encoding: str):
    path = tmp_path / "log.csv"
    words = "测试时间(秒),电流(A),电压(V)" if encoding == "gb18030" else "Zeit für Prüfung [s],Strom [A],Spannung [V]"
    path.write_bytes((words + "\n" + ROWS).encode(encoding))
    assert "1 CSV files" in imported(run, path)


def several(folder: Path) -> list[Path]:
    paths = [folder / f"{name}.csv" for name in ("cell_1", "cell_2", "cell_3")]
    for path in paths:
        path.write_text(HEADER + ROWS)
    return paths


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--specimen", "A=cell_1*", "--specimen", "A=cell_2*"), "--specimen: A is given twice"),
        (("--specimen", "cell_1*"), "give NAME=PATTERN"),
        (("--specimen", "A=cell_1*", "--specimen", "B=cells*"), "no file is called 'cells*'"),
        (("--specimen", "A=*"), "nothing to compare it with"),
        (
            ("--specimen", "A=cell_[12]", "--specimen", "B=cell_3", "--check", "cell_3"),
            "every run of B would be held out",
        ),
        (("--check", "cell_1,cell_2"), "as --check cell_1 --check cell_2"),
        (("--check", "cell_[0-9]"), "every run would be held out"),
        (("--unit", "current_A"), "give COLUMN=UNIT"),
        (("--column", "current_A=a", "--column", "current_A=b"), "--column: current_A is given twice"),
        (("--drive", "current"), "that of a cell is not modelled"),
        (("--controller", "position:k_p=1,k_p=2"), "k_p is given twice"),
        (("--controller", "position:10"), "give position:NAME=VALUE,NAME=VALUE"),
        (("--load", ":mass_kg=1"), "there is no ''"),
    ],
)
def test_options_that_cannot_be_are_one_sentence(run: Run, tmp_path: Path, options: tuple[str, ...], says: str):
    given = ("--kind", "cell", "--ambient", "25", "--sign", "discharge-positive", "--out", tmp_path / "case")
    assert_one_sentence(run("import", *several(tmp_path), *given, *options), says)
    assert not (tmp_path / "case" / "case.toml").exists()


def test_start_names_the_option_that_a_case_does_not_take(run: Run, tmp_path: Path):
    (tmp_path / "case.toml").write_text('kind = "motor"')
    result = run("start", tmp_path, "--motor", "left", "--out", tmp_path / "out")
    assert_one_sentence(result, "--motor: ")


def test_what_is_so_in_several_files_is_said_once(run: Run, tmp_path: Path):
    paths = several(tmp_path)
    for path in paths:
        path.write_text(
            path.read_text().replace("V\n", "V,temperature_degC\n", 1).replace("\n", ",25\n").replace(",25", "", 1)
        )
    given = ("--kind", "cell", "--ambient", "25", "--answer-only", "--out", tmp_path / "case")
    said = run("import", *paths, *given).stdout
    assert said.count("the thermometer never moves") == 1
    assert "look at: cell_1, cell_2, cell_3: cell_temperature_degC is 25 in all 40 readings" in said


def test_what_differs_in_its_numbers_alone_is_said_once(run: Run, tmp_path: Path):
    paths = several(tmp_path)
    for number, path in enumerate(paths, start=1):
        lines = path.read_text().splitlines()
        warm = [f"{line},{20 + number}" for line in lines[1:]]
        path.write_text("\n".join([lines[0] + ",temperature_degC", *warm]))
    given = ("--kind", "cell", "--answer-only", "--out", tmp_path / "case")
    said = run("import", *paths, *given).stdout
    assert said.count("the thermometer never moves") == 1
    assert "cell_1, cell_2, cell_3: cell_temperature_degC is 21 in all 40 readings" in said
    assert "The numbers are those of cell_1; import.json has all." in said
    assert "cell_temperature_degC is 23" in (tmp_path / "case" / "import.json").read_text(encoding="utf-8")
