"""What the tests of the workbench share: the command line."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from typer.testing import CliRunner, Result

from jaxmodel.app.cli import app

Run = Callable[..., Result]


@pytest.fixture
def run() -> Run:
    """Run the command line with arguments of any kind; returns exit code, stdout and stderr."""
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])
