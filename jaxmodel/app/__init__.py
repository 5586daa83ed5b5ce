"""Command line, report and web page: the only package that talks to people.

from jaxmodel.app import write_report

write_report(diagnosis, "results")  # report.html, one page that opens offline, and its pictures
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jaxmodel.app.report import write_report

__all__ = ["write_report"]


def __getattr__(name: str) -> Any:
    """Load the report when it is asked for: `jaxmodel --help` must not wait for what draws it."""
    if name == "write_report":
        from jaxmodel.app.report import write_report

        return write_report
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
