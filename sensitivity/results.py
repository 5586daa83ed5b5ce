"""The result of an analysis as tables, in a folder, and in one number."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import xarray

from jaxmodel.base.atomic_files import write_whole

# The name of an analysis' files, and the digits of its tables: indices have sampling errors, derivatives have none.
FILES = {
    "local": ("sensitivity", "%.12g"),
    "interactions": ("interactions", "%.12g"),
    "uncertainty": ("uncertainty", "%.12g"),
    "global_indices": ("global", "%.8g"),
    "elasticity_map": ("elasticity-map", "%.12g"),
}


def tables(data: xarray.Dataset) -> dict[str, pd.DataFrame]:
    """Return the result of an analysis as tables without the readings over time, by the names of their files.

    Args:
        data: of any analysis of this package.

    Returns:
        "sensitivity": a line for each metric and parameter; "interactions": for each metric and pair; "uncertainty":
        for each metric; "global" and "global-pairs": for each metric and factor, or pair of factors; "elasticity-map":
        for each combination of the axes, metric and parameter.
    """
    analysis = data.attrs["analysis"]
    if analysis == "local":
        pairs = data.drop_dims(["output", "time_s"], errors="ignore")
        return {"sensitivity": pairs.to_dataframe(dim_order=["metric", "parameter"]).reset_index()}
    if analysis == "interactions":
        of_pairs = data.drop_vars([name for name, v in data.variables.items() if "parameter" in v.dims])
        table = of_pairs.to_dataframe(dim_order=["metric", "pair"]).reset_index("pair", drop=True).reset_index()
        return {"interactions": table}
    if analysis == "uncertainty":
        of_metrics = data.drop_dims(["output", "time_s", "parameter"], errors="ignore")
        table = of_metrics.drop_dims("quantile").to_dataframe()
        for q in data["quantile"].to_numpy():
            table[f"quantile_{q:g}"] = data["metric_quantile"].sel(quantile=q).to_numpy()
        return {"uncertainty": table.reset_index()}
    if analysis == "global_indices":
        of_factors = data.drop_dims(["blocks", "other", "parameter"], errors="ignore")
        found = {"global": of_factors.to_dataframe(dim_order=["metric", "factor"]).reset_index()}
        if "second" in data:
            second = data[["second", "second_error"]].to_dataframe(dim_order=["metric", "factor", "other"])
            found["global-pairs"] = second.dropna().reset_index()
        return found
    return {"elasticity-map": data.to_dataframe().reset_index()}


def save(data: xarray.Dataset, directory: str | Path) -> Path:
    """Write the result of an analysis to a folder: a Zarr store and CSV tables, in place of those of an earlier one.

    `xarray.open_zarr` reads the store back. An elasticity map is written as a store alone.

    Args:
        data: of any analysis of this package.
        directory: made where it does not exist.

    Returns:
        The path of the store.
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    name, digits = FILES[data.attrs["analysis"]]
    # Text of fixed width has no place in the Zarr format yet, text of any length has.
    texts = {key: (v.dims, v.to_numpy().astype(object)) for key, v in data.variables.items() if v.dtype.kind == "U"}
    store = directory / f"{name}.zarr"
    aside = directory / f".{name}.new"
    data.assign(texts).to_zarr(aside, mode="w", consolidated=False)
    shutil.rmtree(store, ignore_errors=True)
    os.replace(aside, store)  # there whole or not at all
    if name != "elasticity-map":
        for file, table in tables(data).items():
            write_whole(directory / f"{file}.csv", table.to_csv(index=False, float_format=digits))
    return store


def largest_elasticity(data: xarray.Dataset, metric: str) -> tuple[str, float]:
    """Return the parameter with the largest elasticity of a metric, and that elasticity; ('', nan) where there is none.

    Args:
        data: as `jaxmodel.sensitivity.local` returns it.
        metric: one of its metrics.
    """
    values = data["elasticity"].sel(metric=metric).to_numpy()
    if not np.isfinite(values).any():
        return "", float("nan")
    place = int(np.nanargmax(np.abs(values)))
    return str(data["parameter"].to_numpy()[place]), float(values[place])
