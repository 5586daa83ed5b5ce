"""The outcome of an import: the case, everything that was found and decided on the way, and both as files."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import html
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base import toml
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError, listed
from jaxmodel.base.schema import with_schema
from jaxmodel.case.brushless import WAYS
from jaxmodel.case.records import Case
from jaxmodel.case.run_csv import write_numbers
from jaxmodel.case.writing import preset_entry
from jaxmodel.data.importing.charge import Stated
from jaxmodel.data.importing.conditions import Condition
from jaxmodel.data.importing.findings import Decision, Finding
from jaxmodel.data.importing.logs import Log
from jaxmodel.data.importing.options import Kind, Options
from jaxmodel.data.importing.plotting import ImportPlots
from jaxmodel.effects.controllers import CONTROLLERS
from jaxmodel.effects.loads import LAWS

_LINE = 160
_NAMED, _ALIKE = 3, 3  # files or runs that a sentence names, and from which on their numbers are not told


@dataclasses.dataclass(frozen=True, eq=False)
class ImportedRun:
    """One run as it is written.

    Attributes:
        log: its readings.
        split: "fit" or "check".
        label: in words.
        ambient_degC: constant ambient temperature; None where it is a column.
        start: state of charge at the first row; None for a motor.
        condition: under which it was measured.
        rises: of a motor that begins warm, by parameter of the case [K].
        capacity: that the cell had left; None where all runs have that of the case.
    """

    log: Log
    split: str
    label: str
    ambient_degC: float | None
    start: Stated | None
    condition: Condition
    rises: Mapping[str, float] = dataclasses.field(default_factory=dict)
    capacity: Stated | None = None

    def entries(self) -> dict[str, Any]:
        """Return the run's entries of case.toml."""
        stated: dict[str, Any] = {"label": self.label}
        if self.log.specimen:
            stated["specimen"] = self.log.specimen
        if self.ambient_degC is not None:
            stated["ambient_degC"] = self.ambient_degC
        if self.start is not None:
            stated["initial_soc"] = _entry(self.start)
        if self.capacity is not None:
            stated["capacity_Ah"] = _entry(self.capacity)
        if self.condition.cycles is not None:
            stated["cycles"] = self.condition.cycles
        return stated | dict(self.rises)


