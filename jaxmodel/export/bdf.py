"""The runs of a cell in the Battery Data Format of the Battery Data Alliance, a CSV file for each.

Labels and units are fixed by the format; its current is positive on charge. Source of the labels: the repository
battery-data-alliance/battery-data-format.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from jaxmodel.base.errors import ParameterError
from jaxmodel.case.exported import Exported
from jaxmodel.case.records import Case, Run

# Label of each column that the format has, in the order of its list: required ones first.
LABELS = {
    "voltage_V": "Voltage / V",
    "current_A": "Current / A",
    "ambient_degC": "Ambient Temperature / degC",
    "cell_temperature_degC": "Surface Temperature T1 / degC",
}
TIME = "Test Time / s"


def export_bdf(case: Case) -> Exported:
    """Return a file for each run that reads a voltage: time in s, voltage in V, current in A, temperatures in degC.

    Numbers are those of the case to the last digit; the current is positive on charge, other than in the case. A
    missing reading is an empty field.

    Args:
        case: of a cell.

    Raises:
        ParameterError: the case is of a motor or robot, or no run reads the voltage.
    """
    if case.kind != "cell":
        raise ParameterError(f"{case.label}: the Battery Data Format is of single cells, and this is a {case.kind}.")
    read = [run for run in case.runs if "voltage_V" in run.measured.outputs]
    if not read:
        raise ParameterError(f"{case.label}: no run reads the voltage, which the Battery Data Format requires.")
    files = {f"{run.name}.bdf.csv": _table(run).to_csv(index=False, lineterminator="\n") for run in read}
    return Exported("", _left_out(case, read), files)


def _table(run: Run) -> pd.DataFrame:
    columns = {**run.measured.inputs, **run.measured.outputs}
    columns["current_A"] = 0.0 - columns["current_A"]
    return pd.DataFrame(
        {TIME: run.measured.time_s, **{label: columns[name] for name, label in LABELS.items() if name in columns}}
    )


def _left_out(case: Case, read: list[Run]) -> tuple[str, ...]:
    said = ["Parameters, tables and noise of the cell, and what single runs state (initial_soc, fit or check, label)."]
    others = [run.name for run in case.runs if run not in read]
    if others:
        said.append(f"Runs that read no voltage: {', '.join(others)}.")
    with_soc = [run.name for run in read if np.isfinite(run.measured.outputs.get("soc", np.nan)).any()]
    if with_soc:
        said.append(f"The state of charge that {', '.join(with_soc)} reads: the format has no column for it.")
    return tuple(said)
