"""The schema of files that are read again: cases, studies, missions, presets, tunings, manifests, answers.

One number counts for all. A file without it has schema 1. It grows when a file that was valid would be read otherwise,
and then this module converts the older ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from jaxmodel.base.errors import MeasurementError

SCHEMA = 1
KEY = "schema"


def with_schema(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a file holds with the schema it is written in, first."""
    return {KEY: SCHEMA, **content}


def without_schema(content: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return what a file holds without its schema.

    Args:
        content: of the file.
        where: its name in messages.

    Raises:
        MeasurementError: a newer version wrote it, or its schema is no whole number from 1 on.
    """
    schema = content.get(KEY, SCHEMA)
    if not isinstance(schema, int) or isinstance(schema, bool) or schema < 1:
        raise MeasurementError(f"{where}: {KEY} must be a whole number from 1 on; remove it, or write {SCHEMA}.")
    if schema > SCHEMA:
        raise MeasurementError(
            f"{where} has {KEY} {schema}, and this version reads up to {SCHEMA}; update with "
            "`pip install --upgrade jaxmodel`."
        )
    return {name: entry for name, entry in content.items() if name != KEY}
