"""The lanes of a result as one Parquet file, block by block: there may be more of them than memory."""

from __future__ import annotations

import itertools
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import xarray as xr

from jaxmodel.base.atomic_files import flush

# Lanes that are in memory at a time, at most.
_LANES_AT_ONCE = 2**18


def to_parquet(dataset: xr.Dataset, path: str | Path) -> Path:
    """Write a result as a Parquet file with a row for each lane: axes or drawn values, metrics and status.

    A column has `units` and `long_name` in its metadata, and the file `title`, `kind` and `manifest`. Columns over time
    are left out: the Zarr store has them.

    Args:
        dataset: a result of `run` or `load`.
        path: the file; one that is there is replaced once the new one is whole.

    Returns:
        The file.

    Raises:
        OSError: it cannot be written.

    Example:
        >>> import tempfile
        >>> import pandas as pd
        >>> from jaxmodel import sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.0, 3.0]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> result = sweeps.run(study, progress=False)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = sweeps.to_parquet(result, f"{folder}/lanes.parquet")
        ...     print(pd.read_parquet(path).round(4).to_dict("list"))
        {'capacity_Ah': [2.0, 3.0], 'final_soc': [0.7994, 0.8663], 'status': [0, 0]}
    """
    path = Path(path)
    lanes = dataset.drop_dims("time_s") if "time_s" in dataset.dims else dataset
    axes = [str(name) for name in lanes["status"].dims]
    names = [*dict.fromkeys([*axes, *map(str, lanes.coords), *map(str, lanes.data_vars)])]
    names = [name for name in names if name in lanes.variables]  # `lane` of a sample has no values
    schema = pa.schema(
        [pa.field(name, pa.from_numpy_dtype(lanes[name].dtype), metadata=_said(lanes[name].attrs)) for name in names],
        metadata=_said(lanes.attrs),
    )
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with pq.ParquetWriter(aside, schema, compression="zstd") as writer:
            for block in _blocks(lanes, axes):
                table = block.to_dataframe(axes).reset_index()
                writer.write_table(pa.table([table[name].to_numpy() for name in names], schema=schema))
        flush(aside)
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
    flush(path.parent)
    return path


def _said(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Return attributes as metadata of Parquet, which is text."""
    return {name: value if isinstance(value, str) else json.dumps(value.tolist()) for name, value in attributes.items()}


def _blocks(lanes: xr.Dataset, axes: Sequence[str]) -> Iterator[xr.Dataset]:
    """Give the lanes in their order: whole in the last axes, one after the other in those before."""
    sizes = {name: lanes.sizes[name] for name in axes}
    rows, steps = _LANES_AT_ONCE, {}
    for name in reversed(sizes):
        steps[name] = max(1, min(rows, sizes[name]))
        rows //= steps[name]
    firsts = itertools.product(*(range(0, size, steps[name]) for name, size in sizes.items()))
    for first in firsts:
        yield lanes.isel({name: slice(at, at + steps[name]) for name, at in zip(sizes, first, strict=True)})
