"""`python -m tests.stress.words --count 500`: spoil the words of every command, and show what breaks one.

A command with words that are good by chance does its work; it is stopped after some seconds, which breaks nothing.
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import os
import random
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

import click
import typer
from typer.testing import CliRunner

from jaxmodel.app.cli import app
from jaxmodel.app.one_sentence import MISTAKE
from tests.stress import seeds
from tests.stress.mutators import NUMBERS, TEXTS
from tests.stress.trial import emptied, faults

SECONDS = 5.0
# What stands for an argument of a command, in a folder with the files of `seeds`.
GOOD = {"case": "case", "study": "study/study.toml", "files": "case/one.csv", "mission": "mission/mission.toml"}
WORDS = (*NUMBERS, *TEXTS, "-1", "--", "-x", "--out", "--no-such", "CASE", "one.csv:voltage_V", "a.py:B", "1e400 GiB")


class _Late(BaseException):
    """The command works; its words are good."""


@dataclasses.dataclass(frozen=True)
class Said:
    """How a command ended: its words, exit code (None: it was still at work), what is wrong with it, its last line."""

    words: tuple[str, ...]
    code: int | None
    wrong: str
    sentence: str = ""


def commands() -> dict[str, Any]:
    """Return every command by its name; the workbench is a server and `demo` takes minutes."""
    every = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    return {name: one for name, one in every.items() if name not in ("workbench", "demo")}


def spoilt_words(name: str, rng: random.Random) -> list[str]:
    """Return a command with good arguments and a few options, of which one or two words are spoilt."""
    command = commands()[name]
    words = []
    for one in command.params:
        if isinstance(one, click.Argument) or one.param_type_name == "argument":
            words.append(GOOD.get(str(one.name), "case"))
    options = [one for one in command.params if one.param_type_name == "option" and one.opts and one.name != "help"]
    for one in rng.sample(options, min(len(options), rng.randrange(1, 4))):
        words.append(rng.choice(one.opts))
        if not getattr(one, "is_flag", False):
            words.append(rng.choice(WORDS))
    for _ in range(rng.randrange(0, 3)):
        match rng.randrange(3):
            case 0 if words:
                words[rng.randrange(len(words))] = rng.choice(WORDS)
            case 1 if words:
                del words[rng.randrange(len(words))]
            case _:
                words.insert(rng.randrange(len(words) + 1), rng.choice(WORDS))
    return [name, *(word.replace("\\u0000", "\0") for word in words)]


def said(words: list[str], folder: Path) -> Said:
    """Run a command in a folder, and judge how it ended."""

    def late(*_: object) -> None:
        raise _Late

    before, here = signal.signal(signal.SIGALRM, late), Path.cwd()
    os.chdir(folder)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        result = CliRunner().invoke(app, words)
    except _Late:
        return Said(tuple(words), None, "")
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        os.chdir(here)
    lines = result.stderr.strip().splitlines() or [""]
    return Said(tuple(words), result.exit_code, _wrong(result, lines[-1]), lines[-1])


def _wrong(result: Any, sentence: str) -> str:
    error = result.exception
    if error is not None and not isinstance(error, SystemExit):
        return f"{type(error).__name__}: {error}"
    if result.exit_code not in (0, 1, MISTAKE):
        return f"exit code {result.exit_code}"
    if result.exit_code != MISTAKE:
        return ""
    if not sentence:
        return "exit code 2 without a sentence"
    found = faults(sentence, [""])
    return f"sentence {found}: {sentence}" if found else ""


def trial(name: str, seed: int, folder: Path) -> Said:
    """Spoil the words of a command and run it among good files."""
    rng = random.Random(f"{name} {seed}")
    for made, files in seeds.folders().items():
        (folder / made).mkdir(parents=True, exist_ok=True)
        for file, content in files.items():
            (folder / made / file).write_bytes(content)
    try:
        return said(spoilt_words(name, rng), folder)
    finally:
        emptied(folder)


def main() -> int:
    """Run the trials; return 1 if one broke a command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200, help="trials of each command")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--command", action="append", choices=list(commands()), help="this one only; repeatable")
    given = parser.parse_args()
    broke = 0
    with tempfile.TemporaryDirectory(prefix="stress") as folder:
        for name in given.command or commands():
            codes, seen = collections.Counter(), set()
            for number in range(given.count):
                ended = trial(name, given.seed * 1_000_000 + number, Path(folder))
                codes[ended.code] += 1
                broke += bool(ended.wrong)
                shape = "".join(c for c in ended.wrong if not c.isdigit())[:80]
                if ended.wrong and shape not in seen:
                    seen.add(shape)
                    print(f"  {' '.join(map(repr, ended.words))[:400]}: {ended.wrong[:400]}", flush=True)
            print(f"{name}: exit codes {dict(codes)}", flush=True)
    return int(broke > 0)


if __name__ == "__main__":
    sys.exit(main())