@dataclasses.dataclass(frozen=True, eq=False)
class Imported:
    """Imported files: a case, findings and decisions.

    Attributes:
        kind: of the case.
        runs: in the order of the files.
        options: decisions of the user.
        capacity: of a cell; None for other kinds.
        capacity_known: whether a full discharge or the user told the capacity.
        constants: first values of a motor's constants, by name of the parameter.
        general: findings and decisions that concern no single run.

    Example:
        >>> from jaxmodel import import_case
        >>> log = "examples/samsung_30q/cc1C.csv"
        >>> imported = import_case(log, "cell", ambient=23.0, progress=False)
        >>> [run.log.name for run in imported.runs]
        ['cc1C']
    """

    kind: Kind
    runs: tuple[ImportedRun, ...]
    options: Options
    capacity: Stated | None
    capacity_known: bool
    constants: dict[str, Stated]
    general: tuple[Finding | Decision, ...]

    @functools.cached_property
    def case(self) -> Case:
        """The case, in memory.

        Raises:
            UserError: it holds what cannot be, such as a unit that does not fit; the sentence says what to do.
        """
        frames = {run.log.name: self._frame(run) for run in self.runs}
        return Case.from_dataframes(
            frames,
            kind=self.kind,
            name="imported",
            title=self.title,
            load=self.options.load,
            drive=self.options.drive,
            controller=self.options.controller,
            brushless=self.brushless(),
            effects=self.effects(),
            preset=self.options.preset or "paper",
            parameters=self.parameters(),
            check=[run.log.name for run in self.runs if run.split == "check"],
            runs={run.log.name: run.entries() for run in self.runs},
        )

    def check(self) -> None:
        """Refuse a case that `read_case` would refuse.

        Raises:
            UserError: it holds what cannot be; the sentence says what to do.
        """
        _ = self.case

    @property
    def title(self) -> str:
        """What the case is called."""
        if self.options.title:
            return self.options.title
        folders = sorted({run.log.source.resolve().parent.name for run in self.runs})
        return f"{', '.join(folders)}: imported {self.kind}"

    def _frame(self, run: ImportedRun) -> pd.DataFrame:
        return run.log.to_dataframe()

    def parameters(self) -> dict[str, Any]:
        """Return what the case states of its hardware: the capacity, and that it is as old as when it was measured."""
        if self.capacity is None:
            known = [name for name, keys in WAYS.items() if keys & self.options.brushless_numbers.keys()]
            return {name: _entry(stated) for name, stated in self.constants.items() if name not in known}
        # A preset states a capacity of its own: a measured one takes precedence, an assumed one does not.
        of_files = {} if self.options.preset and not self.capacity_known else {"capacity_Ah": _entry(self.capacity)}
        return of_files | {"cycles": 0, "storage_months": 0}

    def brushless(self) -> dict[str, Any] | None:
        """Return what the user states of a brushless motor; None for a motor with brushes."""
        current = self.options.brushless
        return None if current is None else {"current": current, **self.options.brushless_numbers}

    def effects(self) -> dict[str, dict[str, float]]:
        """Return the law of the load and the controller with the numbers that the user states of them."""
        law, loop = LAWS.get(self.options.load or ""), CONTROLLERS.get(self.options.controller or "")
        stated = {} if law is None else {law.name: dict(self.options.load_numbers)}
        return stated if loop is None else stated | {loop.name: dict(self.options.controller_numbers)}

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Everything that a person should know, in the order of the files."""
        return tuple(one for one in self._all() if isinstance(one, Finding))

    @property
    def decisions(self) -> tuple[Decision, ...]:
        """Everything that was settled, in the order of the files."""
        return tuple(one for one in self._all() if isinstance(one, Decision))

    def _all(self) -> Iterator[Finding | Decision]:
        yield from self.general
        for run in self.runs:
            yield from run.log.decisions
            yield from run.log.findings

    def missing(self) -> str:
        """Return in one sentence what the case does not know yet; "" if nothing."""
        if self.options.preset:
            return ""
        if self.kind == "motor":
            lacking = [name for name in ("R_0", "k_tau") if name not in self.constants]
            first = f"first values of {', '.join(self.constants)} and " if self.constants else ""
            rest = f"{', '.join(lacking)}, " if lacking else ""
            return (
                f"The case has {first}the paper's motor for {rest}inertia, friction and heat: run "
                "`jaxmodel parameterise CASE`, or give "
                "--preset."
            )
        if self.kind == "robot":
            return ""
        lacking = "" if self.capacity_known else "its capacity, "
        return (
            f"The case does not know {lacking}its open-circuit voltage and its resistances (formulas of "
            "the paper's cell stand in for "
            "them): run `jaxmodel parameterise CASE`, or give --preset."
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return a row for each run: rows, duration, condition, start, split, number of warnings."""
        return pd.DataFrame([self._row(run) for run in self.runs])

    def _row(self, run: ImportedRun) -> dict[str, Any]:
        log = run.log
        warmth = run.ambient_degC if run.ambient_degC is not None else float(np.median(log.columns["ambient_degC"]))
        return {
            "run": log.name,
            "split": run.split,
            "rows": log.rows,
            "duration_s": float(log.time_s[-1] - log.time_s[0]),
            "ambient_degC": warmth,
            "initial_soc": np.nan if run.start is None else run.start.value,
            "columns": ", ".join(log.columns),
            "warnings": sum(finding.weight == "warning" for finding in log.findings),
            "label": run.label,
        }

    def summary(self) -> str:
        """Return runs, decisions that are not the user's, warnings, and what is missing."""
        lines = [self.title, self.to_dataframe().drop(columns=["columns"]).to_string(index=False, max_colwidth=60)]
        lines += [
            f"decided: {one}" for one in shortened([d for d in self.decisions if d.about not in ("reading", "clock")])
        ]
        lines += [f"look at: {said}" for said in self.warned()]
        return "\n".join([*lines, *([self.missing()] if self.missing() else [])])

    def warned(self) -> list[str]:
        """Return what is to be looked at, in sentences; what is so in several runs is said once."""
        return sentences(one for one in self.findings if one.weight == "warning")

    @property
    def plot(self) -> ImportPlots:
        """Pictures: `imported.plot("run")`."""
        return ImportPlots(self)

    def write(self, folder: str | Path, *, pictures: bool = False, force: bool = False) -> Path:
        """Write the case: case.toml, a CSV for each run, import.json, and a picture of each run if asked for.

        Args:
            folder: of the case.
            pictures: draw one of each run.
            force: write over a case.toml that was edited since it was imported.

        Returns:
            The TOML file.

        Raises:
            MeasurementError: the folder holds the files that were imported, or a case that was edited since.
        """
        return _write(self, Path(folder), pictures, force)

    def __repr__(self) -> str:
        warnings = sum(finding.weight == "warning" for finding in self.findings)
        return f"<Imported {self.kind}: {len(self.runs)} runs, {warnings} warnings>"

    def _repr_html_(self) -> str:
        return f"<p><b>{html.escape(repr(self)[1:-1])}</b></p>{self.to_dataframe().to_html(index=False, border=0)}"


