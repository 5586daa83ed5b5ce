"""One case in a process of its own: `python -m benchmarks.physics.one CASE OUT.json [--reference]`.

The one place of this benchmark that calls the diagnosis, or the reference of `benchmarks.real`.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

from benchmarks.apart import ROOT, plain, run_apart
from jaxmodel.base.atomic_files import write_whole

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
    words = [str(folder.resolve()), str(out.resolve()), *(("--reference",) if refer else ())]
    said = run_apart("benchmarks.physics.one", words, limit_s, os.environ | {"PYTHONPATH": str(ROOT)})
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {"failed": said.complaint}
    found |= {"seconds": round(said.seconds, 1), "of": of}
    write_whole(out, json.dumps(found, indent=1) + "\n")
    return found


def main(folder: Path, out: Path, refer: bool) -> None:
    """Write what the diagnosis or the reference says of a case."""
    write_whole(out, json.dumps(plain(referred(folder) if refer else diagnosed(folder))) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), "--reference" in sys.argv[3:])
