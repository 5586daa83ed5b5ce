"""What must not change an answer: the same measurements told otherwise, and other measurements of the same cell.

Each change is made in the files of the case, as a user might make it, and the answer must keep its verdict and names.
"""

from __future__ import annotations

import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from jaxmodel.base import toml
from jaxmodel.case.reading import read_case
from jaxmodel.data.importing import import_case
from jaxmodel.diagnosis import diagnose
from tests.diagnosis import bench_cases as made

Change = Callable[[Path], object]


def _answer(folder: Path) -> dict[str, Any]:
    return diagnose(read_case(folder)).answer()


def _named(answer: dict[str, Any]) -> tuple[str, set[str]]:
    return answer["verdict"], {effect["name"] for effect in answer["effects"] if effect["probability"] >= 0.5}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The case as it was measured: a cell with a slow diffusion that its model lacks."""
    return Path(made.make(tmp_path_factory.mktemp("bench") / "case", "diffusion", seed=6).case.files[0]).parent


@pytest.fixture(scope="module")
def answer(bench: Path) -> dict[str, Any]:
    return _answer(bench)


def _in_tables(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Change:
    def in_tables(folder: Path) -> None:
        for path in sorted(folder.glob("*.csv")):
            change(pd.read_csv(path)).to_csv(path, index=False)

    return in_tables


def _in_case(change: Callable[[dict[str, Any]], object]) -> Change:
    def in_case(folder: Path) -> None:
        path = folder / "case.toml"
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        change(content)
        path.write_text(toml.document(content), encoding="utf-8")

    return in_case


def _time_shifted(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(time_s=table["time_s"] + 86_400.0)


def _thinned(table: pd.DataFrame) -> pd.DataFrame:
    """Every second reading is left out; the load is known at every row."""
    outputs = [name for name in table.columns if name not in ("time_s", "current_A", "ambient_degC")]
    thin = table.copy()
    thin.loc[thin.index % 2 == 1, outputs] = np.nan
    return thin


def _columns_turned(table: pd.DataFrame) -> pd.DataFrame:
    first, *others = table.columns
    return table[[first, *reversed(others)]]


def _higher(folder: Path) -> None:
    """A constant added to the voltage that is measured and to the one that is stated."""
    _in_tables(lambda table: table.assign(voltage_V=table["voltage_V"] + 0.05))(folder)

    def raise_ocv(content: dict[str, Any]) -> None:
        ocv = content["parameters"]["ocv"]
        ocv["voltage_V"] = [value + 0.05 for value in ocv["voltage_V"]]

    _in_case(raise_ocv)(folder)


def _noise_redrawn(folder: Path) -> None:
    shutil.rmtree(folder)
    made.make(folder, "diffusion", seed=106)


def _copied(folder: Path) -> None:
    first = sorted(folder.glob("*.csv"))[0]
    shutil.copy(first, folder / "copy.csv")

    def add(content: dict[str, Any]) -> None:
        content["runs"].append(content["runs"][0] | {"file": "copy.csv", "label": "once more"})

    _in_case(add)(folder)


def _renamed(folder: Path) -> None:
    """Files, labels and the title have other names."""

    def rename(content: dict[str, Any]) -> None:
        content["title"] = "Another name"
        for number, run in enumerate(content["runs"]):
            (folder / run["file"]).rename(folder / f"z{9 - number} measured.csv")
            run["file"], run["label"] = f"z{9 - number} measured.csv", f"condition {number}"

    _in_case(rename)(folder)


CHANGES: dict[str, Change] = {
    "time shifted": _in_tables(_time_shifted),
    "runs permuted": _in_case(lambda content: content["runs"].reverse()),
    "columns permuted": _in_tables(_columns_turned),
    "names changed": _renamed,
    "a constant on both sides": _higher,
    "readings thinned": _in_tables(_thinned),
    "noise redrawn": _noise_redrawn,
    "a copy of a run added": _copied,
}


@pytest.mark.slow
@pytest.mark.parametrize("change", CHANGES)
def test_answer_keeps_its_verdict_and_names(change: str, bench: Path, answer: dict[str, Any], tmp_path: Path) -> None:
    assert _named(answer) == ("missing_effect", {"slow_diffusion"})
    folder = Path(shutil.copytree(bench, tmp_path / "case"))
    CHANGES[change](folder)
    assert _named(_answer(folder)) == _named(answer)


def test_case_of_other_units_is_the_same_case(made_case: Path, tmp_path: Path) -> None:
    """Logs in mV, mA and minutes are imported as those in V, A and s: what is diagnosed is then the same."""
    table = pd.read_csv(made_case / "run-02.csv")
    current, voltage, minutes = table["current_A"], table["voltage_V"], table["time_s"] / 60.0
    plain = pd.DataFrame({"Time [s]": table["time_s"], "Current [A]": current, "Voltage [V]": voltage})
    scaled = pd.DataFrame({"Time [min]": minutes, "Current [mA]": 1e3 * current, "Voltage [mV]": 1e3 * voltage})
    found = []
    for name, log in (("plain", plain), ("scaled", scaled)):
        log.to_csv(tmp_path / f"{name}.csv", index=False, float_format="%.15g")
        imported = import_case(tmp_path / f"{name}.csv", "cell", ambient=25.0)
        (run,) = read_case(imported.write(tmp_path / name, pictures=False)).runs
        found.append({"time_s": run.measured.time_s, **run.measured.inputs, **run.measured.outputs})
    assert found[0].keys() == found[1].keys()
    for name, values in found[0].items():
        np.testing.assert_allclose(found[1][name], values, rtol=1e-12, atol=1e-9, err_msg=name)