def shortened(decisions: list[Decision]) -> list[str]:
    """Return decisions as sentences, those that say the same of several files or runs as one.

    The numbers of the reason are then those of the first.
    """
    places: dict[tuple[str, str, str], list[str]] = {}
    for one in decisions:
        named = places.setdefault((one.about, one.value, one.why), [])
        named += [one.where] if one.where and one.where not in named else []
    lines = []
    for (about, value, why), where, first in _alike(places, lambda key: (*key[:2], _without_numbers(key[2]))):
        some = f" ({listed(where, _NAMED)})" if where else ""
        lines.append(f"{about}{some}: {value} - {why}" + (f"; the numbers are those of {first}" if first else ""))
    return lines


def sentences(findings: Iterable[Finding]) -> list[str]:
    """Return what findings say, each once, those that say the same of several files or runs as one.

    The numbers are then those of the first.
    """
    places: dict[str, list[str]] = {}
    for one in findings:
        begin = f"{one.where}: " if one.where and one.sentence.startswith(f"{one.where}: ") else ""
        named = places.setdefault(one.sentence.removeprefix(begin), [])
        named += [one.where] if begin and one.where not in named else []
    return [
        (f"{listed(where, _NAMED)}: {said}" if where else said)
        + (f" The numbers are those of {first}; import.json has all." if first else "")
        for said, where, first in _alike(places, _without_numbers)
    ]


def _alike(places: Mapping[Any, list[str]], mask: Callable[[Any], Any]) -> list[tuple[Any, list[str], str]]:
    """Return what is said with its places; what three places and more say with other numbers is that of the first.

    The last entry is the place whose numbers they are, "" where they hold for all.
    """
    groups: dict[Any, list[Any]] = {}
    for key in places:
        groups.setdefault(mask(key), []).append(key)
    found: list[tuple[Any, list[str], str]] = []
    for keys in groups.values():
        where = [place for key in keys for place in places[key]]
        if len(keys) >= _ALIKE and len(set(where)) == len(where) and all(places[key] for key in keys):
            found.append((keys[0], where, where[0]))
        else:
            found += [(key, places[key], "") for key in keys]
    return found


def _without_numbers(text: str) -> str:
    """Return a text without its numbers; those inside names stay."""
    return re.sub(r"(?<![\w.])[+-]?\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?(?![\w])", "#", text)


def _entry(stated: Stated) -> float | dict[str, float]:
    value = float(f"{stated.value:.5g}")
    return value if stated.sd is None else {"value": value, "sd": float(f"{stated.sd:.2g}")}


def file_name(name: str) -> str:
    """Return a run's name as a valid file name."""
    return re.sub(r"[^\w.+-]+", "_", name).strip(".") or "run"


