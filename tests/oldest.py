"""`python tests/oldest.py`: the oldest releases that pyproject.toml allows, as a constraints file."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path


def oldest(pyproject: str) -> list[str]:
    """Return a line `name==version` for each dependency, wanted or optional, with a lower bound."""
    project = tomllib.loads(pyproject)["project"]
    wanted = [*project["dependencies"], *(one for some in project["optional-dependencies"].values() for one in some)]
    found = [re.match(r"([\w.-]+)(?:\[[^]]*\])?>=([\w.]+)(?:,<[\w.]+)?$", one) for one in wanted]
    return sorted({f"{one[1]}=={one[2]}" for one in found if one})


if __name__ == "__main__":
    print("\n".join(oldest(Path("pyproject.toml").read_text(encoding="utf-8"))))
