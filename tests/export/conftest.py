"""What the tests of exports share: a compiler."""

from __future__ import annotations

import shutil

import pytest


@pytest.fixture(scope="session")
def cc() -> str:
    """The C compiler of this machine; a test of C is skipped where there is none."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("no C compiler is installed")
    return compiler
