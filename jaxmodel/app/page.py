"""HTML pages that need nothing but themselves: styles and pictures are inside."""

from __future__ import annotations

import base64
import functools
import re
from pathlib import Path
from typing import Any

import jinja2

from jaxmodel.base.atomic_files import write_whole

_HARD_SPACE = "\u00a0"
# Units as pages write them, alone or over another, and those of two words.
_ONE = r"[mµkM]?(?:V|A|W|J|K|s|C|F|ohm|Hz|N|h)"
_UNIT = rf"(?:{_ONE}(?:/(?:{_ONE}|mol))?(?: (?:m|h|s)(?:/A)?\b)?|rad/s|°C?|degC|min|%|sd|kg|g)"
# A number with its unit, with its sd, or with both.
_WITH_NUMBER = re.compile(rf"\d(?: ± [\d.,]+(?:e[+-]?\d+)?)?(?: {_UNIT}(?!\w))|\d ± (?=\d)")


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
        finalize=_unbroken,
    )
    environment.filters["png"] = _embedded
    environment.filters["breakable"] = _breakable
    return environment


def _unbroken(value: Any) -> Any:
    """Return what is written on a page; in a text, numbers do not part from their units, sds and signs."""
    if not isinstance(value, str) or hasattr(value, "__html__"):  # markup is whole already
        return value
    return _WITH_NUMBER.sub(lambda found: found[0].replace(" ", _HARD_SPACE), value)


def _breakable(name: str) -> str:
    """Return a name that may break at its underscores, as a long one must."""
    return name.replace("_", "_\u200b")


def _embedded(picture: bytes) -> str:
    """Return a PNG as a data address."""
    return "data:image/png;base64," + base64.b64encode(picture).decode("ascii")
