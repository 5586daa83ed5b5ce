"""Names of a package that are imported when they are first asked for, so that a program loads what it uses."""

from __future__ import annotations

import ast
import functools
import importlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any


def names_when_used(package: str, file: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Return the `__getattr__` and `__dir__` of a package: what it imports under TYPE_CHECKING comes when it is used.

    So its source lists its names once, for readers, for type checkers and for this. No submodule may have the name of
    something that is imported from it: it would stand in its place.

    Args:
        package: its `__name__`.
        file: its `__file__`.
    """

    @functools.cache
    def places() -> dict[str, tuple[str, str]]:
        blocks = [node for node in ast.parse(Path(file).read_text(encoding="utf-8")).body if isinstance(node, ast.If)]
        imports = [node for block in blocks for node in block.body if isinstance(node, ast.ImportFrom) and node.module]
        return {one.asname or one.name: (str(node.module), one.name) for node in imports for one in node.names}

    def get(name: str) -> Any:
        if name not in places():
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        module, original = places()[name]
        # As `from module import original` does: a name of the module, or else a module inside it.
        inside = vars(importlib.import_module(module))
        value = inside[original] if original in inside else importlib.import_module(f"{module}.{original}")
        setattr(sys.modules[package], name, value)
        return value

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *places()})

    return get, names
