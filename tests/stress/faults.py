"""`python -m tests.stress.faults --count 20`: commands without disk or memory, by a wrong clock, two at once.

A disk is full or read-only; memory is lacking at a random moment, for an array or for a file that is begun. Each must
end with its result, or with exit code 2 and one sentence. What its folder then holds must be whole, and the same
command, run again where all is well, must leave what it would have left undisturbed. Disks are mounted, for which an
administrator's rights are needed; `--fault "no memory"` needs none.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from jaxmodel.app.one_sentence import MISTAKE
from jaxmodel.base.errors import UserError
from jaxmodel.sweeps.places import LOG
from jaxmodel.sweeps.results import GRID, MANIFEST, load
from jaxmodel.sweeps.store import RUN
from tests.conftest import REPOSITORY
from tests.stress import seeds
from tests.stress.kills import COMMANDS, different, program
from tests.stress.shortage import VARIABLES
from tests.stress.trial import emptied, faults

_ROOM_KIB = 2**20
# A clock that is set while a command runs: each look is up to some months off.
_WRONG_CLOCK = """import random, time
_time, _time_ns = time.time, time.time_ns
time.time = lambda: _time() + random.choice((-1e7, 0.0, 1e7))
time.time_ns = lambda: _time_ns() + random.choice((-(10**16), 0, 10**16))
"""
_SHORT = "from tests.stress.shortage import from_environment; from_environment()"
# The last moment at which memory may run out, as a power of two: a diagnosis asks for some 2^20 arrays, and a sweep
# begins some 2^7 files.
_LAST = {"arrays": 21.0, "files": 7.5}


class Place:
    """A disk of its own, with good files beside it, on which a command writes to `disk/out`."""

    def __init__(self, folder: Path, words: list[str], again: list[str]) -> None:
        """Take the words of a command, and those that are added where it goes on."""
        self.folder, self.disk, self.out = folder, folder / "disk", folder / "disk" / "out"
        self._words = [word.replace("out", "disk/out") if word == "out" else word for word in words]
        self._again = again

    @contextlib.contextmanager
    def mounted(self, size_KiB: int = _ROOM_KIB) -> Iterator[None]:
        """Mount an empty disk of a size."""
        self.disk.mkdir(exist_ok=True)
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_KiB}k", "tmpfs", self.disk], check=True)
        try:
            yield
        finally:
            subprocess.run(["umount", self.disk], check=True)

    def remount(self, options: str) -> None:
        """Change the disk that is mounted."""
        subprocess.run(["mount", "-o", f"remount,{options}", self.disk], check=True, stderr=subprocess.DEVNULL)

    def begin(self, environment: dict[str, str] | None = None) -> subprocess.Popen[str]:
        """Start the command."""
        more = self._again if self.out.exists() and (self.out / "manifest.json").exists() else []
        return subprocess.Popen(
            program([*self._words, *more]),
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **(environment or {})},
        )

    def run(self, environment: dict[str, str] | None = None) -> tuple[int, str]:
        """Run the command; return its exit code and what it said."""
        process = self.begin(environment)
        said, _ = process.communicate()
        return process.returncode, said


def unclear(code: int, said: str) -> list[str]:
    """Return what is wrong with how a command ended."""
    if "Traceback" in said:
        return [f"a traceback: {said[-300:]}"]
    if code == 0:
        return []
    sentence = (re.split(r"\n(?=\S)", said.strip()) or [""])[-1]
    found = faults(" ".join(sentence.split()), [""])
    return [f"exit code {code}"] * (code != MISTAKE) + [f"sentence {found}: {sentence}"] * bool(found)


def half(place: Path, whole: Path) -> list[str]:
    """Return the files of a folder that are neither whole nor kept for a sweep that goes on."""
    paths = {str(path.relative_to(place)): path for path in place.rglob("*") if path.is_file()}
    found = [name for name in different(place, whole) if name in paths.keys() - {LOG, RUN}]
    shown = {name: path for name, path in paths.items() if not any(p.startswith(".") for p in Path(name).parts)}
    return [f"{name} is half" for name in (*found, *(name for name, path in shown.items() if _is_cut(path)))]


def _is_cut(path: Path) -> bool:
    """Return whether a file that differs from run to run, and so is not compared, lacks its end."""
    if path.suffix == ".json":
        try:
            json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            return True
    if path.name == MANIFEST and (path.parent / GRID).exists():
        try:
            load(path.parent).load()
        except UserError:
            return True
    return path.suffix == ".html" and not path.read_text(encoding="utf-8").rstrip().endswith("</html>")


def _still_wrong(place: Place, whole: Path) -> list[str]:
    """Run the command where all is well; return what is wrong then."""
    code, said = place.run()
    ended = [f"then exit code {code}: {said[-300:]}"] * (code != 0)
    return ended + [f"then {name}" for name in different(place.out, whole)]


def full(place: Place, whole: Path, rng: random.Random) -> list[str]:
    """Write to a disk that is too small from the start, or full from some moment on; then make room."""
    need_KiB = sum(-(-path.stat().st_size // 4096) * 4 for path in whole.rglob("*") if path.is_file())
    later = rng.random() < 0.5
    with place.mounted(_ROOM_KIB if later else rng.randrange(4, need_KiB + 2048)):
        code, said = _disturbed(place, rng, lambda: f"size={_used_KiB(place.disk) + 4}k" if later else "")
        wrong = unclear(code, said) + half(place.out, whole)
        place.remount(f"size={_ROOM_KIB}k")
        return wrong + _still_wrong(place, whole)


def read_only(place: Place, whole: Path, rng: random.Random) -> list[str]:
    """Write to a disk on which nothing can be written, from the start or from some moment on."""
    later = rng.random() < 0.5
    with place.mounted():
        place.out.mkdir()
        if not later:
            place.remount("ro")
        code, said = _disturbed(place, rng, lambda: "ro" if later else "")
        wrong = unclear(code, said) + half(place.out, whole)
        if not later and code == 0:
            wrong.append("it said nothing")
        place.remount("rw")
        return wrong + _still_wrong(place, whole)


def _used_KiB(disk: Path) -> int:
    usage = shutil.disk_usage(disk)
    return max(4, (usage.total - usage.free) // 1024)


def _disturbed(place: Place, rng: random.Random, options: Callable[[], str]) -> tuple[int, str]:
    """Run the command; change its disk after some seconds, unless it has a file open for writing just then."""
    process = place.begin()
    time.sleep(rng.uniform(0.5, 8.0))
    if changed := options():
        with contextlib.suppress(subprocess.CalledProcessError):
            place.remount(changed)
    said, _ = process.communicate()
    return process.returncode, said


def wrong_clock(place: Place, whole: Path, rng: random.Random) -> list[str]:
    """Run by a clock that is set while the command runs."""
    with place.mounted(), tempfile.TemporaryDirectory() as name:
        (Path(name) / "sitecustomize.py").write_text(_WRONG_CLOCK)
        code, said = place.run({"PYTHONPATH": os.pathsep.join([name, os.environ.get("PYTHONPATH", "")])})
        return unclear(code, said) + [f"exit code {code}"] * (code != 0) + different(place.out, whole)


def two_at_once(place: Place, whole: Path, rng: random.Random) -> list[str]:
    """Run the command twice at the same time, with one folder."""
    with place.mounted():
        first = place.begin()
        time.sleep(rng.choice([0.0, rng.uniform(0.0, 6.0)]))
        second = place.begin()
        ended = [(one.communicate()[0], one.returncode) for one in (first, second)]
        wrong = [sentence for said, code in ended for sentence in unclear(code, said)]
        if all(code for _, code in ended):
            wrong.append(f"none came to its end: {[said[-200:] for said, _ in ended]}")
        return wrong + different(place.out, whole)


def no_memory(place: Place, whole: Path, rng: random.Random) -> list[str]:
    """Run with no memory for one array, or for one file that is begun, or for none from there on."""
    what = rng.choice(list(_LAST))
    at, lasts = round(2.0 ** rng.uniform(0.0, _LAST[what])), rng.choice(["", "1"])
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "sitecustomize.py").write_text(_SHORT)
        path = os.pathsep.join([name, str(REPOSITORY), os.environ.get("PYTHONPATH", "")])
        short = dict(zip(VARIABLES, (what, str(at), lasts, str(place.out)), strict=True))
        code, said = place.run({"PYTHONPATH": path} | short)
    wrong = unclear(code, said) + half(place.out, whole) + _still_wrong(place, whole)
    emptied(place.disk)
    return [f"{what} {at}{' and after' * bool(lasts)}: {one}" for one in wrong]


FAULTS: dict[str, Callable[[Place, Path, random.Random], list[str]]] = {
    "disk full": full,
    "read-only": read_only,
    "wrong clock": wrong_clock,
    "two at once": two_at_once,
    "no memory": no_memory,
}


def main() -> int:
    """Do each fault to each command so many times; return 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--command", action="append", choices=list(COMMANDS))
    parser.add_argument("--fault", action="append", choices=list(FAULTS))
    given = parser.parse_args()
    rng, failed = random.Random(given.seed), 0
    with tempfile.TemporaryDirectory(prefix="faults") as name:
        folder = Path(name)
        for made, files in seeds.folders().items():
            (folder / made).mkdir()
            for file, content in files.items():
                (folder / made / file).write_bytes(content)
        for command in given.command or COMMANDS:
            place, whole = Place(folder, *COMMANDS[command]), folder / f"whole {command}"
            place.disk.mkdir(exist_ok=True)
            code, said = place.run()
            if code:
                print(f"{command}: left with {code} undisturbed: {said[-300:]}")
                return 1
            os.replace(place.out, whole)
            emptied(place.disk)
            for fault in given.fault or FAULTS:
                found = []
                for _ in range(given.count):
                    if wrong := FAULTS[fault](place, whole, rng):
                        found.append(wrong)
                        print(f"  {command}, {fault}: {wrong[:3]}", flush=True)
                failed += len(found)
                print(f"{command}, {fault}: {given.count} times, {len(found)} with something wrong", flush=True)
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
