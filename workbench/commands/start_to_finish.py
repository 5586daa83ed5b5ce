"""`jaxmodel start`: from raw files to a diagnosis in one command, stage by stage, each resumed where it stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from workbench import terminal
from workbench.commands.diagnose import diagnose_all
from workbench.commands.import_files import files_of, import_files
from workbench.commands.parameterise import parameterise_case

CASE, PARAMETERISED, DIAGNOSIS = "1_case", "2_parameterised", "3_diagnosis"
STAGES, ANSWER = "start.json", "answer.json"


def start_to_finish(files: Sequence[Path], kind: str, out: Path, *, again: bool = False, **decisions: Any) -> None:
    """Import files, parameterise the case, diagnose it, and write all pages below `out`.

    A stage that was finished before with the same files and decisions is not repeated. A folder that is a case takes
    the place of the files: the import is then left out.

    Args:
        files: of one piece of hardware, or one folder with a case.toml.
        kind: of the case.
        out: folder for the results.
        again: repeat all stages.
        decisions: of `workbench.commands.import_files.import_files`.

    Raises:
        UserError: a stage cannot be done; what the earlier ones wrote is kept.
    """
    is_case = len(files) == 1 and (files[0] / "case.toml").is_file()
    case = files[0] if is_case else out / CASE
    sources = sorted(case.iterdir()) if is_case else files_of(files, case)
    stages = _Stages(out, _digest(sources, {"kind": kind, **decisions}), again)
    if not is_case:
        stages.do("import", case / "case.toml", lambda: import_files(files, kind, case, **decisions))
    better = out / PARAMETERISED
    stages.do("parameterise", better / "case.toml", lambda: parameterise_case(case, better, []))
    answer = out / DIAGNOSIS / PARAMETERISED / ANSWER
    stages.do("diagnose", answer, lambda: diagnose_all([better], out / DIAGNOSIS, []))
    terminal.say(
        f"Read {better / 'report.html'} (the parameters) and {answer.parent / 'report.html'} (what is missing)."
    )


class _Stages:
    """The stages that are done, kept in a file."""

    def __init__(self, out: Path, made_from: str, again: bool) -> None:
        out.mkdir(parents=True, exist_ok=True)
        self._file, self._made_from = out / STAGES, made_from
        self._done: dict[str, str] = {} if again else _read(self._file)
        self._repeated = False

    def do(self, name: str, result: Path, work: Callable[[], object]) -> None:
        """Do one stage, unless it was finished with the same files and decisions and no earlier stage is repeated."""
        if not self._repeated and self._done.get(name) == self._made_from and result.is_file():
            terminal.say(f"{name}: done before, {result.parent}; --again repeats it.")
            return
        self._repeated = True
        self._done.pop(name, None)
        work()
        self._done[name] = self._made_from
        part = self._file.with_suffix(".part")
        part.write_text(json.dumps(self._done, indent=2), encoding="utf-8")
        part.replace(self._file)


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
