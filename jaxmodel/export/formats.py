"""The formats of an export by name: ours, and those that other packages add by an entry point.

A format is a function of a case, and of options of its own by keyword, that returns an `Exported`. A package adds one:

    [project.entry-points."jaxmodel.export"]
    my_tool = "my_package.my_module:export_my_tool"
"""

from __future__ import annotations

import importlib
import importlib.metadata
import inspect
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError, ParameterError, instead, reason
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case

GROUP = "jaxmodel.export"
# Ours stand here too, so that they need no installed package.
OWN = {
    "actuator": "jaxmodel.export.actuator_settings:export_actuator",
    "bdf": "jaxmodel.export.bdf:export_bdf",
    "c": "jaxmodel.export.c_model:export_c",
    "c-filter": "jaxmodel.export.c_filter:export_c_filter",
    "fmu": "jaxmodel.export.fmu:export_fmu",
    "mujoco": "jaxmodel.export.mujoco_actuator:export_mujoco",
    "pybamm": "jaxmodel.export.pybamm_parameters:export_pybamm",
    "simscape": "jaxmodel.export.simscape:export_simscape",
}


def formats() -> dict[str, Callable[[], Callable[..., Exported]]]:
    """Return by the name of each format what loads its function; ours come before those of the same name."""
    others = {point.name: point.load for point in importlib.metadata.entry_points(group=GROUP)}
    return others | {name: _loads(place) for name, place in OWN.items()}


def _loads(place: str) -> Callable[[], Callable[..., Exported]]:
    module, _, function = place.partition(":")
    return lambda: getattr(importlib.import_module(module), function)


def export(case: Case, to: str, **options: Any) -> Exported:
    """Return a case in a format.

    Args:
        case: of any kind that the format takes.
        to: a name of `formats`.
        options: what the format takes beside the case.

    Raises:
        ParameterError: there is no such format, it has no such option, or it cannot hold such a case.
    """
    known = formats()
    if to not in known:
        raise ParameterError(f"There is no format '{to}' to export to.{instead(to, sorted(known))}")
    try:
        function = known[to]()
    except (ImportError, AttributeError) as error:
        why = f"The format '{to}' cannot be loaded ({reason(error)}); install its package anew."
        raise ParameterError(why) from error
    taken = list(inspect.signature(function).parameters)[1:]
    for name in options:
        if name not in taken:
            raise ParameterError(f"The format '{to}' takes no '{name}'.{instead(name, taken)}")
    return function(case, **options)


def export_case(case: Case, to: str, out: str | Path | None = None, **options: Any) -> Exported:
    """Return a case in a format, and write it to a file if one is given; to a folder where the format has several.

    Raises:
        ParameterError: as `export`.
        MeasurementError: there is a folder in place of the file, the reverse, or a file of the case itself.
        OSError: a file cannot be written.
    """
    found = export(case, to, **options)
    if out is not None:
        files = {Path(out, name): content for name, content in found.files.items()} or {Path(out): found.content}
        _refuse(case, to, Path(out), files)
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, content)
    return found


def _refuse(case: Case, to: str, out: Path, files: Collection[Path]) -> None:
    """Raise MeasurementError for a place where files of an export cannot be, or would replace a run of the case."""
    several = out not in files
    if several and out.is_file():
        raise MeasurementError(f"{out} is a file, and '{to}' writes several; give a folder.")
    if not several and out.is_dir():
        raise MeasurementError(f"{out}: this is a folder; give a file.")
    own = {file.resolve() for file in case.files}
    for path in files:
        if path.resolve() in own:
            raise MeasurementError(f"{path}: this is a file of the case; give another{' folder' if several else ''}.")
