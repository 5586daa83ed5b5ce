"""The result of an analysis as tables, in a folder, and in one number."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import xarray

from jaxmodel.base.atomic_files import write_whole
from jaxmodel.base.errors import SweepError, listed

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

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> tables = sensitivity.tables(sensitivity.local(study, progress=False))
        >>> sorted(tables)
        ['sensitivity']
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

    `load` reads the store back. An elasticity map is written as a store alone.

    Args:
        data: of any analysis of this package.
        directory: made where it does not exist.

    Returns:
        The path of the store.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = sensitivity.save(sensitivity.local(study, progress=False), folder)
        ...     print(path.name, sensitivity.load(folder).attrs["analysis"])
        sensitivity.zarr local
    """
    directory = Path(directory)
    directory.mkdir(parents=True, exist_ok=True)
    name, digits = FILES[data.attrs["analysis"]]
    # Text of fixed width has no place in the Zarr format yet, text of any length has.
    texts = {
        key: (v.dims, v.to_numpy().astype(object), v.attrs) for key, v in data.variables.items() if v.dtype.kind == "U"
    }
    store = directory / f"{name}.zarr"
    aside = directory / f".{name}.new"
    data.assign(texts).to_zarr(aside, mode="w", consolidated=False)
    shutil.rmtree(store, ignore_errors=True)
    os.replace(aside, store)  # there whole or not at all
    if name != "elasticity-map":
        for file, table in tables(data).items():
            write_whole(directory / f"{file}.csv", table.to_csv(index=False, float_format=digits))
    return store


def load(directory: str | Path) -> xarray.Dataset:
    """Return the result of an analysis that `save` has written, read as far as it is used.

    Args:
        directory: the folder that it was written to, or the store in it where there is more than one.

    Raises:
        SweepError: there is no result, more than one, or one that is damaged.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> profile = {"duration_s": 600, "step_s": 60, "current_A": 2.0, "ambient_degC": 20.0}
        >>> axes = {"capacity_Ah": [2.5]}
        >>> study = sweeps.Study(kind="cell", profile=profile, metrics=["final_soc"], axes=axes)
        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = sensitivity.save(sensitivity.local(study, doubling=False, progress=False), folder)
        ...     print(sensitivity.load(folder).attrs["analysis"])
        local
    """
    directory = Path(directory)
    stores = [directory] if directory.suffix == ".zarr" else [directory / f"{name}.zarr" for name, _ in FILES.values()]
    found = [store for store in stores if store.is_dir()]
    if not found:
        raise SweepError(f"{directory} holds no result of a sensitivity; give the folder that it was written to.")
    if len(found) > 1:
        names = listed([store.name for store in found], len(found))
        raise SweepError(f"{directory} holds {names}; give the path of one of them.")
    try:
        data = xarray.open_zarr(found[0], consolidated=False, chunks=None)
        _ = FILES[data.attrs["analysis"]]
    except (ValueError, KeyError, TypeError, AttributeError, OSError) as error:
        raise SweepError(
            f"{found[0]}: its files are damaged ({type(error).__name__}); run the analysis again."
        ) from error
    texts = {key: v for key, v in data.variables.items() if v.dtype.kind in "OT"}
    return data.assign({key: (v.dims, np.array(v.to_numpy().tolist(), str), v.attrs) for key, v in texts.items()})


def largest_elasticity(data: xarray.Dataset, metric: str) -> tuple[str, float]:
    """Return the parameter with the largest elasticity of a metric, and that elasticity; ('', nan) where there is none.

    Args:
        data: as `jaxmodel.sensitivity.local` returns it.
        metric: one of its metrics.

    Example:
        >>> from jaxmodel import sensitivity, sweeps
        >>> study = sweeps.Study(
        ...     kind="cell",
        ...     profile={"duration_s": 60.0, "step_s": 10.0, "ambient_degC": 20.0},
        ...     axes={"current_A": [2.0]},
        ...     metrics=["final_soc"],
        ... )
        >>> sensitivity.largest_elasticity(sensitivity.local(study, doubling=False), "final_soc")[0]
        'initial_soc'
    """
    values = data["elasticity"].sel(metric=metric).to_numpy()
    if not np.isfinite(values).any():
        return "", float("nan")
    place = int(np.nanargmax(np.abs(values)))
    return str(data["parameter"].to_numpy()[place]), float(values[place])
