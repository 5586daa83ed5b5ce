"""Writing an imported case: case.toml with what was decided, a CSV for each run, and import.json."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from jaxmodel.base import toml
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError
from jaxmodel.base.schema import with_schema
from jaxmodel.case.run_csv import write_numbers
from jaxmodel.case.writing import preset_entry
from jaxmodel.data.importing.imported import Imported, file_name, shortened

_LINE = 160


def write(imported: Imported, folder: Path, pictures: bool) -> Path:
    """Write a case and return its TOML file; see `Imported.write`."""
    sources = {run.log.source.resolve() for run in imported.runs}
    if any(source.parent == folder.resolve() for source in sources):
        raise MeasurementError(f"{folder}: the files that were imported are in this folder; give another one.")
    folder.mkdir(parents=True, exist_ok=True)
    names, file = _names(imported), folder / "case.toml"
    file.unlink(missing_ok=True)  # until its runs are written, the folder is no case
    for run, name in zip(imported.runs, names, strict=True):
        write_numbers({"time_s": run.log.time_s, **run.log.columns}, folder / f"{name}.csv")
    write_whole(folder / "import.json", json.dumps(with_schema(to_dict(imported)), indent=1, ensure_ascii=False) + "\n")
    write_whole(file, _head(imported) + toml.document(with_schema(_content(imported, names, folder))))
    if pictures:
        for run, name in zip(imported.runs, names, strict=True):
            write_whole(folder / f"{name}.png", imported.plot.png(run.log.name))
    return file


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
    if imported.options.preset:
        content["preset"] = preset_entry(imported.options.preset, folder / "case.toml")
    if parameters := imported.parameters():
        content["parameters"] = parameters
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
    if warnings := [one.sentence for one in imported.findings if one.weight == "warning"]:
        lines += ["", "To be looked at:", *(f"- {one}" for one in dict.fromkeys(warnings))]
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
