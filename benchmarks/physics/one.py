"""One case in a process of its own: `python -m benchmarks.physics.one CASE OUT.json [--reference]`.

The one place of this benchmark that calls the diagnosis, or the reference of `benchmarks.real`.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from jaxmodel.base.atomic_files import write_whole

ROOT = Path(__file__).parents[2]
# What an answer depends on beside the case, and the reference.
CODE_OF_ANSWERS, CODE_OF_REFERENCES = ("jaxmodel",), ("benchmarks/real", "jaxmodel/case")


def diagnosed(folder: Path) -> dict[str, Any]:
    """Return the answer of the diagnosis on a case, with the held-out error of every model tried in `ladder`."""
    from jaxmodel.base.jax_settings import keep_compiled_programs
    from jaxmodel.case.reading import read_case
    from jaxmodel.diagnosis import diagnose

    keep_compiled_programs()
    found = diagnose(read_case(folder))
    ladder = [
        {
            "name": rung.name,
            "added": list(rung.added),
            "error": {channel: {"fit": error.fit, "check": error.check} for channel, error in rung.errors.items()},
        }
        for rung in found.ladder
    ]
    return found.answer() | {"ladder": ladder}


def referred(folder: Path) -> dict[str, Any]:
    """Return the errors of the reference by channel and split."""
    from benchmarks.real.reference import reference
    from jaxmodel.case.reading import read_case

    found = reference(read_case(folder))
    return {"errors": found.errors}


def code(parts: tuple[str, ...]) -> str:
    """Return what tells whether the source of some folders has changed."""
    files = sorted(path for part in parts for path in (ROOT / part).rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def contents(folder: Path) -> str:
    """Return what tells whether a case has changed."""
    files = sorted(folder.glob("*.toml")) + sorted(folder.glob("*.csv"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()[:16]


def known(out: Path, of: str) -> dict[str, Any]:
    """Return what was found before of the same code and case; nothing where there is none, or it failed."""
    found = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {}
    return found if found.get("of") == of and "failed" not in found else {}


def apart(folder: Path, out: Path, of: str, limit_s: float, *, refer: bool = False) -> dict[str, Any]:
    """Diagnose a case, or fit the reference to it, in a process of its own, and keep what it says with `seconds`.

    Args:
        folder: of the case.
        out: the file that keeps it; of one that failed it has `failed`, why.
        of: what tells code and case.
        limit_s: a process that takes longer is ended.
        refer: whether the reference is asked.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    out.unlink(missing_ok=True)
    command = [sys.executable, "-m", "benchmarks.physics.one", str(folder.resolve()), str(out.resolve())]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    began = time.perf_counter()
    try:
        done = subprocess.run(
            [*command, *(("--reference",) if refer else ())],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=limit_s,
        )
        complaint = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
    except subprocess.TimeoutExpired:
        complaint = f"not done after {limit_s:.0f} s"
    said: dict[str, Any] = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {"failed": complaint}
    said |= {"seconds": round(time.perf_counter() - began, 1), "of": of}
    write_whole(out, json.dumps(said, indent=1) + "\n")
    return said


def plain(what: Any) -> Any:
    """Return it with null for numbers that do not exist: JSON has no NaN."""
    if isinstance(what, dict):
        return {name: plain(value) for name, value in what.items()}
    if isinstance(what, list | tuple):
        return [plain(value) for value in what]
    return None if isinstance(what, float) and not math.isfinite(what) else what


def main(folder: Path, out: Path, refer: bool) -> None:
    """Write what the diagnosis or the reference says of a case."""
    write_whole(out, json.dumps(plain(referred(folder) if refer else diagnosed(folder))) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), "--reference" in sys.argv[3:])