def _write(imported: Imported, folder: Path, pictures: bool, force: bool) -> Path:
    sources = {run.log.source.resolve() for run in imported.runs}
    if any(source.parent == folder.resolve() for source in sources):
        raise MeasurementError(f"{folder}: the files that were imported are in this folder; give another one.")
    folder.mkdir(parents=True, exist_ok=True)
    names, file = _names(imported), folder / "case.toml"
    if not force and _was_edited(file):
        raise MeasurementError(
            f"{folder}: its case.toml was edited since it was imported; give another folder, or write over it with "
            "--force (of start: --again)."
        )
    file.unlink(missing_ok=True)  # until its runs are written, the folder is no case
    for run, name in zip(imported.runs, names, strict=True):
        write_numbers({"time_s": run.log.time_s, **run.log.columns}, folder / f"{name}.csv")
    text = _head(imported) + toml.document(with_schema(_content(imported, names, folder)))
    said = to_dict(imported) | {"case_sha256": _digest(text.encode())}
    write_whole(folder / "import.json", json.dumps(with_schema(said), indent=1, ensure_ascii=False) + "\n")
    write_whole(file, text)
    if pictures:
        for run, name in zip(imported.runs, names, strict=True):
            write_whole(folder / f"{name}.png", imported.plot.png(run.log.name))
    return file


def _digest(content: bytes) -> str:
    return hashlib.sha256(content.replace(b"\r\n", b"\n")).hexdigest()


def _was_edited(file: Path) -> bool:
    """Return whether a case is not as its import wrote it; False where no import says how that was."""
    try:
        said = json.loads((file.parent / "import.json").read_text(encoding="utf-8"))
        return said["case_sha256"] != _digest(file.read_bytes())
    except (OSError, ValueError, TypeError, KeyError):
        return False


def _names(imported: Imported) -> list[str]:
    names: list[str] = []
    for run in imported.runs:
        name, count = file_name(run.log.name), 1
        while (name if count == 1 else f"{name}_{count}") in names:
            count += 1
        names.append(name if count == 1 else f"{name}_{count}")
    return names


def _content(imported: Imported, names: list[str], folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = {"title": imported.title, "kind": imported.kind}
    if imported.options.load:
        content["load"] = imported.options.load
    content |= {name: said for name, said in imported.options.servo._asdict().items() if said}
    if brushless := imported.brushless():
        content["brushless"] = brushless
    if imported.options.preset:
        content["preset"] = preset_entry(imported.options.preset, folder / "case.toml")
    if parameters := imported.parameters():
        content["parameters"] = parameters
    if effects := imported.effects():
        content["effects"] = effects
    content["runs"] = [
        {"file": f"{name}.csv", "split": run.split, **run.entries()}
        for run, name in zip(imported.runs, names, strict=True)
    ]
    return content


def _head(imported: Imported) -> str:
    """Return what was decided and found, as comments."""
    decided = [one for one in imported.decisions if one.about not in ("reading", "convention")]
    lines = ["Written by `jaxmodel import`; import.json holds all of this for programs.", "", "Decided:"]
    lines += [f"- {one}" for one in shortened(decided)]
    if warnings := imported.warned():
        lines += ["", "To be looked at:", *(f"- {one}" for one in warnings)]
    if missing := imported.missing():
        lines += ["", missing]
    return "".join(f"# {' '.join(line.split())[: 4 * _LINE]}".rstrip() + "\n" for line in lines)


def to_dict(imported: Imported) -> dict[str, Any]:
    """Return files, options, decisions and findings as JSON holds them."""
    options = {
        name: value for name, value in dataclasses.asdict(imported.options).items() if value not in (None, {}, ())
    }
    if imported.options.preset:
        options["preset"] = Path(imported.options.preset).name
    return {
        "kind": imported.kind,
        "files": sorted({run.log.source.name for run in imported.runs}),
        "options": {name: list(value) if isinstance(value, tuple) else value for name, value in options.items()},
        "runs": [
            {
                "run": run.log.name,
                "file": run.log.source.name,
                "rows": run.log.rows,
                "split": run.split,
                **run.entries(),
            }
            for run in imported.runs
        ],
        "decisions": [one.to_dict() for one in imported.decisions],
        "findings": [one.to_dict() for one in imported.findings],
        "missing": imported.missing(),
    }
