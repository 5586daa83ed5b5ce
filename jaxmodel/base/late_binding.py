"""Methods of records whose work is done above them: `late_bound("package.module:function")`.

A record, such as a case or a diagnosis, stands below what reads, writes, says and draws it, and imports none of that.
Its users still call `case.write(folder)` and `diagnosis.plot.ladder()`. Such a method has its name, arguments and
docstring in the record, where editors and type checkers find them, and its body names the function that does the work,
in the form of an entry point. The module is imported at the call, so that a program loads what it uses.

Only for methods of records: all else imports what it needs. tests/test_architecture.py holds that each name is there,
stands above the record, and takes these arguments.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any


def late_bound(name: str) -> Callable[..., Any]:
    """Return the function of a name such as "jaxmodel.plots.evidence:ladder"."""
    module, _, function = name.partition(":")
    return getattr(importlib.import_module(module), function)
