"""Make cases from measurements: LFP cells, an NCA cell in the cold, cells that warm, one that ages, two sets of motors.

Usage: python make_cases.py DATA_FOLDER OUT_FOLDER. What DATA_FOLDER holds is in README.md beside this script. The cases
are those of `python -m benchmarks.real`, which makes them with the same functions and evaluates the diagnosis on them.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks.real.cases import CASES, build


def main(source: Path, out: Path) -> None:
    """Write all cases but the one that this repository holds."""
    for case in CASES.values():
        if case.needs:
            build(case, source, out)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="folder of the measurements")
    parser.add_argument("out", type=Path, help="folder for the cases")
    arguments = parser.parse_args()
    try:
        main(arguments.source, arguments.out)
    except FileNotFoundError as error:
        parser.error(f"{error.filename} is not there; README.md beside this script says what DATA_FOLDER must hold.")
