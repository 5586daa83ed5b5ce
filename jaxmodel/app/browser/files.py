"""The files of a session, which its worker writes and its pages read; each is replaced whole, never half written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from jaxmodel.base.atomic_files import write_whole

# What a session's folder holds.
VIEW, PROGRESS, WANTED, STOP = "view.json", "progress.json", "wanted.json", "stop"
CASE, UPLOADS, PARAMETERISED, KEPT, SWEEP = "case", "files", "parameterised", "kept", "sweep"
ANSWERS = "answers"
TRACES, PREVIEWS, CELLS = "traces", "previews", "cells"
GRID, SENSITIVITY = "grid.json", "sensitivity.json"
LOG = "worker.log"


def write_json(path: Path, content: Any) -> None:
    """Write a value as JSON, readable by the owner alone."""
    write_whole(path, json.dumps(content, separators=(",", ":")), lasting=False, mode=0o600)


def read_json(path: Path) -> Any:
    """Return the content of a JSON file; None if there is none, or if it is no JSON."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
