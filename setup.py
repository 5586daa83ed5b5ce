"""What pyproject.toml cannot say: README.md with links that lead to the repository from wherever it is shown."""

import re
import tomllib
from pathlib import Path

from setuptools import setup

HERE = Path(__file__).parent
SOURCE = tomllib.loads((HERE / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]["Source"]
# A picture or a link in Markdown whose target is a file of the repository.
LINK = re.compile(r"(!?)(\[[^\]]*\])\((?!\w+:|#)([^)\s]+)\)")


def absolute(text: str) -> str:
    """Return a text in Markdown whose links and pictures are found from any address."""
    return LINK.sub(lambda link: f"{link[1]}{link[2]}({SOURCE}/{'raw' if link[1] else 'blob'}/main/{link[3]})", text)


setup(
    long_description=absolute((HERE / "README.md").read_text(encoding="utf-8")),
    long_description_content_type="text/markdown",
)
