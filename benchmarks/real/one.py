"""One case, diagnosed in a process of its own: `python -m benchmarks.real.one CASE` prints the answer as JSON.

So the time is that of a user who starts anew, compiling included, and all memory is given back.
"""

from __future__ import annotations

import json
import os
import resource
import sys
from pathlib import Path
from typing import Any

from benchmarks.apart import run_apart

KEPT_PROGRAMS = ("JAX_COMPILATION_CACHE_DIR", "JAXMODEL_CACHE")


def said_of(folder: Path) -> dict[str, Any]:
    """Return the answer of the diagnosis on a case: the one place that knows where the diagnosis lives."""
    from jaxmodel.case.reading import read_case
    from jaxmodel.diagnosis import diagnose

    return diagnose(read_case(folder)).answer()


def diagnose_apart(folder: Path, limit_s: float) -> dict[str, Any]:
    """Return the answer on a case from a process of its own, with `seconds` and `peak_MiB`; or `failed`, why not."""
    environment = {name: value for name, value in os.environ.items() if name not in KEPT_PROGRAMS}
    said = run_apart("benchmarks.real.one", [str(folder.resolve())], limit_s, environment)
    seconds = min(said.seconds, limit_s)
    if said.failed:
        return {"failed": said.complaint, "seconds": seconds}
    return json.loads(said.output.strip().splitlines()[-1]) | {"seconds": seconds}


def main(folder: Path) -> None:
    """Print the answer on a case, on one line."""
    said = said_of(folder)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (2**20 if sys.platform == "darwin" else 2**10)
    print(json.dumps(said | {"peak_MiB": peak}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
