"""Every reader of the product, with good files for it, and what must hold of a file that it takes."""

from __future__ import annotations

import csv
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from jaxmodel.app.browser.worker.opening import refuse_outside
from jaxmodel.case.build import case_model, load_effect_class, preset_model
from jaxmodel.case.reading import read_case
from jaxmodel.case.records import Run
from jaxmodel.data.importing import import_case
from jaxmodel.data.importing.options import Kind
from jaxmodel.model.electrothermal import Model
from jaxmodel.operation.mission import mission_profile, read_mission, rounds_in
from jaxmodel.operation.state_of_charge import read_tunings
from jaxmodel.sweeps.runner import Runner
from jaxmodel.sweeps.study import read_study
from tests.data.tables.made_logs import frc
from tests.stress import seeds
from tests.stress.mutators import BINARY, TABLE, TEXT, Mutator


@dataclasses.dataclass(frozen=True)
class Reader:
    """A reader, good files for it, and what spoils them.

    Attributes:
        files: returns content by name.
        read: takes the folder.
        mutators: that spoil a file.
        label: what a sentence may name instead of a file.
        only: the files to be spoilt; all if empty.
    """

    files: Callable[[], Mapping[str, bytes]]
    read: Callable[[Path], object]
    mutators: tuple[Mutator, ...] = TEXT
    label: str = ""
    only: tuple[str, ...] = ()

    def spoils(self, name: str) -> bool:
        """Return whether a file is to be spoilt."""
        return not self.only or name in self.only


def _case(folder: Path) -> None:
    case = read_case(folder)
    for run in case.runs:
        case_model(case, run)
        _as_written(run)
    case.summary()


def _as_written(run: Run) -> None:
    """Check that a run has the numbers that its file has for any other reader of CSV."""
    assert run.source is not None
    lines = run.source.read_text(encoding="utf-8-sig").splitlines(keepends=True)
    rows = list(csv.reader(line for line in lines if line.strip() and not line.lstrip().startswith("#")))
    header, *body = [[field.strip() for field in row] for row in rows if any(map(str.strip, row))]
    columns = {"time_s": run.measured.time_s, **run.measured.inputs, **run.measured.outputs}
    for place, name in enumerate(header):
        written = np.array([float(row[place]) if row[place] else math.nan for row in body])
        np.testing.assert_array_equal(columns[name], written, err_msg=f"{run.file}, {name}")


def _study(folder: Path) -> None:
    study = read_study(folder / "study.toml")
    assert study.digest
    Runner(study).chunks(None, whole=False)


def _mission(folder: Path) -> None:
    mission = read_mission(folder / "mission.toml")
    mission_profile(mission, _robot(), rounds_in(mission, 8.0))


@functools.cache
def _robot() -> Model:
    return preset_model("paper", "robot")


def _log(kind: Kind, name: str, content: bytes, mutators: tuple[Mutator, ...], **decisions: object) -> Reader:
    return Reader(
        lambda: {name: content},
        lambda folder: import_case(folder / name, kind, ambient=25.0, **decisions).check(),
        mutators,
        label="imported",
    )


def _effect(folder: Path) -> None:
    load_effect_class(f"{folder / 'effects.py'}:HotContact")


def _upload(folder: Path) -> None:
    refuse_outside(folder / "case.toml")
    read_case(folder)


def _folder(name: str) -> Callable[[], Mapping[str, bytes]]:
    return functools.partial(seeds.folders().__getitem__, name)


READERS: dict[str, Reader] = {
    "case": Reader(_folder("case"), _case),
    "table of a run": Reader(_folder("case"), _case, TABLE, only=("one.csv", "two.csv")),
    "preset": Reader(_folder("preset"), _case, only=("own.toml",)),
    "study": Reader(_folder("study"), _study),
    "study of a case": Reader(_folder("study of a case"), _study),
    "drive": Reader(_folder("drive"), _study),
    "mission": Reader(_folder("mission"), _mission, label="mission"),
    "tuning": Reader(_folder("tuning"), lambda folder: read_tunings(folder / "tuning.json")),
    "effect": Reader(_folder("effect"), _effect, label="hot_contact"),
    "upload": Reader(_folder("case"), _upload),
    "log of a motor": _log("motor", "motor.csv", seeds.motor_csv(), TABLE),
    "match.wpilog": _log("robot", "match.wpilog", frc(), BINARY, constants={"incline_deg": 0.0}),
    **{name: _log("cell", name, content, TABLE) for name, content in seeds.text_logs().items()},
    **{name: _log("cell", name, content, BINARY) for name, content in seeds.binary_logs().items()},
}
