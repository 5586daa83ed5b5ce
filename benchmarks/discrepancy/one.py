"""One case diagnosed in a process of its own: `python -m benchmarks.discrepancy.one FOLDER ANSWER.json`.

The one place of the proving ground that calls the diagnosis.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer

REPOSITORY = Path(__file__).parents[2]
CACHE = "JAX_COMPILATION_CACHE_DIR"
MOST_SECONDS = 900.0


def diagnose_folder(folder: Path) -> dict[str, Any]:
    """Return the answer of the diagnosis of a case."""
    from jaxmodel.case.reading import read_case
    from jaxmodel.diagnosis import diagnose

    return diagnose(read_case(folder)).answer()


def in_a_process(folder: Path, out: Path, *, cold: bool, limit_s: float = MOST_SECONDS) -> dict[str, Any]:
    """Diagnose a case in a process of its own, keep the answer and return it, with the seconds of the whole process.

    Args:
        folder: of the case.
        out: the file of the answer; of one that failed it has `error`, the last line of what was said.
        cold: whether no program compiled before may be used.
        limit_s: a process that takes longer is ended.
    """
    environment = {name: value for name, value in os.environ.items() if name != CACHE or not cold}
    command = [sys.executable, "-m", "benchmarks.discrepancy.one", str(folder.resolve()), str(out.resolve())]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.unlink(missing_ok=True)
    began = time.perf_counter()
    try:
        done = subprocess.run(
            [*command, *(() if cold else ("--warm",))],
            cwd=REPOSITORY,
            env=environment,
            capture_output=True,
            text=True,
            timeout=limit_s,
        )
        complaint = (done.stderr.strip().splitlines() or ["nothing was said"])[-1]
    except subprocess.TimeoutExpired:
        complaint = f"took more than {limit_s:g} s"
    said: dict[str, Any] = json.loads(out.read_text()) if out.exists() else {"error": complaint}
    said["seconds"] = round(time.perf_counter() - began, 2)
    out.write_text(json.dumps(said, indent=1) + "\n")
    return said


def main(folder: Path, out: Path, warm: Annotated[bool, typer.Option(help="Use programs compiled before.")] = False):
    """Diagnose a case and write its answer."""
    if warm:
        from jaxmodel.base.jax_settings import keep_compiled_programs

        keep_compiled_programs()
    out.write_text(json.dumps(diagnose_folder(folder)))


if __name__ == "__main__":
    typer.run(main)
