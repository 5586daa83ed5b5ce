"""Starts the logs of public_logs.toml, keeps what came out in public_logs.json, and makes public_logs.md of it.

    python -m benchmarks.public_logs                       the page alone, from the results that are kept
    python -m benchmarks.public_logs SHARED [FOLDER ...]   all logs, or those of some folders, are started first

SHARED is the folder that holds `data` and `wild`. All of it takes twenty minutes on two cores.
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jaxmodel.base.units import split_unit

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
LIST, RESULTS, PAGE = DOCS / "public_logs.toml", DOCS / "public_logs.json", DOCS / "public_logs.md"
ANSWER = Path("3_diagnosis", "2_parameterised", "answer.json")
_NOTE = "<!-- Made by python -m benchmarks.public_logs: run it after a change. -->\n"
_LONGEST_S = 3600.0  # a start that goes on for longer is taken for one that hangs
_SHOWN_IN = {"V": (1e3, "mV"), "degC": (1.0, "K")}


def logs() -> list[dict[str, Any]]:
    """Return the logs that are started: folder, what they are, kind, files, options."""
    return tomllib.loads(LIST.read_text(encoding="utf-8"))["logs"]


def results() -> dict[str, dict[str, Any]]:
    """Return what came out of each folder, as it is kept."""
    return json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.is_file() else {}


def files_of(log: Mapping[str, Any], shared: Path) -> list[str]:
    """Return the names of the files in their folder, in the order that a shell gives them."""
    folder = shared / log["folder"]
    return [path.name for pattern in log["files"] for path in sorted(folder.glob(pattern))]


def command(log: Mapping[str, Any], files: Sequence[str]) -> list[str]:
    """Return the words after `jaxmodel`, without the folder of the results."""
    return ["start", *files, "--kind", log.get("kind", "cell"), *shlex.split(log.get("options", ""))]


def start(log: Mapping[str, Any], shared: Path, out: Path) -> dict[str, Any]:
    """Start the logs of one folder in a process of its own, where nobody is asked, and return what came out."""
    words = [*command(log, files_of(log, shared)), "--out", str(out)]
    program = [sys.executable, "-c", "from jaxmodel.app.cli import app; app(prog_name='jaxmodel')", *words]
    paths = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    began = time.perf_counter()
    done = subprocess.run(
        program,
        cwd=shared / log["folder"],
        env={**os.environ, "PYTHONPATH": paths},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=_LONGEST_S,
        check=False,
    )
    result: dict[str, Any] = {"exit_code": done.returncode, "seconds": round(time.perf_counter() - began)}
    if done.returncode:  # all of it: a traceback is no sentence, and the test says so
        return result | {"said": done.stderr.strip()}
    return result | _of_answer(json.loads((out / ANSWER).read_text(encoding="utf-8")))


def _of_answer(answer: Mapping[str, Any]) -> dict[str, Any]:
    units = {row["channel"]: row["unit"] for row in answer["errors_by_run"]}
    errors = {}
    for channel, error in answer["error"].items():
        split = "fit" if error["before"].get("check") is None else "check"
        errors[channel] = {
            "split": split,
            "unit": units[channel],
            "before": error["before"][split],
            "after": error["after"][split],
        }
    return {
        "verdict": answer["verdict"],
        "title": answer["title"],
        "effects": [effect["name"] for effect in answer["effects"]],
        "curves": [f"{curve['port']} over {curve['over']}" for curve in answer["curves"]],
        "errors": errors,
    }


def page(kept: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the page, with a row for each folder that was started."""
    rows = [
        (
            f"`{log['folder']}`",
            log["what"],
            log.get("kind", "cell"),
            _shown(log),
            _outcome(kept[log["folder"]]),
            _errors(kept[log["folder"]]),
            str(kept[log["folder"]]["seconds"]),
        )
        for log in logs()
        if log["folder"] in kept
    ]
    head = (
        "folder",
        "what it holds",
        "kind",
        "command, in the folder",
        "what comes out",
        "error, before to after",
        "s",
    )
    return f"""{_NOTE}
# What `start` gives on public logs

Each row is one command: [`jaxmodel start`](how_to/from_logs_to_diagnosis.md) on the logs of one folder, with what a
user states who has read the README of the folder, for a first try. No `case.toml` was edited. `data/` holds public
measurements, `wild/` small made-up logs of kinds that once went wrong. Nothing is tuned to a row: the same program with
the same settings runs in each.

A command ends with a verdict, or it stops with one sentence before the diagnosis begins. Then the logs lack what only a
person or a further measurement can give, and the sentence says what that is.

Errors are root mean squares on the check runs, which are never fitted; "fit" where there is no check run. "Before" is
the calibrated base model, "after" the model of the verdict. Times are wall times, two commands at a time on two
cores, beside another measurement.

{_table(head, rows)}{_missing(kept)}
`python -m benchmarks.public_logs` makes the table from `docs/public_logs.toml`.
`tests/app/test_start_on_everything.py` repeats each row where the logs are beside the repository.
"""


def _missing(kept: Mapping[str, Mapping[str, Any]]) -> str:
    """Return what to say of folders that are listed and were not started."""
    missing = [f"`{log['folder']}`" for log in logs() if log["folder"] not in kept]
    return f"\nNot started with the present version: {', '.join(missing)}.\n" if missing else ""


def _shown(log: Mapping[str, Any]) -> str:
    files, options = log["files"], command(log, [])[1:]
    return f"`jaxmodel start {' '.join([*files, *map(_quoted, options)])}`"


def _quoted(word: str) -> str:
    """Return a word of a command as a person writes it for a shell."""
    if not set(word) & set(" '<>()&|;*`"):
        return word
    return f"'{word}'" if "'" not in word else f'"{word}"'


def _outcome(result: Mapping[str, Any]) -> str:
    if "verdict" not in result:
        return f"stops: {result['said']}"
    words, effects = result["title"], _names(result["effects"])
    if effects:
        words += f": {effects}" if result["verdict"] in ("missing_effect", "sensor_fault") else f"; named: {effects}"
    return words + (f"; corrected: {_names(result['curves'])}" if result["curves"] else "")


def _names(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _errors(result: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{split_unit(channel)[0].replace('_', ' ')} {_figures(error)}{' (fit)' if error['split'] == 'fit' else ''}"
        for channel, error in result.get("errors", {}).items()
    )


def _figures(error: Mapping[str, Any]) -> str:
    factor, unit = _SHOWN_IN.get(error["unit"], (1.0, error["unit"]))
    return f"{factor * error['before']:.3g} to {factor * error['after']:.3g} {unit}"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |\n" for line in lines)


def main(arguments: Sequence[str]) -> None:
    """Start what is asked for, keep each result as soon as it is there, and write the page."""
    kept = results()
    if arguments:
        shared = Path(arguments[0]).resolve()
        for log in logs():
            if arguments[1:] and log["folder"] not in arguments[1:]:
                continue
            with tempfile.TemporaryDirectory() as out:
                kept[log["folder"]] = start(log, shared, Path(out))
            print(log["folder"], kept[log["folder"]], flush=True)
            RESULTS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(page(kept), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
