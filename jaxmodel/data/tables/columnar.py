"""Tables of Parquet and Feather (Arrow) files, by pyarrow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from jaxmodel.base.errors import MeasurementError
from jaxmodel.case.measurements import file_label
from jaxmodel.case.run_csv import worth_threads
from jaxmodel.data.tables.delimited import Keep
from jaxmodel.data.tables.raw_table import RawTable, unique_names, units_in

_MOST_NUMBERS = 500_000_000  # 4 GB


def read_columnar(path: Path, keep: Keep | None = None, rows: int | None = None) -> RawTable:
    """Read a Parquet or Feather file.

    Args:
        path: the file.
        keep: chooses from the names of the columns those to be read; by default all.
        rows: the most rows to read.

    Raises:
        MeasurementError: the file is damaged.
    """
    import pyarrow as pa
    import pyarrow.feather as feather
    import pyarrow.parquet as parquet

    try:
        if path.suffix.lower() in (".parquet", ".pq"):
            head = parquet.read_metadata(path)
            names = head.schema.to_arrow_schema().names
            wanted = list(names if keep is None else keep(names))
            _refuse_too_many(head.num_rows * len(wanted), path)
            table = parquet.read_table(path, columns=wanted, use_threads=worth_threads(path))
        else:
            table = feather.read_table(path, memory_map=False, use_threads=worth_threads(path))
            names = table.column_names
            wanted = list(names if keep is None else keep(names))
            table = table.select(wanted)
    except UnicodeDecodeError as error:
        raise MeasurementError(
            f"{file_label(path)} cannot be read (a name in it is not UTF-8); export it again."
        ) from error
    except (pa.ArrowException, OSError) as error:
        what = str(error).splitlines()[0].rstrip(". ")
        raise MeasurementError(f"{file_label(path)} cannot be read ({what}); export it again.") from error
    table = table if rows is None else table.slice(0, rows)
    columns = {name: _column(table.column(name)) for name in wanted}
    stated = _units(table)
    index = {name: f"{name}" for name in columns}
    frame = pd.DataFrame(dict(zip(unique_names(index.values()), columns.values(), strict=True)), copy=False)
    left_out = tuple(name for name in names if name not in wanted)
    return RawTable(frame, units_in(frame.columns) | stated, path, path.suffix[1:].lower(), left_out=left_out)


def _refuse_too_many(numbers: int, path: Path) -> None:
    """Raise MeasurementError for more numbers than memory holds: equal ones take no room in the file."""
    if numbers > _MOST_NUMBERS:
        raise MeasurementError(
            f"{file_label(path)} has {numbers:,} numbers, for which there is no memory; export a part of them."
        )


def _units(table: Any) -> dict[str, str]:
    """Return the units that fields of the file's schema state."""
    found = {}
    for field in table.schema:
        for key, value in (field.metadata or {}).items():
            if key.lower() in (b"unit", b"units"):
                found[field.name] = value.decode(errors="replace")
    return found


def _column(column: Any) -> np.ndarray | pd.Series:
    import pyarrow as pa

    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type) or pa.types.is_decimal(column.type):
        return column.cast(pa.float64()).to_numpy()
    if pa.types.is_duration(column.type):
        return column.cast(pa.duration("ns")).cast(pa.int64()).cast(pa.float64()).to_numpy() * 1e-9
    return column.to_pandas(use_threads=False)
