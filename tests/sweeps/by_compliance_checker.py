"""Check netCDF files against the CF conventions by the IOOS compliance checker; print what it complains of as JSON."""

from __future__ import annotations

import contextlib
import json
import sys
import tempfile
from pathlib import Path

from compliance_checker.runner import CheckSuite, ComplianceChecker

CheckSuite.load_all_available_checkers()
found = {}
for path in sys.argv[1:]:
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(sys.stderr):
        out = Path(folder, "report.json")
        ComplianceChecker.run_checker(path, ["cf:1.11"], 0, "strict", output_filename=str(out), output_format="json")
        report = json.loads(out.read_text(encoding="utf-8"))["cf:1.11"]
    listed = [*report["high_priorities"], *report["medium_priorities"], *report["low_priorities"]]
    found[path] = {"checked": len(listed), "complaints": [said for one in listed for said in one["msgs"]]}
print(json.dumps(found))
