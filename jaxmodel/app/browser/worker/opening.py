"""Bringing data: a shipped example, a case, or raw files of a bench, with what an upload may not hold."""

from __future__ import annotations

import dataclasses
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from jaxmodel.app.browser.files import CASE, PARAMETERISED, UPLOADS
from jaxmodel.app.browser.worker.place import Place
from jaxmodel.app.browser.worker.progress import Progress
from jaxmodel.app.browser.worker.view import import_view
from jaxmodel.base import toml
from jaxmodel.base.errors import MeasurementError, UserError
from jaxmodel.case.measurements import KINDS, read_utf8
from jaxmodel.data.importing import Options, import_case
from jaxmodel.data.importing.written import options_of
from jaxmodel.parameterisation import parameterise

_CODE = re.compile(r"\.pyc?(:|$)", re.IGNORECASE)


def open_case(place: Place, progress: Progress, path: str, how: str) -> None:
    """Open a case that is already on this machine: a shipped example, or one that the command line named.

    Raises:
        UserError: the case cannot be used.
    """
    progress("reading the case")
    place.opened(_toml(Path(path)), {"how": how, "name": Path(path).resolve().stem, "files": []})


def open_upload(place: Place, progress: Progress, kind: str, options: Mapping[str, Any]) -> None:
    """Open the files that were dropped: as a case if a TOML file is among them, else as raw files of a bench.

    Raises:
        UserError: a file cannot be used, something is open that only the user can tell, or a case reaches outside.
    """
    files = sorted(path for path in (place.folder / UPLOADS).glob("*") if path.is_file())
    cases = [path for path in files if path.suffix.lower() == ".toml"]
    if cases:
        chosen = next((path for path in cases if path.name == "case.toml"), cases[0])
        for path in cases:
            refuse_outside(path)
        progress("reading the case")
        place.opened(chosen, {"how": "upload", "name": chosen.stem, "files": [path.name for path in files]})
        return
    import_files(place, progress, [str(path) for path in files], kind, options)


def import_files(place: Place, progress: Progress, files: Sequence[str], kind: str, options: Mapping[str, Any]) -> None:
    """Import raw files of a bench and write them as the session's case.

    Args:
        place: of the session.
        progress: of the job.
        files: on this machine.
        kind: "cell", "motor" or "robot".
        options: decisions of the user, as `jaxmodel.data.importing.written` takes them.

    Raises:
        UserError: a file cannot be used, or something is open that only the user can tell.
    """
    if kind not in KINDS:
        raise MeasurementError(f"kind: there is no '{kind}'; use {', '.join(KINDS)}.")
    known = {field.name for field in dataclasses.fields(Options)}
    given = {name: value for name, value in options.items() if name in known and value not in (None, "", {}, [])}
    if _is_path(str(given.get("preset", ""))):
        raise MeasurementError("preset: name one of the presets that jaxmodel ships; a path is not read here.")
    stated = options_of(given)
    imported = import_case(files, cast(Any, kind), options=stated, progress=progress)
    progress("checking the case")
    imported.check()
    progress(f"writing {len(imported.runs)} runs")
    shutil.rmtree(place.folder / CASE, ignore_errors=True)
    path = imported.write(place.folder / CASE)
    names = [Path(file).name for file in files]
    source = {"how": "files", "name": imported.title, "files": names, "paths": list(files), "kind": kind}
    place.opened(path, source | {"options": _changed(stated)}, import_view(imported))


def _changed(options: Options) -> dict[str, Any]:
    """Return the options that are not as by default, as JSON holds them."""
    unstated = dataclasses.asdict(Options())
    return {name: value for name, value in dataclasses.asdict(options).items() if value != unstated[name]}


def parameterised(place: Place, progress: Progress) -> None:
    """Give an imported case first parameters from its fit runs, if it has no preset and has none yet.

    Raises:
        UserError: there is no data yet, or the runs lack what is needed.
    """
    case, source = place.case, place.view["source"]
    if source["how"] != "files" or source.get("parameterised") or source["options"].get("preset"):
        return
    progress("first parameters from the runs alone")
    found = parameterise(case, progress=progress)
    shutil.rmtree(place.folder / PARAMETERISED, ignore_errors=True)
    found.write(place.folder / PARAMETERISED, pictures=False)
    imported = place.view["imported"]
    place.opened(place.folder / PARAMETERISED / "case.toml", source | {"parameterised": True}, imported)
    place.show(remarks=list(found.remarks))


def refuse_outside(path: Path) -> None:
    """Refuse an uploaded case that names code, or a file outside its own folder.

    Raises:
        MeasurementError: it does, or is no TOML.
    """
    for key, value in _texts(toml.parsed(read_utf8(path), path.name)):
        if _CODE.search(value):
            raise MeasurementError(
                f"{path.name}: '{value}' is Python code, which the workbench does not run from an upload; "
                "use `jaxmodel diagnose --effect` for an effect of your own."
            )
        if key in ("file", "preset", "csv") and _is_path(value):
            raise MeasurementError(
                f"{path.name}: '{value}' is outside the upload; name files without a folder and drop them together."
            )


def _texts(content: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Give every text in a TOML file with its key."""
    if isinstance(content, dict):
        for name, value in content.items():
            yield from _texts(value, str(name))
    elif isinstance(content, list):
        for value in content:
            yield from _texts(value, key)
    elif isinstance(content, str):
        yield key, content


def _is_path(text: str) -> bool:
    return "/" in text or "\\" in text or text.startswith("..")


def _toml(path: Path) -> Path:
    """Return the TOML file of a case given as a folder or a file.

    Raises:
        UserError: there is none.
    """
    found = path / "case.toml" if path.is_dir() else path
    if not found.is_file():
        raise UserError(f"{path} is not a case: it has no case.toml; name a folder that has one.")
    return found.resolve()
