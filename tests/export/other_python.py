"""The Python that has another tool: this one, or the one that an environment variable names."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

_HERE = Path(__file__).parent


def run_by(tool: str, program: str, *words: str | Path) -> Any:
    """Run a program of this folder where a tool is installed, and return what it prints, read as JSON.

    The test is skipped where neither this Python nor that of the variable JAXMODEL_PYTHON_OF_<TOOL> has the tool.
    """
    variable = f"JAXMODEL_PYTHON_OF_{tool.upper()}"
    python = os.environ.get(variable) or (sys.executable if importlib.util.find_spec(tool) else None)
    if python is None:
        pytest.skip(f"{tool} is not installed; {variable} may name a Python that has it")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [python, str(_HERE / program), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])
