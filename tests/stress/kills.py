"""`python -m tests.stress.kills --count 100`: kill a command at a random moment, and see what its folder holds then.

A folder with a `case.toml` must hold the whole case. The same command, run again, must leave what it would have left
undisturbed, but for times.
"""

from __future__ import annotations

import argparse
import filecmp
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from jaxmodel import read_case
from jaxmodel.base.errors import UserError
from tests.stress import seeds

# By what is killed: the words, and the words of the second run.
COMMANDS = {
    "import": (["import", "case/one.csv", "--kind", "cell", "--ambient", "25", "--out", "out"], []),
    "parameterise": (["parameterise", "case", "--out", "out"], []),
    "simulate": (["simulate", "case", "--answer-only", "--out", "out"], []),
    "compare": (["compare", "case", "--answer-only", "--out", "out"], []),
    "diagnose": (["diagnose", "case", "--out", "out"], []),
    "export": (["export", "case", "--to", "bdf", "--out", "out"], []),
    "sweep": (["sweep", "study/study.toml", "--answer-only", "--out", "out"], ["--resume"]),
}
# What differs from run to run: times, and what they are written into.
SAID_APART = {"manifest.json", "report.html", "import.json", "result.zarr", "history"}


def program(words: list[str]) -> list[str]:
    """Return what runs a command."""
    return [sys.executable, "-c", "from jaxmodel.app.cli import main; main()", *words]


def _run(words: list[str], folder: Path, after_s: float | None) -> int | None:
    """Run a command; kill it after some seconds. Return its exit code, None if it was killed."""
    process = subprocess.Popen(program(words), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        return process.wait(after_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return None


def different(one: Path, other: Path) -> list[str]:
    """Return the files that two folders do not have alike; what begins with a dot is no result."""
    names = sorted({str(path.relative_to(root)) for root in (one, other) for path in root.rglob("*") if path.is_file()})
    shown = [name for name in names if not any(part.startswith(".") for part in Path(name).parts)]
    compared = [name for name in shown if not SAID_APART & {*Path(name).parts}]
    return [
        name
        for name in compared
        if not (one / name).is_file()
        or not (other / name).is_file()
        or not filecmp.cmp(one / name, other / name, False)
    ]


def killed(name: str, after_s: float, folder: Path, whole: Path) -> list[str]:
    """Kill a command in a folder with good files, run it again, and return what is wrong."""
    words, again = COMMANDS[name]
    out, wrong = folder / "out", []
    ended = _run(words, folder, after_s)
    if (out / "case.toml").exists():
        try:
            if name == "import":
                read_case(out)
            elif [one for one in different(out, whole) if one.endswith((".toml", ".csv")) and (out / one).exists()]:
                wrong.append("a case that is not whole")
        except UserError as error:
            wrong.append(f"a case that is not whole: {error}")
    held = out.exists() and (out / "manifest.json").exists()
    code = _run([*words, *(again if held and ended is None else [])], folder, None) if ended != 0 else 0
    if code != 0:
        wrong.append(f"the second run left with {code}")
    else:
        wrong += [f"{one} differs" for one in different(out, whole)]
    shutil.rmtree(out, ignore_errors=True)
    return wrong


def main() -> int:
    """Kill each command so many times; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--command", action="append", choices=list(COMMANDS))
    given = parser.parse_args()
    rng, failed = random.Random(given.seed), 0
    with tempfile.TemporaryDirectory(prefix="kills") as name:
        folder = Path(name)
        for made, files in seeds.folders().items():
            (folder / made).mkdir()
            for file, content in files.items():
                (folder / made / file).write_bytes(content)
        for command in given.command or COMMANDS:
            began = time.perf_counter()
            if code := _run(COMMANDS[command][0], folder, None):
                print(f"{command}: left with {code} when nobody killed it")
                return 1
            took, whole = time.perf_counter() - began, folder / f"whole {command}"
            os.replace(folder / "out", whole)
            found = []
            for _ in range(given.count):
                at = rng.uniform(0.2 * took, 1.1 * took)
                wrong = killed(command, at, folder, whole)
                if wrong:
                    found.append(wrong)
                    print(f"  {command}, killed after {at:.2f} of {took:.2f} s: {wrong[:3]}", flush=True)
            failed += len(found)
            print(f"{command}: {given.count} kills, {len(found)} with something wrong", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
