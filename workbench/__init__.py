"""Command line, report and web page: the only package that talks to people.

from workbench import write_report

write_report(diagnosis, "results")  # report.html, one page that opens offline, and its pictures
"""

from workbench.report import write_report

__all__ = ["write_report"]
