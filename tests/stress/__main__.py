"""`python -m tests.stress --count 2000 --seed 7`: spoil files of every form, and show what breaks a reader."""

from __future__ import annotations

import argparse
import collections
import sys
import tempfile
import time
from pathlib import Path

from tests.stress.readers import READERS
from tests.stress.trial import trial


def main() -> int:
    """Run the trials; return 1 if one broke a reader."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2000, help="trials of each reader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--reader", action="append", choices=list(READERS), help="this one only; repeatable")
    parser.add_argument("--sentences", action="store_true", help="print every sentence once")
    parser.add_argument("--keep", type=Path, help="folder for the files that broke a reader")
    given = parser.parse_args()
    broke = 0
    with tempfile.TemporaryDirectory(prefix="stress") as folder:
        for name in given.reader or READERS:
            began, ends, seen = time.perf_counter(), collections.Counter(), collections.Counter()
            for number in range(given.count):
                seed = given.seed * 1_000_000 + number
                ended = trial(name, seed, Path(folder))
                ends[ended.how] += 1
                shape = f"{ended.how} {''.join(c for c in ended.what if not c.isdigit())[:100]}"
                seen[shape] += 1
                if ended.how == "broke" and seen[shape] == 1:
                    print(f"  {name}, seed {seed}: {ended.what}", flush=True)
                    if given.keep:
                        for file, content in ended.files.items():
                            kept = given.keep / f"{name}-{seed}" / file
                            kept.parent.mkdir(parents=True, exist_ok=True)
                            kept.write_bytes(content)
                elif given.sentences and ended.how == "refused" and seen[shape] == 1:
                    print(f"  {name}: {ended.what}")
            broke += ends["broke"]
            took = time.perf_counter() - began
            print(f"{name}: {dict(ends)} in {took:.0f} s", flush=True)
    return int(broke > 0)


if __name__ == "__main__":
    sys.exit(main())
