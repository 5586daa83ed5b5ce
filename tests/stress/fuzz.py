"""`python -m tests.stress.fuzz READER --seconds 120 --out broken`: change a reader's files where its branches show it.

Atheris (`pip install atheris`) changes the bytes of a file at random, and goes on from what took a branch of ours that
none had taken before. What breaks a reader is kept in `out`, one file for each place where it broke.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import re
import sys
import tempfile
import time
from pathlib import Path

import atheris  # type: ignore[import-not-found]

with atheris.instrument_imports(include=["jaxmodel"]):
    import jaxmodel  # first: it sets JAX up
    from tests.stress.readers import READERS
    from tests.stress.trial import read


def main() -> None:
    """Fuzz one reader, all its files by turns, and print what broke."""
    assert jaxmodel.__name__
    parser = argparse.ArgumentParser()
    parser.add_argument("reader", choices=READERS)
    parser.add_argument("--seconds", type=int, default=120)
    parser.add_argument("--out", type=Path, default=Path("broken"))
    asked = parser.parse_args()
    reader, good = READERS[asked.reader], dict(READERS[asked.reader].files())
    names = [name for name in good if reader.spoils(name)]
    places: set[str] = set()
    tried = {"read": 0, "refused": 0, "broke": 0}
    until = time.monotonic() + asked.seconds
    asked.out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as room:
        folder, seeds = Path(room) / "files", Path(room) / "seeds"
        folder.mkdir()
        seeds.mkdir()
        for number, name in enumerate(names):  # the first byte says which file it is
            (seeds / str(number)).write_bytes(bytes([number]) + good[name])

        def one(data: bytes) -> None:
            name = names[(data[0] if data else 0) % len(names)]
            if time.monotonic() > until:  # libFuzzer, once it ends, says nothing and returns to nobody
                print(f"{asked.reader}: {tried}, broke at {len(places)} places", flush=True)
                os._exit(int(bool(places)))
            ended = read(reader, good | {name: data[1:]}, folder)
            tried[ended.how] += 1
            place = re.sub(r"[\d'\"].*", "", ended.what) if ended.how == "broke" else ""
            if place and place not in places:
                places.add(place)
                kept = asked.out / f"{asked.reader} {hashlib.sha256(data).hexdigest()[:8]} {name}".replace(" ", "_")
                kept.write_bytes(data[1:])
                print(f"{kept.name}: {ended.what}", flush=True)

        longest = max(len(good[name]) for name in names) + 4096
        arguments = [f"-max_len={longest}", "-timeout=60", "-rss_limit_mb=0"]
        atheris.Setup([sys.argv[0], str(seeds), *arguments, "-print_final_stats=0", "-verbosity=0"], one)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
