"""`python -m tests.stress.writes --count 100`: kill a process while it writes a result, and see what the folder holds.

The result is there before; only its writing is disturbed: the process ends with the n-th file that it opens, renames or
removes, or some moments later. A file that is there must be whole: the one of an undisturbed writing, or the one that
was there before. Written again undisturbed, the folder must hold what it would have held.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path

from jaxmodel import sensitivity
from jaxmodel.app.commands.simulate import write_csv
from jaxmodel.app.report import write_report
from jaxmodel.case.reading import read_case
from jaxmodel.case.simulation import simulate_case
from jaxmodel.sweeps import Study
from tests.made_up import diagnosis_of, write_case

Write = Callable[[Path], object]
_TOUCHES = ("open", "os.rename", "os.remove", "os.mkdir", "os.rmdir", "shutil.rmtree")
# What a page says of the moment at which it was made.
_MOMENT = re.compile(rb"\d{4}-\d\d-\d\d[ T]\d\d:\d\d(:\d\d)?|\d+(\.\d+)? s\b")


def results(folder: Path) -> dict[str, Write]:
    """Return what writes a result, by the command that does so."""
    case = read_case(write_case(folder / "small"))
    diagnosis, (run, *_) = diagnosis_of(case), simulate_case(case)
    profile = {"duration_s": 60.0, "step_s": 10.0, "ambient_degC": 20.0, "current_A": 1.0}
    study = Study(kind="cell", profile=profile, axes={"capacity_Ah": [2.5]}, metrics=["final_soc"])
    local = sensitivity.local(study)

    def diagnose(out: Path) -> None:
        diagnosis.write(out, pictures=False)
        write_report(diagnosis, out)

    def simulate(out: Path) -> None:
        out.mkdir(parents=True, exist_ok=True)
        write_csv(run, out / "run.csv")

    return {
        "diagnose": diagnose,
        "simulate": simulate,
        "case": lambda out: case.write(out),
        "sensitivity": lambda out: sensitivity.save(local, out),
    }


def _dies(write: Write, out: Path, touch: int, after_s: float) -> int:
    """Write in a process of its own that kills itself; return how many files it touched if it lived."""
    read, tell = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of JAX's threads, which what is written does not need
        child = os.fork()
    if not child:
        touched = 0

        def count(event: str, arguments: tuple) -> None:
            nonlocal touched
            if event not in _TOUCHES or str(out) not in str(arguments[0]):
                return
            if event == "open" and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
                return
            touched += 1
            if touched == touch:
                if after_s:
                    threading.Timer(after_s, os.kill, (os.getpid(), signal.SIGKILL)).start()
                else:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        signal.alarm(120)
        write(out)
        os.write(tell, str(touched).encode())
        os._exit(0)
    os.close(tell)
    with os.fdopen(read) as pipe:
        said = pipe.read()
    os.waitpid(child, 0)
    return int(said or 0)


def _content(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder without their moments; what begins with a dot is no result.

    The history is of the moment alone: each writing adds a file to it.
    """
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.parent.name != "history"]
    names = {str(path.relative_to(folder)): path for path in paths}
    shown = {name: path for name, path in names.items() if not any(p.startswith(".") for p in Path(name).parts)}
    return {name: _MOMENT.sub(b"", path.read_bytes()) for name, path in shown.items()}


def killed(write: Write, out: Path, whole: dict[str, bytes], touches: int, rng: random.Random) -> list[str]:
    """Kill a writing into an empty folder or over an old result; return what is wrong."""
    shutil.rmtree(out, ignore_errors=True)
    old: dict[str, bytes] = {}
    if rng.random() < 0.5:
        write(out)
        for path in [path for path in out.iterdir() if path.is_file()]:
            path.write_bytes(b"of an earlier writing\n" + path.read_bytes())
        old = _content(out)
    _dies(write, out, rng.randrange(1, touches + 1), rng.choice([0.0, rng.uniform(0.0, 0.003)]))
    left = _content(out) if out.exists() else {}
    wrong = [f"{name} is half" for name, content in left.items() if content not in (whole.get(name), old.get(name))]
    write(out)
    again = _content(out)
    return wrong + [f"{name} differs, written again" for name in whole if again.get(name) != whole[name]]


def main() -> int:
    """Kill each writing so many times; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    failed, rng = 0, random.Random(given.seed)
    with tempfile.TemporaryDirectory(prefix="writes") as name:
        folder = Path(name)
        for command, write in results(folder).items():
            out, began, found = folder / command, time.perf_counter(), []
            write(out)  # what is computed once, is; a fork has none of JAX's threads
            whole = _content(out)
            touches = _dies(write, out, 0, 0.0)
            for _ in range(given.count):
                if wrong := killed(write, out, whole, touches, rng):
                    found.append(wrong)
                    print(f"  {command}: {wrong[:3]}", flush=True)
            failed += len(found)
            took = time.perf_counter() - began
            print(
                f"{command}: {given.count} kills over {touches} files touched, {len(found)} wrong, {took:.0f} s",
                flush=True,
            )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
