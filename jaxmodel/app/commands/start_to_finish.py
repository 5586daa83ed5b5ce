"""`jaxmodel start`: from logs to a diagnosis in one command, stage by stage, resumed where it stopped."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from jaxmodel.app import terminal
from jaxmodel.app.commands.diagnose import diagnose_all
from jaxmodel.app.commands.import_files import files_of, import_files
from jaxmodel.app.commands.parameterise import parameterise_case
from jaxmodel.app.folders import take
from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import MeasurementError
from jaxmodel.data.importing import Options
from jaxmodel.data.importing.written import option_of

CASE, PARAMETERISED, DIAGNOSIS = "1_case", "2_parameterised", "3_diagnosis"
STAGES, ANSWER = "start.json", "answer.json"
_OF_A_CASE = (".toml", ".csv", ".parquet")


def start_to_finish(
    files: Sequence[Path],
    kind: str,
    out: Path,
    *,
    again: bool = False,
    effects: Sequence[str] = (),
    search: Mapping[str, Sequence[str]] | None = None,
    **decisions: Any,
) -> None:
    """Import files, parameterise the case, diagnose it, and write all pages below `out`.

    A stage that was finished before is not repeated while its own files and decisions are the same. A folder that is a
    case takes the place of the files: the import is then left out.

    Args:
        files: of one piece of hardware, or one folder with a case.toml.
        kind: of the case.
        out: folder for the results.
        again: repeat all stages.
        effects: the user's own, as `file.py:Class`.
        search: what `jaxmodel.app.commands.diagnose.diagnose_all` is to add or to rule out, by its arguments.
        decisions: of `jaxmodel.app.commands.import_files.import_files`.

    Raises:
        UserError: a stage cannot be done; what the earlier ones wrote is kept.
    """
    given = _given_case(files, decisions)
    case, better = given or out / CASE, out / PARAMETERISED
    answer = out / DIAGNOSIS / PARAMETERISED / ANSWER
    stages = _Stages(out, again)
    try:
        if given is None:
            logs = files_of(files, case)
            importing = partial(import_files, files, kind, case, force=again, **decisions)
            stages.do("import", logs, {"kind": kind, **decisions}, case / "case.toml", importing)
        own = {"effects": effects} if effects else {}
        parameterising = partial(parameterise_case, case, better, effects)
        stages.do("parameterise", _files_of(case), own, better / "case.toml", parameterising)
        sought = {name: labels for name, labels in (search or {}).items() if labels}
        diagnosing = partial(diagnose_all, [better], out / DIAGNOSIS, effects, **sought)
        stages.do("diagnose", _files_of(better), own | sought, answer, diagnosing)
    except KeyboardInterrupt:
        terminal.say("The same command goes on with the stage that was stopped.")
        raise
    terminal.say(
        f"Read {better / 'report.html'} (the parameters) and {answer.parent / 'report.html'} (what is missing)."
    )


def _given_case(files: Sequence[Path], decisions: Mapping[str, Any]) -> Path | None:
    """Return the folder of the case that the user names; None for logs.

    Raises:
        MeasurementError: a decision is stated that only an import can take, or a case stands among others.
    """
    cases = [path.parent if path.name == "case.toml" else path for path in files if _is_case(path)]
    if not cases:
        return None
    if len(files) > 1:
        raise MeasurementError(f"{cases[0]} is a case; give one case alone, or logs alone.")
    stated = [*_stated(decisions)]
    if stated:
        raise MeasurementError(
            f"{stated[0]}: {cases[0]} is a case and is not imported; correct its case.toml, or give its logs."
        )
    return cases[0]


def _is_case(path: Path) -> bool:
    return (path / "case.toml").is_file() or (path.name == "case.toml" and path.is_file())


def _stated(decisions: Mapping[str, Any]) -> Iterable[str]:
    """Yield the options of the import that the user states, as they are written."""
    unstated = {field.name: field.default for field in dataclasses.fields(Options)}
    return (option_of(name) for name, value in decisions.items() if value not in (unstated[name], None))


def _files_of(case: Path) -> list[Path]:
    """Return the files of a case; pictures and pages do not count."""
    if not case.is_dir():
        return []
    return sorted(path for path in case.iterdir() if path.suffix in _OF_A_CASE)


class _Stages:
    """The stages that are done, kept in a file."""

    def __init__(self, out: Path, again: bool) -> None:
        take(out)
        self._file = out / STAGES
        self._done: dict[str, str] = {} if again else _read(self._file)

    def do(
        self,
        name: str,
        files: Sequence[Path],
        decisions: Mapping[str, Any],
        result: Path,
        work: Callable[[], object],
    ) -> None:
        """Do one stage, unless it was finished with the same files and decisions."""
        made_from = _digest(files, decisions)
        if self._done.get(name) == made_from and result.is_file():
            terminal.say(f"{name}: done before, {result.parent}; --again repeats it.")
            return
        # Written before the work: a stage that is stopped halfway is done with neither the old files nor the new.
        self._done.pop(name, None)
        self._write()
        work()
        self._done[name] = made_from
        self._write()

    def _write(self) -> None:
        write_whole(self._file, json.dumps(self._done, indent=2))


def _read(file: Path) -> dict[str, str]:
    """Return the stages that a file lists; none if it cannot be read: they are repeated."""
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {str(name): str(key) for name, key in found.items()} if isinstance(found, dict) else {}


def _digest(files: Sequence[Path], decisions: Mapping[str, Any]) -> str:
    """Return a digest of names, sizes and times of change of the files, and of the decisions."""
    stats = [(str(file.resolve()), *_state(file)) for file in files if file.is_file()]
    text = json.dumps([stats, sorted(decisions.items())], default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def _state(file: Path) -> tuple[int, int]:
    stat = file.stat()
    return stat.st_size, stat.st_mtime_ns
