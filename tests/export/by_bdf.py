"""Read files of the Battery Data Format by the package of the Battery Data Alliance, and validate them.

Run by a Python that has `batterydf`: prints the report and the columns of each file as JSON.
"""

from __future__ import annotations

import contextlib
import json
import sys

import bdf

found = {}
for path in sys.argv[1:]:
    with contextlib.redirect_stdout(sys.stderr):
        table = bdf.read(path)
        report = bdf.validate(table, report=True, raise_on_error=False)
    columns = {
        name: [None if value != value else value for value in values] for name, values in table.to_dict("list").items()
    }
    kept = {name: report[name] for name in ("ok", "missing", "extras", "legacy_labels")}
    found[path] = {"report": kept, "columns": columns, "monotonic": report["time_stats"]["monotonic"]}
print(json.dumps(found))
