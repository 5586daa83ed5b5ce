"""HTML pages that need nothing but themselves: styles and pictures are inside."""

from __future__ import annotations

import base64
import functools
from pathlib import Path
from typing import Any

import jinja2

from jaxmodel.base.atomic_files import write_whole


def write_page(path: Path, template: str, **content: Any) -> None:
    """Fill a template of `templates/` and write it; text is escaped, pictures are given as PNG."""
    write_whole(path, _environment().get_template(template).render(**content))


@functools.cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("jaxmodel.app"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["png"] = _embedded
    environment.filters["breakable"] = _breakable
    return environment


def _breakable(name: str) -> str:
    """Return a name that may break at its underscores, as a long one must."""
    return name.replace("_", "_\u200b")


def _embedded(picture: bytes) -> str:
    """Return a PNG as a data address."""
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
