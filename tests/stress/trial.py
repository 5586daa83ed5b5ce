"""One trial: a folder of good files, one of them spoilt, read in this process within limits of time and memory."""

from __future__ import annotations

import contextlib
import dataclasses
import random
import re
import resource
import shutil
import signal
import traceback
import warnings
from collections.abc import Iterator
from pathlib import Path

from jaxmodel.base.errors import UserError
from tests.stress.mutators import spoilt
from tests.stress.readers import READERS, Reader

SECONDS, BYTES = 20, 3 * 2**30
# What a sentence for a person does not hold: names of Python's types and errors.
_LEAKS = re.compile(r"Traceback|\w+Error\b|object at 0x|Input should|NoneType|invalid literal|errno")
_MENDS = re.compile(
    r"(?i)Did you mean|;|\b(add|allow|change|check|convert|correct|drop|export|fill|give|install|keep|leave|look|must|"
    r"name|needs|put|remove|rename|save|set|slow|state|takes?|turn|use|write)\b"
)


class TooLong(BaseException):
    """A reader took more seconds than a person would wait for a sentence."""


@dataclasses.dataclass(frozen=True)
class Ended:
    """How a trial ended.

    Attributes:
        how: "read", "refused" or "broke".
        what: the sentence, or what broke.
        files: as they were read.
    """

    how: str
    what: str
    files: dict[str, bytes]


def trial(name: str, seed: int, folder: Path) -> Ended:
    """Spoil a file of a reader's folder and read it."""
    rng, reader = random.Random(f"{name} {seed}"), READERS[name]
    files = dict(reader.files())
    chosen = rng.choice([file for file in files if reader.spoils(file)])
    files[chosen] = spoilt(files[chosen], reader.mutators, rng)
    return read(reader, files, folder)


def read(reader: Reader, files: dict[str, bytes], folder: Path) -> Ended:
    """Write files to an empty folder and read them."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    try:
        with _limits(), warnings.catch_warnings():
            warnings.simplefilter("error")
            reader.read(folder)
    except UserError as error:
        wrong = faults(str(error), [*files, folder.name], reader.label)
        return Ended("broke", f"sentence {wrong}: {error}", files) if wrong else Ended("refused", str(error), files)
    except (Exception, TooLong, MemoryError) as error:
        place = traceback.extract_tb(error.__traceback__)
        ours = [frame for frame in place if ".venv" not in frame.filename and "/lib/python" not in frame.filename]
        at = ours[-1] if ours else place[-1]
        return Ended("broke", f"{type(error).__name__} at {at.filename}:{at.lineno}: {str(error)[:300]}", files)
    finally:
        emptied(folder)
    return Ended("read", "", files)


def emptied(folder: Path) -> None:
    """Remove what is in a folder."""
    for path in folder.iterdir():
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def faults(sentence: str, names: list[str], label: str = "") -> str:
    """Return what is wrong with a sentence for a person; "" if it is one, with place and mend."""
    if not sentence.isprintable() or sentence != " ".join(sentence.split()):
        return "has control characters or line ends"
    if not sentence.endswith((".", "?")):
        return "does not end"
    if len(sentence) > 1000:
        return "is too long"
    if found := _LEAKS.search(sentence):
        return f"has {found[0]!r}"
    if not any(name in sentence for name in (*names, *([label] if label else []))):
        return "names no place"
    return "" if _MENDS.search(sentence) else "says nothing to do"


@contextlib.contextmanager
def _limits() -> Iterator[None]:
    """Allow so many seconds, and so much memory more than there is."""

    def late(*_: object) -> None:
        raise TooLong(f"after {SECONDS} s")

    before = signal.signal(signal.SIGALRM, late)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    resource.setrlimit(resource.RLIMIT_AS, (used + BYTES, hard))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGALRM, before)
