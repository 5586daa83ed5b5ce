"""Formats of cyclers and loggers that need a package of their own, each an extra of this project."""

from __future__ import annotations

import importlib
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError, reason
from jaxmodel.case.measurements import file_label
from jaxmodel.data.tables.raw_table import RawTable, unique_names, units_in

_GPL = "galvani is under the GPL, which then holds for what you pass on"
# By the ending of a file: the package that reads it, the extra that installs it, and what to do without.
PACKAGES = {
    ".nda": ("NewareNDA", "neware", "export it as text or Excel"),
    ".ndax": ("NewareNDA", "neware", "export it as text or Excel"),
    ".mpr": ("galvani", "galvani", f"export it as text (.mpt); {_GPL}"),
    ".res": ("galvani", "galvani", f"export it as CSV or Excel; {_GPL}"),
    ".tdms": ("nptdms", "tdms", "export it as text"),
    ".mf4": ("asammdf", "mdf", "export it as CSV or Parquet"),
    ".mdf": ("asammdf", "mdf", "export it as CSV or Parquet"),
    ".dat": ("asammdf", "mdf", "export it as CSV or Parquet"),
}  # fmt: skip


def read_logger(path: Path) -> RawTable:
    """Read a file of Neware (nda, ndax), BioLogic (mpr), Arbin (res), LabVIEW (tdms) or ASAM (mf4, mdf).

    Raises:
        MeasurementError: its package is not installed, or the file is damaged.
    """
    suffix, label = path.suffix.lower(), file_label(path)
    name, extra, otherwise = PACKAGES[suffix]
    try:
        package = importlib.import_module(name)
    except ImportError:
        raise MeasurementError(
            f"{label} needs the package {name}: install jaxmodel[{extra}], or {otherwise}."
        ) from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # theirs, on how they use pandas and NumPy
            frame, remarks = _READERS[suffix](path, package)
    except MeasurementError:
        raise
    except Exception as error:  # a damaged file fails in as many ways as these packages have lines
        raise MeasurementError(f"{label} cannot be read by {name} ({reason(error)}); {otherwise}.") from error
    frame.columns = unique_names(frame.columns)
    if len(frame) == 0:
        raise MeasurementError(f"{label} holds no rows of readings; {otherwise}.")
    return RawTable(frame, units_in(frame.columns), path, suffix[1:], tuple(remarks))


def _neware(path: Path, package: Any) -> tuple[pd.DataFrame, list[str]]:
    frame = pd.DataFrame(package.read(str(path)))
    return frame, ["Read by NewareNDA."]


def _biologic(path: Path, package: Any) -> tuple[pd.DataFrame, list[str]]:
    content = package.MPRfile(str(path))
    frame = pd.DataFrame({name: np.asarray(content.data[name]).astype(float) for name in content.data.dtype.names})
    remarks = ["Read by galvani."]
    if not {"I/mA", "<I>/mA"} & {*frame} and {"time/s", "(Q-Qo)/mA.h"} <= {*frame}:
        step_s = np.diff(frame["time/s"], prepend=np.nan)
        step_s[step_s <= 0.0] = np.nan
        rate = 3600.0 * np.diff(frame["(Q-Qo)/mA.h"], prepend=np.nan) / step_s
        frame["I/mA"] = pd.Series(rate).bfill().ffill().fillna(0.0)
        remarks.append("The file has no current; 'I/mA' is the rate of its charge '(Q-Qo)/mA.h'.")
    return frame.drop(columns=[name for name in frame if str(name).startswith("control/")]), remarks


def _arbin(path: Path, package: Any) -> tuple[pd.DataFrame, list[str]]:
    import sqlite3

    convert = importlib.import_module("galvani.res2sqlite").convert_arbin_to_sqlite
    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "log.sqlite"
        convert(str(path), str(database))
        with sqlite3.connect(database) as connection:
            frame = pd.read_sql("select * from Channel_Normal_Table order by Data_Point", connection)
    return frame, ["Read by galvani, by way of mdbtools."]


def _tdms(path: Path, package: Any) -> tuple[pd.DataFrame, list[str]]:
    content = package.TdmsFile.read(path)
    groups = [group.channels() for group in content.groups() if group.channels()]
    if not groups:
        raise MeasurementError(f"{file_label(path)} has no channels; give the file that holds the readings.")
    channels = max(groups, key=lambda group: sum(len(channel) for channel in group))
    length = max(len(channel) for channel in channels)
    columns: dict[str, Any] = {}
    first = next(channel for channel in channels if len(channel) == length)
    if "wf_increment" in first.properties and first.properties["wf_increment"] > 0.0:
        columns["Time (s)"] = first.time_track()
    for channel in channels:
        if len(channel) == length:
            unit = channel.properties.get("unit_string", "")
            columns[f"{channel.name} ({unit})" if unit and "(" not in channel.name else channel.name] = channel[:]
    left = [channel.name for channel in channels if len(channel) != length]
    remarks = [f"Group '{channels[0].group_name}' was read."]
    return pd.DataFrame(columns), remarks + ([f"Not read, being of other lengths: {', '.join(left)}."] if left else [])


def _asam(path: Path, package: Any) -> tuple[pd.DataFrame, list[str]]:
    with package.MDF(str(path)) as content:
        units = {channel.name: channel.unit for group in content.groups for channel in group.channels if channel.unit}
        frame = content.to_dataframe(use_interpolation=False)
    frame = frame.rename(columns={name: f"{name} ({units[name]})" for name in frame if units.get(name)})
    frame.insert(0, "Time (s)", np.asarray(frame.index, dtype=float))
    remark = "Channels have clocks of their own; a row stands for each time of any of them, without interpolation."
    return frame.reset_index(drop=True), [remark]


_READERS = {
    ".nda": _neware, ".ndax": _neware, ".mpr": _biologic, ".res": _arbin, ".tdms": _tdms, ".mf4": _asam, ".mdf": _asam,
    ".dat": _asam,
}  # fmt: skip
