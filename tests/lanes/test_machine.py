"""The compiler: one that is too old is named, and nothing falls back in silence."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import llvmlite
llvmlite.__version__ = "{}"
from jaxmodel import UserError
try:
    from jaxmodel.lanes import Kernel
    print("good")
except UserError as error:
    print(error)
"""


@pytest.mark.parametrize("version", ["0.44.0", "0.9.1", "0.45.0", "0.50.0rc1", "1.0.0"])
def test_an_llvmlite_that_is_too_old_gets_a_sentence(version: str) -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM.format(version)], capture_output=True, text=True, check=True)
    old = version in ("0.44.0", "0.9.1")
    wanted = f"llvmlite {version} is too old to compile a model; install 0.45 or newer: pip install --upgrade llvmlite."
    assert done.stdout.strip() == (wanted if old else "good")
