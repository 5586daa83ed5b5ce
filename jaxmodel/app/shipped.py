"""The examples that commands use: data of the package, in the repository a link to its folder examples/."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

EXAMPLES = Path(str(resources.files("jaxmodel") / "examples"))
